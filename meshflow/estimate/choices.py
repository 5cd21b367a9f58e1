"""Parts of a plan that are the same for grids, meshes and volumes: what the caller gives, and what a search has found."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Origin
from meshflow.estimate.plan import GIVEN, Decided, Part, Plan, size_of
from meshflow.estimate.request import Request
from meshflow.estimate.search_rounds import Found
from meshflow.flow.constraints import Limit
from meshflow.flow.family import Variant
from meshflow.flow.methods.beltrami import Beltrami, Heat, HeightMethod
from meshflow.flow.methods.searched import Search
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh

__all__ = [
    "HARM", "UNSURE", "begun", "beside", "channels_of", "chosen", "contrast_by_rule", "exponents_found", "filled",
    "limit_of_planes", "no_noise", "of_twicing", "ruled", "timed", "what_is_known",
]  # fmt: skip

HARM = "data left unchanged: every method was estimated to increase the error"
UNSURE = (
    "data left unchanged: no method lowers the estimated error by more than its uncertainty; name a method to smooth it "
    "anyway"
)


def begun(data: Data, request: Request, noise: Noise, mobility: Array | None) -> Plan:
    """A plan with the given options and the exponents of the paper for the others, before anything is chosen."""
    asked = request.heights
    method: HeightMethod = asked
    if isinstance(asked, Search):
        method = Beltrami(indicator=asked.indicator, mass=asked.mass)
    boundary = GIVEN if request.boundary else Decided("default", "weights of zero and above" if request.rim else "")
    origin: Origin = "given" if request.named else "default"
    decided = {name: Decided(origin) for name in ("method", "gamma", "sharpness", "patch")}
    lift = Lift(1.0, request.compute.diagonals, request.rim)
    return Plan(data, request, noise, method, lift, 0.0, {**decided, "boundary": boundary}, mobility=mobility)


def filled(request: Request, variant: Variant, contrast: float, twicing: float) -> HeightMethod:
    """The named method, or that of the found exponents, with its numbers."""
    asked = request.heights
    if request.named:
        return replace(asked, contrast=None if variant.linear else contrast, twicing=twicing)
    if variant.linear:
        return Heat(twicing=twicing, mass=asked.mass)
    return Beltrami(
        gamma=variant.gamma,
        sharpness=variant.sharpness,
        patch=variant.patch,
        contrast=contrast,
        twicing=twicing,
        indicator=asked.indicator,
        mass=asked.mass,
    )


def ruled(plan: Plan, contrast: float, how: Decided, much: float, words: str) -> Plan:
    """The plan with a contrast, the given time or the time by rule, and the given twicing.

    :param much: the time by rule, squared sample distances; ``words``: its description.
    """
    request = plan.request
    time, when = timed(request, much * plan.data.step**2, Decided("default", words))
    decided = {"contrast": how, "time": when, "twicing": of_twicing(request)}
    method = filled(request, plan.variant, contrast, float(request.twicing or 0.0))
    return plan.with_(decided, method=method, lift=replace(plan.lift, contrast=contrast), time=time)


def contrast_by_rule(plan: Plan, sigma: float, edge: float) -> tuple[float, Decided]:
    """The given contrast, or the one at which noise has so many sample distances, and its origin.

    :param sigma: in the unit of the values; ``edge``: sample distances over noise.
    """
    given = plan.request.heights.contrast
    if given is not None:
        return float(given), GIVEN
    if sigma > 0:
        return edge * plan.data.step / sigma, Decided("estimated", f"{edge:g} h / sigma")
    return 1.0, Decided("default", "no noise found")


def beside(noise: Noise, sigma: float) -> float:
    """The noise in differences of neighbours, which is smaller than sigma for correlated noise; the mean over all axes."""
    if noise.correlation is None:
        return sigma
    middle = np.array(noise.correlation.shape) // 2
    axes = [axis for axis in range(noise.correlation.ndim) if noise.correlation.shape[axis] > 1]
    next_to = sum(float(noise.correlation[tuple(middle + (np.arange(len(middle)) == axis))]) for axis in axes)
    return sigma * float(np.sqrt(max(1.0 - next_to / noise.correlation.ndim, 0.01)))


def limit_of_planes(limit: ArrayLike, data: Data, planes: Array) -> Array:
    """The largest change of every value of data, in the layout of its planes.

    :param limit: one number, or one for each sample or value, in the layout of the data.
    :param planes: (k, h, w), or (k, d, h, w) of a volume.
    """
    shape, n = size_of(data)
    columns = Limit.of(np.zeros((n, 1)), limit, shape).most
    return np.broadcast_to(columns, (n, len(planes))).T.reshape(planes.shape)


def timed(request: Request, found: float, how: Decided) -> tuple[float, Decided]:
    """The given time, or else the found one, and its origin."""
    given = request.until_time
    if given is None:
        return found, how
    return float(given), Decided("given", "" if request.scale is None else f"scale {request.scale:g}")


def of_twicing(request: Request) -> Decided:
    """The origin of the weight of twicing."""
    if request.compute.triangles == "clamped":
        return Decided("default", "it overshoots")
    return GIVEN if request.twicing is not None else Decided()


def chosen(plan: Plan, found: Found, sigma: float, many: bool) -> Plan:
    """The plan with the best candidate.

    :param many: whether several weights of twicing were tried.
    """
    request, best, candidates = plan.request, found.candidates[0].configuration, found.candidates
    where = "least estimated risk"
    contrast = GIVEN
    if request.heights.contrast is None:
        contrast = Decided("estimated", f"{best.contrast * sigma / plan.data.step:.3g} h / sigma, {where}")
    twicing = Decided("estimated") if many else of_twicing(request)
    time, when = timed(request, candidates[0].least[0] if found.better else 0.0, Decided("estimated", where))
    decided = {"contrast": contrast, "twicing": twicing, "time": when, **exponents_found(request)}
    idle = (HARM if isinstance(plan.data, Mesh) else UNSURE) if request.until_time is None and time == 0 else None
    method = filled(request, best.variant, best.contrast, best.twice)
    lift = replace(plan.lift, contrast=best.contrast)
    blend = tuple(
        Part(
            weight,
            filled(request, one.configuration.variant, one.configuration.contrast, one.configuration.twice),
            one.least[0],
        )
        for weight, one in zip(found.weights, candidates, strict=False)
        if weight > 0
    )
    if found.neumann:
        lift, decided["boundary"] = replace(lift, boundary="neumann"), Decided("estimated")
    return plan.with_(decided, method=method, lift=lift, time=time, candidates=candidates, blend=blend, idle=idle)


def exponents_found(request: Request) -> dict[str, Decided]:
    """The origins of the exponents of a search."""
    if request.named:
        return {}
    return {name: Decided("estimated") for name in ("method", "gamma", "sharpness", "patch")}


def no_noise(noise: Noise) -> str:
    """The reason why nothing is done where there is no noise."""
    nothing = "" if noise.how == "nothing" else "nothing to remove, "
    return f"{what_is_known(noise)}: {nothing}nothing was changed"


def what_is_known(noise: Noise) -> str:
    """What is known of the noise where there is none."""
    return "too few samples to tell noise from data" if noise.how == "nothing" else "no noise was found"


def channels_of(data: Data) -> int:
    """The number of values of a sample."""
    (shape, n) = size_of(data)
    return int(np.prod(shape)) // n
