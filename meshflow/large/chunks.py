"""Smooths arrays of dask, and DataArrays of xarray that hold one: lazy in, lazy out, the same chunks."""

from collections.abc import Sequence
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
        run = run or (_unseen(grid.form, request, free) if _is_given(request) else None)
        run = run or windowed(grid.form, *_asked(grid, request, free, sides))
    census, chunks = _census(grid), grid.values.chunks
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
    if values.ndim not in (axes, axes + 1) or any(np.isnan(values.shape)) or min(values.shape[:axes]) < 2:
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


def _gone(values: Array, declared: tuple[Any, ...], missing: Array | None, axes: int) -> Array:
    """Missing samples of a chunk.

    :param axes: of the samples, 2 or 3; one more of the values is that of their channels.
    """
    gone = ~np.isfinite(values)
    for value in declared:
        gone |= values == values.dtype.type(value)
    gone = gone if gone.ndim == axes else np.logical_or.reduce(gone, axis=axes)
    return gone if missing is None else gone | missing


def _is_given(request: Request) -> bool:
    """Whether nothing is left to be found: neither noise, nor method, nor contrast, nor the end."""
    ended = request.until_time is not None or request.steps is not None
    ruled = request.heights.contrast is not None or request.heights.variant.linear
    return request.named and ruled and ended and request.noise is not None


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
    gone = _gone(values, grid.declared, missing, len(grid.form.shape))
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
    gone = _gone(parts[0], grid.declared, parts[1] if len(parts) > 1 else None, len(grid.form.shape))
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


def _moved(grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked], census: object) -> Chunked:
    """The smoothed values."""
    import dask.array as da
    from dask.array.overlap import overlap

    values, axes = grid.values, len(grid.form.shape)
    depth = {axis: local.halo if len(values.chunks[axis]) > 1 else 0 for axis in range(axes)}
    names = [*(["missing"] if grid.missing is not None else []), *sides]
    arrays = [values, *([] if grid.missing is None else [grid.missing]), *sides.values()]
    wide = [overlap(array, {**depth, **({axes: 0} if array.ndim > axes else {})}, boundary="none") for array in arrays]
    pairs = [part for array in wide for part in (array, LETTERS[: array.ndim])]
    numbers = [da.from_array(np.arange(count), (1,)) for count in values.numblocks[:axes]]  # type: ignore[arg-type]
    lines = [part for array, index in zip(numbers, LETTERS, strict=False) for part in (array, index)]
    return da.blockwise(
        _block,
        LETTERS[: values.ndim],
        *lines,
        *pairs,
        dtype=values.dtype,
        align_arrays=False,
        adjust_chunks=dict(zip(LETTERS, values.chunks, strict=False)),
        meta=np.zeros((0,) * values.ndim, values.dtype),
        names=tuple(names),
        task=_Task(local, values.chunks[:axes], grid.declared, free, tuple(depth.values())),
        census=census,
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """What every chunk is told.

    :ivar chunks: of each axis.
    :ivar depth: of each axis, how many lines of its neighbours it has on each side.
    """

    local: Local
    chunks: tuple[tuple[int, ...], ...]
    declared: tuple[Any, ...]
    free: Constraints
    depth: tuple[int, ...]


def _block(*parts: Array, names: tuple[str, ...], task: _Task, census: Census) -> Array:
    """The smoothed values of a chunk.

    :param parts: of each axis (1,), the number of the chunk along it; its values; and what ``names`` names, with their halo.
    """
    axes = len(task.chunks)
    values, own = parts[axes], dict(zip(names, parts[axes + 1 :], strict=True))
    missing = _gone(values, task.declared, own.pop("missing", None), axes)
    inner = _window(task.chunks, [int(number[0]) for number in parts[:axes]])
    bound = task.local.over(census)
    shape = task.local.form.shape
    outer = tuple(grown(inner, depth, shape)[axis] for axis, depth in enumerate(task.depth))
    compute: Compute = bound.plan.request.compute
    with compute.running():
        return bound.moved((inner, outer), values, missing, replace(task.free, **own))


def _window(chunks: tuple[tuple[int, ...], ...], numbers: Sequence[int]) -> Window:
    """The window of a chunk.

    :param numbers: of the chunk along each axis.
    """
    begins = [sum(sizes[:i]) for sizes, i in zip(chunks, numbers, strict=True)]
    return tuple(slice(begin, begin + sizes[i]) for begin, sizes, i in zip(begins, chunks, numbers, strict=True))


def _census(grid: Lazy) -> Any:
    """The count of the whole, delayed."""
    import dask

    count = dask.delayed(_counted)  # type: ignore[attr-defined]
    axes = len(grid.form.shape)
    blocks = grid.values.to_delayed().reshape(grid.values.numblocks[:axes])
    masks = None if grid.missing is None else grid.missing.to_delayed()
    counts = [
        count(
            _window(grid.values.chunks[:axes], at),
            block,
            None if masks is None else masks[at],
            grid.declared,
            grid.form,
        )
        for at, block in np.ndenumerate(blocks)
    ]
    return dask.delayed(joined)(counts, grid.form)  # type: ignore[attr-defined]


def _counted(window: Window, values: Array, missing: Array | None, declared: tuple[Any, ...], form: Form) -> Counted:
    """The count of one chunk."""
    return counted_in(window, values, _gone(values, declared, missing, len(form.shape)), form)
