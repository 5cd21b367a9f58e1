"""Runs a plan in stretches: a part of its steps at a time, so that its state can be exchanged between windows of its data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import NotConverged
from meshflow.estimate.plan import Plan
from meshflow.flow.constraints import Hold
from meshflow.flow.contract import Flow
from meshflow.flow.workspace import Workspace
from meshflow.geometry.validation import Array
from meshflow.results.given_steps import Track
from meshflow.results.run import engine_of, hold_of, steered

__all__ = ["Held", "Seen", "Stretch", "advanced"]

# What a run holds between two stretches, (n, k) each, by name: "u", its state; "kept", that of twicing; of a blend "first", the
# end of its first run, and "total", the sum so far.
Held = Mapping[str, Array]


# Is told of a step: the flow, and its state (n, k) before and after.
Seen = Callable[[Flow, Array, Array], object]


@dataclass(frozen=True)
class Stretch:
    """Consecutive steps of one run of a plan, or passes of its second stage.

    :ivar number: of the run; the second stage comes after the last one.
    :ivar begin: the first step; ``end``: that after the last one.
    """

    number: int
    begin: int
    end: int


def _passes_of(plan: Plan) -> tuple[int, ...]:
    """How far each pass of the second stage of a grid reaches; empty without a second stage."""
    return () if plan.groups is None else plan.groups.reaches(plan.grid.missing.ndim)


def advanced(plan: Plan, tracks: Sequence[Track], stretch: Stretch, held: Held, seen: Seen | None = None) -> Held:
    """What a run holds after a stretch of it; the state is its end after the last one.

    :param plan: that is not idle; ``tracks``: its runs.
    :param held: after the stretch before; empty before the first one.
    :param seen: is told of every step.
    :raises NotConverged: where coordinates are no longer finite.
    """
    if stretch.number == len(tracks):
        return {"u": _passed(plan, stretch, held["u"])}
    alone = plan.only(plan.blend[stretch.number]) if stretch.number else replace(plan, blend=())
    flow = steered(engine_of(alone), alone)
    limit = hold_of(alone, flow)
    found = _stepped(flow, tracks[stretch.number], stretch, held, limit, seen)
    if stretch.end < len(tracks[stretch.number].lengths):
        return found
    return _ended(plan, stretch.number, len(tracks), found, limit)


def _stepped(flow: Flow, track: Track, stretch: Stretch, held: Held, limit: Hold | None, seen: Seen | None) -> Held:
    """What a run holds after some of its steps."""
    workspace, found = Workspace(flow), dict(held)
    begin = flow.start() if stretch.begin == 0 else held["u"].astype(flow.start().dtype, copy=False)
    u = begin
    for step in range(stretch.begin, stretch.end):
        new = track.stepper.step(flow, u, track.lengths[step], step, workspace)
        new = new if limit is None else limit.hold(new)
        if seen is not None:
            seen(flow, u, new)
        if step + 1 == len(track.lengths) and track.share < 1:
            new = u + np.asarray(track.share, u.dtype) * (new - u)
        if step + 1 == track.kept:
            found["kept"] = new.copy(order="K")
        if u is not begin:
            workspace.give(u)
        u = new
    if u is not begin and not np.isfinite(flow.size((1.0, u), (-1.0, begin), roughly=True)[0]):
        raise NotConverged(f"step {stretch.end}: the coordinates are no longer finite; take a smaller dt")
    return {**found, "u": u}


def _ended(plan: Plan, number: int, count: int, held: Held, limit: Hold | None) -> Held:
    """What a run holds after its last step.

    :param number: of the run, of ``count``.
    """
    u = held["u"]
    if "kept" in held:
        kept = held["kept"].astype(u.dtype, copy=False)
        twicing = (plan.only(plan.blend[number]) if number else plan).twicing
        u = kept + kept.dtype.type(twicing) * (kept - u)
        u = u if limit is None else limit.hold(u)
    if count == 1:
        return {"u": u}
    if number == 0:
        return {"first": u}
    first, total = held["first"].astype(u.dtype, copy=False), held.get("total", held["first"]).astype(u.dtype)
    total += u.dtype.type(plan.blend[number].weight) * (u - first)  # what stays keeps its bits
    return {"u": total} if number + 1 == count else {"first": first, "total": total}


def _passed(plan: Plan, stretch: Stretch, u: Array) -> Array:
    """The state after passes of the second stage; fixed samples do not change."""
    grid, groups = plan.grid, plan.groups
    if groups is None:
        return u
    planes = np.ascontiguousarray(grid.planes)
    pilot = np.ascontiguousarray(u.T).reshape(planes.shape).astype(planes.dtype)
    for number in range(stretch.begin, stretch.end):
        pilot = groups.passed(number, planes, pilot, grid.missing, plan.request.compute.threads)
    if stretch.end < len(_passes_of(plan)):
        return pilot.reshape(len(pilot), -1).T
    start = steered(engine_of(replace(plan, blend=())), plan).start()
    limit = plan.limit(start)
    made = pilot.reshape(len(pilot), -1).T.astype(start.dtype)
    stays = grid.fixed.ravel()
    made[stays] = start[stays]
    return made if limit is None else limit.hold(made)
