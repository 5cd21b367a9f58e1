"""Smooths arrays of dask, and DataArrays of xarray that hold one: lazy in, lazy out, the same chunks."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeGuard

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.request import Request
from meshflow.flow.steppers import Explicit
from meshflow.geometry.validation import Array, real, spacing_of
from meshflow.io.adapters.xarray import Described, described
from meshflow.io.metadata import ReadOptions
from meshflow.large.census import joined
from meshflow.large.chunk_work import Task, counted_chunk, gone_in, smoothed_chunk
from meshflow.large.outcome import Outcome
from meshflow.large.sample import Places, Sample, places_in, sample_from
from meshflow.large.source import Form
from meshflow.large.windows import Local, Windowed, windowed
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume, steps_of

__all__ = ["Chunked", "is_chunked", "run_of_given", "sample_of_chunked", "smooth_chunked"]

# The names of axes.
LETTERS = "ijkl"


class Chunked(Protocol):
    """An array of dask, as far as it is used here."""

    shape: tuple[int, ...]
    ndim: int
    dtype: np.dtype
    chunks: tuple[tuple[int, ...], ...]
    numblocks: tuple[int, ...]

    def astype(self, dtype: np.dtype | type) -> "Chunked":
        """Another number type."""
        ...

    def rechunk(self, chunks: tuple[tuple[int, ...], ...] | dict[int, int]) -> "Chunked":
        """Other chunks."""
        ...

    def reshape(self, shape: tuple[int, ...]) -> "Chunked":
        """Another shape."""
        ...

    def __dask_graph__(self) -> object:
        """Its tasks."""
        ...

    def to_delayed(self) -> Array:
        """Its chunks, as objects that are computed later."""
        ...

    def __getitem__(self, at: object) -> "Chunked":
        """A part."""
        ...


@dataclass(frozen=True, eq=False)
class Lazy:
    """A grid whose samples are computed when they are asked for.

    :ivar values: (h, w) or (h, w, k), of a volume (d, h, w) or (d, h, w, k), float32 or float64, all channels in each chunk.
    :ivar form: of the grid.
    :ivar declared: values of missing samples.
    :ivar missing: (h, w) or (d, h, w), further samples that are missing, in the chunks of the values; None: none.
    :ivar said: of a DataArray; None of a dask array.
    :ivar notes: sentences for the user.
    """

    values: Chunked
    form: Form
    declared: tuple[Any, ...] = ()
    missing: Chunked | None = None
    said: Described | None = None
    notes: tuple[str, ...] = ()

    def holding(self, values: Chunked) -> object:
        """Other values as an object of the kind that was given."""
        return values if self.said is None else self.said.holding(values, anything_missing=True)


def is_chunked(data: object) -> bool:
    """Whether data is an array of dask, or a DataArray that holds one."""
    return _is_dask(data) or (type(data).__module__.startswith("xarray.") and _is_dask(getattr(data, "data", None)))


def smooth_chunked(
    data: object, request: Request, options: ReadOptions, run: Windowed | None = None
) -> tuple[Any, Outcome]:
    """Smooth chunks, each with a halo from its neighbours: what is computed equals the whole bit for bit.

    Samples are read at once only where noise, method, time, or the length of super-time steps are to be found: on tiles spread
    over the whole. The ends of all values are found when the result is computed, in a pass of its own.

    :param run: the plan, where it was found before.
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
    census, chunks = _census(grid, run.local, free, sides), grid.values.chunks
    grid, sides, said = _in_chunks_of(replace(grid, values=_again(grid.values, census)), sides, run.local.halo)
    done = _moved(grid, run.local, free, sides, census)
    back = grid.holding(done.rechunk(chunks) if said else done)
    found = replace(run.found, request=replace(run.found.request, compute=chosen))
    run = replace(run, found=found, warnings=(*grid.notes, *said, *run.warnings))
    return back, Outcome(run, int(np.prod(done.numblocks[: len(grid.form.shape)])), data=back)


def _is_dask(data: object) -> TypeGuard[Chunked]:
    return type(data).__module__.startswith("dask.array")


def _lazy(data: object, options: ReadOptions) -> Lazy:
    """Imports an array of dask or a DataArray; no sample is read."""
    said, unit, notes = None, options.unit or "", ()
    volume = options.kind == "volume"
    if _is_dask(data):
        options.must_belong("an array of dask", ("kind", "spacing", "missing", "nodata", "unit"))
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
    values = values.astype(dtype)
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
    return run if isinstance(run.local.plan.request.compute.stepper, Explicit) else None


def _asked(grid: Lazy, request: Request, free: Constraints, sides: dict[str, Chunked]) -> tuple[Sample, Request]:
    """The sample, and the request with the constraints as they are on it."""
    places = places_in(grid.form)
    parts = _taken([grid.values, *([] if grid.missing is None else [grid.missing]), *sides.values()], places)
    values, missing = parts[0], parts[1] if grid.missing is not None else None
    gone = gone_in(values, grid.declared, missing, len(grid.form.shape))
    sample = sample_from(grid.form, places, values, gone)
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
    return grid.form, sample_from(grid.form, places, parts[0], gone)


def _taken(arrays: list[Chunked], places: Places) -> list[Array]:
    """The samples of arrays at some places, computed together by the caller's scheduler."""
    import dask

    if not places.is_whole:
        at = tuple(np.maximum(lines, 0) for lines in places.axes)
        arrays = [_cut(array, at) for array in arrays]
    return [np.asarray(part) for part in dask.compute(*arrays)]  # type: ignore[attr-defined]


def _cut(array: Chunked, at: tuple[Array, ...]) -> Chunked:
    """Samples of an array at indices of each of its first axes."""
    for axis, lines in enumerate(at):
        array = array[(slice(None),) * axis + (lines,)]
    return array


def _in_chunks_of(grid: Lazy, sides: dict[str, Chunked], halo: int) -> tuple[Lazy, dict[str, Chunked], tuple[str, ...]]:
    """The grid in chunks that are no smaller than a halo, and a sentence where that changed them."""
    from dask.array.overlap import ensure_minimum_chunksize

    chunks, axes = grid.values.chunks, len(grid.form.shape)
    sized = [ensure_minimum_chunksize(min(halo, sum(one)), one) if min(one) < halo else one for one in chunks[:axes]]
    if tuple(sized) == chunks[:axes]:
        return grid, sides, ()
    before, after = (" x ".join(str(min(one)) for one in parts) for parts in (chunks[:axes], sized))
    said = (f"chunks of {before} samples are smaller than the halo of {halo}: they are computed in chunks of {after}",)
    values = grid.values.rechunk((*sized, *chunks[axes:]))
    missing = None if grid.missing is None else grid.missing.rechunk(tuple(sized))
    larger = {name: array.rechunk(values.chunks[: array.ndim]) for name, array in sides.items()}
    return replace(grid, values=values, missing=missing), larger, said


def _again(values: Chunked, census: object) -> Chunked:
    """The values once more, read after the count, so that they need not all be held until it is done.

    dask (2026.8) loses tasks when it copies graphs that slice, reshape or change chunks. Values are copied only where all they
    are made of is read, or computed chunk by chunk; others are held.
    """
    from dask.blockwise import Blockwise
    from dask.graph_manipulation import bind

    graph = values.__dask_graph__()
    layers, needed = getattr(graph, "layers", {}), getattr(graph, "dependencies", {})
    few = int(np.prod(values.numblocks)) + 1  # a task for each chunk, and what they are read from
    simple = all(
        isinstance(layer, Blockwise) or (not needed.get(name) and len(layer) <= few) for name, layer in layers.items()
    )
    return bind(values, census) if layers and simple else values


def _most_in(weights: Chunked) -> float:
    """The largest of weights, which shortens all steps; it is computed."""
    import dask.array as da

    return float(da.max(weights).compute())


def _around(grid: Lazy, sides: dict[str, Chunked], depth: tuple[int, ...]) -> dict[str, Chunked]:
    """The values, the missing samples and what else is given for each sample, every chunk with its halo.

    :param depth: of each axis, how many lines of its neighbours a chunk has on each side.
    """
    from dask.array.overlap import overlap

    given = {"values": grid.values, **({} if grid.missing is None else {"missing": grid.missing}), **sides}
    if not any(depth):
        return given
    axes = len(depth)
    wide = {axis: depth[axis] if axis < axes else 0 for axis in range(axes + 1)}
    return {
        name: overlap(array, {axis: wide[axis] for axis in range(array.ndim)}, boundary="none")
        for name, array in given.items()
    }


def _task(grid: Lazy, local: Local, free: Constraints, halo: int, sides: Iterable[str]) -> Task:
    """What the chunks of a grid are told.

    :param halo: how many lines of their neighbours they have on each side.
    :param sides: the names of what else is given for each sample.
    """
    chunks = grid.values.chunks[: len(grid.form.shape)]
    depth = tuple(halo if len(one) > 1 else 0 for one in chunks)
    names = ("values", *(() if grid.missing is None else ("missing",)), *sides)
    return Task(local, chunks, grid.declared, free, depth, names)


def _moved(grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked], census: object) -> Chunked:
    """The smoothed values."""
    import dask.array as da

    values, axes = grid.values, len(grid.form.shape)
    task = _task(grid, local, free, local.halo, sides)
    around = _around(grid, sides, task.depth).values()
    pairs = [part for array in around for part in (array, LETTERS[: array.ndim])]
    numbers = [da.from_array(np.arange(count), (1,)) for count in values.numblocks[:axes]]  # type: ignore[arg-type]
    lines = [part for array, index in zip(numbers, LETTERS, strict=False) for part in (array, index)]
    return da.blockwise(
        smoothed_chunk,
        LETTERS[: values.ndim],
        *lines,
        *pairs,
        dtype=values.dtype,
        align_arrays=False,
        adjust_chunks=dict(zip(LETTERS, values.chunks, strict=False)),
        meta=np.zeros((0,) * values.ndim, values.dtype),
        task=task,
        census=census,
    )


def _census(grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked]) -> Any:
    """The count of the whole, delayed; without its outliers where they are not taken as data."""
    import dask

    count = dask.delayed(counted_chunk)  # type: ignore[attr-defined]
    rule = local.cleaning.rule is not None
    grid, sides, _ = _in_chunks_of(grid, sides if rule else {}, local.reach if rule else 0)
    task = _task(grid, local, free, local.reach if rule else 0, sides)
    each = [
        array.to_delayed().reshape(grid.values.numblocks[: len(task.chunks)])
        for array in _around(grid, sides, task.depth).values()
    ]
    counts = [count(at, *(blocks[at] for blocks in each), task=task) for at in np.ndindex(each[0].shape)]
    return dask.delayed(joined)(counts, grid.form)  # type: ignore[attr-defined]
