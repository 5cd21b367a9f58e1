"""The end of a finite difference scheme whose time nobody gave: it may change the data by as much as the noise, and not more."""

from dataclasses import replace

from meshflow.estimate.plan import Decided, Plan
from meshflow.flow.march import State
from meshflow.flow.methods.beltrami import SchemeMethod
from meshflow.flow.stops import Residual

__all__ = ["held_back", "within_noise"]

WITHIN = Residual(1.0)
# Below this share of its own time a scheme that stopped was changing what is no noise.
EARLY = 0.5


def within_noise(plan: Plan) -> Plan:
    """The plan of a scheme with a stop where the change equals the noise, unless the caller says when it ends.

    Schemes have no estimated risk, and at a fixed time some of them (shock, min-max, low-curvature) change rough data by several
    times its noise.
    """
    request = plan.request
    if not isinstance(plan.method, SchemeMethod) or plan.idle is not None or request.asked or plan.noise.sigma <= 0:
        return plan
    why = f"{plan.decided['time'].why}, at most until the change equals the noise"
    found = replace(plan, request=replace(request, stops=(WITHIN,), time=plan.time))
    return found.with_({"time": Decided("default", why)})


def held_back(plan: Plan, end: State) -> tuple[str, ...]:
    """A warning about a scheme that changed the data by as much as the noise long before its own time."""
    if plan.request.stops != (WITHIN,) or plan.request.stops[0] is not WITHIN or end.time >= EARLY * plan.time:
        return ()
    share = f"{end.time / plan.time:.0%}"
    return (
        f"method {plan.method.word} was stopped at {share} of its time, where it had changed the data by as much as the noise: "
        "here it changes other things than noise; compare_methods shows others, time= goes further",
    )
