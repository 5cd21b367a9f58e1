"""Makes the plan of a run from data and a request: given options are kept, the others are estimated."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.channel_spikes import ValueSpikes, without_value_spikes
from meshflow.estimate.heights import along_rays, as_they_are, limit_of, tuned
from meshflow.estimate.mesh_noise import noise_on
from meshflow.estimate.mesh_parts import noise_by_parts, turned_alike
from meshflow.estimate.noise import Noise, noise_of
from meshflow.estimate.noise_growth import noise_growth
from meshflow.estimate.plan import Decided, Plan, size_of
from meshflow.estimate.points import moving
from meshflow.estimate.preparation import Preparation, prepared
from meshflow.estimate.quantization import steps_of
from meshflow.estimate.quantized import LeastBending, quantized
from meshflow.estimate.request import Request
from meshflow.estimate.rims import with_smooth_rims
from meshflow.estimate.schemes import within_noise
from meshflow.estimate.second_stage import with_second_stage
from meshflow.estimate.spikes import without_spikes
from meshflow.estimate.stabilized import one_number_for_all, volume_of_constant_noise, with_constant_noise
from meshflow.estimate.suits import must_suit
from meshflow.estimate.tet_search import noise_in_body
from meshflow.flow.constraints import Limit, trust_of
from meshflow.flow.methods.points import PointMethod
from meshflow.flow.mobility import speed_of
from meshflow.geometry.validation import Array, mask_of
from meshflow.surfaces.data import Data, SurfaceData, array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.joined import own_samples
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.orientation import AS_IT_IS, Orientation, orientation_of
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = [
    "HELD", "constrained", "ended", "excessive", "held", "must_fit", "noise_in", "oriented", "plan_of_surface", "pull_of",
    "staying", "stepped", "still",
]  # fmt: skip

Kept = TypeVar("Kept", bound=Data)
# The end of a run that does not reach its stop, in squared sample distances.
PATIENT = 100.0
HELD = "no sample may move (Fixed, Mask, Mobility): nothing was changed"
# Samples used for the noise of a range image.
RAYS_ENOUGH = 80_000
# The widest Gaussian, in widths of the data: a wider one takes minutes and leaves nothing.
WIDEST = 4.0
# The time to the steady state, in relaxation times of the data weights.
AT_REST = 10.0


def noise_in(data: Data, mask: Array | None = None) -> Noise:
    """The noise of the data, in the unit of its values; for points along their normals.

    :param mask: (h, w), the samples used; None: all.
    """
    if isinstance(data, Mesh):
        if data.channels is None or data.moves == "points":
            whole = data.points.shape[1] == 3
            return noise_by_parts(turned_alike(data)[0])[0] if whole else noise_on(data.points, data.faces)
        cleaned = without_value_spikes(data)[0].channels
        return noise_on(data.channels if cleaned is None else cleaned, data.faces, data.points)
    if isinstance(data, RangeImage):
        return _noise_along(data, unseen(data.missing, mask))[0]
    if isinstance(data, Volume):
        return volume_of_constant_noise(data, Request(), unseen(data.missing, mask))[2]
    if isinstance(data, TetMesh):
        return noise_in_body(data, mask)
    data, how = with_constant_noise(*prepared(data), Request())
    way = orientation_of(array_of(data), data.missing, data.spacing)
    found = _noise_prepared(data.oriented(way), how, None if mask is None else way.of(mask), way)
    return found.oriented(way.inverse)


def _noise_prepared(data: HeightField | Image, how: Preparation, mask: Array | None, way: Orientation) -> Noise:
    """The noise of a prepared and reoriented grid; rounding of its floating-point numbers is not noise."""
    noise = noise_of(array_of(data), unseen(data.missing | way.of(how.unseen), mask))
    if 0 < noise.sigma <= how.rounding:
        return Noise(0.0, 0.0, (0.0,) * len(noise.channels), 0.0, noise.how)
    if how.stabilizer is not None:
        return noise.stabilized(how.stabilizer)
    return noise.of_compression(how.compression)


def plan_of_surface(data: SurfaceData, request: Request) -> Plan:
    """The plan for data on a surface.

    :raises InputError: for options that do not apply to the kind of data, and constraints that do not fit it.
    """
    must_suit(data, request)
    stays = staying(data, request)
    data, request, mobility = constrained(data, request, stays)
    must_fit(data, request)
    data, how, warnings = _taken_in(data, request)
    own = own_samples(data)
    data, request, mobility, way = _oriented(data, request, mobility)
    mask = None if request.constraints.mask is None else np.asarray(request.constraints.mask, bool)
    if own is not None:  # copies of other samples say nothing new of the noise
        mask = way.of(own) if mask is None else mask & way.of(own)
    spikes: tuple[str, ...] = ()
    if isinstance(data, Mesh) and data.moves == "points" and data.points.shape[1] == 3:
        data, warnings = turned_alike(data)
        if request.is_open and request.outliers != "include":
            data, spikes = without_spikes(data)
            warnings += spikes
    data, values = _spiked(data, request)
    data, noise, why = _with_noise(data, request, mask, (how, way))
    (data, rims), rough = with_smooth_rims(data, request, noise), data
    warnings += excessive(data, request, noise)
    if how is not None and request.level is None:
        warnings += _of_lines(noise.oriented(way.inverse))
    if how is not None and request.noise is None and noise.warning:
        warnings += (noise.warning,)
    warnings += _of_alpha(data, noise)
    if isinstance(data, RangeImage) and request.constraints.min_component is not None:
        data = data.cleared(request.constraints.min_component)
    request = stepped(data, request)
    if still(data):  # nothing to search for
        plain = replace(request, method=None if isinstance(request.method, PointMethod) else request.method)
        found = replace(as_they_are(data, plain, noise), idle=HELD, time=0.0)
        found = found.with_({"time": Decided("default", "nothing may move")})
    elif isinstance(data, RangeImage):
        found = along_rays(data, request, noise, why, mobility)
    elif isinstance(data, Mesh) and data.moves != "channels":
        found = moving(data, request, noise, mobility)
    else:
        found = None if isinstance(data, Mesh) else quantized(data, request, noise)
        found = found or tuned(data, request, noise, mobility)
    if rims:  # noise that no method removes is none at the rim either
        moved = found.with_({"boundary": Decided("estimated", rims)})
        found = moved if found.idle is None else replace(found, data=rough)
    if how is not None:
        warnings = (*how.warnings(found.idle is not None), *warnings)
        found = replace(found, idle=None if found.idle is None else how.beside(found.idle))
    if spikes and found.idle is not None:
        found = replace(found, idle=f"but for spikes, {found.idle}")
    if values is not None:
        warnings = (values.warning(found.idle is not None), *warnings)
    warnings = (*warnings, *found.warnings)
    found = replace(
        found, spikes=values, mobility=mobility, stays=stays, preparation=how, orientation=way, warnings=warnings
    )
    return with_second_stage(ended(within_noise(held(found))))


def _taken_in(data: SurfaceData, request: Request) -> tuple[SurfaceData, Preparation | None, tuple[str, ...]]:
    """A grid of values, prepared, with its preparation and warnings; other data as it is."""
    if isinstance(data, (Mesh, RangeImage)):
        return data, None, ()
    data, how = prepared(data, request.outliers, request.level, still=not (request.named or request.timed))
    data, how = with_constant_noise(data, how, request)
    return data, how, one_number_for_all(data, how, request)


def _spiked(data: SurfaceData, request: Request) -> tuple[SurfaceData, ValueSpikes | None]:
    """The data without the spikes of its channels, and these; looked for where all is open, or the caller says what to do."""
    if not isinstance(data, Mesh) or data.moves != "channels" or request.outliers == "include":
        return data, None
    return without_value_spikes(data, request.outliers) if request.is_open or request.outliers else (data, None)


def _of_lines(noise: Noise) -> tuple[str, ...]:
    """A warning about rows or columns that are shifted against each other, and the option that levels them.

    Offsets below half the step of quantized data are those of its rounding.
    """
    found = (("rows", noise.lines.rows), ("columns", noise.lines.columns))
    return tuple(
        f"{lines} are shifted against each other by {size:.3g} (rms), as in scan lines: level={lines!r} levels them"
        for lines, size in found
        if size > 0.5 * noise.quantum
    )


def _of_alpha(data: Data, noise: Noise) -> tuple[str, ...]:
    """A warning about a fourth channel without noise beside three with it, as that of transparency is."""
    if not isinstance(data, Image) or len(noise.channels) != 4 or noise.channels[3] > 0 or not all(noise.channels[:3]):
        return ()
    return ("the fourth channel has no noise, and is smoothed with the others; if it is alpha, give values[..., :3]",)


def unseen(missing: Array, mask: Array | None) -> Array:
    """The samples (h, w) that are not used for the noise: missing, or outside of a mask that is not empty."""
    unseen = missing if mask is None else missing | ~mask
    return missing if unseen.all() else unseen


def staying(data: Data, request: Request) -> Array:
    """The samples that the data or the caller fixes, (h, w) or (n,)."""
    fixed = data.fixed
    given = request.constraints.fixed
    return fixed if given is None else fixed | mask_of(given, fixed.shape, "fixed")


def constrained(data: Kept, request: Request, fixed: Array) -> tuple[Kept, Request, Array | None]:
    """The data with fixed samples; masks as booleans; the mobility (n, 1), None where all are free."""
    held = request.constraints
    if held.mask is not None:
        held = replace(held, mask=mask_of(held.mask, fixed.shape, "mask"))
        fixed = fixed | ~held.mask
    mobility = None
    if held.mobility is not None:
        mobility = speed_of(held.mobility, fixed.shape)
        fixed = fixed | (mobility == 0)
    return (
        replace(data, fixed=fixed), replace(request, constraints=held), None if mobility is None else mobility.reshape(-1, 1)
    )  # fmt: skip


def _oriented(
    data: SurfaceData, request: Request, mobility: Array | None
) -> tuple[SurfaceData, Request, Array | None, Orientation]:
    """Data, request and mobility in the standard orientation, unless the caller names a diagonal.

    The result of rotated or reflected data is then the rotated or reflected result.
    """
    if isinstance(data, (Mesh, RangeImage)) or request.compute.diagonals in ("forward", "backward"):
        return data, request, mobility, AS_IT_IS
    way = orientation_of(array_of(data), data.missing, data.spacing)
    return *oriented(data, request, mobility, way), way


def oriented(
    data: HeightField | Image, request: Request, mobility: Array | None, way: Orientation
) -> tuple[HeightField | Image, Request, Array | None]:
    """Data, request and mobility (n, 1) in another orientation."""
    if not way.changes:
        return data, request, mobility
    held = request.constraints.oriented(way, array_of(data).shape)
    mobility = None if mobility is None else way.of_samples(mobility, data.missing.shape)
    return data.oriented(way), replace(request, constraints=held), mobility


def _with_noise(
    data: SurfaceData, request: Request, mask: Array | None, made: tuple[Preparation | None, Orientation]
) -> tuple[SurfaceData, Noise, str]:
    """The data with the noise of each depth, the noise, and a description of its growth.

    :param made: the preparation of a grid, and its orientation.
    """
    if isinstance(data, RangeImage):
        if request.noise is not None:
            data = replace(data, sigma=float(request.noise))
        inside = None if mask is None or not mask.any() else mask
        noise, data, why = _noise_along(data, unseen(data.missing, inside))
    elif made[0] is not None and not isinstance(data, Mesh):
        noise, why = _noise_prepared(data, made[0], mask, made[1]), ""
        if isinstance(data, HeightField) and data.sigma is not None:
            noise = noise.known(np.broadcast_to(data.sigma, data.missing.shape)[~data.missing])
    elif isinstance(data, Mesh) and data.moves == "points" and data.points.shape[1] == 3:
        (noise, clean), why = noise_by_parts(data), ""
        if request.is_open:
            data = replace(data, fixed=data.fixed | clean)
    elif isinstance(data, Mesh) and data.channels is not None:  # whose spikes are found
        noise, why = noise_on(data.channels, data.faces, data.points), ""
    else:
        noise, why = noise_in(data, mask), ""
    if request.noise is not None:
        noise = replace(noise, sigma=float(request.noise), how="given")
    return data, noise, why


def _noise_along(data: RangeImage, missing: Array) -> tuple[Noise, RangeImage, str]:
    """The noise along the rays at the median depth, the image with the noise of each depth, and a description of its growth.

    It is estimated from second differences by depth, and is at least that of the steps of the sensor.
    """
    values, there = data.along, ~missing
    known = values[there]
    steps, growth = steps_of(known), noise_growth(values, missing, enough=RAYS_ENOUGH)
    quantum = 0.0 if steps is None else float(np.median(steps.at(known[:: max(1, known.size // 10_000)])))
    if data.sigma is not None:
        sigma, how, why = data.sigma, "given", ""
    elif growth is None:
        return Noise(0.0, quantum), data, ""
    else:
        sigma, how = growth.at(values).astype(data.depth.dtype), "differences"
        why = f"at the median depth; {growth.a:.3g} + {growth.b:.3g} z + {growth.c:.3g} z²"
        if steps is not None:
            least = (steps.at(values) / np.sqrt(12.0)).astype(sigma.dtype)
            why += ", at least step / sqrt 12" if (least > sigma)[there].mean() > 0.1 else ""
            sigma = np.maximum(sigma, least)
    typical = float(np.median(np.broadcast_to(sigma, there.shape)[there]))
    if typical <= 2.0 * np.finfo(data.depth.dtype).eps * float(np.abs(known).max()):
        return Noise(0.0, quantum, how=how), data, ""  # rounding of floating-point numbers is no noise
    data = replace(data, sigma=np.where(missing, typical, sigma) if np.ndim(sigma) else sigma)
    return Noise(typical, quantum, (typical,), 0.0, how), data, why


def excessive(data: Data, request: Request, noise: Noise) -> tuple[str, ...]:
    """A warning about a given noise, or strength, with which the noise exceeds all variation of the data."""
    if request.noise is None and request.strength <= 1.0:
        return ()
    values, there = array_of(data), slice(None) if isinstance(data, Mesh) else ~data.missing
    values = data.points if isinstance(data, Mesh) and data.moves == "points" else values[there]
    most = float((values.max(axis=0) - values.min(axis=0)).max()) if values.size else 0.0
    sigma = noise.sigma * request.strength
    if sigma <= most or most == 0:  # of equal values, and where none is known yet, nothing can be said
        return ()
    if request.noise is None:
        given, doubt = (
            f"strength {request.strength:g} times noise {noise.sigma:.4g}",
            "all that varies counts as noise",
        )
    else:
        given, doubt = f"noise {sigma:.4g}", "is it in their unit?"
    return (f"{given}: more than the largest difference of the values, {most:.4g}; {doubt}",)


def must_fit(data: Data, request: Request) -> None:
    """Refuse invalid numbers before the search."""
    (shape, n), held = size_of(data), request.constraints
    if held.max_change is not None and not isinstance(held.max_change, str):
        Limit.of(np.zeros((n, 1)), held.max_change, shape)
    if held.data_weights is not None:
        trust_of(held.data_weights, shape, n, 1.0)
    time = request.until_time
    if (
        isinstance(data, (HeightField, Image, Volume))
        and time is not None
        and not request.stops
        and request.steps is None
    ):
        widest = WIDEST * data.step * max(shape[:2])
        if np.sqrt(2.0 * time) > widest:
            raise InputError(
                f"time {time:g}: a Gaussian of {np.sqrt(2.0 * time):.4g}, more than {WIDEST:g} times as wide as the data, "
                f"would leave nothing but a mean; up to {widest**2 / 2.0:.3g} expected, or a stop beside it"
            )


def stepped(data: Data, request: Request) -> Request:
    """The request with half the step of quantized data as the largest change, if that is requested.

    :raises InputError: if the data is not quantized.
    """
    if not isinstance(request.constraints.max_change, str):
        return request
    values = array_of(data)
    there = np.isfinite(values)
    if not isinstance(data, Mesh):
        gone = data.missing if values.ndim == data.missing.ndim else data.missing[..., None]
        there = np.broadcast_to(~gone, values.shape)
    steps = steps_of(values[there])
    if steps is None:
        raise InputError(
            "max_change='step': the data is not quantized, there is no step; give a number, or one for each sample"
        )
    return replace(request, constraints=replace(request.constraints, max_change=steps.at(values) / 2.0))


def still(data: Data) -> bool:
    """Whether no sample may move."""
    still = data.fixed if isinstance(data, Mesh) else data.fixed | data.missing
    return bool(still.all())


def held(found: Plan) -> Plan:
    """The plan with the largest change and the data weights."""
    data, request = found.data, found.request
    limit, origin = limit_of(data, request, found.noise)
    if limit is not None and not isinstance(found.method, LeastBending):
        why = "half the quantum, rounding is the noise" if origin == "estimated" else ""
        found = found.with_({"max_change": Decided(origin, why)}, max_change=limit)
    if request.constraints.data_weights is None:
        return found
    pull = pull_of(found)
    found = replace(found, pull=pull)
    if request.until_time is None and (pull > 0).any():
        rest = AT_REST / float(np.median(pull[pull > 0]))
        found = found.with_({"time": Decided("default", "at rest between smoothness and data")}, time=rest)
    return found


def pull_of(found: Plan) -> Array:
    """The data weights of a plan, (n, k), (n, 1) or (1, 1), per time."""
    data, (shape, n) = found.data, size_of(found.data)
    pull = trust_of(found.request.constraints.data_weights, shape, n, found.lift.contrast)
    if isinstance(data, RangeImage) and data.stride is not None:
        pull = pull * data.stride.reshape(-1, 1) ** 2  # per squared footprint, the unit of time
    return pull


def ended(found: Plan) -> Plan:
    """The plan with the latest end of a run with stops."""
    if not found.request.stops or found.request.until_time is not None:
        return found
    why = Decided("default", "at most, where no stop is met")
    return found.with_({"time": why}, time=PATIENT * found.data.step**2)
