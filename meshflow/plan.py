"""From words and data to what is run: what was given is held, what was not is estimated, and each says where it came from."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshflow.choice import (
    CHANNEL_FAMILY,
    EDGES,
    FAMILY,
    LOOKED_AT,
    MESH_ENOUGH,
    MESH_FAMILY,
    METHODS,
    TIMES,
    Search,
    candidates,
    searched_on_grid,
    searched_on_mesh,
)
from meshflow.flow.constraint import Limit, trust_of
from meshflow.flow.control import Until
from meshflow.flow.noise import Noise, noise_of, noise_on
from meshflow.flow.tune import TWICE, Trial
from meshflow.geometry.gates import Array, mask_of
from meshflow.geometry.lift import Lift, Mesh, Noun, RangeImage, data_of
from meshflow.geometry.member import Member
from meshflow.parameters import Origin, Parameter, contrast_unit, given_words, squared_unit, value_unit
from meshflow.settings import Settings

__all__ = ["Plan", "noise_in", "planned"]

# Times in squared sample distances where nobody names one, and nothing is searched for: 7.5 for the one member that suits most
# data, 5 for a member of the caller's (DESIGN.md, section 2); half a squared edge where the points of a mesh move, which smooths
# over one edge and shrinks little.
ONE_TIME, GRID_TIME, MESH_TIME = 7.5, 5.0, 0.5
ONE, ONE_EDGE = {"gamma": -1.0, "sharpness": 1.5}, 3.0
# Where rounding is the noise it is not independent of the data, and its risk cannot be estimated: one member again. Of widths 0
# to 3, contrasts 0.5 to 2 and times 1 to 60 it is within 1 % of the best for a Mars terrain in steps of 200 m, a fractal one in
# steps of 4 m and one in steps of 1 m.
ROUNDED, ROUNDED_EDGE, ROUNDED_TIME = {"patch": 1.0}, 1.0, 1.5
# Contrast in sample distances over noise for a member of the caller's, where nothing is searched for: without patch channels 1.5
# comes within 12 % of the best contrast and time on four of five scenes and 23 % on the fifth (tests/bench_show.py).
EDGE = 1.5
# Time at which a run ends that does not come to its stop, in squared sample distances.
PATIENT = 100.0
HELD = "no sample may move (only, fixed): nothing was changed"
# Times in which a fidelity pulls back after which a run is at rest.
AT_REST = 10.0


@dataclass(frozen=True, eq=False)
class Plan:
    """What is run.

    :ivar noise: what was found, or given; None for bare points.
    :ivar idle: why nothing is done; None where something is.
    :ivar trials: of the search, the chosen one first.
    :ivar twice: w of u(t) + w (u(t) - u(2 t)), t the time of ``until``.
    :ivar limit: what no coordinate leaves, made of the start of a flow.
    :ivar trust: of the fidelity, (n, k), (n, 1) or (1, 1), per time; None: none.
    """

    noun: Noun
    member: Member
    lift: Lift
    until: Until
    parameters: dict[str, Parameter]
    noise: Noise | None = None
    idle: str | None = None
    trials: tuple[Trial, ...] = ()
    twice: float = 0.0
    limit: Callable[[Array], Limit] | None = None
    trust: Array | None = None
    warnings: tuple[str, ...] = ()

    @property
    def unit(self) -> float:
        """Units of u for one of the caller's: the mesh engine counts channels times the contrast."""
        return self.lift.contrast if isinstance(self.noun, Mesh) and self.noun.moves == "channels" else 1.0

    @property
    def there(self) -> float:
        """The share of the samples that are there."""
        if isinstance(self.noun, Mesh):
            return 1.0
        assert self.noun.missing is not None
        return float(np.mean(~self.noun.missing))


def noise_in(noun: Noun, only: Array | None = None) -> Noise:
    """The noise of a noun, in the unit of its values; of bare points along their normals."""
    if isinstance(noun, Mesh):
        if noun.channels is None or noun.moves == "points":
            return noise_on(noun.points, noun.faces, noun.normals)
        return noise_on(noun.channels, noun.faces)
    assert noun.missing is not None
    values = data_of(noun)
    missing = noun.missing if only is None else noun.missing | ~only
    return noise_of(values, noun.missing if missing.all() else missing)


def planned(noun: Noun, settings: Settings) -> Plan:
    """What is run on a noun, as its caller wants it."""
    words, only = given_words(noun, settings), _mask(noun, settings)
    if only is not None:
        assert noun.fixed is not None
        noun = replace(noun, fixed=noun.fixed | ~only)
    noise = noise_in(noun, only)
    if settings.sigma is not None:
        noise = replace(noise, sigma=float(settings.sigma), how="given")
    shape, n = _free(noun)
    if settings.limit is not None:  # what makes no sense is refused now, not after the search
        Limit.of(np.zeros((n, 1)), settings.limit, shape)
    if settings.confidence is not None:
        trust_of(settings.confidence, shape, n, 1.0)
    bare = isinstance(noun, RangeImage) or (isinstance(noun, Mesh) and noun.moves != "channels")
    if _still(noun):  # nothing to search for
        plan = replace(_bare(noun, replace(settings, contrast=None), noise), idle=HELD)
    else:
        plan = _bare(noun, settings, noise) if bare else _tuned(noun, settings, noise)
    plan = _stopping(_held(plan, settings), settings)
    if plan.idle == HELD:
        words["time"] = Parameter(0.0, squared_unit(noun), "default", "nothing may move")
    return replace(plan, parameters={**plan.parameters, **words})


def _mask(noun: Noun, settings: Settings) -> Array | None:
    if settings.only is None:
        return None
    assert noun.fixed is not None
    return mask_of(settings.only, noun.fixed.shape, "only")


def _still(noun: Noun) -> bool:
    """Whether no sample may move."""
    assert noun.fixed is not None
    still = noun.fixed if isinstance(noun, Mesh) or noun.missing is None else noun.fixed | noun.missing
    return bool(still.all())


def _bare(noun: Noun, settings: Settings, noise: Noise) -> Plan:
    """Where points move: no search; contrast 1, or where channels move with them what suits their noise."""
    named = METHODS[settings.method][0] if settings.method else {}
    shrinks = isinstance(noun, Mesh)
    if settings.contrast is not None:
        contrast = Parameter(float(settings.contrast), contrast_unit(noun), "given")
    elif shrinks and noun.moves == "all" and noise.sigma > 0:
        contrast = Parameter(
            EDGE * noun.step / (noise.sigma * settings.strength),
            contrast_unit(noun),
            "estimated",
            f"{EDGE:g} h / sigma",
        )
    else:
        contrast = Parameter(1.0, contrast_unit(noun), "default", "lengths as they are")
    much, why = (MESH_TIME, "half a squared edge") if shrinks else (GRID_TIME, "5 squared pixel footprints")
    time = _given_time(noun, settings) or Parameter(much * noun.step**2, squared_unit(noun), "default", why)
    lift = Lift(float(contrast.value), settings.diagonals, settings.boundary)
    plan = Plan(noun, settings.member(**named), lift, Until(0.0), {}, noise)
    return _unsearched(plan, settings, time, contrast)


def _unsearched(plan: Plan, settings: Settings, time: Parameter, contrast: Parameter) -> Plan:
    """With twicing as it is given, and the parameters told."""
    twice = Parameter(float(settings.twice or 0.0), "", "default" if settings.twice is None else "given")
    plan = replace(plan, twice=float(twice.value))
    return _told(plan, settings, {"time": time, "contrast": contrast, "twice": twice}, "default")


def _tuned(noun: Noun, settings: Settings, noise: Noise) -> Plan:
    """Where values stand above a base: member, contrast and time from the least estimated risk, or without a search."""
    sigma = noise.sigma * settings.strength
    unit = noun.step / sigma if sigma > 0 else 0.0
    timed = _given_time(noun, settings)
    asked = timed is not None or settings.steps is not None or settings.confidence is not None or settings.stopping
    plan = Plan(noun, settings.member(), Lift(1.0, settings.diagonals, settings.boundary), Until(0.0), {}, noise)
    if sigma == 0 and not asked:
        plan = replace(plan, idle=_no_noise(noise))
        return _told(
            plan, settings, {"time": Parameter(0.0, squared_unit(noun), "default", "nothing to remove")}, "default"
        )
    large = isinstance(noun, Mesh) and len(noun.points) > MESH_ENOUGH
    # A member of the caller's exponents has a contrast by rule; one of a name, contrasts of its own to choose from.
    ruled = settings.named and (settings.method is None or settings.contrast is not None)
    known = timed is not None and (ruled or timed.value == 0)
    rounded = _rounded(noise)
    if settings.search and sigma > 0 and settings.steps is None and not (large or known or rounded):
        found = _searched(plan, settings, sigma, unit, timed)
        if found is not None:
            return found
    exponents, edge, much = ({}, EDGE, GRID_TIME) if settings.named else (ONE, ONE_EDGE, ONE_TIME)
    if settings.method:
        exponents, edges = METHODS[settings.method]
        edge = edges[(len(edges) - 1) // 2]
    if rounded and not settings.named:
        exponents, edge, much = ({} if isinstance(noun, Mesh) else ROUNDED), ROUNDED_EDGE, ROUNDED_TIME
    if settings.contrast is not None:
        contrast = Parameter(float(settings.contrast), contrast_unit(noun), "given")
    elif sigma > 0:
        contrast = Parameter(edge * unit, contrast_unit(noun), "estimated", f"{edge:g} h / sigma")
    else:
        contrast = Parameter(1.0, contrast_unit(noun), "default", "no noise found")
        plan = replace(plan, warnings=(f"{_no_noise(noise)}; contrast 1 is taken", *plan.warnings))
    time = timed or Parameter(much * noun.step**2, squared_unit(noun), "default", f"{much:g} h²")
    plan = replace(plan, member=settings.member(**exponents), lift=replace(plan.lift, contrast=float(contrast.value)))
    return _unsearched(plan, settings, time, contrast)


def _searched(plan: Plan, settings: Settings, sigma: float, unit: float, timed: Parameter | None) -> Plan | None:
    """The member, contrast and time of least estimated risk, of what the caller leaves open; None for a time too long to try."""
    noun, contrast = plan.noun, settings.contrast
    if settings.method:
        family = (METHODS[settings.method],)
    elif settings.named:
        given = {"gamma": settings.gamma, "sharpness": settings.sharpness, "patch": settings.patch}
        family = (({name: float(x) for name, x in given.items() if x is not None}, EDGES),)
    else:
        family = MESH_FAMILY if isinstance(noun, Mesh) else CHANNEL_FAMILY if data_of(noun).ndim == 3 else FAMILY
    made = candidates(family, unit, Member(indicator=settings.indicator, mass=settings.mass), contrast)
    h2 = noun.step**2
    end = None if timed is None else float(timed.value)
    alone = end is not None or settings.confidence is not None or settings.stopping
    twices = (float(settings.twice),) if settings.twice is not None else (0.0,) if alone else TWICE
    parts = (0.25, 0.5, 1.0, *((2.0,) if max(twices) > 0 else ()))
    longest = LOOKED_AT if isinstance(noun, Mesh) else np.inf
    times = tuple(t * h2 for t in TIMES if t <= longest) if end is None else tuple(end * part for part in parts)
    search = Search(made, times, contrast is None, sigma, end, twices)
    if isinstance(noun, Mesh):
        trials = searched_on_mesh(noun, plan.lift, search)
    else:
        limit, free = _limit_of(noun, settings, plan.noise)[0], settings.boundary is None
        lattice = noun.gridded(plan.lift)
        trials, found = searched_on_grid(lattice, search, limit, settings.threads, free)
        if found.boundary != lattice.boundary:
            plan = replace(plan, lift=replace(plan.lift, boundary=found.boundary))
    if not trials:
        return None
    best = trials[0]
    time = best.least[0]
    where = "least estimated risk"
    parameters = {
        "time": timed or Parameter(time, squared_unit(noun), "estimated", where),
        "contrast": Parameter(best.candidate.contrast, contrast_unit(noun), "given" if contrast is not None else "estimated",
                              "" if contrast is not None else f"{best.candidate.contrast / unit:.3g} h / sigma, {where}"),
        "risk": Parameter(best.risk, value_unit(noun), "estimated", "root mean square error to be expected"),
    }  # fmt: skip
    parameters["twice"] = Parameter(best.candidate.twice, "", "estimated" if len(twices) > 1 else
                                    "given" if settings.twice is not None else "default")  # fmt: skip
    plan = replace(plan, member=best.candidate.member, trials=trials, twice=best.candidate.twice,
                   lift=replace(plan.lift, contrast=best.candidate.contrast))  # fmt: skip
    if timed is None and time == 0:
        plan = replace(plan, idle="every member would do more harm than the noise that is there: nothing was changed")
    return _told(plan, settings, parameters, "default" if settings.named else "estimated")


def _no_noise(noise: Noise) -> str:
    if noise.how == "nothing":
        return "too few samples to tell noise from data: nothing was changed"
    return "no noise was found: nothing to remove, nothing was changed"


def _told(plan: Plan, settings: Settings, more: dict[str, Parameter], member: Origin) -> Plan:
    """With the parameters of the flow, and where each came from."""
    origins: dict[str, Origin] = {}
    for name in ("gamma", "sharpness", "patch"):
        origins[name] = "given" if settings.method or getattr(settings, name) is not None else member
    found = plan.lift.boundary is not None and settings.boundary is None
    boundary: Origin = "given" if settings.boundary else "estimated" if found else "default"
    assert plan.noise is not None
    how = {"given": "", "nothing": "too few samples"}.get(plan.noise.how, f"from {plan.noise.how}")
    parameters = {
        "sigma": Parameter(
            plan.noise.sigma, value_unit(plan.noun), "given" if plan.noise.how == "given" else "estimated", how
        ),
        "quantum": Parameter(plan.noise.quantum, value_unit(plan.noun), "estimated"),
        "strength": Parameter(settings.strength, "", "default" if settings.strength == 1.0 else "given"),
        "gamma": Parameter(plan.member.gamma, "", origins["gamma"]),
        "sharpness": Parameter(plan.member.sharpness, "", origins["sharpness"]),
        "patch": Parameter(plan.member.patch, "samples", origins["patch"]),
        "indicator": Parameter(settings.indicator),
        "mass": Parameter(settings.mass),
        "boundary": Parameter(plan.lift.boundary or plan.noun.boundary, "", boundary),
        **more,
    }
    if not isinstance(plan.noun, Mesh):
        parameters["diagonals"] = Parameter(settings.diagonals)
    return replace(plan, parameters=parameters)


def _given_time(noun: Noun, settings: Settings) -> Parameter | None:
    time = settings.until_time
    if time is None:
        return None
    why = "" if settings.scale is None else f"scale {settings.scale:g}"
    return Parameter(float(time), squared_unit(noun), "given", why)


def _limit_of(noun: Noun, settings: Settings, noise: Noise | None) -> tuple[Any, Origin]:
    """What no sample leaves, unit of the values, None for no limit, and where that came from."""
    if settings.limit is not None:
        return settings.limit, "given"
    if noise is None or isinstance(noun, Mesh):
        return None, "default"
    return (noise.quantum / 2.0, "estimated") if _rounded(noise) else (None, "default")


def _rounded(noise: Noise) -> bool:
    """Whether rounding is all the noise there is."""
    return 0 < noise.sigma <= 1.01 * noise.quantum / np.sqrt(12.0)


def _free(noun: Noun) -> tuple[tuple[int, ...], int]:
    """The shape of the coordinates that move, as the caller knows them, and how many samples they are of."""
    assert noun.fixed is not None
    shape = data_of(noun).shape
    if isinstance(noun, Mesh) and noun.moves == "all":
        shape = (shape[0], noun.points.shape[1] + shape[1])
    return shape, noun.fixed.size


def _held(plan: Plan, settings: Settings) -> Plan:
    """With its limit and its fidelity."""
    noun, parameters = plan.noun, dict(plan.parameters)
    limit, origin = _limit_of(noun, settings, plan.noise)
    shape, n = _free(noun)
    unit = plan.unit
    if limit is not None:
        most = float(limit) if np.ndim(limit) == 0 else "one per sample"
        why = "half the quantum, rounding is the noise" if origin == "estimated" else ""
        parameters["limit"] = Parameter(most, value_unit(noun), origin, why)
        plan = replace(plan, limit=lambda start: Limit.of(start, limit, shape, unit))
    if settings.confidence is not None:
        trust = trust_of(settings.confidence, shape, n, plan.lift.contrast)
        parameters["confidence"] = Parameter("weights", "", "given", "1 / squared value")
        if _given_time(noun, settings) is None and (trust > 0).any():
            rest = AT_REST / float(np.median(trust[trust > 0]))
            parameters["time"] = Parameter(rest, squared_unit(noun), "default", "at rest between smoothness and data")
        plan = replace(plan, trust=trust)
    return replace(plan, parameters=parameters)


def _stopping(plan: Plan, settings: Settings) -> Plan:
    """With when to stop."""
    noun, parameters = plan.noun, dict(plan.parameters)
    assert plan.noise is not None
    shape, n = _free(noun)
    k = int(np.prod(shape)) // n
    unit = plan.unit
    sigma = plan.noise.sigma * settings.strength * unit * (np.sqrt(k) if not _points(noun) else 1.0)

    def seen(u: Array) -> Array:
        """The values (h, w), (h, w, k) or (n, k) of u."""
        values = np.asarray(u / unit if unit != 1.0 else u).reshape(shape).view()
        values.flags.writeable = False
        return values

    stops = settings.stops(sigma, plan.there, unit, seen)
    time = float(parameters["time"].value)
    if stops and _given_time(noun, settings) is None:
        time = PATIENT * noun.step**2
        parameters["time"] = Parameter(time, squared_unit(noun), "default", "at most, where no stop is met")
    if settings.steps is not None:
        parameters["steps"] = Parameter(float(settings.steps), "", "given")
        until = Until(_given_time(noun, settings) and time, settings.steps, stops)
    else:
        until = Until(time, None, stops)
    return replace(plan, until=until, parameters=parameters)


def _points(noun: Noun) -> bool:
    return isinstance(noun, Mesh) and noun.moves != "channels"
