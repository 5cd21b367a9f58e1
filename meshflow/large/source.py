"""Grids that are read by windows, and the windows that cover them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshflow.geometry.validation import Array, Spacing
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["Form", "Held", "OnGrid", "Source", "Window", "grown", "moved_by", "rows_of", "tiled", "within"]

OnGrid = HeightField | Image
Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Form:
    """A height field or an image without its samples.

    :param shape: (h, w).
    :param channels: the number of channels of an image; None: its values, or heights, have shape (h, w).
    :param dtype: float32 or float64.
    :param spacing: (dx, dy), dx a number or one per row.
    :param kind: the class of the data.
    :param unit: the name of the unit of heights; empty where it is not known.
    """

    shape: tuple[int, int]
    channels: int | None
    dtype: np.dtype
    spacing: Spacing
    kind: type[OnGrid]
    unit: str = ""

    @classmethod
    def of(cls, data: OnGrid) -> "Form":
        """The form of a data object."""
        values, (h, w) = array_of(data), data.missing.shape
        unit = data.unit if isinstance(data, HeightField) else ""
        return cls((h, w), values.shape[2] if values.ndim == 3 else None, values.dtype, data.spacing, type(data), unit)

    @property
    def values(self) -> int:
        """The number of values: samples times channels."""
        return self.shape[0] * self.shape[1] * (self.channels or 1)

    def data(self, values: Array, missing: Array, rows: slice | Array | None = None) -> OnGrid:
        """Values (r, c) or (r, c, k) of some rows as a data object.

        :param missing: (r, c).
        :param rows: of the grid; None: all.
        :raises InputError: where no sample is present.
        """
        spacing = self.spacing if rows is None else rows_of(self.spacing, rows)
        if self.kind is HeightField:
            return HeightField(values, spacing, missing, unit=self.unit)
        return Image(values, spacing, missing)


class Source(Protocol):
    """A height field or an image that is read by windows."""

    @property
    def form(self) -> Form:
        """What it is, without its samples."""
        ...

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing."""
        ...


@dataclass(frozen=True, eq=False)
class Held:
    """A grid in memory, as a source."""

    grid: OnGrid

    @property
    def form(self) -> Form:
        """What it is, without its samples."""
        return Form.of(self.grid)

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values and missing samples of a window."""
        return array_of(self.grid)[window], self.grid.missing[window]


def rows_of(spacing: Spacing, rows: slice | Array) -> Spacing:
    """The spacing of some rows of a grid."""
    dx, dy = spacing
    return (dx if np.ndim(dx) == 0 else np.asarray(dx)[rows]), dy


def tiled(shape: tuple[int, int], sides: tuple[int, int]) -> Iterator[Window]:
    """Windows of at most (rows, columns) ``sides`` that cover a grid, row by row."""
    (h, w), (high, wide) = shape, sides
    for top in range(0, h, high):
        for left in range(0, w, wide):
            yield slice(top, min(top + high, h)), slice(left, min(left + wide, w))


def grown(window: Window, by: int, shape: tuple[int, int]) -> Window:
    """A window with a halo of ``by`` samples, as far as the grid reaches."""
    rows, columns = (
        slice(max(part.start - by, 0), min(part.stop + by, size)) for part, size in zip(window, shape, strict=True)
    )
    return rows, columns


def moved_by(window: Window, place: Window) -> Window:
    """A window of a part of a grid as a window of the grid.

    :param place: of the part.
    """
    rows, columns = (
        slice(part.start + origin.start, part.stop + origin.start) for part, origin in zip(window, place, strict=True)
    )
    return rows, columns


def within(window: Window, outer: Window) -> Window:
    """A window as part of an outer one that contains it."""
    parts: Sequence[slice] = [
        slice(inner.start - around.start, inner.stop - around.start)
        for inner, around in zip(window, outer, strict=True)
    ]
    return parts[0], parts[1]
