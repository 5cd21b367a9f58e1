"""Smooths the tiles of a survey with one choice: by their georeference, neighbours supply the halo of each."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import Array
from meshflow.io.metadata import ReadOptions
from meshflow.large.census import joined
from meshflow.large.cleaning import bound_over
from meshflow.large.memory import Room
from meshflow.large.outcome import Outcome
from meshflow.large.outputs import Output
from meshflow.large.rasters import Sheet, written
from meshflow.large.resuming import DEPENDS, digest_of, unlike
from meshflow.large.running import Block, Run, at_the_last_leg
from meshflow.large.sample import ENOUGH, sample_of
from meshflow.large.source import Form, Window, within
from meshflow.large.step_lengths import lengths_by_all
from meshflow.large.stopping import stopped_by_all
from meshflow.large.tiles import Pair, Tile, common, gathered
from meshflow.large.windows import windowed

__all__ = ["Survey", "grouped", "smooth_together"]


@dataclass(frozen=True, eq=False)
class Survey:
    """All tiles as one grid; where there is none, samples are missing.

    :ivar form: of the grid.
    """

    form: Form
    tiles: tuple[Tile, ...] = field(repr=False)

    @cached_property
    def _ends(self) -> Array:
        """(n, 2, 2): the begin and the end of each tile along each axis."""
        return np.array([[(part.start, part.stop) for part in tile.place] for tile in self.tiles])

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing."""
        shape = tuple(part.stop - part.start for part in window)
        values = np.zeros((*shape, *self.form.tail), self.form.dtype)
        missing = np.ones(shape, bool)
        begin, stop = ([getattr(part, end) for part in window] for end in ("start", "stop"))
        touched = ((self._ends[:, :, 0] < stop) & (self._ends[:, :, 1] > begin)).all(axis=1)
        for number in np.flatnonzero(touched):
            tile = self.tiles[number]
            both = common(window, tile.place)
            values[within(both, window)], missing[within(both, window)] = tile.file.read(within(both, tile.place))
        return values, missing


def smooth_together(
    pairs: Sequence[Pair], request: Request, options: ReadOptions, writing: Output, progress: Progress = None
) -> Iterator[tuple[Path, Outcome | Exception | None]]:
    """Smooth the tiles of a survey; together they equal the mosaic, smoothed by the same plan, bit for bit.

    The tiles that most of them are like give the lattice. A tile that does not suit it, or cannot be read, is refused, and where
    it lies is then a border for the others. One whose file is there already is refused, and its neighbours take their halo from
    it. Where a run is resumed, such a file is kept if it is what this run would write, and replaced if another run wrote it.

    :param pairs: of paths: each tile, and the GeoTIFF that is written for it.
    :param options: of the reader.
    :returns: the path of each tile, and its outcome or the refusal; None: its file is kept.
    :raises InputError: for what cannot be done by windows.
    """
    with ExitStack() as stack, request.compute.running():
        form, tiles, refused = gathered(stack, pairs, options, writing)
        yield from refused.items()
        folder = next((tile.target.resolve().parent for tile in tiles if tile.target is not None), None)
        if form is None or folder is None:
            return
        survey = Survey(form, tuple(tiles))
        census = joined((count for tile in tiles for count in tile.counts), form)
        run = windowed(form, sample_of(survey, writing.budget.sample(form, ENOUGH)), request)
        bound = bound_over(run.local, survey, request.constraints, census, at_once=writing.budget.counted(form))
        shapes = [tile.file.form.shape for tile in tiles]
        largest = (max(h for h, _ in shapes), max(w for _, w in shapes))
        room = Room(writing.budget, folder, writing.uncertainty is not None, largest)
        run, bound = lengths_by_all(run, bound, survey, request, room, progress)
        run, bound = stopped_by_all(run, bound, survey, request, room, progress)
        decisive = bound, request.constraints, writing.options, sorted(tile.identity for tile in tiles)
        own = {DEPENDS: digest_of(decisive)}
        tiles, kept = _undone(tiles, {**Outcome(run, 0).tags, **own})
        yield from dict.fromkeys(kept).items()
        if not tiles:
            return
        made = Run.of(bound, run, census, request, room)
        last = stack.enter_context(at_the_last_leg(survey, made, writing.budget, progress))
        fit = writing.window(form, last.leg)
        for group in grouped(tiles, largest, fit):
            block = Block(survey, last, _around(group), writing.uncertainty is not None) if len(group) > 1 else None
            for tile in group:
                sheet = Sheet(tile.file, survey, tile.place, block, own)
                yield tile.path, _written(tile, sheet, replace(last, census=tile.census), writing, progress)


def _undone(tiles: Sequence[Tile], tags: Mapping[str, str]) -> tuple[list[Tile], list[Path]]:
    """The tiles that are to be written, and the paths of those whose file is what this run would write.

    :param tags: of this run.
    """
    found, kept = list[Tile](), list[Path]()
    for tile in tiles:
        if tile.target is None:
            continue
        other = None if tile.there is None else unlike(tile.there, tags)
        if tile.there is None:
            found.append(tile)
        elif other is None:
            kept.append(tile.path)
        else:
            note = f"what was there was made with {other}, and is written again"
            found.append(replace(tile, notes=(*tile.notes, note)))
    return found, kept


def _written(tile: Tile, sheet: Sheet, run: Run, writing: Output, progress: Progress) -> Outcome | Exception:
    """The outcome of a tile, or why there is none."""
    if tile.target is None:
        raise ValueError(f"{tile.path}: nothing is written for it")
    try:
        outcome = written(sheet, run, tile.target, writing, progress)
    except (InputError, NotConverged, OSError, MemoryError) as refusal:
        return refusal
    return replace(outcome, notes=(*tile.notes, *outcome.notes))


def grouped(tiles: Sequence[Tile], largest: tuple[int, int], fit: Sequence[int]) -> list[list[Tile]]:
    """Groups of tiles that lie side by side, so that each group fits into one window.

    :param largest: the sides of the largest tile; ``fit``: those of a window.
    """
    counts = [side // own for side, own in zip(fit, largest, strict=True)]
    while min(counts) > 0 and max(counts) > 1:
        found = dict[tuple[int, ...], list[Tile]]()
        sides = [count * own for count, own in zip(counts, largest, strict=True)]
        for tile in tiles:
            cell = tuple(part.start // side for part, side in zip(tile.place, sides, strict=True))
            found.setdefault(cell, []).append(tile)
        groups = [found[cell] for cell in sorted(found)]
        wide = (part.stop - part.start <= side for g in groups for part, side in zip(_around(g), fit, strict=True))
        if all(wide):
            return groups
        # Tiles off the lattice of the cells reach beyond them.
        counts = [max(count - 1, 1) for count in counts]
    return [[tile] for tile in tiles]


def _around(tiles: Sequence[Tile]) -> Window:
    """The least window that holds all tiles of a group."""
    axes = range(len(tiles[0].place))
    return tuple(
        slice(min(t.place[axis].start for t in tiles), max(t.place[axis].stop for t in tiles)) for axis in axes
    )
