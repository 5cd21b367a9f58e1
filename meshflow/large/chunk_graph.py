"""The graphs of arrays of dask: chunks with their halos, the count of all, and the smoothed values."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from meshflow.estimate.constraints import Constraints
from meshflow.geometry.validation import Array
from meshflow.io.adapters.xarray import Described
from meshflow.large.census import joined
from meshflow.large.chunk_work import Step, Task, bound_by, counted_chunk, smoothed_chunk, stop_in, summed_chunk
from meshflow.large.legs import Leg
from meshflow.large.outcome import Measured
from meshflow.large.source import Form
from meshflow.large.stopping import Sought
from meshflow.large.windows import Local

__all__ = ["Chunked", "Lazy", "again", "census_of_chunks", "in_chunks_of", "moved", "stop_of_chunks"]

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
    :ivar measured: where chunks note what is removed from them; None: nowhere.
    """

    values: Chunked
    form: Form
    declared: tuple[Any, ...] = ()
    missing: Chunked | None = None
    said: Described | None = None
    notes: tuple[str, ...] = ()
    measured: Measured | None = None

    def holding(self, values: Chunked) -> object:
        """Other values as an object of the kind that was given."""
        return values if self.said is None else self.said.holding(values, anything_missing=True)


def in_chunks_of(grid: Lazy, sides: dict[str, Chunked], halo: int) -> tuple[Lazy, dict[str, Chunked], tuple[str, ...]]:
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


def again(values: Chunked, census: object) -> Chunked:
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


def around(grid: Lazy, sides: dict[str, Chunked], depth: tuple[int, ...]) -> dict[str, Chunked]:
    """The values, the missing samples and what else is given for each sample, every chunk with its halo.

    :param depth: of each axis, how many lines of its neighbours a chunk has on each side.
    """
    given = {"values": grid.values, **({} if grid.missing is None else {"missing": grid.missing}), **sides}
    if not any(depth):
        return given
    return {name: overlapped(array, depth) for name, array in given.items()}


def overlapped(array: Chunked, depth: tuple[int, ...]) -> Chunked:
    """An array, every chunk with its halo.

    :param depth: of each axis of the samples.
    """
    from dask.array.overlap import overlap

    wide = {axis: depth[axis] if axis < len(depth) else 0 for axis in range(array.ndim)}
    return overlap(array, wide, boundary="none") if any(depth) else array


def task_for(grid: Lazy, free: Constraints, halo: int, sides: Iterable[str]) -> Task:
    """What the chunks of a grid are told.

    :param halo: how many lines of their neighbours they have on each side.
    :param sides: the names of what else is given for each sample.
    """
    chunks = grid.values.chunks[: len(grid.form.shape)]
    depth = tuple(halo if len(one) > 1 else 0 for one in chunks)
    names = ("values", *(() if grid.missing is None else ("missing",)), *sides)
    return Task(grid.form.shape, chunks, grid.declared, free, depth, names, grid.measured)


def moved(
    grid: Lazy,
    local: Local,
    legs: Sequence[Leg],
    free: Constraints,
    sides: dict[str, Chunked],
    of_all: tuple[object, object],
) -> Chunked:
    """The smoothed values; chunks exchange their state between legs.

    :param of_all: the count of all chunks, and where they meet a stop (:func:`stop_of_chunks`), delayed; instead of the latter
        ``known``, where there is no stop, or its place is known.
    """
    import dask
    import dask.array as da
    from dask.array.utils import meta_from_array

    values, axes = grid.values, len(grid.form.shape)
    bound = dask.delayed(bound_by)(of_all[0], local)  # type: ignore[attr-defined]
    numbers = [da.from_array(np.arange(count), (1,)) for count in values.numblocks[:axes]]  # type: ignore[arg-type]
    lines = [part for array, index in zip(numbers, LETTERS, strict=False) for part in (array, index)]
    held, names = list[Chunked](), ()
    for leg in legs:
        last, task = leg is legs[-1], task_for(grid, free, leg.halo, sides)
        given = around(grid, sides, task.depth)
        pairs = [part for array in given.values() for part in (array, LETTERS[: array.ndim])]
        pairs += [part for array in held for part in (overlapped(array, task.depth), f"{LETTERS[:axes]}n")]
        after = () if last else local.legs.names_after(leg)
        index = LETTERS[: values.ndim] if last else f"{LETTERS[:axes]}m"
        made = da.blockwise(
            smoothed_chunk,
            index,
            *lines,
            *pairs,
            dtype=values.dtype,
            align_arrays=False,
            concatenate=True,
            new_axes=None if last else {"m": len(after) * (grid.form.channels or 1)},
            adjust_chunks=dict(zip(LETTERS[:axes], values.chunks, strict=False)),
            meta=meta_from_array(values, ndim=len(index)) if last else np.zeros((0,) * len(index), values.dtype),
            task=task,
            bound=bound,
            step=Step(leg, names, after),
            met=of_all[1],
        )
        held, names = [made], after
    return held[0]


def census_of_chunks(grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked]) -> Any:
    """The count of the whole, delayed; without its outliers where they are not taken as data."""
    import dask

    count = dask.delayed(counted_chunk)  # type: ignore[attr-defined]
    rule = local.cleaning.rule is not None
    grid, sides, _ = in_chunks_of(grid, sides if rule else {}, local.reach if rule else 0)
    task = task_for(grid, free, local.reach if rule else 0, sides)
    counts = [count(at, *blocks, task=task, local=local) for at, blocks in _blocks(grid, sides, task)]
    return dask.delayed(joined)(counts, grid.form)  # type: ignore[attr-defined]


def _blocks(grid: Lazy, sides: dict[str, Chunked], task: Task) -> Iterator[tuple[tuple[int, ...], list[object]]]:
    """The numbers of each chunk, and what it is given, delayed."""
    each = [
        array.to_delayed().reshape(grid.values.numblocks[: len(task.chunks)])
        for array in around(grid, sides, task.depth).values()
    ]
    for at in np.ndindex(each[0].shape):
        yield at, [blocks[at] for blocks in each]


def stop_of_chunks(
    grid: Lazy, local: Local, free: Constraints, sides: dict[str, Chunked], census: object, sought: Sought
) -> Any:
    """Where all chunks together meet a stop, delayed: each is run to the end of the steps that are known."""
    import dask

    grid, sides, _ = in_chunks_of(grid, sides, local.halo)
    task, sums = task_for(grid, free, local.halo, sides), dask.delayed(summed_chunk)  # type: ignore[attr-defined]
    bound = dask.delayed(bound_by)(census, local)  # type: ignore[attr-defined]
    each = [sums(at, *blocks, task=task, bound=bound, sought=sought) for at, blocks in _blocks(grid, sides, task)]
    lengths = local.legs.tracks[0].lengths
    return dask.delayed(stop_in)(each, sought, lengths)  # type: ignore[attr-defined]
