"""Depths of a pinhole smoothed as a height field of inverse depths over the pixels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter
from meshflow.estimate.plan import Plan
from meshflow.estimate.planner import noise_in
from meshflow.estimate.planner import plan_of_surface as planned
from meshflow.estimate.reported import parameters_of
from meshflow.estimate.request import Request
from meshflow.estimate.risk import Candidate
from meshflow.flow.methods.beltrami import Beltrami
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import Array
from meshflow.results.result import Result
from meshflow.results.run import carried_out
from meshflow.surfaces.disparity import from_disparity, has_disparity, in_disparity
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.range_image import RangeImage

__all__ = ["in_inverse_depths", "smoothed_in_disparity"]

# Patch and time, squared pixels, where depths are quantized: on the frames of a Kinect and simulated structured light
# (tests/bench_range_quality.py) within 4 % of the best of widths 0 to 2.5 and times 3 to 45.
STEPPED_PATCH, STEPPED_TIME = 2.0, 15.0
STEPPED = "quantized depths: the risk cannot be estimated where rounding is the noise"

# The parameters that are those of the depths themselves.
OF_DEPTHS = ("noise", "quantum", "max_change")

# Noise that is said for each pixel is even where the quantiles EVEN_PART of inverse depths differ by a factor of EVEN at most.
EVEN_PART, EVEN = (0.02, 0.98), 3.0


def smoothed_in_disparity(data: RangeImage, request: Request) -> bool:
    """Whether inverse depths are smoothed: where that is asked for, or where nothing is given that refers to lengths."""
    if request.domain != "auto":
        return request.domain == "disparity"
    free = request.constraints.data_weights is None and request.constraints.preserve is None
    plain = request.boundary is None and free and data.time_unit == "footprint"
    return has_disparity(data) and _is_left_open(request) and plain and _is_even(data)


def _is_even(data: RangeImage) -> bool:
    """Whether the noise of inverse depths is about the same everywhere, as far as the data says; else times along the rays, which
    follow the noise of each pixel, are better.
    """
    if not isinstance(data.sigma, np.ndarray) or data.missing.all():
        return True
    low, high = np.quantile((data.sigma / np.square(np.where(data.missing, 1.0, data.depth)))[~data.missing], EVEN_PART)
    return bool(high <= EVEN * low)


def in_inverse_depths(data: RangeImage, request: Request, progress: Progress, record: bool | None) -> Result:
    """Smooth the inverse depth as a height field over the pixels.

    The noise and the largest change are given in depths; noise, steps, limit, risks and what was removed are reported in depths.

    :raises InputError: where inverse depths are asked for: for a camera for which planes do not stay planes, and for inverse
        depths that end below zero.
    """
    chosen = request.domain == "auto"
    with request.compute.running():
        held = request.constraints
        small = Constraints(min_component=held.min_component, fixed=held.fixed, max_change=held.max_change)
        about = planned(data, Request(time=0.0, noise=request.noise, constraints=small))
        cleared, noise = about.data, about.noise
        if not isinstance(cleared, RangeImage):
            raise InputError(f"domain: only for range images, got {type(data).__name__}")
        if noise.sigma == 0 and chosen:
            return carried_out(planned(data, request), data, progress, record)
        squares = _squares(cleared)
        inverse = _with_noise(cleared, squares, data.sigma is not None or request.noise is not None)
        held = replace(held, min_component=None, max_change=_limit_of(cleared, about))
        free = replace(request, domain="auto", outliers="include", noise=None, constraints=held)
        stepped = _is_stepped(noise, request)
        if stepped:
            free = replace(free, method=Beltrami(patch=STEPPED_PATCH), time=STEPPED_TIME * request.strength)
        found = carried_out(planned(inverse, free), inverse, progress, record)
        if not isinstance(found.after, HeightField):
            raise InputError(f"domain: a height field of inverse depths expected, got {type(found.after).__name__}")
        if chosen and not (found.after.z > 0)[~cleared.missing].all():  # far depths may leave what is finite
            return carried_out(planned(data, request), data, progress, record)
    done = replace(from_disparity(cleared, found.after), fixed=data.fixed, sigma=data.sigma)
    parameters = _in_depths(_of_inverses(found.parameters, inverse.unit, stepped), about, squares.typical, data.unit)
    why = "planes stay planes in inverse depths" if chosen else ""
    parameters["domain"] = Parameter("disparity", "", "default" if chosen else "given", why)
    candidates = tuple(_of_depths(candidate, squares.typical**2) for candidate in found.candidates)
    warnings = about.warnings + found.warnings
    return replace(
        found, data=done, after=done, before=data, parameters=parameters, noise=noise, candidates=candidates,
        warnings=warnings, plan=None,
    )  # fmt: skip


def _limit_of(image: RangeImage, about: Plan) -> Array | None:
    """The largest change of each inverse depth (h, w) with which no depth z leaves z +- m; None without a limit m.

    1 / z may fall by m / (z (z + m)), and rise by more than that, m / (z (z - m)).

    :param about: the plan in depths, with m.
    """
    z = np.where(image.missing, 1.0, image.depth.astype(np.float64)).reshape(-1, 1)
    limit = about.limit(z)
    if limit is None:
        return None
    m = np.broadcast_to(limit.most, z.shape)
    most = np.divide(m, z + m, out=np.full(z.shape, np.inf), where=np.isfinite(m)) / z
    return most.reshape(image.depth.shape)


@dataclass(frozen=True, eq=False)
class _Squares:
    """Errors of depths over errors of their inverses.

    :ivar each: (h, w), 1 where missing; ``typical``: the median.
    """

    each: Array
    typical: float


def _squares(image: RangeImage) -> _Squares:
    """The squares of the depths."""
    each = np.square(np.where(image.missing, 1.0, image.depth.astype(np.float64)))
    return _Squares(each, float(np.median(each[~image.missing])) if not image.missing.all() else 1.0)


def _with_noise(cleared: RangeImage, squares: _Squares, given: bool) -> HeightField:
    """Inverse depths with the noise of each depth, unless their noise is correlated, which differences do not show."""
    inverse = in_disparity(cleared)
    if cleared.sigma is None or (not given and noise_in(inverse).correlation is not None):
        return inverse
    return replace(inverse, sigma=np.broadcast_to(cleared.sigma, squares.each.shape) / squares.each)


def _is_stepped(noise: Noise, request: Request) -> bool:
    """Whether rounding is the noise, so that no risk can be estimated, and the method is left open."""
    return noise.quantum > noise.sigma and _is_left_open(request)


def _is_left_open(request: Request) -> bool:
    """Whether the caller leaves method, end and search open."""
    return request.method is None and not request.timed and request.compute.search is None


def _of_inverses(parameters: Mapping[str, Parameter], inverse: str, stepped: bool) -> dict[str, Parameter]:
    """The parameters of a run on inverse depths, in units of pixels and of inverse depths.

    :param stepped: whether the depths are quantized.
    """
    units = {"time": "pixels²", "dt": "pixels²", "contrast": f"pixels per {inverse}"}
    reported = {name: replace(p, unit=units.get(name, p.unit)) for name, p in parameters.items()}
    if stepped:
        reported |= {name: replace(reported[name], origin="default", why=STEPPED) for name in ("patch", "time")}
        reported |= {name: replace(reported[name], origin="default") for name in ("method", "gamma", "sharpness")}
    return reported


def _in_depths(parameters: Mapping[str, Parameter], about: Plan, square: float, unit: str) -> dict[str, Parameter]:
    """The parameters of a run on inverse depths with noise, steps, limit and risk of depths.

    :param about: the plan in depths.
    :param square: of the median depth; ``unit``: of depths.
    """
    own = parameters_of(about)
    reported = {name: own[name] if name in OF_DEPTHS and name in own else p for name, p in parameters.items()}
    for name in ("risk", "max_change"):
        if name in parameters and reported[name] is parameters[name]:  # found in inverse depths
            p = parameters[name]
            reported[name] = replace(p, value=float(p.value) * square, unit=unit, why=f"{p.why}, at the median depth")
    return reported


def _of_depths(candidate: Candidate, growth: float) -> Candidate:
    """A candidate with its mean square errors of depths, at the median depth.

    :param growth: by what the mean square of an error grows.
    """
    squares = tuple(growth * square for square in candidate.squares)
    return replace(candidate, squares=squares, doubt=growth * candidate.doubt)
