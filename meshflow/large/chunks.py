"""Smooths arrays of dask, and DataArrays of xarray that hold one: lazy in, lazy out, the same chunks."""

from dataclasses import replace
from typing import Any, TypeGuard

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.request import Request
from meshflow.flow.steppers import Explicit
from meshflow.geometry.validation import Array, real, spacing_of
from meshflow.io.adapters.xarray import described
from meshflow.io.formats.arrays import must_be_meant
from meshflow.io.metadata import ReadOptions
from meshflow.large.chunk_graph import Chunked, Lazy, again, census_of_chunks, in_chunks_of, moved, stop_of_chunks
from meshflow.large.chunk_work import gone_in
from meshflow.large.legs import Leg
from meshflow.large.outcome import Measured, Outcome
from meshflow.large.sample import Places, Sample, places_in, sample_from
from meshflow.large.source import Form
from meshflow.large.stopping import Sought
from meshflow.large.windows import Windowed, windowed
from meshflow.results.given_steps import is_uniform
from meshflow.results.run import engine_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume, steps_of

__all__ = ["Chunked", "is_chunked", "run_of_given", "sample_of_chunked", "smooth_chunked", "unsteady"]


def is_chunked(data: object) -> bool:
    """Whether data is an array of dask, or a DataArray that holds one."""
    return _is_dask(data) or (type(data).__module__.startswith("xarray.") and _is_dask(getattr(data, "data", None)))


def smooth_chunked(
    data: object, request: Request, options: ReadOptions, run: Windowed | None = None, *, measure: bool = False
) -> tuple[Any, Outcome]:
    """Smooth chunks, each with a halo from its neighbours: what is computed equals the whole bit for bit.

    Samples are read at once only where noise, method, time, or the length of super-time steps are to be found: on tiles spread
    over the whole. The ends of all values are found when the result is computed, in a pass of its own.

    :param run: the plan, where it was found before.
    :param measure: whether chunks note what is removed from them; they must then be computed in this process.
    :returns: the same kind of object, lazy and in the same chunks, and what is known before it is computed.
    :raises InputError: for what cannot be done by windows, and a camera.
    """
    grid, chosen = _lazy(data, options), request.compute
    if request.compute.threads is None:
        request = replace(request, compute=replace(request.compute, threads=1))
    given = {name: getattr(request.constraints, name) for name in request.constraints.arrays}
    sides = {name: _chunked_as(grid, array, name) for name, array in given.items()}
    free = replace(request.constraints, **dict.fromkeys(given))
    with request.compute.running():
        most = _most_in(sides["data_weights"]) if "data_weights" in sides else None
        known = free if most is None else replace(free, data_weights=most)
        run = run or (_unseen(grid.form, request, known) if _is_given(request) else None)
        run = run or windowed(grid.form, *_asked(grid, request, free, sides), most)
    if run.unsteady:
        raise unsteady(request)
    census, chunks = census_of_chunks(grid, run.local, free, sides), grid.values.chunks
    met: Any = "known"
    longer = run.longer
    if longer is not None:
        run = replace(run, local=run.local.ended(longer, None))
        sought = Sought.of(request, run.found.noise.sigma, grid.form.channels)
        local = sought.to_the_end(run.local, longer)
        met = stop_of_chunks(replace(grid, values=again(grid.values, census)), local, free, sides, census, sought)
    legs = _legs_for(grid, run)
    widest = max(leg.halo for leg in legs)
    measured = (Measured(),) if measure else ()
    grid = replace(grid, values=again(grid.values, census), measured=next(iter(measured), None))
    grid, sides, said = in_chunks_of(grid, sides, widest)
    done = moved(grid, run.local, legs, free, sides, (census, met))
    back = grid.holding(done.rechunk(chunks) if said else done)
    found = replace(run.found, request=replace(run.found.request, compute=chosen))
    run = replace(run, found=found, warnings=(*grid.notes, *said, *run.warnings))
    count = int(np.prod(done.numblocks[: len(grid.form.shape)]))
    return back, Outcome(run, count, data=back, legs=legs, measured=measured)


def unsteady(request: Request) -> InputError:
    """The refusal of a method whose steps follow from samples that are computed later."""
    return InputError(
        f"method={request.heights.word!r}: the lengths of its steps follow from all samples, and so does their number; "
        "compute() the array, smooth the file with the command (meshflow smooth), or take gamma of -1 or above"
    )


def _legs_for(grid: Lazy, run: Windowed) -> tuple[Leg, ...]:
    """The legs by which chunks have the least to compute."""
    shape = grid.form.shape
    typical = tuple(int(np.median(one)) for one in grid.values.chunks[: len(shape)])
    return run.local.legs.cheapest(lambda _: typical, shape)


def _is_dask(data: object) -> TypeGuard[Chunked]:
    return type(data).__module__.startswith("dask.array")


def _lazy(data: object, options: ReadOptions) -> Lazy:
    """Imports an array of dask or a DataArray; no sample is read."""
    said, unit, notes = None, options.unit or "", ()
    volume = options.kind == "volume"
    if _is_dask(data):
        options.must_belong("an array of dask", ("kind", "spacing", "missing", "nodata", "unit"))
        if options.kind is None:
            must_be_meant(data.shape)
        if options.kind not in (None, "terrain", "image", "volume") or (options.kind == "terrain" and data.ndim != 2):
            raise InputError(
                f"kind: terrain of shape (h, w), image or volume expected, got {options.kind!r} of shape {data.shape}"
            )
        values, kind = data, Image if data.ndim == 3 or options.kind == "image" else HeightField
        distances = 1.0 if options.spacing is None else options.spacing
        kind, spacing = (Volume, steps_of(distances)) if volume else (kind, spacing_of(distances, data.shape[0]))
    else:
        said = described(data, options)
        values, kind = said.ordered.data.reshape(said.shape), said.kind
        spacing, unit, notes = said.spacing, said.unit or unit, said.notes
    axes = 3 if volume else 2
    if any(np.isnan(values.shape)):
        raise InputError(
            f"chunks of known sizes expected, got the shape {values.shape}; call compute_chunk_sizes() of the array first"
        )
    if values.ndim not in (axes, axes + 1) or min(values.shape[:axes]) < 2:
        letters, least = ("d, h, w", "2 x 2 x 2") if volume else ("h, w", "2 x 2")
        raise InputError(
            f"an array of shape ({letters}) or ({letters}, k), at least {least} samples, expected, got {values.shape}"
        )
    dtype = real(np.zeros(1, values.dtype), "data").dtype
    values = values.astype(dtype) if said is None else _filled(values.astype(dtype))
    if values.ndim > axes:
        values = values.rechunk({axes: -1})
    shape = values.shape[:axes]
    form = Form(shape, values.shape[axes] if values.ndim > axes else None, dtype, spacing, kind, unit)
    missing = options.missing
    is_mark = missing is not None and np.ndim(missing) == 0
    marks = (None if said is None else said.nodata, options.nodata, missing if is_mark else None)
    declared = tuple(value for value in marks if value is not None)
    grid = Lazy(values, form, declared, None, said, notes)
    return (
        grid
        if missing is None or is_mark
        else replace(grid, missing=_chunked_as(grid, missing, "missing").astype(bool))
    )


def _filled(values: Chunked) -> Chunked:
    """Values of a DataArray, which has no mask: what is masked is NaN, as it is where xarray takes a masked array."""
    from dask.array.ma import filled
    from dask.array.utils import meta_from_array

    if not isinstance(meta_from_array(values), np.ma.MaskedArray):
        return values
    return filled(values, np.nan)


def _chunked_as(grid: Lazy, given: Any, name: str) -> Chunked:
    """Numbers per sample, or per value, in the chunks of the values; they may be lazy themselves."""
    import dask.array as da

    array = da.asarray(getattr(given, "data", given) if _is_dask(getattr(given, "data", None)) else given)
    if array.shape not in (grid.values.shape, grid.form.shape):
        raise InputError(f"{name}: one number per sample, shape {grid.form.shape}, expected, got {array.shape}")
    return array.rechunk(grid.values.chunks[: array.ndim])


def _is_given(request: Request) -> bool:
    """Whether nothing is left to be found: neither noise, nor method, nor contrast, nor the end, nor what an outlier is."""
    ended = (request.until_time is not None or request.steps is not None) and not request.stops
    ruled = request.heights.contrast is not None or request.heights.variant.linear
    looked_for = request.outliers in ("keep", "repair")
    return request.named and ruled and ended and request.noise is not None and not looked_for


def _unseen(form: Form, request: Request, free: Constraints) -> Windowed | None:
    """The plan of a request that leaves nothing to be found; None where the steps depend on samples."""
    shape = (2,) * len(form.shape) if form.kind is Volume else (2, max(form.shape))
    data = form.data(np.zeros((*shape, *form.tail), form.dtype), np.zeros(shape, bool), np.arange(2))
    sample = Sample(data, Places(tuple(map(np.arange, shape)), True))
    asked = replace(request, constraints=free, outliers=None if form.kind is Volume else "include")
    run = windowed(form, sample, asked)
    groups = run.local.plan.groups
    seen = groups is not None and groups.axes is not None  # of the channels
    explicit = all(isinstance(track.stepper, Explicit) for track in run.local.legs.tracks)
    return run if explicit and not seen and is_uniform(engine_of(run.found)) else None


def _asked(grid: Lazy, request: Request, free: Constraints, sides: dict[str, Chunked]) -> tuple[Sample, Request]:
    """The sample, and the request with the constraints as they are on it."""
    places = places_in(grid.form)
    parts = _taken([grid.values, *([] if grid.missing is None else [grid.missing]), *sides.values()], places)
    values, missing = parts[0], parts[1] if grid.missing is not None else None
    gone = gone_in(values, grid.declared, missing, len(grid.form.shape))
    sample = sample_from(grid.form, places, np.ma.getdata(values), gone)
    own = dict(zip(sides, parts[len(parts) - len(sides) :], strict=True))
    return sample, replace(request, constraints=replace(free, **own))


def run_of_given(data: object, request: Request, options: ReadOptions) -> Windowed | None:
    """The plan of a request that leaves nothing to be found, without reading a sample; None where it needs some."""
    if not _is_given(request):
        return None
    free = replace(request.constraints, **dict.fromkeys(request.constraints.arrays))
    return _unseen(_lazy(data, options).form, request, free)


def sample_of_chunked(data: object, options: ReadOptions, enough: int) -> tuple[Form, Sample]:
    """The form of chunks, and a sample of them, which is computed.

    :param enough: the largest number of its values.
    """
    grid = _lazy(data, options)
    places = places_in(grid.form, enough)
    parts = _taken([grid.values, *([] if grid.missing is None else [grid.missing])], places)
    gone = gone_in(parts[0], grid.declared, parts[1] if len(parts) > 1 else None, len(grid.form.shape))
    return grid.form, sample_from(grid.form, places, np.ma.getdata(parts[0]), gone)


def _taken(arrays: list[Chunked], places: Places) -> list[Array]:
    """The samples of arrays at some places, computed together by the caller's scheduler."""
    import dask

    if not places.is_whole:
        at = tuple(np.maximum(lines, 0) for lines in places.axes)
        arrays = [_cut(array, at) for array in arrays]
    return [np.asanyarray(part) for part in dask.compute(*arrays)]  # type: ignore[attr-defined]


def _cut(array: Chunked, at: tuple[Array, ...]) -> Chunked:
    """Samples of an array at indices of each of its first axes."""
    for axis, lines in enumerate(at):
        array = array[(slice(None),) * axis + (lines,)]
    return array


def _most_in(weights: Chunked) -> float:
    """The largest of weights, which shortens all steps; it is computed."""
    import dask.array as da

    return float(da.max(weights).compute())
