"""Plans for values above a base, and for depths along rays: method, contrast and time as given, by rule, or by search."""

from dataclasses import replace
from typing import Any

import numpy as np

from meshflow.estimate.base_surface import base_of
from meshflow.estimate.choices import (
    HARM,
    UNSURE,
    begun,
    beside,
    channels_of,
    chosen,
    contrast_by_rule,
    exponents_found,
    filled,
    limit_of_planes,
    no_noise,
    of_twicing,
    ruled,
    timed,
    what_is_known,
)
from meshflow.estimate.families import CHANNEL_FAMILY, FAMILY, MESH_FAMILY, RAY_FAMILY, Family, configurations
from meshflow.estimate.grid_search import searched_on_grid
from meshflow.estimate.mesh_search import LOOKED_AT, TIMES, MeshSearch, searched_on_mesh
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Origin
from meshflow.estimate.plan import GIVEN, Decided, Plan
from meshflow.estimate.request import Request
from meshflow.estimate.risk import TWICE, Configuration
from meshflow.estimate.search_rounds import Found, GridSearch
from meshflow.estimate.variational import at_rest
from meshflow.flow.family import Variant
from meshflow.flow.methods.searched import Search
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, array_of, on_surface
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh

__all__ = ["HARM", "along_rays", "as_they_are", "by_rule", "limit_of", "no_noise", "tuned"]

# Default times without a search, in squared sample distances: 7.5 for the one variant that suits most data, 5 for a variant of
# the caller (DESIGN.md, section 2); half a squared edge where the points of a mesh move, which smooths over one edge and
# shrinks little.
ONE_TIME, GRID_TIME, MESH_TIME = 7.5, 5.0, 0.5
# It runs above a base (:mod:`.base_surface`), because slopes are not edges: on planes of slope 0 to 5 the remaining noise is 0.09
# of it, without a base 0.09 to 1.00. On 19 crops of scenes the error is 0.73 to 1.5 of that without a base, 1.035 on average;
# it is higher on flat plateaus.
# For several channels gamma -1 is so stiff that implicit steps diverge where noise is weak.
ONE, OF_CHANNELS = ({"gamma": -1.0, "sharpness": 1.5}, 3.0), ({"patch": 0.7}, 2.5)
# Where rounding is the noise it is not independent of the data, and its risk cannot be estimated: one fixed variant. Of widths 0
# to 3, contrasts 0.5 to 2 and times 1 to 60 it is within 1 % of the best for a Mars terrain in steps of 200 m, a fractal one in
# steps of 4 m and one in steps of 1 m.
ROUNDED, ROUNDED_EDGE, ROUNDED_TIME = {"patch": 1.0}, 1.0, 1.5
# Contrast in sample distances over noise for a variant of the caller, without a search: without patch channels 1.5
# comes within 12 % of the best contrast and time on four of five scenes and 23 % on the fifth (tests/bench_show.py).
EDGE = 1.5
# Time along rays, in squared sample distances for each sigma / h: between 0.02 and 2.4 sigma / h the best time of the ray flow on
# panels, a ball and a box is 10 to 12 times that, for noise that grows with the depth and noise that does not.
# The time is limited to RAY_MOST, since no camera has more noise.
RAY_TIME, RAY_MOST = 10.0, 100.0
STEPPED = (
    "the depths come in steps larger than their noise, so the risk cannot be estimated: no search was done, the time was "
    "chosen by the noise"
)


def as_they_are(data: Data, request: Request, noise: Noise, mobility: Array | None = None) -> Plan:
    """A plan without a search: contrast 1, or, where channels move with the points of a mesh, one that suits their noise.

    :param mobility: (n, 1), of each sample.
    """
    asked, sigma = request.heights, noise.sigma * request.strength
    if asked.contrast is not None:
        contrast, how = float(asked.contrast), GIVEN
    elif isinstance(data, Mesh) and data.moves == "all" and noise.sigma > 0:
        contrast, how = EDGE * data.step / sigma, Decided("estimated", f"{EDGE:g} h / sigma")
    else:
        contrast, how = 1.0, Decided("default", "lengths as they are")
    plan = begun(data, request, noise, mobility)
    return ruled(plan, contrast, how, MESH_TIME, "half a squared edge")


def by_rule(data: Data, request: Request, noise: Noise, mobility: Array | None = None) -> Plan:
    """A plan without a search: one method for all data, or the named one, with contrast and time by rule.

    :param mobility: (n, 1), of each sample.
    """
    asked, sigma = request.heights, noise.sigma * request.strength
    plan, rounded = begun(data, request, noise, mobility), noise.is_rounded
    (exponents, edge), much = ONE if channels_of(data) == 1 or isinstance(data, Mesh) else OF_CHANNELS, ONE_TIME
    if request.named:
        edge, much = asked.edge, GRID_TIME * asked.slower
    elif rounded:
        exponents, edge, much = ({} if isinstance(data, Mesh) else ROUNDED), ROUNDED_EDGE, ROUNDED_TIME
    contrast, how = contrast_by_rule(plan, sigma, edge)
    if sigma <= 0 and asked.contrast is None and not plan.variant.linear:
        plan = replace(plan, warnings=(f"{what_is_known(noise)}; contrast 1 is taken", *plan.warnings))
    if not request.named:
        plan = replace(plan, method=filled(request, replace(plan.variant, **exponents), contrast, 0.0))
        if sigma > 0 and not rounded and isinstance(data, (HeightField, Image)):
            plan = replace(plan, base=base_of(data.gridded(plan.lift), sigma, request.compute.threads))
    plan = ruled(plan, contrast, how, much, f"{much:g} h²")
    if not asked.fits_noise or sigma <= 0 or request.until_time is not None or request.stops:
        return plan
    return at_rest(plan, sigma)


def tuned(data: Data, request: Request, noise: Noise, mobility: Array | None = None) -> Plan:
    """A plan for values above a base: method, contrast and time with the least estimated risk, or without a search.

    :param mobility: (n, 1), of each sample.
    """
    asked, sigma, timed = request.heights, noise.sigma * request.strength, request.until_time
    if sigma == 0 and not request.asked:
        plan = replace(begun(data, request, noise, mobility), idle=no_noise(noise))
        return plan.with_({"time": Decided("default", "nothing to remove")})
    # A method given by exponents has a contrast by rule; a named method has a list of contrasts to choose from.
    by_contrast = request.named and asked.ruled
    known = timed is not None and (by_contrast or timed == 0)
    open_ = request.searching and sigma > 0 and request.steps is None and asked.searches_for(channels_of(data))
    if open_ and not (known or noise.is_rounded):
        found = _searched(begun(data, request, noise, mobility), sigma)
        if found is not None:
            return found
    return by_rule(data, request, noise, mobility)


def _family(data: Data, request: Request) -> Family:
    """The configurations of the search: exponents, and contrasts in sample distances over the noise."""
    if request.named:
        return ((request.heights.exponents, request.heights.contrasts),)
    if isinstance(data, Mesh):
        return MESH_FAMILY
    return CHANNEL_FAMILY if array_of(data).ndim == 3 else FAMILY


def _searched(plan: Plan, sigma: float) -> Plan | None:
    """The method, contrast and time of least estimated risk, for the options that the caller leaves open; None if no estimate
    is reliable.
    """
    data, request = on_surface(plan.data, "a search on a surface"), plan.request
    asked, end = request.heights, request.until_time
    like = Variant(indicator=asked.indicator, mass=asked.mass, linear=asked.variant.linear)
    made = configurations(_family(data, request), data.step / beside(plan.noise, sigma), like, asked.contrast)
    alone = end is not None or request.weighted or bool(request.stops)
    twices = (float(request.twicing),) if request.twicing is not None else (0.0,) if alone else TWICE
    free = asked.contrast is None and not like.linear
    if isinstance(data, Mesh):
        parts = (0.25, 0.5, 1.0, *((2.0,) if max(twices) > 0 else ()))
        times = tuple(t * data.step**2 for t in TIMES if t <= LOOKED_AT)
        times = times if end is None else tuple(end * part for part in parts)
        search = MeshSearch(made, times, free, sigma, end, twices, plan.mobility)
        found = Found(searched_on_mesh(data, plan.lift, search), better=True)
    else:
        grid = data.gridded(plan.lift)
        found = searched_on_grid(grid, _on_grid(plan, grid, made, twices))
    return chosen(plan, found, sigma, len(twices) > 1) if found.candidates else None


def _on_grid(plan: Plan, grid: Grid, made: tuple[Configuration, ...], twices: tuple[float, ...]) -> GridSearch:
    """The input of a search on a grid."""
    data, request, noise = plan.data, plan.request, plan.noise
    limit, k = limit_of(data, request, noise)[0], len(grid.planes)
    return GridSearch(
        made,
        free=request.heights.contrast is None and not plan.variant.linear,
        sigma=_each(plan, k) * request.strength,
        end=request.until_time,
        weights=twices,
        correlation=noise.correlation,
        between=noise.between,
        limit=None if limit is None else limit_of_planes(limit, data, grid.planes),
        speed=None if plan.mobility is None else plan.mobility.reshape(1, *grid.shape),
        blend=isinstance(request.method, Search) and request.method.blend and not request.stops,
        border=request.boundary is None and grid.boundary != "neumann",
        threads=request.compute.workers,
    )


def _each(plan: Plan, k: int) -> Array:
    """The noise of each sample (1, h, w), where the data says it, or of each channel (k, 1, 1)."""
    noise, each = plan.noise, plan.data.sigma if isinstance(plan.data, HeightField) else None
    if isinstance(each, np.ndarray) and plan.request.noise is None:
        return np.where(plan.above.missing, noise.sigma, each)[None]
    return np.reshape(noise.of_channels(k), (-1, 1, 1))


def along_rays(data: RangeImage, request: Request, noise: Noise, why: str, mobility: Array | None = None) -> Plan:
    """A plan for a range image: gamma 0 and a time by rule, or, with a search, both with the least estimated risk.

    :param why: a description of the growth of the noise.
    :param mobility: (n, 1), of each sample.
    """
    asked, twicing = request.heights, float(request.twicing or 0.0)
    contrast = 1.0 if asked.contrast is None else float(asked.contrast)
    plan = begun(data, request, noise, mobility)
    decided = {
        "contrast": GIVEN if asked.contrast is not None else Decided("default", "lengths as they are"),
        "twicing": of_twicing(request),
    }
    method = filled(request, plan.variant, contrast, twicing)
    plan = plan.with_(decided, method=method, lift=replace(plan.lift, contrast=contrast))
    if noise.sigma == 0 or data.sigma is None:
        time, when = timed(request, 0.0, Decided("default", "no noise was found"))
        return plan.with_({"time": when}, time=time, idle=None if request.asked else no_noise(noise))
    plan = plan.with_({"noise": Decided("given" if noise.how == "given" else "estimated", why)})
    there = ~data.missing & (data.footprint > 0)
    sigma = np.broadcast_to(data.sigma, there.shape) * request.strength
    if request.insisting and request.steps is None and noise.quantum > noise.sigma and request.until_time is None:
        plan = replace(plan, warnings=(*plan.warnings, STEPPED))
    elif request.insisting and request.steps is None:
        return _searched_along(plan, data, np.where(there, sigma, noise.sigma))
    return _timed_along(plan, data, sigma[there] / data.footprint[there], data.footprint[there])


def _timed_along(plan: Plan, data: RangeImage, ratio: Array, footprint: Array) -> Plan:
    """The plan with the given time, or a time in proportion to the noise.

    :param ratio: sigma over the width of a pixel, for samples that are present; ``footprint``: that width.
    """
    request, noise = plan.request, plan.noise
    width = footprint if data.time_unit == "length" else 1.0
    much, most = RAY_TIME * float(np.median(ratio * width**2)), RAY_MOST * data.step**2
    if much > most and request.until_time is None:
        words = f"noise of {float(np.median(ratio)):.3g} pixel widths: time is held at {RAY_MOST:g} squared footprints"
        words += "; are all depths in one unit, and the camera in pixels?"
        plan = replace(plan, warnings=(*plan.warnings, words))
    time, when = timed(request, min(much, most), Decided("estimated", f"{RAY_TIME:g} sigma / h"))
    own = (
        noise.how == "given"
        and np.ndim(data.sigma if data.sigma is not None else 0.0) > 0
        and data.time_unit == "footprint"
    )
    if own and request.until_time is None and request.steps is None and not request.stops:
        how = Decided("estimated", "in proportion to sigma / h of each sample")
        plan = plan.with_({"time_unit": how}, data=replace(data, time_unit="noise"))
    return plan.with_({"time": when}, time=time)


def _searched_along(plan: Plan, data: RangeImage, sigma: np.ndarray) -> Plan:
    """The plan with gamma and time of least estimated risk.

    :param sigma: (h, w), a number everywhere.
    """
    request, end = plan.request, plan.request.until_time
    exponents = ({},) if request.named else RAY_FAMILY
    made = tuple(Configuration(replace(plan.variant, **part), 1.0) for part in exponents)
    grid = data.gridded(plan.lift)
    speed = None if plan.mobility is None else plan.mobility.reshape(1, *grid.shape)
    search = GridSearch(made, False, sigma[None], end, (plan.twicing,), speed=speed, threads=request.compute.workers)
    found = searched_on_grid(grid, search)
    if not found.candidates:
        return plan.with_({"time": Decided("default", "no estimate is reliable")}, time=end or 0.0, idle=UNSURE)
    candidates = found.candidates
    least = candidates[0].least[0] if found.better else 0.0
    time, when = timed(request, least, Decided("estimated", "least estimated risk"))
    method = filled(request, candidates[0].configuration.variant, plan.lift.contrast, plan.twicing)
    idle = UNSURE if end is None and time == 0 else None
    decided = {"time": when, **exponents_found(request)}
    return plan.with_(decided, method=method, time=time, candidates=candidates, idle=idle)


def limit_of(data: Data, request: Request, noise: Noise) -> tuple[Any, Origin]:
    """The largest change of a sample, unit of the values, None for no limit, and its origin."""
    if request.constraints.max_change is not None:
        return request.constraints.max_change, "given"
    if isinstance(data, (Mesh, RangeImage, TetMesh)):
        return None, "default"
    return (noise.quantum / 2.0, "estimated") if noise.is_rounded else (None, "default")
