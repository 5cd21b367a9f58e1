"""The steps that the runs of a plan take, found once, so that each window of its data takes the same."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from meshflow.errors import InputError
from meshflow.estimate.plan import Plan
from meshflow.flow.contract import Flow
from meshflow.flow.controls import FixedStep, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.march import State, march
from meshflow.flow.steppers import Explicit, Stepper, SuperTime, stepper_for
from meshflow.flow.stops import Course, Met, crossing
from meshflow.results.run import engine_of, hold_of, steered, stepping, until_of

__all__ = ["Found", "Track", "is_uniform", "kept_after", "tracks_of"]


@dataclass(frozen=True)
class Track:
    """The steps of one run of a plan.

    :ivar stepper: takes them.
    :ivar lengths: of the steps, squared lengths.
    :ivar rates: how many rates each step takes.
    :ivar kept: the number of steps after which the state is kept for twicing; 0: it is not.
    :ivar share: of the last step, at which the run ends by a stop.
    """

    stepper: Stepper
    lengths: tuple[float, ...]
    rates: tuple[int, ...]
    kept: int = 0
    share: float = 1.0

    def until(self, count: int, share: float) -> "Track":
        """The steps to a share of the last one of so many."""
        return replace(self, lengths=self.lengths[:count], rates=self.rates[:count], share=share)


@dataclass(frozen=True)
class Found:
    """The steps of the runs of a plan.

    :ivar tracks: of its run, or of all its runs that are blended.
    :ivar met: where the first one meets a stop; None: there is none, or it is not met.
    :ivar longer: the steps of the first one beyond that; None without a stop.
    :ivar unsteady: whether their lengths follow from all samples, of which the plan knows a part.
    """

    tracks: tuple[Track, ...]
    met: Met | None = None
    longer: Track | None = None
    unsteady: bool = False


def tracks_of(plan: Plan, beyond: float | None = None) -> Found:
    """The steps of the run of a plan, or of all its runs that are blended, and where the first one meets a stop.

    Explicit steps follow from the spacing alone. Where their length depends on the data, the runs are made for it.

    :param beyond: the steps are continued to so many times the time at which the stop is met; None: the data is the whole.
    :raises InputError: for implicit steps; where the bound of steps depends on the data, for others than explicit ones.
    """
    first = _track_of(replace(plan, blend=()), beyond)
    return replace(
        first, tracks=(*first.tracks, *(_track_of(plan.only(part), None).tracks[0] for part in plan.blend[1:]))
    )


def _track_of(plan: Plan, beyond: float | None) -> Found:
    """The steps of one run, and where it meets a stop."""
    engine = engine_of(plan)
    flow = steered(engine, plan)
    stepper, control = stepping(flow, plan)
    until = until_of(plan)
    stepper = stepper_for(stepper or Explicit(), flow, until.time)
    uniform, unsteady = is_uniform(engine), False
    if not uniform and beyond is not None:
        _must_be_found(plan, engine)
        unsteady = plan.idle is None
    if not isinstance(stepper, (Explicit, SuperTime)):
        raise InputError(f"stepper={stepper.name!r}: an implicit step needs all samples; take explicit or super-time")
    explicit, lengths, met, count = Explicit().largest(flow, flow.start()), [], None, None
    if unsteady:
        lengths = [explicit]  # a guess; those of all samples are found by all windows
    elif until.stops and plan.idle is None:
        states = march(flow, replace(until, stops=()), stepper, control, limit=hold_of(plan, flow))
        lengths, met, count = _until_met(states, until, beyond or 1.0)
    elif uniform and isinstance(stepper, Explicit) and (control is None or isinstance(control, FixedStep)):
        dt, time = (control or FixedStep()).opened(flow, stepper, flow.start(), until).dt, 0.0
        while until.reason(time, len(lengths)) is None:
            lengths.append(min(dt, explicit, until.left(time)))
            time += lengths[-1]
    else:
        limit = hold_of(plan, flow)
        lengths = [state.dt for state in march(flow, until, stepper, control, recycle=True, limit=limit)][1:]
    unit = explicit * flow.pace
    rates = [stepper.count(dt, unit) if isinstance(stepper, SuperTime) else 1 for dt in lengths]
    longer = Track(stepper, tuple(lengths), tuple(rates), kept_after(plan, lengths))
    track = longer if count is None else longer.until(count, 1.0 if met is None else met.share)
    return Found((track,), met, longer if until.stops and plan.idle is None else None, unsteady)


def _must_be_found(plan: Plan, engine: Flow) -> None:
    """Refuse steps whose lengths are not found on all samples: others than explicit ones, and those to a stop.

    :raises InputError: it says what helps.
    """
    word = f"method={plan.method.word!r}: the length of its steps depends on all samples"
    if not isinstance(engine, GridFlow):
        raise InputError(f"{word}; take one with gamma of -1 or above (for several channels 0)")
    if plan.request.compute.stepper not in ("explicit", Explicit()):
        raise InputError(
            f"{word}; take stepper='explicit', or gamma of -1 or above (for several channels 0) and mass barycentric or ring"
        )
    if plan.request.stops:
        raise InputError(f"{word}, and so does where it stops; give a time")


def kept_after(plan: Plan, lengths: Sequence[float]) -> int:
    """The number of steps to the time of a plan with twicing; 0 without."""
    time, end = 0.0, plan.until.time
    for number, dt in enumerate(lengths, 1):
        time += dt
        if plan.twicing > 0 and end is not None and time >= end * (1.0 - 1e-12):
            return number
    return 0


def _until_met(states: Iterator[State], until: Until, beyond: float) -> tuple[list[float], Met | None, int | None]:
    """The lengths of the steps to a multiple of the time at which a stop is met, where that is, and the number of steps to it."""
    lengths, old, met, count = [], next(states), None, None
    for new in states:
        if met is not None and old.time >= beyond * met.time:
            break
        lengths.append(new.dt)
        if met is None:
            found = crossing(until.stops, Course(new.flow, until.scale), (old.u, old.time), (new.u, new.time))
            if found is not None:
                _, time, said, share = found
                met, count = Met(share, time, said), len(lengths)
        old = new
    return lengths, met, count


def is_uniform(engine: Flow) -> bool:
    """Whether the steps of an engine do not depend on the data: then a window moves as the whole does."""
    return isinstance(engine, (GridFlow, VolumeFlow)) and engine.uniform
