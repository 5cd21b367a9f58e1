"""Smooths the tiles of a survey with one choice: by their georeference, neighbours supply the halo of each."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from rasterio.transform import Affine

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import Array
from meshflow.io.formats.raster_windows import raster_read
from meshflow.io.formats.rasters import spacing_in
from meshflow.io.metadata import ReadOptions
from meshflow.large.census import Census, Counted, bands, counted_in, joined
from meshflow.large.cleaning import bound_over
from meshflow.large.memory import Room
from meshflow.large.outcome import Outcome
from meshflow.large.outputs import Output, must_be_stored, must_be_writable
from meshflow.large.rasters import Gridded, Sheet, counted, gridded, written
from meshflow.large.running import Run, at_the_last_leg
from meshflow.large.sample import ENOUGH, sample_of
from meshflow.large.source import Form, Window, moved_by
from meshflow.large.stopping import stopped_by_all
from meshflow.large.windows import windowed

__all__ = ["Survey", "smooth_together"]

# How far a tile may lie beside the lattice of the first one, in samples; relative difference of their transforms.
OFF, ROUNDING = 1e-3, 1e-6


@dataclass(frozen=True, eq=False)
class Tile:
    """A raster of a survey.

    :ivar target: what is written for it; None: nothing, it is there for its neighbours.
    :ivar origin: row and column of its first sample in the lattice of the survey.
    """

    path: Path
    target: Path | None
    file: Gridded
    census: Census
    origin: tuple[int, int]
    notes: tuple[str, ...] = ()

    @property
    def place(self) -> Window:
        """Its window of the survey."""
        (top, left), (h, w) = self.origin, self.file.form.shape
        return slice(top, top + h), slice(left, left + w)


@dataclass(frozen=True, eq=False)
class _Opened:
    """A raster before it is known where it lies."""

    path: Path
    target: Path | None
    file: Gridded
    notes: tuple[str, ...]

    @property
    def kind(self) -> tuple[object, ...]:
        """What the tiles of a survey have in common."""
        form, transform = self.file.form, self.file.reader.frame.transform
        steps = tuple(round(getattr(transform, name), 9) for name in "abde")
        return self.file.reader.frame.crs, form.unit, form.channels, form.dtype, steps


@dataclass(frozen=True, eq=False)
class Survey:
    """All tiles as one grid; where there is none, samples are missing.

    :ivar form: of the grid.
    """

    form: Form
    tiles: tuple[Tile, ...] = field(repr=False)

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing."""
        shape = tuple(part.stop - part.start for part in window)
        values = np.zeros((*shape, *self.form.tail), self.form.dtype)
        missing = np.ones(shape, bool)
        for tile in self.tiles:
            common = [_common(one, other) for one, other in zip(window, tile.place, strict=True)]
            if any(part.start >= part.stop for part in common):
                continue
            at, inside = (
                (_from(common[0], one[0]), _from(common[1], one[1])) for one in (window, tile.place)
            )  # in the window, and in the tile
            values[at], missing[at] = tile.file.read(inside)
        return values, missing

    def counts(self, at_once: int) -> Iterator[Counted]:
        """The count of each tile, by bands of its rows."""
        for tile in self.tiles:
            for window in bands(tile.file.form, at_once):
                yield counted_in(moved_by(window, tile.place), *tile.file.read(window), self.form)


def smooth_together(
    pairs: Sequence[tuple[Path, Path | None]],
    request: Request,
    options: ReadOptions,
    writing: Output,
    progress: Progress = None,
) -> Iterator[tuple[Path, Outcome | Exception]]:
    """Smooth the tiles of a survey; together they equal the mosaic, smoothed by the same plan, bit for bit.

    The tiles that most of them are like give the lattice. A tile that does not suit it, or cannot be read, is refused, and where
    it lies is then a border for the others. One whose file is there already is refused, and its neighbours take their halo from
    it.

    :param pairs: of paths: each tile, and the GeoTIFF that is written for it; None: it is there for its neighbours.
    :param options: of the reader.
    :returns: the path of each tile, and its outcome or the refusal.
    :raises InputError: for what cannot be done by windows.
    """
    with ExitStack() as stack, request.compute.running():
        tiles, refused = _gathered(stack, pairs, options, writing)
        yield from refused.items()
        to_write = [tile.target for tile in tiles if tile.target is not None]
        if not to_write:
            return
        survey = _laid(tiles, options)
        census = joined(survey.counts(writing.budget.counted(survey.form)), survey.form)
        run = windowed(survey.form, sample_of(survey, writing.budget.sample(survey.form, ENOUGH)), request)
        bound = bound_over(run.local, survey, request.constraints, census, at_once=writing.budget.counted(survey.form))
        shapes = [tile.file.form.shape for tile in tiles]
        largest = tuple(max(shape[axis] for shape in shapes) for axis in (0, 1))
        room = Room(writing.budget, to_write[0].resolve().parent, writing.uncertainty is not None, largest)
        run, bound = stopped_by_all(run, bound, survey, request, room, progress)
        made = Run.of(bound, run, census, request, room)
        last = stack.enter_context(at_the_last_leg(survey, made, writing.budget, progress))
        for tile in survey.tiles:
            if tile.target is None:
                continue
            sheet, own = Sheet(tile.file, survey, tile.place), replace(last, census=tile.census)
            try:
                outcome = written(sheet, own, tile.target, writing, progress)
                yield tile.path, replace(outcome, notes=(*tile.notes, *outcome.notes))
            except (InputError, NotConverged, OSError, MemoryError) as refusal:
                yield tile.path, refusal


def _gathered(
    stack: ExitStack, pairs: Sequence[tuple[Path, Path | None]], options: ReadOptions, writing: Output
) -> tuple[list[Tile], dict[Path, Exception]]:
    """The tiles that suit each other, open until the stack ends, and why others are not written."""
    found, refused, tiles = list[_Opened](), dict[Path, Exception](), list[Tile]()
    for path, target in pairs:
        try:
            if target is not None:
                must_be_writable(target, writing)
        except (InputError, OSError) as refusal:
            refused[path], target = refusal, None
        try:
            found.append(_opened(stack, path, target, options, writing))
        except (InputError, OSError) as refusal:
            refused.setdefault(path, refusal)
    for one in _most_alike_first(found):
        try:
            tiles.append(_placed(one, writing, tiles))
        except (InputError, OSError) as refusal:
            refused.setdefault(one.path, refusal)
    return tiles, refused


def _opened(stack: ExitStack, path: Path, target: Path | None, options: ReadOptions, writing: Output) -> _Opened:
    """A raster that is open until the stack ends.

    :raises InputError: where it cannot be a tile; the message says why.
    """
    reader = stack.enter_context(raster_read(path, options))
    if target is not None:
        must_be_stored(reader, target, writing)
    file, notes = gridded(reader, options)
    if not file.reader.frame.georeferenced:
        raise InputError(f"{path.name}: tiles are put together by their georeference, and it has none")
    return _Opened(path, target, file, notes)


def _most_alike_first(found: Sequence[_Opened]) -> list[_Opened]:
    """The rasters with one of the largest group of like ones first, the first of it; none if nothing is to be written."""
    if all(one.target is None for one in found):
        return []
    counts = Counter(one.kind for one in found)
    first = next(one for one in found if counts[one.kind] == max(counts.values()))
    return [first, *(one for one in found if one is not first)]


def _placed(one: _Opened, writing: Output, tiles: Sequence[Tile]) -> Tile:
    """A tile that suits the first one.

    :raises InputError: where it does not; the message says in what.
    """
    path, file, frame = one.path, one.file, one.file.reader.frame
    origin = (0, 0)
    if tiles:
        first = tiles[0].file
        origin = _origin(path, frame.transform, first.reader.frame.transform)
        for word, own, theirs in (
            ("CRS", frame.crs, first.reader.frame.crs),
            ("unit", file.form.unit, first.form.unit),
            ("number of bands", file.form.channels, first.form.channels),
            ("number type", file.form.dtype, first.form.dtype),
        ):
            if own != theirs:
                raise InputError(
                    f"{path.name}: its {word} is {own}; the other tiles, such as {tiles[0].path.name}, have {theirs}"
                )
    file, census, more = counted(file, writing.budget, None)
    made = Tile(path, one.target, file, census, origin, (*one.notes, *more))
    for other in tiles:
        overlap = [_common(one, two) for one, two in zip(made.place, other.place, strict=True)]
        if all(part.start < part.stop for part in overlap):
            sizes = " x ".join(str(part.stop - part.start) for part in overlap)
            raise InputError(
                f"{path.name} overlaps {other.path.name} by {sizes} samples; cut it (gdal_translate -srcwin)"
            )
    return made


def _origin(path: Path, own: Affine, first: Affine) -> tuple[int, int]:
    """Row and column of the first sample of a tile in the lattice of the first one."""
    size = max(abs(first.a), abs(first.b), abs(first.d), abs(first.e))
    if any(abs(getattr(own, name) - getattr(first, name)) > ROUNDING * size for name in "abde"):
        raise InputError(
            f"{path.name}: samples {(first.a, first.e)} apart, as in the other tiles, expected, got {(own.a, own.e)}; "
            "resample it (gdalwarp)"
        )
    column, row = ~first * (own.c, own.f)
    if max(abs(row - round(row)), abs(column - round(column))) > OFF:
        raise InputError(
            f"{path.name}: it lies {row % 1:.3f} rows and {column % 1:.3f} columns off the grid of the other tiles; "
            "resample it (gdalwarp -tap)"
        )
    return round(row), round(column)


def _laid(tiles: Sequence[Tile], options: ReadOptions) -> Survey:
    """The tiles as one grid."""
    top, left = (min(tile.origin[axis] for tile in tiles) for axis in (0, 1))
    placed = tuple(replace(tile, origin=(tile.origin[0] - top, tile.origin[1] - left)) for tile in tiles)
    h, w = (max(tile.place[axis].stop for tile in placed) for axis in (0, 1))
    first = tiles[0].file
    spacing = first.form.spacing
    if options.spacing is None:
        frame = first.reader.frame
        moved = replace(frame, transform=frame.transform * Affine.translation(left, top))
        spacing = spacing_in(moved, first.form.unit, (h, w))[0]
    return Survey(replace(first.form, shape=(h, w), spacing=spacing), placed)


def _common(one: slice, other: slice) -> slice:
    """The lines that two parts have in common; empty where the start is not before the stop."""
    return slice(max(one.start, other.start), min(one.stop, other.stop))


def _from(part: slice, origin: slice) -> slice:
    """A part relative to the start of another one."""
    return slice(part.start - origin.start, part.stop - origin.start)
