"""Looks for undeclared values that mark missing samples of a raster that is read by windows."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.io.formats.raster_windows import RasterReader
from meshflow.io.undeclared import Mark, mark_in, may_mark
from meshflow.large.source import Window, rows_and_columns

__all__ = ["marked"]


def marked(
    reader: RasterReader, ends: tuple[float, float], windows: Iterable[Window]
) -> tuple[RasterReader, Mark | None]:
    """The reader with an undeclared value as a mark, and that mark; the same reader and None where there is none.

    The samples are read again only where an end of their range is a value that programs write for missing ones.

    :param ends: the least and the greatest stored value.
    :param windows: that cover the raster.
    """
    dtype = np.dtype(reader.frame.dtype)
    asked = [end for end in dict.fromkeys(ends) if may_mark(end, dtype)]
    if not asked or reader.nodata is not None:
        return reader, None
    counts, low, high = dict.fromkeys(asked, 0), np.inf, -np.inf
    for window in windows:
        raw, gone = reader.stored(rows_and_columns(window))
        known = raw[~gone]
        rest = np.ones(known.shape, bool)
        for end in asked:
            at_end = known == end
            counts[end] += int(np.count_nonzero(at_end))
            rest &= ~at_end
        inner = known[rest].astype(np.float64)
        low, high = float(inner.min(initial=low)), float(inner.max(initial=high))
    few = _like(counts, (low, high), dtype)
    found = mark_in(few, np.zeros(few.shape, bool))
    if found is None:
        return reader, None
    found = replace(found, count=counts[found.value])
    frame = reader.frame if reader.frame.nodata is not None else replace(reader.frame, nodata=found.value)
    return replace(reader, frame=frame, marks=(*reader.marks, found.value)), found


def _like(counts: dict[float, int], rest: tuple[float, float], dtype: np.dtype) -> Array:
    """A few numbers with the ends of all samples."""
    few = [end for end, count in counts.items() for _ in range(min(count, 2))]
    return np.array([*few, *(end for end in rest if np.isfinite(end))]).astype(dtype)
