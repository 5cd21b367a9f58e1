"""Opens the tiles of a survey, and finds where each lies in the lattice that they have in common."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np
from rasterio.transform import Affine

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.formats.raster_windows import raster_read, tags_of_run
from meshflow.io.formats.rasters import spacing_in
from meshflow.io.metadata import ReadOptions
from meshflow.large.census import Census, Counted, counted_in
from meshflow.large.outputs import Output, must_be_stored, must_be_writable
from meshflow.large.rasters import Gridded, counted, gridded
from meshflow.large.source import Form, Window, moved_by

__all__ = ["Pair", "Tile", "common", "gathered"]

# A raster, and what is written for it.
Pair = tuple[Path, Path]
# How far a tile may lie beside the lattice of the first one, in samples; relative difference of their transforms.
OFF, ROUNDING = 1e-3, 1e-6


@dataclass(frozen=True, eq=False)
class Tile:
    """A raster of a survey.

    :ivar target: what is written for it; None: nothing, it is there for its neighbours.
    :ivar place: its window of the survey.
    :ivar census: its own; ``counts``: of its bands of rows, as parts of the survey.
    :ivar digest: of its samples and those that are missing.
    :ivar there: the tags of the file of another run that lies at its target; None: none does.
    """

    path: Path
    target: Path | None
    file: Gridded
    place: Window
    census: Census
    counts: tuple[Counted, ...]
    digest: tuple[int, int]
    notes: tuple[str, ...] = ()
    there: Mapping[str, str] | None = None

    @property
    def identity(self) -> tuple[object, ...]:
        """Which samples it holds, and where they lie."""
        frame = self.file.reader.frame
        ends = [(part.start, part.stop) for part in self.place]
        return ends, self.digest, tuple(frame.transform), "" if frame.crs is None else frame.crs.to_wkt()


@dataclass(frozen=True, eq=False)
class _Opened:
    """A raster of which no sample was read yet.

    :ivar origin: row and column of its first sample in the lattice of the first one, once that is known.
    :ivar there: the tags of the file of another run that lies at its target.
    """

    path: Path
    target: Path | None
    file: Gridded
    notes: tuple[str, ...]
    there: Mapping[str, str] | None = None
    origin: tuple[int, int] = (0, 0)

    @property
    def kind(self) -> tuple[object, ...]:
        """What the tiles of a survey have in common."""
        form, transform = self.file.form, self.file.reader.frame.transform
        steps = tuple(round(getattr(transform, name), 9) for name in "abde")
        return self.file.reader.frame.crs, form.unit, form.channels, form.dtype, steps


def gathered(
    stack: ExitStack, pairs: Sequence[Pair], options: ReadOptions, writing: Output
) -> tuple[Form | None, list[Tile], dict[Path, Exception]]:
    """The grid of a survey, its tiles, open until the stack ends, and why others are refused.

    The tiles that most of them are like give the lattice. The grid is None where nothing is to be written.
    """
    found, refused = list[_Opened](), dict[Path, Exception]()
    for path, wanted in pairs:
        target, there = wanted, None
        try:
            there = _there(wanted, writing)
        except (InputError, OSError) as refusal:
            refused[path], target = refusal, None
        try:
            found.append(replace(_opened(stack, path, target, options, writing), there=there))
        except (InputError, OSError) as refusal:
            refused.setdefault(path, refusal)
    if all(one.target is None for one in found):
        return None, [], refused
    placed = list[_Opened]()
    for one in _most_alike_first(found):
        try:
            placed.append(replace(one, origin=_origin(one, placed[0])) if placed else one)
        except InputError as refusal:
            refused.setdefault(one.path, refusal)
    form, placed = _laid(placed, options)
    tiles = list[Tile]()
    for one in placed:
        try:
            tile = _counted(one, form, writing)
            _must_lie_beside(tile, tiles)
            tiles.append(tile)
        except (InputError, OSError) as refusal:
            refused.setdefault(one.path, refusal)
    return form, tiles, refused


def _there(target: Path, writing: Output) -> Mapping[str, str] | None:
    """The tags of a file of meshflow that lies at a target, where a run is resumed; None where it is written in any case.

    :raises FormatError: where it cannot be written.
    """
    found = tags_of_run(target) if writing.resume and target.is_file() else {}
    must_be_writable(target, replace(writing, overwrite=writing.overwrite or bool(found)))
    return found or None


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
    """The rasters with one of the largest group of like ones first, the first of it."""
    counts = Counter(one.kind for one in found)
    first = next(one for one in found if counts[one.kind] == max(counts.values()))
    return [first, *(one for one in found if one is not first)]


def _origin(one: _Opened, other: _Opened) -> tuple[int, int]:
    """Row and column of the first sample of a tile in the lattice of the first one.

    :raises InputError: where it does not suit that one; the message says in what.
    """
    name, frame, first = one.path.name, one.file.reader.frame, other.file.reader.frame
    form, like, own, lattice = one.file.form, other.file.form, frame.transform, first.transform
    size = max(abs(lattice.a), abs(lattice.b), abs(lattice.d), abs(lattice.e))
    if any(abs(getattr(own, each) - getattr(lattice, each)) > ROUNDING * size for each in "abde"):
        raise InputError(
            f"{name}: samples {(lattice.a, lattice.e)} apart, as in the other tiles, expected, got {(own.a, own.e)}; "
            "resample it (gdalwarp)"
        )
    column, row = ~lattice * (own.c, own.f)
    if max(abs(row - round(row)), abs(column - round(column))) > OFF:
        raise InputError(
            f"{name}: it lies {row % 1:.3f} rows and {column % 1:.3f} columns off the grid of the other tiles; "
            "resample it (gdalwarp -tap)"
        )
    for word, mine, theirs in (
        ("CRS", frame.crs, first.crs),
        ("unit", form.unit, like.unit),
        ("number of bands", form.channels, like.channels),
        ("number type", form.dtype, like.dtype),
    ):
        if mine != theirs:
            raise InputError(f"{name}: its {word} is {mine}; the other tiles, such as {other.path.name}, have {theirs}")
    return round(row), round(column)


def _laid(placed: Sequence[_Opened], options: ReadOptions) -> tuple[Form, list[_Opened]]:
    """The grid of all tiles, and they with their first samples in it."""
    top, left = (min(one.origin[axis] for one in placed) for axis in (0, 1))
    moved = [replace(one, origin=(one.origin[0] - top, one.origin[1] - left)) for one in placed]
    h, w = (max(one.origin[axis] + one.file.form.shape[axis] for one in moved) for axis in (0, 1))
    first = placed[0].file
    spacing = first.form.spacing
    if options.spacing is None:
        frame = first.reader.frame
        frame = replace(frame, transform=frame.transform * Affine.translation(left, top))
        spacing = spacing_in(frame, first.form.unit, (h, w))[0]
    return replace(first.form, shape=(h, w), spacing=spacing), moved


def _counted(one: _Opened, form: Form, writing: Output) -> Tile:
    """A tile whose samples were read once, and counted.

    :param form: of the survey.
    """
    (top, left), (h, w) = one.origin, one.file.form.shape
    place, counts = (slice(top, top + h), slice(left, left + w)), dict[int, Counted]()
    sums = (0, 0)

    def seen(window: Window, values: Array, missing: Array) -> None:
        """Count a band of rows as a part of the survey."""
        nonlocal sums
        counts[window[0].start] = counted_in(moved_by(window, place), values, missing, form)
        before = sums if window[0].start else (0, 0)  # the bands come in order, and anew where a mark was found
        sums = (
            crc32(np.ascontiguousarray(values).data, before[0]),
            crc32(np.ascontiguousarray(missing).data, before[1]),
        )

    file, census, more = counted(one.file, writing.budget, None, seen)
    notes = (*one.notes, *more)
    return Tile(one.path, one.target, file, place, census, tuple(counts.values()), sums, notes, one.there)


def _must_lie_beside(tile: Tile, others: Sequence[Tile]) -> None:
    """Refuse a tile that has samples in common with another one.

    :raises InputError: it names both.
    """
    for other in others:
        overlap = common(tile.place, other.place)
        if all(part.start < part.stop for part in overlap):
            sizes = " x ".join(str(part.stop - part.start) for part in overlap)
            raise InputError(
                f"{tile.path.name} overlaps {other.path.name} by {sizes} samples; cut it (gdal_translate -srcwin)"
            )


def common(one: Window, other: Window) -> Window:
    """The part that two windows have in common; empty where a start is not before its stop."""
    return tuple(slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
