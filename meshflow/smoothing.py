"""The front door: any supported thing in, the same kind of thing out."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.noise import noise_growth
from meshflow.estimate.parameters import Parameter, Plan
from meshflow.estimate.plan import noise_in, planned
from meshflow.estimate.settings import Settings
from meshflow.flow.conservation import Kept, free_of
from meshflow.flow.constraints import Both, Faithful, Hold
from meshflow.flow.contract import Flow
from meshflow.flow.controls import Control, Fixed, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped
from meshflow.flow.march import VANISHED, State, march
from meshflow.flow.mobility import slowed
from meshflow.flow.progress import Progress
from meshflow.flow.steppers import Explicit, SemiImplicit, Stepper, StepperName, stepper_for
from meshflow.geometry.validation import whole
from meshflow.io.adapters.multipart import multipart
from meshflow.io.files import Document
from meshflow.io.metadata import PER_SAMPLE, ReadOptions
from meshflow.io.objects import Adopted, opened, taken_in
from meshflow.results.multipart import Results, one_by_one
from meshflow.results.result import Moment, Result, release
from meshflow.surfaces.lift import HeightField, Mesh, Noun, RangeImage, from_disparity, in_disparity

__all__ = ["denoise", "flowing", "noise", "smooth", "smooth_document", "smooth_noun"]

# What a thing may be told about itself (meshflow.io.objects).
HINTS = frozenset(ReadOptions.__dataclass_fields__)
# Where depths come in steps, their inverses move by this much: within 5 % of the best patch and time on the frames of a Kinect.
STEPPED_PATCH, STEPPED_TIME = 1.0, 15.0
# Samples without a triangle that are worth a word: more than so many, and more than this share.
ALONE, ALONE_SHARE = 10, 1e-3


def noise(noun: Noun) -> dict[str, float]:
    """What a thing says of its own noise, in the unit of its values: standard deviation and quantum; of bare points along their
    normals; of depths also how it grows, sigma = a + b z + c z^2.
    """
    found = noise_in(noun)
    facts = {"noise": found.sigma, "quantum": found.quantum}
    if found.quantum > 0:
        facts["on the quantum"] = found.share
    if len(found.channels) > 1:
        facts |= {f"noise of channel {i}": sigma for i, sigma in enumerate(found.channels)}
    if isinstance(noun, RangeImage):
        growth = noise_growth(noun.depth, noun.missing)
        if growth is not None:
            facts |= {"noise a": growth.a, "noise b (per depth)": growth.b, "noise c (per depth²)": growth.c}
    return facts


def smooth_noun(noun: Noun, settings: Settings, progress: Progress = None, *, record: bool | None = True) -> Result:
    """Smooth a noun of ``meshflow.surfaces.lift``; a new one comes back, with what was done and why.

    :param record: measure the surface after each step; where false ``moments`` holds the start and the end, and where None
        nothing: for callers who want what comes back and no more, nor is a warning looked for.
    """
    if settings.space == "disparity" and isinstance(noun, RangeImage):
        return _in_disparity(noun, settings, progress, record)
    plan = planned(noun, settings)
    engine = _engine(plan, settings)
    flow = _steered(engine, plan)
    start, end, moments = _run(flow, plan, settings, progress, record)
    done, warnings = plan.noun, plan.warnings
    if plan.idle is None:
        done = plan.noun.lowered(end.u)
        warnings += (end.reason,) if end.reason is not None and VANISHED in end.reason else ()
    if isinstance(engine, GridFlow):
        warnings += _alone(engine, plan) if record is not None else ()
    done = replace(
        done, fixed=noun.fixed, **({"sigma": noun.sigma, "pace": noun.pace} if isinstance(noun, RangeImage) else {})
    )
    return Result(
        thing=done,
        noun=done,
        before=noun,
        start=start,
        end=end,
        parameters=plan.parameters,
        noise=plan.noise,
        trials=plan.trials,
        moments=moments,
        reason=end.reason or "",
        warnings=warnings,
        version=release(),
    )


def _in_disparity(noun: RangeImage, settings: Settings, progress: Progress, record: bool | None) -> Result:
    """The graph of the inverse depth, smoothed as a height field over the pixels."""
    plan = planned(noun, Settings(islands=settings.islands, steps=0))
    cleared, noise = plan.noun, plan.noise
    assert isinstance(cleared, RangeImage)
    assert noise is not None
    there = ~cleared.missing
    squares = np.square(cleared.depth[there].astype(np.float64))  # what a depth is off, times its inverse squared
    if settings.sigma is not None:
        noise = replace(noise, sigma=settings.sigma * float(np.median(squares)), how="given")
    elif noun.sigma is not None:
        settings = replace(settings, sigma=float(np.median(np.broadcast_to(noun.sigma, there.shape)[there] / squares)))
    rule = "depths in steps: the error of rounding is no noise whose risk could be estimated"
    free = not settings.named and settings.until_time is None and settings.steps is None and settings.search is None
    stepped = free and noise.quantum > noise.sigma
    if stepped:
        settings = replace(settings, patch=STEPPED_PATCH, time=STEPPED_TIME, search=False)
    found = smooth_noun(in_disparity(cleared), replace(settings, space="length", islands=None), progress, record=record)
    assert isinstance(found.noun, HeightField)
    done = replace(from_disparity(cleared, found.noun), fixed=noun.fixed, sigma=noun.sigma)
    inverse = in_disparity(cleared).unit
    units = {"time": "pixels²", "dt": "pixels²", "contrast": f"pixels per {inverse}"}
    told = {name: replace(p, unit=units.get(name, p.unit)) for name, p in found.parameters.items()}
    told["space"] = Parameter("disparity", "", "given")
    if stepped:
        told |= {name: replace(told[name], origin="default", why=rule) for name in ("patch", "time")}
        told.pop("search", None)
    # What was removed is told in depths, and so is the noise beside it; the parameters are those of the inverse depth.
    return replace(found, thing=done, noun=done, before=noun, parameters=told, noise=noise)


def _alone(engine: GridFlow, plan: Plan) -> tuple[str, ...]:
    """A word on samples that have no triangle, where they are more than a few."""
    if plan.idle is not None or not (isinstance(plan.noun, RangeImage) or engine.lattice.missing.any()):
        return ()
    lone, size = engine.lattice.lone, int((~engine.lattice.missing).sum())
    if lone <= max(ALONE, ALONE_SHARE * size):
        return ()
    cut = ", cut off by jumps or by what is missing" if isinstance(plan.noun, RangeImage) else ""
    return (f"{lone} of {size} samples have no triangle{cut}: they stay as they are",)


def _engine(plan: Plan, settings: Settings) -> Flow:
    """What moves the noun."""
    if isinstance(plan.noun, Mesh):
        surface = plan.noun.lifted(plan.lift)
        if plan.motion is not None:
            return plan.motion.engine(surface, plan.member)
        return MeshFlow(surface, plan.member, Clamped() if settings.triangles == "clamped" else None)
    return GridFlow(plan.noun.gridded(plan.lift), plan.member, settings.threads)


def _steered(engine: Flow, plan: Plan) -> Flow:
    """The engine with the speeds and the fidelity of a plan."""
    flow = slowed(engine, plan.speed)
    return flow if plan.trust is None else Faithful(flow, plan.trust)


def _run(
    flow: Flow, plan: Plan, settings: Settings, progress: Progress, record: bool | None
) -> tuple[State, State, tuple[Moment, ...]]:
    """From the start to the end; the first state, the last, and what was measured."""
    begin = State(flow, flow.start(), reason=plan.idle)
    if plan.idle is not None:
        return begin, begin, () if record is None else (_moment(begin, plan),)
    until, time, kept = plan.until, plan.until.time, None
    if plan.twice > 0:
        assert time is not None
        until = replace(until, time=2.0 * time, marks=(time,))
    stepper, control = _stepping(flow, plan, settings)
    limit = _held(plan, flow)
    moments, state = [], begin
    for state in march(flow, until, stepper, control, progress, recycle=True, limit=limit):
        if record or (record is not None and state.step == 0):
            moments.append(_moment(state, plan))
        if plan.twice > 0 and kept is None and time is not None and state.time >= time * (1.0 - 1e-12):
            kept = state.u.copy(order="K")
    end = state
    if kept is not None and time is not None:
        u = kept + kept.dtype.type(plan.twice) * (kept - end.u)
        u = u if limit is None else limit.hold(u)
        words = f"reached time {time:.6g}, and twice that for twicing, in {end.step} step{'' if end.step == 1 else 's'}"
        end = State(flow, u, time, 0.0, end.step, words, end.stepper)
    if end.step > 0 and record is not None and (kept is not None or not record):
        moments.append(_moment(end, plan))
    return begin, end, tuple(moments)


def _stepping(flow: Flow, plan: Plan, settings: Settings) -> tuple[Any, Control | None]:
    """How time is stepped, and what controls the steps."""
    time = plan.until.time
    control: Control | None = settings.control or (None if settings.dt is None else Fixed(settings.dt))
    stepper: Any = _stepper(flow, plan, settings)
    if plan.motion is not None and isinstance(plan.noun, Mesh):
        stepper = plan.motion.stepper(stepper, flow, time, plan.noun.faces)
        control = Fixed(time) if plan.motion.once and control is None and time else control
    return stepper, control


def flowing(noun: Noun, settings: Settings, count: int, progress: Progress = None) -> Iterator[tuple[float, Noun]]:
    """States of a noun on its way, and the times of each: the start, the end, and others between them.

    Times grow with the square, so that the widths of the Gaussians that they equal on flat data grow evenly. It is the flow
    itself: without the twicing that :func:`smooth_noun` may end in.

    :param count: how many states, two or more; fewer come where the run has fewer steps.
    :raises InputError: as :func:`smooth_noun`, for a count below two, and for flows of inverse depth.
    """
    if whole(count, "count", 2) and settings.space == "disparity":
        raise InputError("space='disparity': only lengths are shown on their way; leave it out")
    plan = planned(noun, settings)
    engine = _engine(plan, settings)
    flow = _steered(engine, plan)
    yield 0.0, plan.noun
    until, time = plan.until, plan.until.time
    if plan.idle is not None or time == 0.0:
        return
    shares = [(k / (count - 1)) ** 2 for k in range(1, count)]
    stepper, control = _stepping(flow, plan, settings)
    limit = _held(plan, flow)
    if until.stops:  # when they will be met is known afterwards
        *_, end = march(flow, until, stepper, control, progress, recycle=True, limit=limit)
        until, time = Until(time=end.time), end.time
    if plan.motion is not None and plan.motion.once and time is not None:  # each state is one step from the start
        for mark in (share * time for share in shares):
            *_, state = march(flow, Until(time=mark), stepper, Fixed(mark), limit=limit)
            yield state.time, plan.noun.lowered(state.u)
        return
    marks = () if time is None else tuple(share * time for share in shares)
    steps = frozenset() if until.steps is None else {round(share * until.steps) for share in shares}
    for state in march(flow, replace(until, marks=marks), stepper, control, progress, limit=limit):
        met = any(abs(state.time - mark) <= 1e-9 * mark for mark in marks) or state.step in steps
        if state.step > 0 and (met or state.reason is not None):
            yield state.time, plan.noun.lowered(state.u)


def _stepper(flow: Flow, plan: Plan, settings: Settings) -> Stepper | StepperName:
    """The stepper that is asked for, or the one that keeps a range: super-time steps would overshoot."""
    free = plan.motion is None or not plan.motion.once
    if settings.triangles != "clamped" or settings.stepper != "auto" or not free:
        return settings.stepper
    suits = "semi-implicit" if plan.motion is not None else stepper_for("auto", flow, plan.until.time)
    return suits if isinstance(suits, Explicit) else SemiImplicit()


def _held(plan: Plan, flow: Flow) -> Hold | None:
    """What every step is held to."""
    limit = None if plan.limit is None else plan.limit(flow.start())
    if plan.keep is None or not isinstance(plan.noun, Mesh):
        return limit
    free = free_of(plan.noun.faces, plan.noun.fixed, plan.speed, rim=plan.lift.boundary == "fixed")
    kept = Kept(plan.keep, plan.noun.faces, flow.start(), free)
    return kept if limit is None else Both(kept, limit)


def _moment(state: State, plan: Plan) -> Moment:
    """A state in numbers."""
    flow = state.flow
    change, largest = (0.0, 0.0) if state.step == 0 else flow.size((1.0, state.u), (-1.0, flow.start()))
    return Moment(state.time, state.dt, state.area, float(change / np.sqrt(plan.there)), largest)


def smooth(
    thing: Any,
    *,
    time: float | None = None,
    scale: float | None = None,
    steps: int | None = None,
    method: str | None = None,
    gamma: float | None = None,
    strength: float = 1.0,
    full: bool = False,
    progress: Progress = None,
    settings: dict[str, Any] | None = None,
    **more: Any,
) -> Any:
    """Smooth anything that lives on a triangulated surface; the same kind of thing comes back, a new one.

    With nothing else given the noise is estimated, and the member of the family and the time are those of least estimated risk;
    of range images, and where the points of a mesh move, a fixed time. What is given is held.

    :param thing: numpy array (h, w): a height field, (h, w, k): an image of k channels, masked arrays and NaN as missing;
        ``(points, faces)``: a mesh; ``trimesh.Trimesh``, ``pyvista`` PolyData, ImageData, StructuredGrid, ``open3d`` triangle
        meshes, ``meshio.Mesh``, ``xarray.DataArray``; a ``trimesh.Scene`` or ``pyvista.MultiBlock``, each of its parts as if it
        were alone; a noun of meshflow. Files: what :func:`meshflow.read` gives, or the command ``meshflow smooth``.
    :param time: how far, in squared length; by default searched for, for meshes half a squared mean edge.
    :param scale: instead of ``time``, the standard deviation of the equal Gaussian on flat data, a length.
    :param steps: the number of steps; then nothing is searched for.
    :param method: a member of the family by name: ``beltrami | graph | mean-curvature | total-variation | perona-malik |
        geman-mcclure | heat | patches``.
    :param gamma: instead, the exponent of the edge indicator. 0: Beltrami flow; above: edges kept more; -1, -2: mean curvature
        diffusion, graph flow.
    :param strength: more or less of it: the noise times this is what is removed.
    :param full: return a :class:`Result`, or :class:`Results` of several parts, as :func:`denoise` does.
    :param progress: None, True (a bar on stderr) or a callable ``(done, total)``.
    :param settings: further fields of :class:`Settings` by name, also accepted as keywords: ``sharpness, patch, contrast,
        twice``; ``residual, area_loss, displacement, stop``; ``limit, confidence, only, speed, islands, space``;
        ``sigma, search``; ``indicator, mass, boundary, diagonals, stepper, dt, control, threads``.
        ``only``, ``speed``, ``confidence``, ``limit`` and the hint ``fixed`` hold one number per sample, as the thing stores
        its samples; or the name of an array that the thing itself holds (point data, vertex attributes).
    :param more: those, and what the thing itself does not say: ``kind`` (``terrain | image | depth | mesh``), ``spacing``,
        ``camera``, ``missing``, ``fixed``, ``channels``, ``moves``.
    :returns: the same kind of thing, smoothed; integers come back as floating point, since rounding would undo the smoothing.
    :raises InputError: for what cannot be smoothed or an option that does not exist; the message says what to do.
    :raises NotConverged: when a solver fails.
    """
    words = {"time": time, "scale": scale, "steps": steps, "method": method, "gamma": gamma, "strength": strength}
    known, fixed = _words({**(settings or {}), **words}, more)
    thing, options = opened(thing, ReadOptions.of(more))
    parts = multipart(thing, options)
    if parts is not None:
        found = one_by_one(parts, known, fixed, lambda part: _smoothed(part, known, fixed, progress, full or None))
        return found if full else found.thing
    adopted = taken_in(thing, options)
    found = _smoothed(adopted, known, fixed, progress, full or None)
    back = adopted.to_object(found.noun)
    return replace(found, thing=back, warnings=(*adopted.notes, *found.warnings)) if full else back


def _words(known: dict[str, Any], more: dict[str, Any]) -> tuple[dict[str, Any], str | None]:
    """The words of :class:`Settings`, those among ``more`` too, which keeps the hints; and ``fixed`` where it is a name.

    :raises InputError: for a word that nobody knows.
    """
    known |= {name: more.pop(name) for name in list(more) if name in Settings.__dataclass_fields__}
    unknown = set(known) - set(Settings.__dataclass_fields__)
    if unknown:
        raise InputError(
            f"{', '.join(sorted(unknown))}: no such option; there are {', '.join(Settings.__dataclass_fields__)}"
        )
    strange = set(more) - HINTS
    if strange:
        options = ", ".join((*Settings.__dataclass_fields__, *sorted(HINTS)))
        raise InputError(f"{', '.join(sorted(strange))}: no such option; there are {options}")
    return known, more.pop("fixed") if isinstance(more.get("fixed"), str) else None


def _smoothed(
    adopted: Adopted, known: dict[str, Any], fixed: str | None, progress: Progress, record: bool | None
) -> Result:
    """An adopted thing, with the words of a caller.

    :param fixed: the name of an array in the thing.
    :param record: as of :func:`smooth_noun`.
    """
    noun = adopted.noun if fixed is None else replace(adopted.noun, fixed=adopted.samples(fixed, "fixed"))
    return smooth_noun(noun, Settings(**_sampled(known, adopted)), progress, record=record)


def smooth_document(
    document: Document, words: dict[str, Any], progress: Progress = None, *, record: bool = True
) -> tuple[Document, Result | Results]:
    """What a file held, smoothed: its one thing, or each of its meshes as if it were alone.

    :param words: fields of :class:`Settings` by name; numbers per sample as arrays of the noun.
    :param record: as of :func:`smooth_noun`.
    """
    parts = multipart(document, ReadOptions())
    if parts is None:
        result = smooth_noun(document.noun, Settings(**words), progress, record=record)
        return document.holding(result.noun), result
    results = one_by_one(parts, words, None, lambda part: _smoothed(part, words, None, progress, record))
    return results.thing, results


def _sampled(known: dict[str, Any], adopted: Adopted) -> dict[str, Any]:
    """The words of a caller, those of one number per sample as the noun has its samples."""
    given = {word: known[word] for word in PER_SAMPLE if known.get(word) is not None}
    steps = isinstance(known.get("limit"), str) and known["limit"] == "step"
    return {
        **known,
        **{word: adopted.samples(it, word) for word, it in given.items() if not (steps and word == "limit")},
    }


def denoise(thing: Any, **options: Any) -> Any:
    """:func:`smooth`, told in full: the smoothed thing, what was estimated, each parameter with its unit and origin, the run, why
    it ended, and what was removed.

    :returns: a :class:`Result`; of several parts :class:`Results`, one for each by its name.
    """
    return smooth(thing, full=True, **options)
