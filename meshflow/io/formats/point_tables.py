"""Tables of points (``.csv``, ``.tsv``, ``.xyz``): one point a line, its columns by name; one or several columns are smoothed."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions
from meshflow.io.metadata import ReadOptions, looked_up
from meshflow.surfaces.irregular import Irregular
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.on_sphere import OnSphere
from meshflow.surfaces.scattered import Scattered

__all__ = ["can_write", "is_scattered", "read", "write"]

NAME: str = "a table of points"
READS: tuple[str, ...] = ("kind", "channels", "nodata", "max_edge")
WRITES: tuple[str, ...] = ()

# The names of the columns of places, in lower case, and of heights.
_PLANE = (("x", "y"), ("easting", "northing"), ("east", "north"), ("e", "n"))
_DEGREES = (("lon", "lat"), ("longitude", "latitude"), ("long", "lat"), ("lng", "lat"))
_HEIGHTS = ("z", "height", "elevation", "h", "alt", "altitude", "elev", "depth")
_SEPARATORS = (",", ";", "\t")
# The mean radius of the Earth, metres (IUGG).
_EARTH = 6_371_008.8


@dataclass(frozen=True, eq=False)
class Table(Source):
    """A table as it was read.

    :param header: the names of its columns, in order.
    :param rows: its cells, as text.
    :param named: whether the first line has the names.
    :param separator: between cells; empty: blanks.
    :param columns: the numbers of the columns that are smoothed.
    :param samples_of_rows: the points with their values.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    named: bool
    separator: str
    columns: tuple[int, ...]
    samples_of_rows: Irregular

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per vertex: of a column by its name, or of an array with one for each line."""
        if isinstance(given, str):
            found = _numbers(self.rows, self.header.index(given)) if given in self.header else None
            given = looked_up(given, word, (found, self.header))
        return self.samples_of_rows.aligned(given)


def is_scattered(path: Path) -> bool:
    """Whether the lines of an ``.xyz`` are no grid, of which each x is there with each y."""
    try:
        _, rows, _, _ = _parsed(path)
        x, y = _numbers(rows, 0), _numbers(rows, 1)
    except (FormatError, IndexError):
        return False
    return len(np.unique(x)) * len(np.unique(y)) != len(rows)


def read(path: Path, options: ReadOptions) -> Document:
    """Read a table of points as a mesh of which one column moves.

    The places are the columns x and y, easting and northing, or lon and lat in degrees, in which case lengths are metres on the
    Earth. Without a line of names the columns are x, y, z and so on. A cell that is empty or no number is missing.

    :param options: ``channels``, the names of the columns that move, separated by commas; by default z, height or elevation, or
        the only other column of numbers. ``nodata``, a value that marks missing ones. ``max_edge``, the longest edge of a
        triangle.
    :raises FormatError: for a file that is no table.
    :raises InputError: for a column that is not there, or where it must be said which one moves.
    """
    if options.kind not in (None, "mesh", "terrain"):
        raise InputError(f"{path.name}: a table of points is a mesh, got kind={options.kind!r}; leave it out")
    header, rows, named, separator = _parsed(path)
    words = [name.strip().lower() for name in header]
    places, degrees = _places(words, path.name)
    if options.channels is not None and options.attribute is None:
        raise InputError(f"channels: the names of columns of {path.name} expected, separated by commas")
    moving = _moving(header, rows, places, options.attribute, path.name)
    x, y = (_numbers(rows, column) for column in places)
    values = np.stack([_numbers(rows, column) for column in moving], axis=1)
    if options.nodata is not None:
        values[values == options.nodata] = np.nan
    if degrees:
        points: Irregular = OnSphere(x, y, values, _EARTH, options.max_edge)
    else:
        points = Scattered(np.column_stack([x, y]), values, max_edge=options.max_edge)
    said = ", ".join(header[column] for column in moving)
    lengths = " (degrees; lengths in metres)" if degrees else ""
    note = Fact(f"{said} over {header[places[0]]} and {header[places[1]]}{lengths}: {points!r}")
    return Document(points.mesh, path, Table(header, rows, named, separator, moving, points), (note,))


def can_write(document: Document, suffix: str) -> bool:
    """Whether it came from a table."""
    return isinstance(document.source, Table) and suffix in (".csv", ".tsv", ".xyz")


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write the table that was read with the smoothed columns; all other cells, and missing ones, keep their text.

    Numbers have two decimals more than the column had, so that rounding does not undo the smoothing.

    :raises FormatError: when the file cannot be written, or the data came from another format.
    """
    source, data = document.source, document.data
    if not isinstance(source, Table) or not isinstance(data, Mesh):
        raise FormatError(f"{path.name}: a table is written of what came from one; use .ply or .npz")
    values = source.samples_of_rows.holding(data).columns
    there = source.samples_of_rows.vertices.home >= 0
    cells = [list(row) for row in source.rows]
    for column, numbers in zip(source.columns, values.T, strict=True):
        decimals = 2 + max(_decimals(row[column]) for row in source.rows)
        for row, number, known in zip(cells, numbers, there, strict=True):
            row[column] = f"{number:.{decimals}f}" if known else row[column]
    content = StringIO()
    lines = ([source.header] if source.named else []) + [tuple(row) for row in cells]
    if source.separator:
        csv.writer(content, delimiter=source.separator, lineterminator="\n").writerows(lines)
    else:
        content.write("".join(" ".join(line) + "\n" for line in lines))
    with beside(path) as temporary:
        temporary.write_text(content.getvalue(), encoding="utf-8")
    return ()


def _parsed(path: Path) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...], bool, str]:
    """The names of the columns, the cells of all lines, whether the names are in the file, and the separator.

    :raises FormatError: for a file without lines of equal length, or with fewer than two columns.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as cause:
        raise FormatError(
            f"{path.name}: a table of points in UTF-8 expected; {' '.join(str(cause).split())}"
        ) from cause
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    first = lines[0] if lines else ""
    separator = max(_SEPARATORS, key=first.count) if any(one in first for one in _SEPARATORS) else ""
    split = list(csv.reader(lines, delimiter=separator)) if separator else [line.split() for line in lines]
    rows = tuple(tuple(cell.strip() for cell in row) for row in split)
    if not rows or len(rows[0]) < 2:
        raise FormatError(f"{path.name}: a table of points, with columns such as x, y, z, expected, got {first[:40]!r}")
    named = not all(_is_number(cell) for cell in rows[0])
    header = rows[0] if named else tuple(("x", "y", "z", *(f"column {i}" for i in range(4, 99)))[: len(rows[0])])
    rows = rows[1:] if named else rows
    uneven = next((i for i, row in enumerate(rows, 1 + named) if len(row) != len(header)), None)
    if uneven is not None:
        got = len(rows[uneven - 1 - named])
        raise FormatError(f"{path.name}: {len(header)} columns in each line expected, line {uneven} has {got}")
    return header, rows, named, separator


def _places(words: Sequence[str], name: str) -> tuple[tuple[int, int], bool]:
    """The columns of the places, and whether they are degrees.

    :raises InputError: where there are none.
    """
    for pairs, degrees in ((_PLANE, False), (_DEGREES, True)):
        for one, other in pairs:
            if one in words and other in words:
                return (words.index(one), words.index(other)), degrees
    raise InputError(f"{name}: columns x and y, easting and northing, or lon and lat expected, got {', '.join(words)}")


def _moving(
    header: Sequence[str], rows: Sequence[Sequence[str]], places: tuple[int, int], given: str | None, name: str
) -> tuple[int, ...]:
    """The columns that move: those of the given names, heights, or the only column of numbers beside the places.

    :raises InputError: for a name that is not there, and where several would do.
    """
    numeric = [i for i in range(len(header)) if i not in places and np.isfinite(_numbers(rows, i)).any()]
    there = ", ".join(header[i] for i in numeric) or "none"
    if given is not None:
        wanted = [word.strip() for word in given.split(",")]
        strange = [word for word in wanted if word not in header or header.index(word) not in numeric]
        if strange:
            raise InputError(f"channels={strange[0]!r}: no such column of numbers in {name}; there are {there}")
        return tuple(header.index(word) for word in wanted)
    heights = [i for i in numeric if header[i].strip().lower() in _HEIGHTS]
    if heights or len(numeric) == 1:
        return ((heights or numeric)[0],)
    raise InputError(f"{name}: which column moves? Say channels='name'; there are {there}")


def _numbers(rows: Sequence[Sequence[str]], column: int) -> Array:
    """The numbers (n,) of a column; NaN where a cell is none."""
    return np.array([float(row[column]) if _is_number(row[column]) else np.nan for row in rows])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _decimals(cell: str) -> int:
    """The number of digits after the point; of a number with an exponent as many as it needs."""
    if not _is_number(cell) or not np.isfinite(float(cell)):
        return 0
    mantissa, _, exponent = cell.lower().partition("e")
    return max(0, len(mantissa.partition(".")[2]) - int(exponent or 0))
