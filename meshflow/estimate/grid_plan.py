"""Member, contrast and time: as given, by rule, or of least estimated risk; each says where it came from."""

from dataclasses import replace
from typing import Any

import numpy as np

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import (
    Origin,
    Parameter,
    Plan,
    contrast_unit,
    expected_error,
    squared_unit,
    value_unit,
)
from meshflow.estimate.risk import TWICE, Candidate, Trial
from meshflow.estimate.search import (
    CHANNEL_FAMILY,
    EDGES,
    FAMILY,
    LOOKED_AT,
    MESH_ENOUGH,
    MESH_FAMILY,
    METHODS,
    RAY_FAMILY,
    TIMES,
    Search,
    candidates,
    searched_on_grid,
    searched_on_mesh,
)
from meshflow.estimate.settings import Settings
from meshflow.flow.controls import Until
from meshflow.flow.methods.beltrami import Member
from meshflow.geometry.validation import Array
from meshflow.surfaces.lift import Lift, Mesh, Noun, RangeImage, data_of

__all__ = ["HARM", "along_rays", "bare", "given_time", "is_rounded", "limit_of", "no_noise", "tuned"]

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
# Time along rays, in squared sample distances for each sigma / h: between 0.02 and 2.4 sigma / h the best time of the ray flow on
# panels, a ball and a box is 10 to 12 times that, for noise that grows with the depth and noise that does not.
# So much noise is no noise of a camera: no more than RAY_MOST.
RAY_TIME, RAY_MOST = 10.0, 100.0
HARM = "every member would do more harm than the noise that is there: nothing was changed"


def bare(noun: Noun, settings: Settings, noise: Noise) -> Plan:
    """Where the points of a mesh move: no search; contrast 1, or where channels move with them what suits their noise."""
    named = METHODS[settings.method][0] if settings.method else {}
    if settings.contrast is not None:
        contrast = Parameter(float(settings.contrast), contrast_unit(noun), "given")
    elif isinstance(noun, Mesh) and noun.moves == "all" and noise.sigma > 0:
        contrast = Parameter(
            EDGE * noun.step / (noise.sigma * settings.strength),
            contrast_unit(noun),
            "estimated",
            f"{EDGE:g} h / sigma",
        )
    else:
        contrast = Parameter(1.0, contrast_unit(noun), "default", "lengths as they are")
    time = given_time(noun, settings)
    time = time or Parameter(MESH_TIME * noun.step**2, squared_unit(noun), "default", "half a squared edge")
    lift = Lift(float(contrast.value), settings.diagonals, settings.rim)
    plan = Plan(noun, settings.member(**named), lift, Until(0.0), {}, noise)
    return _unsearched(plan, settings, time, contrast)


def _unsearched(plan: Plan, settings: Settings, time: Parameter, contrast: Parameter) -> Plan:
    """With twicing as it is given, and the parameters told."""
    twice = Parameter(float(settings.twice or 0.0), "", "default" if settings.twice is None else "given")
    plan = replace(plan, twice=float(twice.value))
    return _told(plan, settings, {"time": time, "contrast": contrast, "twice": twice}, "default")


def tuned(noun: Noun, settings: Settings, noise: Noise, speed: Array | None = None) -> Plan:
    """Where values stand above a base: member, contrast and time from the least estimated risk, or without a search.

    :param speed: (n, 1), of each sample.
    """
    sigma = noise.sigma * settings.strength
    unit = noun.step / sigma if sigma > 0 else 0.0
    timed = given_time(noun, settings)
    asked = timed is not None or settings.steps is not None or settings.confidence is not None or settings.stopping
    plan = Plan(
        noun, settings.member(), Lift(1.0, settings.diagonals, settings.rim), Until(0.0), {}, noise, speed=speed
    )
    if sigma == 0 and not asked:
        plan = replace(plan, idle=no_noise(noise))
        return _told(
            plan, settings, {"time": Parameter(0.0, squared_unit(noun), "default", "nothing to remove")}, "default"
        )
    large = isinstance(noun, Mesh) and len(noun.points) > MESH_ENOUGH
    # A member of the caller's exponents has a contrast by rule; one of a name, contrasts of its own to choose from.
    ruled = settings.named and (settings.method is None or settings.contrast is not None)
    known = timed is not None and (ruled or timed.value == 0)
    rounded = is_rounded(noise)
    if settings.search is not False and sigma > 0 and settings.steps is None and not (large or known or rounded):
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
        plan = replace(plan, warnings=(f"{no_noise(noise)}; contrast 1 is taken", *plan.warnings))
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
    search = Search(made, times, contrast is None, sigma, end, twices, plan.speed)
    if isinstance(noun, Mesh):
        trials = searched_on_mesh(noun, plan.lift, search)
    else:
        limit, free = limit_of(noun, settings, plan.noise)[0], settings.boundary is None
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
        "risk": expected_error(best, value_unit(noun)),
    }  # fmt: skip
    parameters["twice"] = Parameter(best.candidate.twice, "", "estimated" if len(twices) > 1 else
                                    "given" if settings.twice is not None else "default")  # fmt: skip
    plan = replace(plan, member=best.candidate.member, trials=trials, twice=best.candidate.twice,
                   lift=replace(plan.lift, contrast=best.candidate.contrast))  # fmt: skip
    if timed is None and time == 0:
        plan = replace(plan, idle=HARM)
    return _told(plan, settings, parameters, "default" if settings.named else "estimated")


def along_rays(noun: RangeImage, settings: Settings, noise: Noise, why: str, speed: Array | None = None) -> Plan:
    """Of a range image with its noise: gamma 0 and a time by rule, or with a search both of least estimated risk.

    :param why: how the noise grows, in words.
    :param speed: (n, 1), of each sample.
    """
    lift = Lift(1.0 if settings.contrast is None else settings.contrast, settings.diagonals, settings.rim)
    named = METHODS[settings.method][0] if settings.method else {}
    plan = Plan(noun, settings.member(**named), lift, Until(0.0), {}, noise, speed=speed)
    told = {
        "contrast": Parameter(
            lift.contrast, "", "default" if settings.contrast is None else "given", "lengths as they are"
        )
    }
    timed, footprint = given_time(noun, settings), noun.footprint
    if noise.sigma == 0 or noun.sigma is None:
        asked = timed is not None or settings.steps is not None or settings.confidence is not None or settings.stopping
        time = timed or Parameter(0.0, squared_unit(noun), "default", "no noise was found")
        plan = plan if asked else replace(plan, idle=no_noise(noise))
        return _told(plan, settings, {**told, "time": time}, "default")
    there = ~noun.missing & (footprint > 0)
    sigma = np.broadcast_to(noun.sigma, there.shape) * settings.strength
    told["sigma"] = Parameter(noise.sigma, value_unit(noun), "given" if noise.how == "given" else "estimated", why)
    if settings.search and settings.steps is None:
        return _searched_along(plan, settings, np.where(there, sigma, noise.sigma), told, timed)
    ratio, width = sigma[there] / footprint[there], footprint[there] if noun.pace == "length" else 1.0
    much, most = RAY_TIME * float(np.median(ratio * width**2)), RAY_MOST * noun.step**2
    if much > most and timed is None:
        words = f"noise of {float(np.median(ratio)):.3g} pixel widths: time is held at {RAY_MOST:g} squared footprints"
        plan = replace(
            plan, warnings=(*plan.warnings, f"{words}; are all depths in one unit, and the camera in pixels?")
        )
    time = timed or Parameter(min(much, most), squared_unit(noun), "estimated", f"{RAY_TIME:g} sigma / h")
    own = noise.how == "given" and np.ndim(noun.sigma) > 0 and noun.pace == "footprint"
    if own and timed is None and settings.steps is None and not settings.stopping:
        plan = replace(plan, noun=replace(noun, pace="noise"))
        told["pace"] = Parameter("noise", "", "estimated", "in proportion to sigma / h of each sample")
    twice = Parameter(float(settings.twice or 0.0), "", "default" if settings.twice is None else "given")
    return _told(replace(plan, twice=float(twice.value)), settings, {"time": time, **told, "twice": twice}, "default")


def _searched_along(
    plan: Plan, settings: Settings, sigma: np.ndarray, told: dict[str, Parameter], timed: Parameter | None
) -> Plan:
    """With gamma and time of least estimated risk.

    :param sigma: (h, w), a number everywhere.
    """
    noun, end = plan.noun, None if timed is None else float(timed.value)
    assert isinstance(noun, RangeImage)
    exponents = ({},) if settings.named else RAY_FAMILY
    made = tuple(Candidate(replace(plan.member, **part), 1.0) for part in exponents)
    times = tuple(t * noun.step**2 for t in TIMES) if end is None else (end / 4, end / 2, end)
    twices = (0.0,) if settings.twice is None else (float(settings.twice),)
    search = Search(made, times, False, sigma, end, twices, plan.speed)
    trials: tuple[Trial, ...] = searched_on_grid(noun.gridded(plan.lift), search, None, settings.threads)[0]
    best = trials[0]
    told |= {
        "time": timed or Parameter(best.least[0], squared_unit(noun), "estimated", "least estimated risk"),
        "risk": expected_error(best, value_unit(noun)),
        "twice": Parameter(twices[0], "", "default" if settings.twice is None else "given"),
    }
    plan = replace(plan, member=best.candidate.member, trials=trials, twice=twices[0])
    if timed is None and best.least[0] == 0:
        plan = replace(plan, idle=HARM)
    return _told(plan, settings, told, "default" if settings.named else "estimated")


def no_noise(noise: Noise) -> str:
    """Why nothing is done where there is nothing to remove."""
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


def given_time(noun: Noun, settings: Settings) -> Parameter | None:
    """The time that the caller gives."""
    time = settings.until_time
    if time is None:
        return None
    why = "" if settings.scale is None else f"scale {settings.scale:g}"
    return Parameter(float(time), squared_unit(noun), "given", why)


def limit_of(noun: Noun, settings: Settings, noise: Noise | None) -> tuple[Any, Origin]:
    """What no sample leaves, unit of the values, None for no limit, and where that came from."""
    if settings.limit is not None:
        return settings.limit, "given"
    if noise is None or isinstance(noun, (Mesh, RangeImage)):
        return None, "default"
    return (noise.quantum / 2.0, "estimated") if is_rounded(noise) else (None, "default")


def is_rounded(noise: Noise) -> bool:
    """Whether rounding is all the noise there is."""
    return 0 < noise.sigma <= 1.01 * noise.quantum / np.sqrt(12.0)
