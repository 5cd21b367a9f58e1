"""Smooths arrays of dask, and DataArrays of xarray that hold one: lazy in, lazy out, the same chunks."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeGuard

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.steppers import Explicit
from meshflow.geometry.validation import Array, real, spacing_of
from meshflow.io.adapters.xarray import Described, described
from meshflow.io.metadata import ReadOptions
from meshflow.large.census import Census, Counted, counted_in, joined
from meshflow.large.outcome import Outcome
from meshflow.large.sample import Places, Sample, places_in, sample_from
from meshflow.large.source import Form, Window, grown
from meshflow.large.windows import Local, Windowed, windowed
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["Chunked", "is_chunked", "run_of_given", "sample_of_chunked", "smooth_chunked"]


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

    :ivar values: (h, w) or (h, w, k), float32 or float64, with all channels in each chunk.
    :ivar form: of the grid.
    :ivar declared: values of missing samples.
    :ivar missing: (h, w), further samples that are missing, in the chunks of the values; None: none.
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
        run = run or (_unseen(grid.form, request, free) if _is_given(request) else None)
        run = run or windowed(grid.form, *_asked(grid, request, free, sides))
    census, chunks = _census(grid), grid.values.chunks
    grid, sides, said = _in_chunks_of(replace(grid, values=_again(grid.values, census)), sides, run.local.halo)
    done = _moved(grid, run.local, free, sides, census)
    back = grid.holding(done.rechunk(chunks) if said else done)
    found = replace(run.found, request=replace(run.found.request, compute=chosen))
    run = replace(run, found=found, warnings=(*grid.notes, *said, *run.warnings))
    return back, Outcome(run, int(np.prod(done.numblocks[:2])), data=back)


def _is_dask(data: object) -> TypeGuard[Chunked]:
    return type(data).__module__.startswith("dask.array")


def _lazy(data: object, options: ReadOptions) -> Lazy:
    """Imports an array of dask or a DataArray; no sample is read."""
    said, unit, notes = None, options.unit or "", ()
    if _is_dask(data):
        options.must_belong("an array of dask", ("kind", "spacing", "missing", "nodata", "unit"))
        if options.kind not in (None, "terrain", "image") or (options.kind == "terrain" and data.ndim != 2):
            raise InputError(
                f"kind: terrain of shape (h, w) or image expected, got {options.kind!r} of shape {data.shape}"
            )
        values, kind = data, Image if data.ndim == 3 or options.kind == "image" else HeightField
        spacing = spacing_of(1.0 if options.spacing is None else options.spacing, data.shape[0])
    else:
        said = described(data, options)
        values, kind = said.ordered.data.reshape(said.shape), said.kind
        spacing, unit, notes = said.spacing, said.unit, said.notes
    if values.ndim not in (2, 3) or any(np.isnan(values.shape)) or min(values.shape[:2]) < 2:
        raise InputError(f"an array of shape (h, w) or (h, w, k), at least 2 x 2 samples, expected, got {values.shape}")
    dtype = real(np.zeros(1, values.dtype), "data").dtype
    values = values.astype(dtype)
    if values.ndim == 3:
        values = values.rechunk({2: -1})
    h, w = values.shape[:2]
    form = Form((h, w), values.shape[2] if values.ndim == 3 else None, dtype, spacing, kind, unit)
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
    """Numbers per sample (h, w) or (h, w, k) in the chunks of the values; they may be lazy themselves."""
    import dask.array as da

    array = da.asarray(getattr(given, "data", given) if _is_dask(getattr(given, "data", None)) else given)
    if array.shape not in (grid.values.shape, grid.values.shape[:2]):
        raise InputError(f"{name}: one number per sample, shape {grid.form.shape}, expected, got {array.shape}")
    return array.rechunk(grid.values.chunks[: array.ndim])


def _gone(values: Array, declared: tuple[Any, ...], missing: Array | None) -> Array:
    """Missing samples (r, c) of a chunk."""
    gone = ~np.isfinite(values)
    for value in declared:
        gone |= values == values.dtype.type(value)
    gone = gone if gone.ndim == 2 else np.logical_or.reduce(gone, axis=2)
    return gone if missing is None else gone | missing


def _is_given(request: Request) -> bool:
    """Whether nothing is left to be found: neither noise, nor method, nor contrast, nor the end."""
    ended = request.until_time is not None or request.steps is not None
    ruled = request.heights.contrast is not None or request.heights.variant.linear
    return request.named and ruled and ended and request.noise is not None


def _unseen(form: Form, request: Request, free: Constraints) -> Windowed | None:
    """The plan of a request that leaves nothing to be found; None where the steps depend on samples."""
    size = max(form.shape)
    values = np.zeros((2, size, *(() if form.channels is None else (form.channels,))), form.dtype)
    data = form.data(values, np.zeros((2, size), bool), np.arange(2))
    sample = Sample(data, Places(np.arange(2), np.arange(size), True))
    run = windowed(form, sample, replace(request, constraints=free, outliers="include"))
    return run if isinstance(run.local.plan.request.compute.stepper, Explicit) else None


def _asked(grid: Lazy, request: Request, free: Constraints, sides: dict[str, Chunked]) -> tuple[Sample, Request]:
    """The sample, and the request with the constraints as they are on it."""
    places = places_in(grid.form)
    parts = _taken([grid.values, *([] if grid.missing is None else [grid.missing]), *sides.values()], places)
    values, missing = parts[0], parts[1] if grid.missing is not None else None
    sample = sample_from(grid.form, places, values, _gone(values, grid.declared, missing))
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
    gone = _gone(parts[0], grid.declared, parts[1] if len(parts) > 1 else None)
    return grid.form, sample_from(grid.form, places, parts[0], gone)


def _taken(arrays: list[Chunked], places: Places) -> list[Array]:
    """The samples of arrays at some places, computed together by the caller's scheduler."""
    import dask

    if not places.is_whole:
        rows, columns = np.maximum(places.rows, 0), np.maximum(places.columns, 0)
        arrays = [array[rows][:, columns] for array in arrays]
    return [np.asarray(part) for part in dask.compute(*arrays)]  # type: ignore[attr-defined]


def _in_chunks_of(grid: Lazy, sides: dict[str, Chunked], halo: int) -> tuple[Lazy, dict[str, Chunked], tuple[str, ...]]:
    """The grid in chunks that are no smaller than a halo, and a sentence where that changed them."""
    from dask.array.overlap import ensure_minimum_chunksize

    chunks = grid.values.chunks
    sized = [ensure_minimum_chunksize(min(halo, sum(one)), one) if min(one) < halo else one for one in chunks[:2]]
    if tuple(sized) == chunks[:2]:
        return grid, sides, ()
    said = (
        f"chunks of {min(chunks[0])} x {min(chunks[1])} samples are smaller than the halo of {halo}: they are computed in chunks "
        f"of {min(sized[0])} x {min(sized[1])}",
    )
    values = grid.values.rechunk((*sized, *chunks[2:]))
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


def _moved(grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked], census: object) -> Chunked:
    """The smoothed values."""
    import dask.array as da
    from dask.array.overlap import overlap

    values = grid.values
    depth = {axis: local.halo if len(values.chunks[axis]) > 1 else 0 for axis in (0, 1)}
    names = [*(["missing"] if grid.missing is not None else []), *sides]
    arrays = [values, *([] if grid.missing is None else [grid.missing]), *sides.values()]
    wide = [overlap(array, {**depth, **({2: 0} if array.ndim == 3 else {})}, boundary="none") for array in arrays]
    pairs = [part for array in wide for part in (array, "ijk"[: array.ndim])]
    numbers = [da.from_array(np.arange(count), (1,)) for count in values.numblocks[:2]]  # type: ignore[arg-type]
    lines = [part for array, index in zip(numbers, "ij", strict=True) for part in (array, index)]
    return da.blockwise(
        _block,
        "ijk"[: values.ndim],
        *lines,
        *pairs,
        dtype=values.dtype,
        align_arrays=False,
        adjust_chunks=dict(zip("ijk", values.chunks, strict=False)),
        meta=np.zeros((0,) * values.ndim, values.dtype),
        names=tuple(names),
        task=_Task(local, values.chunks[:2], grid.declared, free, tuple(depth.values())),
        census=census,
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """What every chunk is told.

    :ivar chunks: of rows and of columns.
    :ivar depth: how many rows and columns of its neighbours it has on each side.
    """

    local: Local
    chunks: tuple[tuple[int, ...], ...]
    declared: tuple[Any, ...]
    free: Constraints
    depth: tuple[int, ...]


def _block(
    rows: Array, columns: Array, values: Array, *sides: Array, names: tuple[str, ...], task: _Task, census: Census
) -> Array:
    """The smoothed values of a chunk; each array comes with its halo.

    It has one parameter for each array of the graph, hence their number.

    :param rows: (1,), the number of the chunk along them; ``columns``: likewise.
    """
    own = dict(zip(names, sides, strict=True))
    missing = _gone(values, task.declared, own.pop("missing", None))
    inner = _window(task.chunks, int(rows[0]), int(columns[0]))
    bound = task.local.over(census)
    shape = task.local.form.shape
    high, wide = (grown(inner, depth, shape)[axis] for axis, depth in enumerate(task.depth))
    compute: Compute = bound.plan.request.compute
    with compute.running():
        return bound.moved((inner, (high, wide)), values, missing, replace(task.free, **own))


def _window(chunks: tuple[tuple[int, ...], ...], row: int, column: int) -> Window:
    """The window of a chunk."""
    top, left = sum(chunks[0][:row]), sum(chunks[1][:column])
    return slice(top, top + chunks[0][row]), slice(left, left + chunks[1][column])


def _census(grid: Lazy) -> Any:
    """The count of the whole, delayed."""
    import dask

    count = dask.delayed(_counted)  # type: ignore[attr-defined]
    blocks = grid.values.to_delayed().reshape(grid.values.numblocks[:2])
    masks = None if grid.missing is None else grid.missing.to_delayed()
    counts = [
        count(
            _window(grid.values.chunks, i, j),
            block,
            None if masks is None else masks[i, j],
            grid.declared,
            grid.form.shape,
        )
        for (i, j), block in np.ndenumerate(blocks)
    ]
    return dask.delayed(joined)(counts, grid.form)  # type: ignore[attr-defined]


def _counted(
    window: Window, values: Array, missing: Array | None, declared: tuple[Any, ...], shape: tuple[int, int]
) -> Counted:
    """The count of one chunk."""
    return counted_in(window, values, _gone(values, declared, missing), shape)
