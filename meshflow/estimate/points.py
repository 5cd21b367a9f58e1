"""Plans for the points of a mesh: method and time as given, by rule, or by search."""

from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.heights import HARM, as_they_are, no_noise
from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Origin
from meshflow.estimate.plan import GIVEN, Decided, Plan
from meshflow.estimate.point_limits import limited, may_be_shape, quanta_to_keep
from meshflow.estimate.point_search import Tried, configurations, regularizing, searched
from meshflow.estimate.request import Request
from meshflow.flow.conservation import Keep
from meshflow.flow.methods.between_voxels import BetweenVoxels
from meshflow.flow.methods.curvature import ConformalFlow, CurvatureFlow
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.normal_channels import NormalChannels
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import Along, PointMethod, PointSetting
from meshflow.flow.methods.principal import PrincipalFlow
from meshflow.flow.methods.searched import Search
from meshflow.flow.within_voxels import VoxelEdges
from meshflow.geometry.connectivity import boundary_edges
from meshflow.geometry.delaunay import is_thin
from meshflow.geometry.normals import mean_altitude
from meshflow.geometry.operator import cotangents, total_area
from meshflow.geometry.options import options_of
from meshflow.geometry.validation import Array
from meshflow.geometry.volume import is_closed, volume
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh

__all__ = ["moving"]

SIZELESS = "all points of the mesh are at one place: nothing was changed"
# The fixed choice without a search, and its time in squared edges.
FIXED, FAIRED = NormalFilter().filled(), Fairing().filled()
FIXED_TIME = {NormalFilter.word: 100.0, Fairing.word: 1.0}
# The order of a fairing that keeps every value in its range, with weights of zero or more.
RANGED = 1
# The number of vertices below which differences of neighbours may be the shape.
FEW = 100
# Weight of normal channels in edges; the threshold of principal directions, (BENT + BENDS sigma / h) / h, which for cubes and
# cylinders with noise of 0.03 to 0.3 edges is the best within a fifth; and times in squared edges.
CHANNELS, BENT, BENDS, LONGER = 8.0, 0.05, 0.3, {NormalChannels.word: 5.0, PrincipalFlow.word: 5.0}
# The volume of a closed mesh, over its area to the power 3/2, below which it counts as none.
HOLLOW = 1e-6
RECENTRED = Decided("estimated", "the noise has no mean along the normals, over many triangles between creases")
# The time in squared edges of the run of which round parts are taken, and its contrast and sharpness. With twice the time, or a
# contrast of 4 and a sharpness of 4, less of their facets goes (14 shapes, 3 or 4 noises).
SHORT, ROUNDER = 10.0, (8.0, 2.0)
ROUND_PARTS = Decided("estimated", "where it is nearer to the data than the long one, which leaves facets")
# Order and time of the low-pass filter that removes steps of voxels, and the time of smoothing before cotangents are
# measured, in squared edges. Order 4 is as good on round bodies, and leaves rings on flat parts; with twice the time
# balls gain and thin plates lose (nine shapes; 40 to 100 cells; voxels of 1 x 1 x 1 to 1 x 1 x 4).
VOXELS, SMOOTH, LEVEL = 3, 4.0, 1.0


def moving(data: Mesh, request: Request, noise: Noise, mobility: Array | None = None) -> Plan:
    """The plan for the points of a mesh: method and time as given, by rule, or by search.

    :param mobility: (n, 1), of each vertex.
    :raises InputError: for options that do not apply to such a mesh.
    """
    method = request.method
    whole = data.moves == "points" and data.points.shape[1] == 3
    if isinstance(method, PointMethod) and type(method) is not CurvatureFlow and not whole:
        raise InputError(
            f"method={method.word!r}: of points in R^3 that move alone, got moves={data.moves!r} in R^{data.points.shape[1]}"
        )
    if data.step**2 == 0:
        unnamed = replace(request, method=None if isinstance(method, PointMethod) else method)
        plan = replace(as_they_are(data, unnamed, noise, mobility), idle=SIZELESS, time=0.0)
        return plan.with_({"time": Decided("default", "nothing may move")})
    shaping = isinstance(method, (NormalFilter, Fairing))
    plan = (_shaped if shaping or (whole and _open(request)) else _curved)(data, request, noise, mobility)
    useless = _useless(request) if data.moves == "points" else ()
    return replace(plan, warnings=(*plan.warnings, *useless))


def _open(request: Request) -> bool:
    """Whether no method is given, and no option that only the curvature flow has."""
    if isinstance(request.method, PointMethod) or request.named:
        return False
    return not (request.asked or request.compute.stepping)


def _useless(request: Request) -> tuple[str, ...]:
    """A warning about options of a search that have no effect where only points move."""
    plain, asked = Search(), request.heights
    names = [
        name for name in ("contrast", "twicing", "indicator", "mass") if getattr(asked, name) != getattr(plain, name)
    ]
    return (f"{', '.join(names)}: no effect where points move",) if names and not request.named else ()


def _along(request: Request) -> Along:
    """The directions in which points move."""
    method = request.method
    return method.along if isinstance(method, (PointMethod, Search)) else "all"


def _setting(request: Request) -> PointSetting:
    return PointSetting(request.compute.triangles, request.boundary == "border-curve")


def _curved(data: Mesh, request: Request, noise: Noise, mobility: Array | None) -> Plan:
    """The plan for a mean curvature flow, with the length or the weight of one that keeps features."""
    named = request.method if isinstance(request.method, PointMethod) else None
    method = named or CurvatureFlow(along=_along(request), mass=request.heights.mass)
    method, decisions = _featured(data, request, noise, method)
    origin: Origin = "default" if named is None else "given"
    setting = _setting(request)
    plan = as_they_are(data, request, noise, mobility)
    decided = {"method": Decided(origin), **_options_given(named), **decisions, **_of_triangles(data, request, method)}
    if setting.curve:
        decided["boundary"] = GIVEN
    if method.word in LONGER and request.until_time is None:
        much = LONGER[method.word]
        plan = replace(plan, time=much * data.step**2)
        decided["time"] = Decided("default", f"{much:g} squared edges")
    if request.named:
        words = f"method {request.heights.word}"
        useless = f"{words}: no effect where points move; mean curvature flow, method curvature, was used"
        plan = replace(plan, warnings=(*plan.warnings, useless))
    preserve = request.constraints.preserve or _preserved(data, request, method)
    decided["preserve"] = GIVEN if request.constraints.preserve else Decided()
    return plan.with_(decided, method=method, setting=setting, preserve=preserve)


def _options_given(method: PointMethod | None) -> dict[str, Decided]:
    """The origins of the given options."""
    if method is None:
        return {}
    plain = type(method)()
    return {o.name: GIVEN for o in options_of(type(method)) if getattr(method, o.name) != getattr(plain, o.name)}


def _featured(
    data: Mesh, request: Request, noise: Noise, method: PointMethod
) -> tuple[PointMethod, dict[str, Decided]]:
    """A method that keeps features, with its length or weight."""
    if isinstance(method, NormalChannels) and method.normal_weight is None:
        return replace(method, normal_weight=CHANNELS * data.step), {
            "normal_weight": Decided("default", f"{CHANNELS:g} edges")
        }
    if isinstance(method, PrincipalFlow):
        return _of_principal(data, noise.sigma * request.strength, method)
    return method, {}


def _of_principal(data: Mesh, sigma: float, method: PrincipalFlow) -> tuple[PrincipalFlow, dict[str, Decided]]:
    """The method with its length, and the time of the initial regularization.

    :param sigma: of the noise that is removed.
    """
    found: dict[str, Decided] = {}
    if method.feature_length is None:
        edges = 1.0 / (BENT + BENDS * sigma / data.step)
        why = f"{edges:.3g} edges, h / ({BENT:g} + {BENDS:g} sigma / h)"
        found["feature_length"] = Decided("estimated", why)
        method = replace(method, feature_length=edges * data.step)
    if method.regularize is None:
        altitude = mean_altitude(data.points, data.faces)
        edges = regularizing(altitude, sigma) if method.along == "all" and altitude > 0 else 0.0
        found["regularize"] = Decided("estimated", f"{edges:.3g} squared edges, for noise along the surface")
        method = replace(method, regularize=edges * data.step**2)
    return method, found


def _preserved(data: Mesh, request: Request, method: PointMethod) -> Keep | None:
    """What is preserved by default.

    For a conformal flow with all points free it is the volume by scaling, for an open mesh the area; for normal channels, which
    shrink balls, the volume.
    """
    fixed = bool(data.fixed.any())
    filled = _is_filled(data)
    if isinstance(method, ConformalFlow):
        free = method.along == "all" and request.constraints.mobility is None and not fixed
        rim = request.boundary == "fixed" and len(boundary_edges(data.faces)) > 0
        # Noise increases the area; where the area is preserved, noisy parts swell.
        return ("scale" if filled else "area") if free and not rim else None
    return "volume" if isinstance(method, NormalChannels) and filled else None


def _is_filled(data: Mesh) -> bool:
    """Whether a mesh is closed and holds a volume."""
    return (
        data.points.shape[1] == 3
        and is_closed(data.faces)
        and abs(volume(data.points, data.faces)) > HOLLOW * total_area(data.points, data.faces) ** 1.5
    )


def _of_triangles(data: Mesh, request: Request, method: PointMethod) -> dict[str, Decided]:
    """The origin of the choice of cotangents."""
    if request.compute.triangles != "auto":
        return {"triangles": GIVEN}
    if not isinstance(method, PrincipalFlow) and is_thin(cotangents(data.points.astype(np.float64), data.faces)[0]):
        return {"triangles": Decided("estimated", "intrinsic: some triangles are almost degenerate")}
    return {}


def _shaped(data: Mesh, request: Request, noise: Noise, mobility: Array | None) -> Plan:
    """The plan for the normal filter or a fairing."""
    if request.weighted:
        raise InputError(
            "data weights work only with the curvature flow where the points of a mesh move; give method='curvature', or Fixed "
            "and MaxChange"
        )
    quanta = quanta_to_keep(data, request, noise)
    if quanta is not None:
        request = replace(request, method=Search(along="normals"))
    methods, setting, timed = _methods(data, request, noise.sigma), _setting(request), request.until_time
    lift = Lift(1.0, request.compute.diagonals, request.rim)
    preserve, asked = request.constraints.preserve, request.timed
    plan = Plan(
        data, request, noise, methods[0], lift, 0.0, mobility=mobility, preserve=preserve, setting=setting,
        decided=_of_shaped(request, noise),
    )  # fmt: skip
    voxels = noise.voxels if isinstance(noise, PointNoise) else None
    if voxels is not None and not asked and request.searching and len(methods) > 1:
        return _of_voxels(plan, voxels)
    time, when = (0.0, Decided()) if timed is None else (float(timed), GIVEN)
    found = False
    if noise.sigma == 0 and not asked:
        return plan.with_({"time": Decided("default", "nothing to remove")}, idle=no_noise(noise))
    settled = len(methods) == 1 and timed is not None  # nothing to choose
    if noise.sigma > 0 and request.searching and request.steps is None and not request.stops and not settled:
        candidates = searched(
            data, lift, Tried(methods, setting, _of_points(noise), timed, mobility, request.compute.workers)
        )
        if candidates:
            if timed is None:
                time = candidates[0].least[0] * request.strength**2
                when = Decided(
                    "estimated", "least estimated risk" + (", times strength²" if request.strength != 1 else "")
                )
            open_ = timed is None and not isinstance(request.method, PointMethod)
            idle, found = HARM if time == 0 else may_be_shape(plan, candidates[0]) if open_ else None, True
            time = 0.0 if idle is not None else time
            plan = plan.with_(
                _options_found(request, candidates[0].configuration),
                method=candidates[0].configuration,
                candidates=candidates,
                idle=idle,
            )
    if found:
        plan = limited(plan, quanta)
    freely = quanta is not None or _along(request) == "all"
    if found and time > 0 and preserve is None and mobility is None and freely:
        plan = plan.with_({"offsets": RECENTRED}, recentred=True)
        white = _of_points(noise).spread == 0  # more of correlated noise is left by a short run
        if white and isinstance(plan.method, NormalFilter) and time > SHORT * data.step**2 * request.strength**2:
            short = _of_round_parts(plan.method, data.step, request.strength)
            plan = plan.with_({"round_parts": ROUND_PARTS}, of_round_parts=short)
    if not found and timed is None:
        much = FIXED_TIME[plan.method.word]
        time, when = much * data.step**2, Decided("default", f"{much:g} squared edges")
    if found and timed is None and time > 0 and noise.how != "given" and len(data.points) < FEW:
        few = f"noise and method were found from {len(data.points)} vertices, whose shape looks like noise"
        plan = replace(plan, warnings=(*plan.warnings, f"{few}: give the noise, or a time"))
    return plan.with_({"time": when}, time=time)


def _of_round_parts(method: NormalFilter, step: float, strength: float) -> tuple[NormalFilter, float]:
    """The shorter run of which the round parts are taken, and its time."""
    contrast, sharpness = ROUNDER
    return replace(method, crease_contrast=contrast, crease_sharpness=sharpness), SHORT * step**2 * strength**2


def _of_points(noise: Noise) -> PointNoise:
    """The noise as one of points."""
    return noise if isinstance(noise, PointNoise) else PointNoise(noise.sigma, 0.0)


def _of_voxels(plan: Plan, voxels: VoxelEdges) -> Plan:
    """The plan against steps of voxels: a short low-pass filter between the voxels, with changes of at most half a voxel, and
    the volume preserved.
    """
    strength, why = plan.request.strength, Decided("estimated", "steps of voxels")
    time = SMOOTH * plan.data.step**2 * strength**2
    along = _along(plan.request)
    found = {
        "method": why,
        "order": why,
        "weights": why,
        "presmooth": why,
        "time": why,
        "max_change": Decided("estimated", "half a voxel"),
    }
    if isinstance(plan.data, Mesh) and plan.preserve is None and _is_filled(plan.data):
        plan = plan.with_({"preserve": why}, preserve="volume")
    presmooth = LEVEL * plan.data.step**2
    method = BetweenVoxels(order=VOXELS, weights="cotangent", presmooth=presmooth, along=along, edges=voxels)
    return plan.with_(found, method=method, time=time)


def _of_shaped(request: Request, noise: Noise) -> dict[str, Decided]:
    """The origins of the values before a search."""
    how = {"given": "", "nothing": "too few samples"}.get(noise.how, f"from {noise.how}, along the normals")
    named = request.method if isinstance(request.method, PointMethod) else None
    found = {
        "noise": Decided("given" if noise.how == "given" else "estimated", how),
        "boundary": GIVEN
        if request.boundary
        else Decided("default", "weights of zero and above" if request.rim else ""),
        "method": GIVEN if named else Decided(),
        "triangles": GIVEN if request.compute.triangles != "auto" else Decided(),
        "preserve": GIVEN if request.constraints.preserve else Decided(),
        **_options_given(named),
    }
    if named is None and request.compute.triangles == "clamped":
        found["order"] = Decided("default", "no value leaves its range")
    return found


def _options_found(request: Request, method: PointMethod) -> dict[str, Decided]:
    """The origins of the options found by a search."""
    named = request.method if isinstance(request.method, PointMethod) else None
    given = _options_given(named)
    found = {o.name: Decided("estimated") for o in options_of(type(method)) if o.name not in given}
    return {**found, "method": GIVEN if named else Decided("estimated")}


def _methods(data: Mesh, request: Request, sigma: float) -> tuple[PointMethod, ...]:
    """The methods to choose from; the first is the one without a search."""
    named = request.method if isinstance(request.method, PointMethod) else None
    clamped, along = request.compute.triangles == "clamped", _along(request)
    ranged = named is None and clamped
    fairing = isinstance(named, Fairing) or (named is None and (request.boundary == "border-curve" or clamped))
    made: list[PointMethod] = []
    for method in (
        FAIRED if fairing else FIXED,
        *configurations(data.step, mean_altitude(data.points, data.faces), sigma),
    ):
        if fairing != isinstance(method, Fairing) and (fairing or named is not None):
            continue
        if isinstance(method, NormalFilter):
            made.append(_normal_filter(method, named if isinstance(named, NormalFilter) else NormalFilter(along=along)))
        elif isinstance(method, Fairing):
            made.append(_fairing(method, named if isinstance(named, Fairing) else Fairing(along=along), ranged))
    return tuple(dict.fromkeys(made))


def _normal_filter(method: NormalFilter, asked: NormalFilter) -> NormalFilter:
    """The method with the given options."""
    names = ("crease_contrast", "crease_sharpness", "regularize")
    given = {name: float(getattr(asked, name)) for name in names if getattr(asked, name) is not None}
    if asked.along == "normals":
        given["regularize"] = 0.0
    return replace(method, along=asked.along, **given)


def _fairing(method: Fairing, asked: Fairing, ranged: bool) -> Fairing:
    """The method with the given options; ``ranged``: the one that keeps every value in its range."""
    if ranged:
        return replace(method, order=RANGED, weights="cotangent", along=asked.along)
    # Order 1 is implicit fairing by its definition, whose weights are cotangents unless others are named.
    order, weights = asked.order or method.order, asked.weights or (FAIRED if asked.order == 1 else method).weights
    searched_for = method.presmooth if asked.weights is None else 0.0
    presmooth = searched_for if asked.presmooth is None else asked.presmooth
    return replace(method, order=order, weights=weights, presmooth=presmooth, along=asked.along)
