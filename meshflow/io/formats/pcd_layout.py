"""The layout of a PCD file of PCL, which is written with the same bytes around new points."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array

__all__ = ["PcdBytes", "loaded"]

_BEGIN = 8192
_CODES = {"F": "f", "I": "i", "U": "u"}
_KINDS = ("f4", "f8", *(f"{sign}{size}" for sign in "iu" for size in (1, 2, 4, 8)))
# The most that one byte of LZF stands for, rounded up.
_DENSEST = 100


@dataclass(frozen=True, eq=False)
class PcdBytes:
    """A PCD file.

    :param header: its bytes up to and including the line ``DATA``.
    :param body: the bytes after it.
    :param how: ``ascii | binary | binary_compressed``.
    :param words: the words of each line of the header, by the first.
    :param rows: (n,), the points as they are stored, a structured array.
    """

    header: bytes
    body: bytes
    how: str
    words: Mapping[str, tuple[str, ...]]
    rows: Array

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w) of the grid; h is 1 where the points have no order."""
        return int(self.words["HEIGHT"][0]), int(self.words["WIDTH"][0])

    @property
    def eye(self) -> Array:
        """(3,), where the scanner stood."""
        return np.array(self.words.get("VIEWPOINT", ("0", "0", "0"))[:3], np.float64)

    @property
    def points(self) -> Array:
        """(n, 3), float64."""
        with np.errstate(invalid="ignore"):  # signalling NaN
            return np.stack([self.rows[axis] for axis in "xyz"], axis=-1).astype(np.float64)

    def holding(self, points: Array) -> bytes:
        """The file with new points (n, 3); points that did not move keep their bits."""
        new = self.rows.copy()
        for axis, column in zip("xyz", points.T, strict=True):
            old = self.rows[axis].astype(np.float64)
            moved = (column != old) & ~np.isnan(column)
            new[axis][moved] = column[moved]
        if self.how == "binary":
            return self.header + new.tobytes() + self.body[new.nbytes :]
        if self.how == "binary_compressed":
            columns = b"".join(np.ascontiguousarray(new[name]).tobytes() for name in new.dtype.names or ())
            packed = _packed(columns)
            sizes = np.array([len(packed), len(columns)], "<u4").tobytes()
            return self.header + sizes + packed
        lines = self.body.decode("latin-1").split("\n")
        filled = [at for at, line in enumerate(lines) if line.strip()]
        places = _starts(new.dtype)
        for row in np.flatnonzero(new != self.rows):
            words = lines[filled[row]].split()
            for axis in "xyz":
                if new[axis][row] != self.rows[axis][row]:
                    words[places[axis]] = str(new[axis][row])
            lines[filled[row]] = " ".join(words)
        return self.header + "\n".join(lines).encode("latin-1")


def loaded(path: Path) -> PcdBytes:
    """Read a PCD file.

    :raises FormatError: for a header without what is needed, and a file that is cut off.
    """
    content = path.read_bytes()
    at = content.find(b"\nDATA", 0, _BEGIN)
    end = content.find(b"\n", at + 1) + 1 if at >= 0 else 0
    if not end:
        raise FormatError(f"{path.name}: not a PCD, whose header ends with a line DATA")
    lines = content[:end].decode("latin-1").splitlines()
    words = {parts[0]: tuple(parts[1:]) for line in lines if (parts := line.split("#")[0].split())}
    dtype = _dtype(path, words)
    how, count = words["DATA"][0] if words["DATA"] else "", _counted(path, words)
    if not all(axis in (dtype.names or ()) and dtype[axis].kind == "f" and not dtype[axis].shape for axis in "xyz"):
        raise FormatError(
            f"{path.name}: the fields x, y, z of one float each expected, got {' '.join(dtype.names or ())}"
        )
    body = content[end:]
    if how == "ascii":
        return PcdBytes(content[:end], body, how, words, _of_text(path, body, dtype, count))
    if how == "binary_compressed":
        return PcdBytes(content[:end], body, how, words, _of_columns(path, body, dtype, count))
    if how != "binary":
        raise FormatError(f"{path.name}: DATA ascii, binary or binary_compressed expected, got {how!r}")
    if len(body) < count * dtype.itemsize:
        raise _cut_off(path, count, dtype, len(body))
    return PcdBytes(content[:end], body, how, words, np.frombuffer(body, dtype, count))


def _cut_off(path: Path, count: int, dtype: np.dtype, there: int) -> FormatError:
    return FormatError(
        f"{path.name}: cut off, {count} points of {dtype.itemsize} bytes expected in {there} bytes; get the whole file"
    )


def _dtype(path: Path, words: Mapping[str, tuple[str, ...]]) -> np.dtype:
    """The type of a point; fields of padding, which share the name ``_``, are numbered."""
    fields, sizes, kinds = (words.get(word, ()) for word in ("FIELDS", "SIZE", "TYPE"))
    counts = words.get("COUNT", ("1",) * len(fields))
    columns, known = [], set()
    for number, (name, size, kind, many) in enumerate(zip(fields, sizes, kinds, counts, strict=False)):
        name = f"{name}:{number}" if name in known or name == "_" else name
        known.add(name)
        code = f"{_CODES.get(kind, '?')}{size}"
        if code not in _KINDS or not 0 < len(many) < 6 or not many.isdecimal():
            raise FormatError(f"{path.name}: the field {name} has the type {kind}, size {size}, count {many}")
        code = f"<{code}"
        columns.append((name, code) if many == "1" else (name, code, (int(many),)))
    if not columns or not len(fields) == len(sizes) == len(kinds) == len(counts):
        raise FormatError(f"{path.name}: FIELDS, SIZE, TYPE and COUNT of the same length expected in the header")
    return np.dtype(columns)


def _counted(path: Path, words: Mapping[str, tuple[str, ...]]) -> int:
    """The number of points."""
    numbers = []
    for word in ("WIDTH", "HEIGHT"):
        given = words.get(word, ())
        if len(given) != 1 or not given[0].isdecimal() or int(given[0]) == 0:
            raise FormatError(f"{path.name}: {word} with a whole number above zero expected, got {' '.join(given)!r}")
        numbers.append(int(given[0]))
    count = numbers[0] * numbers[1]
    if words.get("POINTS", (str(count),)) != (str(count),):
        raise FormatError(f"{path.name}: {numbers[0]} x {numbers[1]} points, but POINTS {' '.join(words['POINTS'])}")
    try:
        eye = np.array(words.get("VIEWPOINT", ("0", "0", "0"))[:3], np.float64)
    except ValueError:
        eye = np.array(np.nan)
    if eye.shape != (3,) or not np.isfinite(eye).all():
        raise FormatError(f"{path.name}: VIEWPOINT of finite numbers expected, got {' '.join(words['VIEWPOINT'])}")
    return count


def _starts(dtype: np.dtype) -> dict[str, int]:
    """The place of the first number of each field in a line."""
    places, at = {}, 0
    for name in dtype.names or ():
        places[name] = at
        at += int(np.prod(dtype[name].shape))
    return places


def _of_text(path: Path, body: bytes, dtype: np.dtype, count: int) -> Array:
    """Points of lines of numbers."""
    lines = [line.split() for line in body.decode("latin-1").split("\n") if line.strip()]
    width = sum(int(np.prod(dtype[name].shape)) for name in dtype.names or ())
    if len(lines) < count or any(len(line) < width for line in lines[:count]):
        raise FormatError(f"{path.name}: cut off, {count} lines of {width} numbers expected, got {len(lines)} lines")
    rows, places = np.zeros(count, dtype), _starts(dtype)
    for name in dtype.names or ():
        many = int(np.prod(dtype[name].shape))
        words = np.array([line[places[name] : places[name] + many] for line in lines[:count]])
        try:
            kind = dtype[name].base
            values = words.astype(np.float64 if kind.kind == "f" else kind)
        except (ValueError, OverflowError) as cause:
            raise FormatError(f"{path.name}: a number expected in the field {name} ({cause})") from cause
        rows[name] = values.reshape(rows[name].shape)
    return rows


def _of_columns(path: Path, body: bytes, dtype: np.dtype, count: int) -> Array:
    """Points of compressed fields, one after the other."""
    packed, size = (int(n) for n in np.frombuffer(body[:8].ljust(8, b"\0"), "<u4"))
    if size != count * dtype.itemsize or len(body) < 8 + packed or size > _DENSEST * max(packed, 1):
        raise _cut_off(path, count, dtype, len(body))
    content = _unpacked(body[8 : 8 + packed])
    if content is None or len(content) != size:
        raise FormatError(f"{path.name}: its compressed points cannot be unpacked; get the whole file")
    rows, at = np.zeros(count, dtype), 0
    for name in dtype.names or ():
        many = count * dtype[name].itemsize
        rows[name] = np.frombuffer(content[at : at + many], dtype[name].base).reshape(rows[name].shape)
        at += many
    return rows


def _unpacked(packed: bytes) -> bytes | None:
    """What LZF has compressed; None for what it cannot have written."""
    out, at = bytearray(), 0
    try:
        while at < len(packed):
            token = packed[at]
            at += 1
            if token < 32:
                out += packed[at : at + token + 1]
                at += token + 1
                continue
            length = (token >> 5) + 2
            if length == 9:
                length += packed[at]
                at += 1
            start = len(out) - ((token & 31) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                return None
            piece = out[start : start + length]
            out += piece if len(piece) == length else (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        return None
    return bytes(out)


def _packed(content: bytes) -> bytes:
    """Bytes as LZF holds those that do not repeat."""
    pieces = (content[at : at + 32] for at in range(0, len(content), 32))
    return b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)
