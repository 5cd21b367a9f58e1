"""Plans for values in a body, a volume or tetrahedra: method, contrast and time as given, by rule, or by search."""

from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.choices import (
    begun,
    beside,
    channels_of,
    chosen,
    contrast_by_rule,
    filled,
    limit_of_planes,
    no_noise,
    ruled,
)
from meshflow.estimate.families import Family, configurations
from meshflow.estimate.heights import limit_of
from meshflow.estimate.mesh_search import LOOKED_AT, TIMES, MeshSearch
from meshflow.estimate.noise import Noise
from meshflow.estimate.noise_left import without_noise_as_signal
from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.planner import (
    HELD,
    constrained,
    ended,
    excessive,
    held,
    must_fit,
    noise_in,
    staying,
    stepped,
    still,
    unseen,
)
from meshflow.estimate.request import Request
from meshflow.estimate.risk import TWICE
from meshflow.estimate.search_rounds import Found, GridSearch
from meshflow.estimate.second_stage import with_second_stage
from meshflow.estimate.stabilized import bias_left, volume_of_constant_noise
from meshflow.estimate.tet_search import searched_on_tetrahedra
from meshflow.estimate.volume_search import searched_on_volume
from meshflow.flow.family import Variant
from meshflow.flow.methods import HEIGHT_METHODS
from meshflow.flow.methods.beltrami import HeightMethod, Patches, UnsearchedMethod
from meshflow.flow.methods.searched import Search
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import SolidData
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["plan_of_solid", "volume_words"]

# The configurations of a search where no method is named, with their contrasts in sample distances over the noise.
VOLUME_FAMILY: Family = (
    ({"linear": True}, (1.0,)),
    ({"gamma": -1.0, "sharpness": 1.5}, (3.0, 5.0)),
    ({"gamma": -1.0, "sharpness": 2.0}, (1.0, 2.0, 2.7)),
    ({"gamma": -1.0, "sharpness": 3.0}, (0.7, 1.35)),
)
# On tetrahedra, whose rates cost more: contrasts between these are tried, too.
TET_FAMILY: Family = (
    ({"linear": True}, (1.0,)),
    ({"gamma": -1.0, "sharpness": 1.5}, (4.0,)),
    ({"gamma": -1.0, "sharpness": 2.0}, (1.8,)),
    ({"gamma": -1.0, "sharpness": 3.0}, (1.0,)),
)
VOLUME_CHANNEL_FAMILY: Family = (({}, (1.5, 3.0)), ({"sharpness": 1.5}, (2.0,)), ({"linear": True}, (1.0,)))
# Without a search: the member that is within a few percent of the best on three phantoms at three levels of noise.
ONE, OF_CHANNELS, ONE_TIME = ({"gamma": -1.0, "sharpness": 1.5}, 3.0), ({}, 3.0), 4.0
# A method of the caller, and where rounding is the noise.
GIVEN_TIME, ROUNDED_EDGE, ROUNDED_TIME = 4.0, 1.0, 1.5


def volume_words() -> tuple[str, ...]:
    """The names of the methods that are defined on volumes."""
    return ("search", "quick", *(kind.word for kind in HEIGHT_METHODS if not _without_engine(kind())))


def _without_engine(method: HeightMethod) -> bool:
    """Whether a method needs another engine than that of tetrahedra."""
    return isinstance(method, (UnsearchedMethod, Patches)) or not method.searches or method.once


def plan_of_solid(data: SolidData, request: Request) -> Plan:
    """The plan for a volume, or a mesh of tetrahedra.

    :raises InputError: for options that they do not have, and constraints that do not fit.
    """
    _must_suit(data, request)
    stays = staying(data, request)
    data, request, mobility = constrained(data, request, stays)
    must_fit(data, request)
    mask = request.constraints.mask
    seen = mask if mask is None or not np.any(mask) else np.asarray(mask, bool)
    how = None
    if isinstance(data, Volume):
        data, how, noise = volume_of_constant_noise(data, request, unseen(data.missing, seen))
    else:
        noise = noise_in(data, seen)
    warnings = bias_left(request, noise, how)
    if request.noise is not None:
        noise = replace(noise, sigma=float(request.noise), how="given")
    warnings = (*warnings, *excessive(data, request, noise))
    request = stepped(data, request)
    if still(data):
        found = replace(_by_rule(data, request, noise, mobility), idle=HELD, time=0.0)
        found = found.with_({"time": Decided("default", "nothing may move")})
    else:
        found = _tuned(data, request, noise, mobility)
    found = replace(found, mobility=mobility, stays=stays, preparation=how, warnings=(*warnings, *found.warnings))
    return with_second_stage(without_noise_as_signal(ended(held(found))))


def _must_suit(data: SolidData, request: Request) -> None:
    """Refuse what volumes do not have.

    :raises InputError: with its name.
    """
    compute, constraints = request.compute, request.constraints
    name = "volumes" if isinstance(data, Volume) else "meshes of tetrahedra"
    for word, given in (
        (f"domain={request.domain!r}", not _has_domain(data, request)),
        ("outliers", request.outliers is not None),
        ("level", request.level is not None),
        ("MinComponent", constraints.min_component is not None),
        ("PreserveVolume and PreserveArea", constraints.preserve is not None),
        ("triangles", compute.triangles != "auto"),
        (f"boundary={request.boundary!r}", request.boundary not in (None, "neumann", "fixed")),
    ):
        if given:
            raise InputError(f"{word}: not for {name}; leave it out")
    method = request.method
    if method is None:
        return
    if not isinstance(method, HeightMethod) or _without_engine(method) or not method.searches_for(channels_of(data)):
        raise InputError(f"method={method.word!r}: not for {name}; methods for {name} are {', '.join(volume_words())}")


def _has_domain(data: SolidData, request: Request) -> bool:
    """Whether the domain of a request is one of the data."""
    return request.domain in ("auto", "length", *(("stabilized", "magnitudes") if isinstance(data, Volume) else ()))


def _tuned(data: SolidData, request: Request, noise: Noise, mobility: Array | None) -> Plan:
    """Method, contrast and time with the least estimated risk, or without a search."""
    asked, sigma, timed = request.heights, noise.sigma * request.strength, request.until_time
    if sigma == 0 and not request.asked:
        plan = replace(begun(data, request, noise, mobility), idle=no_noise(noise))
        return plan.with_({"time": Decided("default", "nothing to remove")})
    known = timed is not None and ((request.named and asked.ruled) or timed == 0)
    if request.searching and sigma > 0 and request.steps is None and not known and not noise.is_rounded:
        found = _searched(begun(data, request, noise, mobility), data, sigma)
        if found is not None:
            return found
    return _by_rule(data, request, noise, mobility)


def _by_rule(data: SolidData, request: Request, noise: Noise, mobility: Array | None) -> Plan:
    """One method for all volumes, or the named one, with contrast and time by rule."""
    asked, sigma, much = request.heights, noise.sigma * request.strength, ONE_TIME
    plan = begun(data, request, noise, mobility)
    exponents, edge = ONE if channels_of(data) == 1 else OF_CHANNELS
    if request.named:
        exponents, edge, much = {}, asked.edge, GIVEN_TIME * asked.slower
    elif noise.is_rounded:
        exponents, edge, much = {}, ROUNDED_EDGE, ROUNDED_TIME
    contrast, how = contrast_by_rule(plan, sigma, edge)
    if not request.named:
        plan = replace(plan, method=filled(request, replace(plan.variant, **exponents), contrast, 0.0))
    return ruled(plan, contrast, how, much, f"{much:g} h²")


def _searched(plan: Plan, data: SolidData, sigma: float) -> Plan | None:
    """The method, contrast and time of least estimated risk, for the options that the caller leaves open; None if no estimate
    is reliable.
    """
    request, noise, end = plan.request, plan.noise, plan.request.until_time
    asked, k = request.heights, channels_of(data)
    like = Variant(indicator=asked.indicator, mass=asked.mass, linear=asked.variant.linear)
    alike = TET_FAMILY if isinstance(data, TetMesh) else VOLUME_FAMILY
    family = alike if k == 1 else VOLUME_CHANNEL_FAMILY
    if request.named:
        family = ((asked.exponents, asked.contrasts),)
    made = configurations(family, data.step / beside(noise, sigma), like, asked.contrast)
    alone = end is not None or request.weighted or bool(request.stops)
    twices = (float(request.twicing),) if request.twicing is not None else (0.0,) if alone else TWICE
    if isinstance(data, TetMesh):
        parts = (0.25, 0.5, 1.0, *((2.0,) if max(twices) > 0 else ()))
        times = (
            tuple(t * data.step**2 for t in TIMES if t <= LOOKED_AT)
            if end is None
            else tuple(end * part for part in parts)
        )
        free = asked.contrast is None and not like.linear
        tried = MeshSearch(made, times, free, sigma, end, twices, plan.mobility)
        found = Found(searched_on_tetrahedra(data, plan.lift, tried), better=True)
        return chosen(plan, found, sigma, len(twices) > 1) if found.candidates else None
    block = data.gridded(plan.lift)
    limit = limit_of(data, request, noise)[0]
    search = GridSearch(
        made,
        free=asked.contrast is None and not like.linear,
        sigma=np.reshape(noise.of_channels(k), (-1, 1, 1, 1)) * request.strength,
        end=end,
        weights=twices,
        correlation=noise.correlation,
        between=noise.between,
        limit=None if limit is None else limit_of_planes(limit, data, block.planes),
        speed=None if plan.mobility is None else plan.mobility.reshape(1, *block.shape),
        blend=_blends(request),
        threads=request.compute.workers,
    )
    found = searched_on_volume(block, search)
    return chosen(plan, found, sigma, len(twices) > 1) if found.candidates else None


def _blends(request: Request) -> bool:
    """Whether the best runs are blended: by default where nothing is named, and as :class:`Search` says."""
    if request.stops or request.timed or request.weighted:
        return False
    return request.method is None or (isinstance(request.method, Search) and request.method.blend)
