"""Runs a plan: engine, wrappers, stepper, stops; returns the result, or the states of the flow."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.plan import Plan
from meshflow.estimate.planning import plan as planned
from meshflow.estimate.planning import plan_of_flow
from meshflow.estimate.reported import parameters_of
from meshflow.estimate.request import Request
from meshflow.estimate.schemes import held_back
from meshflow.flow.conservation import Kept, free_of
from meshflow.flow.constraints import Both, Faithful, Hold
from meshflow.flow.contract import Flow
from meshflow.flow.controls import Control, FixedStep, GrowingStep, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped
from meshflow.flow.engines.tetrahedra import TetFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.march import State, march
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.methods.between_voxels import BetweenVoxels
from meshflow.flow.methods.normal_filter import NormalFilterFlow
from meshflow.flow.methods.points import PointMethod
from meshflow.flow.methods.principal import PrincipalFlow
from meshflow.flow.mobility import slowed
from meshflow.flow.offsets import without_offsets
from meshflow.flow.patch_groups import PatchGroups
from meshflow.flow.progress import Progress
from meshflow.flow.round_parts import with_round_parts
from meshflow.flow.steppers import Explicit, SemiImplicit, Stepper, StepperName, SuperTime, stepper_for
from meshflow.geometry.crossings import moved_less, moved_without_harm
from meshflow.geometry.once import unwritten
from meshflow.geometry.validation import Array, whole
from meshflow.results.afterwards import of_area, of_excess, of_lag, of_lone_samples
from meshflow.results.result import History, Result, release
from meshflow.results.unlike_parts import groups_of, one_by_one
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.joined import Gridded, columns_around, cut_back, period_of, unrolled
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume, WholeVolume

__all__ = ["carried_out", "end_of", "engine_of", "hold_of", "run", "states", "steered", "stepping", "until_of"]

# The share of the elapsed time of a step within which a stop is met by linear interpolation.
WITHIN = 0.1


def run(data: Data, request: Request, progress: Progress = None, *, record: bool | None = True) -> Result:
    """Smooth a data object as requested; returns a new data object in a result.

    :param record: True: measure the surface after each step. False: the history holds the start and the end. None: it is empty.
    :raises InputError: for data that cannot be smoothed, or options that do not suit the data.
    :raises NotConverged: when a solver or a run fails.
    """
    with request.compute.running(), unwritten():
        if isinstance(data, Mesh) and (groups := groups_of(data, request)):
            return one_by_one(data, groups, lambda part: carried_out(planned(part, request), part, progress, record))
        if isinstance(data, (Mesh, TetMesh, Volume)) or not period_of(data):
            return carried_out(planned(data, request), data, progress, record)
        wide, asked, margin = _around(data, request)
        found = carried_out(planned(wide, asked), wide, progress, record)
        done = cut_back(data, found.after, margin)
        return replace(found, data=done, after=done, before=data)


def _around(data: Gridded, request: Request) -> tuple[Gridded, Request, int]:
    """A grid whose rows end where they begin, unrolled; the request for it; and the columns before its first one."""
    columns, margin = columns_around(data)
    held = request.constraints.of_columns(columns, array_of(data).shape)
    return unrolled(data, columns), replace(request, constraints=held), margin


def carried_out(plan: Plan, data: Data, progress: Progress, record: bool | None) -> Result:
    """The result of a plan for data; with the threads of the caller (``Compute.running``)."""
    engine = engine_of(plan)
    start, end, history = _run(steered(engine, plan), plan, progress, record)
    end = end if record else replace(end, before=None)  # an array as large as the data, for who looks at its steps
    if plan.blend and plan.idle is None:
        end = _blended(plan, end)
        history = History.joined((history, _measured(end, plan))) if record is not None else history
    if plan.groups is not None and plan.idle is None:
        end = _grouped(end, plan, plan.groups)
        history = History.joined((history, _measured(end, plan))) if record is not None else history
    if plan.recentred and plan.idle is None:
        end = _recentred(end, plan, engine)
        history = History.joined((history, _measured(end, plan))) if record is not None else history
    done, warnings = plan.result(None if plan.idle is not None else end.u), plan.warnings
    if plan.idle is None:
        warnings += of_area(done, plan, start, end)
        done, held = _without_harm(data, done, plan, end.flow)
        warnings += held
        warnings += held_back(plan, end) + of_lag(plan, end) + of_excess(data, done, plan)
    if isinstance(engine, GridFlow):
        warnings += of_lone_samples(engine, plan)
    done = replace(done, fixed=data.fixed)
    if isinstance(done, Mesh) and isinstance(data, Mesh):
        done = replace(done, faces=data.faces)
    if isinstance(done, RangeImage) and isinstance(data, RangeImage):
        done = replace(done, sigma=data.sigma, time_unit=data.time_unit)
    return Result(
        data=done,
        after=done,
        before=data,
        start=start,
        end=end,
        parameters=parameters_of(plan),
        noise=plan.noise.oriented(plan.orientation.inverse),
        candidates=plan.candidates,
        history=history,
        stopped_because=end.reason or "",
        warnings=warnings,
        version=release(),
        plan=plan,
    )


def end_of(plan: Plan) -> State:
    """The last state of a plan that is not idle: its run, or the blend of its runs, and the second stage; nothing is measured."""
    end = _run(steered(engine_of(plan), plan), plan, None, None)[1]
    end = _blended(plan, end) if plan.blend else end
    return end if plan.groups is None else _grouped(end, plan, plan.groups)


def until_of(plan: Plan) -> Until:
    """The end of a run: for twicing at twice its time, with a step that ends at the time."""
    until = plan.until
    if plan.twicing > 0 and until.time is not None:
        return replace(until, time=2.0 * until.time, marks=(until.time,))
    return until


def states(data: Data, request: Request, count: int, progress: Progress = None) -> Iterator[tuple[float, Data]]:
    """Times and states of a flow: the start, the end, and states between them.

    Times grow quadratically, so that the widths of the Gaussians that they equal on flat data grow linearly. The states are those
    of the flow itself, without the twicing and the second stage that :func:`run` may
    apply at the end.

    :param count: the number of states, two or more; fewer are returned where the run has fewer steps.
    :raises InputError: as :func:`run`, and for a count below two or inverse depths.
    """
    whole(count, "count", 2)
    if request.domain not in ("auto", "length", "stabilized", "magnitudes"):
        raise InputError(f"domain={request.domain!r}: states can be shown for domain='length' only; leave it out")
    if not isinstance(data, (Mesh, TetMesh, Volume)) and period_of(data):
        wide, asked, margin = _around(data, request)
        for time, state in states(wide, asked, count, progress):
            yield time, cut_back(data, state, margin)
        return
    on_the_way = _states(data, request, count, progress)
    while True:
        with request.compute.running():  # not while the caller has a state
            state = next(on_the_way, None)
        if state is None:
            return
        yield state


def _states(data: Data, request: Request, count: int, progress: Progress) -> Iterator[tuple[float, Data]]:
    """:func:`states`, once what was asked for is known to make sense."""
    plan = plan_of_flow(data, request)
    engine = engine_of(plan)
    flow = steered(engine, plan)
    yield 0.0, plan.result()
    until = plan.until
    time = until.time
    if plan.idle is not None or time == 0.0:
        return
    shares = [(k / (count - 1)) ** 2 for k in range(1, count)]
    stepper, control = stepping(flow, plan)
    limit = hold_of(plan, flow)
    if until.stops:  # the time at which they are met is known only after a run
        *_, end = march(flow, until, stepper, control, progress, recycle=True, limit=limit)
        until, time = Until(time=end.time), end.time
    if (
        isinstance(plan.method, (HeightMethod, PointMethod)) and plan.method.once and time is not None
    ):  # each state is reached in one step from the start
        for mark in (share * time for share in shares):
            *_, state = march(flow, Until(time=mark), stepper, FixedStep(mark), limit=limit)
            yield state.time, plan.result(state.u)
        return
    marks = () if time is None else tuple(share * time for share in shares)
    steps = frozenset() if until.steps is None else {round(share * until.steps) for share in shares}
    for state in march(flow, replace(until, marks=marks), stepper, control, progress, limit=limit):
        met = any(abs(state.time - mark) <= 1e-9 * mark for mark in marks) or state.step in steps
        if state.step > 0 and (met or state.reason is not None):
            yield state.time, plan.result(state.u)


def engine_of(plan: Plan) -> Flow:
    """The engine that moves the data."""
    if isinstance(plan.data, Volume):
        whole = plan.whole if isinstance(plan.whole, WholeVolume) else None
        return VolumeFlow(
            replace(plan.data.gridded(plan.lift), whole=whole), plan.variant, plan.request.compute.threads
        )
    if isinstance(plan.data, TetMesh):
        return TetFlow(plan.data, plan.lift, plan.variant, plan.request.compute.threads)
    if not isinstance(plan.data, Mesh):
        whole = plan.whole if isinstance(plan.whole, Whole) else None
        grid = replace(plan.above.gridded(plan.lift), whole=whole)
        threads = plan.request.compute.threads
        if isinstance(plan.method, HeightMethod):
            return plan.method.on_grid(grid, threads)
        return GridFlow(grid, plan.variant, threads)
    surface = plan.data.lifted(plan.lift)
    if plan.points is not None and plan.setting is not None:
        return plan.points.engine(surface, plan.setting)
    clamped = plan.request.compute.triangles == "clamped"
    if isinstance(plan.method, HeightMethod):
        return plan.method.on_surface(surface, clamped)
    return MeshFlow(surface, plan.variant, Clamped() if clamped else None)


def steered(engine: Flow, plan: Plan) -> Flow:
    """The engine with the mobility and the data weights of a plan."""
    flow = slowed(engine, plan.mobility)
    return flow if plan.pull is None else Faithful(flow, plan.pull, plan.most_pull)


def _without_harm(data: Data, done: Data, plan: Plan, flow: Flow) -> tuple[Data, tuple[str, ...]]:
    """The result of a search on a mesh, or against steps of voxels, without new folds and crossings, within the constraints of
    the caller, and a sentence if points move less for that.
    """
    chosen = plan.candidates or isinstance(plan.method, BetweenVoxels)  # nothing is searched for there
    if not isinstance(done, Mesh) or not isinstance(data, Mesh) or not chosen or done.moves != "points":
        return done, ()
    before = plan.data.points if isinstance(plan.data, Mesh) else data.points  # without spikes, which do not come back
    points, less = moved_without_harm(before, done.points, done.faces, _free(plan, done) == 0)
    given = plan.request.constraints
    asked = given.max_change is not None or given.preserve is not None
    if less and asked and (hold := hold_of(replace(plan, recentred=False), flow)) is not None:
        points = hold.hold(points.copy())
    elif less and (limit := plan.hold(flow.start())) is not None:
        points = moved_less(before, points, limit.hold(points.copy()), done.faces)
    other = float(np.abs(points - done.points).max(initial=0.0))
    said = (
        f"{less} of {len(points)} points were moved differently from the method, by at most {other:.3g}, to avoid folds and "
        "crossings of the surface"
    )
    return replace(done, points=points), (said,) if less else ()


def _run(flow: Flow, plan: Plan, progress: Progress, record: bool | None) -> tuple[State, State, History]:
    """Run from start to end; returns the first state, the last state, and the history."""
    begin = State(flow, flow.start(), reason=plan.idle)
    if plan.idle is not None:
        return begin, begin, History.joined(() if record is None else (_measured(begin, plan),))
    until, kept = until_of(plan), None
    time, twicing = plan.until.time, plan.twicing
    stepper, control = stepping(flow, plan)
    limit = hold_of(plan, flow)
    measured, state = [], begin
    for state in march(flow, until, stepper, control, progress, recycle=True, limit=limit):
        if record or (record is not None and state.step == 0):
            measured.append(_measured(state, plan))
        if twicing > 0 and kept is None and time is not None and state.time >= time * (1.0 - 1e-12):
            kept = state.u.copy(order="K")
    end = state
    if kept is not None and time is not None:
        u = kept + kept.dtype.type(twicing) * (kept - end.u)
        u = u if limit is None else limit.hold(u)
        words = f"reached time {time:.6g} (and {2.0 * time:.6g} for twicing) in {end.step} step{'' if end.step == 1 else 's'}"
        end = State(flow, u, time, 0.0, end.step, words, end.stepper)
    if end.step > 0 and record is not None and (kept is not None or not record):
        measured.append(_measured(end, plan))
    return begin, end, History.joined(measured)


def _blended(plan: Plan, first: State) -> State:
    """The ends of all the runs of a blend with their weights; the first one is there."""
    u = first.u.copy(order="K")
    for part in plan.blend[1:]:
        alone = plan.only(part)
        flow = steered(engine_of(alone), alone)
        u += u.dtype.type(part.weight) * (_run(flow, alone, None, None)[1].u - first.u)  # what stays keeps its bits
    words = f"{first.reason}; blended with {len(plan.blend) - 1} more"
    return replace(first, u=u, reason=words)


def _grouped(end: State, plan: Plan, groups: PatchGroups) -> State:
    """The end of a run after the second stage; fixed samples do not change."""
    grid, limit = plan.grid, plan.hold(end.flow.start())
    first = np.ascontiguousarray(end.u.T).reshape(grid.planes.shape).astype(grid.planes.dtype)
    planes = groups.filtered(np.ascontiguousarray(grid.planes), first, grid.missing, plan.request.compute.threads)
    planes[:, grid.fixed] = first[:, grid.fixed]
    u = planes.reshape(len(planes), -1).T.astype(end.u.dtype)
    u = u if limit is None else limit.hold(u)
    return replace(end, u=u, dt=0.0, reason=f"{end.reason}; then groups of similar patches")


def _recentred(end: State, plan: Plan, engine: Flow) -> State:
    """The end of a run on a mesh without mean offsets from its data, its round parts from a shorter run if the plan has one,
    within the largest change.

    :param engine: of the run.
    """
    if not isinstance(plan.data, Mesh):
        return end
    data, start, limit = plan.data, end.flow.start(), plan.hold(end.flow.start())
    u = without_offsets(end.u, data.points, data.faces, _free(plan, data) == 0)
    if plan.of_round_parts is not None and isinstance(engine, NormalFilterFlow):
        method, time = plan.of_round_parts
        short = next(method.states(engine.of(method), start, (time,)))
        u = with_round_parts(u, short, start, data.faces, plan.noise.sigma)
    return replace(end, u=u if limit is None else limit.hold(u), dt=0.0)


def stepping(flow: Flow, plan: Plan) -> tuple[Stepper | StepperName, Control | None]:
    """The stepper, and the control of its steps."""
    compute, time = plan.request.compute, plan.until.time
    control: Control | None = compute.control or (None if compute.dt is None else FixedStep(compute.dt))
    stepper = _stepper(flow, plan)
    if plan.points is not None and isinstance(plan.data, Mesh):
        stepper = plan.points.stepper(stepper, flow, time, plan.data.faces)
        control = plan.points.control(control, time)
        if isinstance(plan.points, PrincipalFlow):
            points, faces, mobility = plan.data.points, plan.data.faces, _free(plan, plan.data)
            stepper = plan.points.begun(stepper_for(stepper, flow, time), points, faces, mobility)
    if isinstance(plan.method, HeightMethod):
        stepper, control = plan.method.stepper(stepper), plan.method.control(control)
        control = FixedStep(plan.time) if plan.method.once and control is None and plan.time else control
        if stepper == "auto" and control is None and time is not None and plan.method.variant.linear:
            return _of_linear(flow, plan.until)
    return stepper, control


def _of_linear(flow: Flow, until: Until) -> tuple[Stepper, Control | None]:
    """Steps that do not depend on the data, so that the result is linear in it; shorter ones where a stop is met within one."""
    if isinstance(stepper_for("auto", flow, until.time), SemiImplicit):
        return SemiImplicit(), None
    control = GrowingStep(WITHIN) if until.stops else GrowingStep()
    return SuperTime(order=2), control


def _stepper(flow: Flow, plan: Plan) -> Stepper | StepperName:
    """The requested stepper; with clamped triangles one that keeps values in range, since super-time steps would overshoot."""
    compute = plan.request.compute
    once = plan.points is not None and plan.points.once
    if compute.triangles != "clamped" or compute.stepper != "auto" or once:
        return compute.stepper
    suits = "semi-implicit" if plan.points is not None else stepper_for("auto", flow, plan.until.time)
    return suits if isinstance(suits, Explicit) else SemiImplicit()


def hold_of(plan: Plan, flow: Flow) -> Hold | None:
    """The constraint that holds after every step; the largest change only at the end where mean offsets are removed first."""
    limit = None if plan.recentred else plan.hold(flow.start())
    if plan.preserve is None or not isinstance(plan.data, Mesh):
        return limit
    kept = Kept(plan.preserve, plan.data.faces, flow.start(), _free(plan, plan.data))
    return kept if limit is None else Both(kept, limit)


def _free(plan: Plan, data: Mesh) -> Array:
    """The mobility (n,) of each point of a mesh, from 0 (fixed) to 1."""
    return free_of(data.faces, data.fixed, plan.mobility, rim=plan.lift.boundary == "fixed")


def _measured(state: State, plan: Plan) -> History:
    """The history of one state."""
    flow = state.flow
    change, largest = (0.0, 0.0)
    if state.step > 0:
        change, largest = flow.size((1.0, state.u), (-1.0, flow.start()))
    numbers = state.time, state.dt, state.area, change / np.sqrt(plan.there), largest
    return History(*(np.array([number], np.float64) for number in numbers))
