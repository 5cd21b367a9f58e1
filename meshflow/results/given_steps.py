"""The steps that the runs of a plan take, found once, so that each window of its data takes the same."""

from collections.abc import Iterator
from dataclasses import replace

from meshflow.errors import InputError
from meshflow.estimate.plan import Plan
from meshflow.flow.compute import Compute
from meshflow.flow.contract import Flow
from meshflow.flow.controls import FixedStep, GivenSteps, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.march import State, march
from meshflow.flow.steppers import Explicit, SuperTime, stepper_for
from meshflow.flow.stops import Course, Met, crossing
from meshflow.results.run import engine_of, hold_of, steered, stepping, until_of

__all__ = ["is_uniform", "with_given_steps"]


def with_given_steps(plan: Plan) -> tuple[Plan, tuple[int, ...]]:
    """The plan with the steps that its runs take, so that a window of its data takes the same; and the rates of each run.

    Explicit steps follow from the spacing alone. Where their length depends on the data, the runs are made for it.

    :raises InputError: for steps that every sample has a part in: implicit ones, and those whose bound depends on the data.
    """
    compute, rates, met = _given_steps(replace(plan, blend=()))
    parts, counts = [], [rates]
    for i, part in enumerate(plan.blend):
        own, rates = (compute, rates) if i == 0 else _given_steps(plan.only(part))[:2]
        parts.append(replace(part, compute=own))
        counts += [rates] * (i > 0)
    request = replace(plan.request, compute=compute, stops=() if met is None else (met,))
    return replace(plan, request=request, blend=tuple(parts)), tuple(counts)


def _given_steps(plan: Plan) -> tuple[Compute, int, Met | None]:
    """The computation of one run with the steps that it takes, the number of its rates, and where it meets a stop."""
    engine = engine_of(plan)
    flow = steered(engine, plan)
    stepper, control = stepping(flow, plan)
    until = until_of(plan)
    stepper = stepper_for(stepper or Explicit(), flow, until.time)
    if not is_uniform(engine):
        raise InputError(
            f"method={plan.method.word!r}: the length of its steps depends on all samples; take one with gamma "
            "of -1 or above (for several channels 0), and mass barycentric or ring"
        )
    if not isinstance(stepper, (Explicit, SuperTime)):
        raise InputError(f"stepper={stepper.name!r}: an implicit step needs all samples; take explicit or super-time")
    explicit, lengths, met = Explicit().largest(flow, flow.start()), [], None
    if until.stops and plan.idle is None:
        lengths, met = _until_met(
            march(flow, replace(until, stops=()), stepper, control, limit=hold_of(plan, flow)), until
        )
    elif isinstance(stepper, Explicit) and (control is None or isinstance(control, FixedStep)):
        dt, time = (control or FixedStep()).opened(flow, stepper, flow.start(), until).dt, 0.0
        while until.reason(time, len(lengths)) is None:
            lengths.append(min(dt, explicit, until.left(time)))
            time += lengths[-1]
    else:
        limit = hold_of(plan, flow)
        lengths = [state.dt for state in march(flow, until, stepper, control, recycle=True, limit=limit)][1:]
    given = GivenSteps(tuple(lengths)) if lengths else None
    unit = explicit * flow.pace
    rates = [stepper.count(dt, unit) if isinstance(stepper, SuperTime) else 1 for dt in lengths]
    return replace(plan.request.compute, stepper=stepper, dt=None, control=given), sum(rates), met


def _until_met(states: Iterator[State], until: Until) -> tuple[list[float], Met | None]:
    """The lengths of the steps to the one within which a stop is met, and where; None where no stop is met."""
    lengths, old = [], next(states)
    for new in states:
        lengths.append(new.dt)
        found = crossing(until.stops, Course(new.flow, until.scale), (old.u, old.time), (new.u, new.time))
        if found is not None:
            _, time, said, share = found
            return lengths, Met(new.time, share, time, said)
        old = new
    return lengths, None


def is_uniform(engine: Flow) -> bool:
    """Whether the steps of an engine do not depend on the data: then a window moves as the whole does."""
    return isinstance(engine, (GridFlow, VolumeFlow)) and engine.uniform
