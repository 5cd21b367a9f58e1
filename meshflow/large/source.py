"""Grids of two or three axes that are read by windows, and the windows that cover them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from typing import Protocol

import numpy as np

from meshflow.geometry.validation import Array, Spacing
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Steps, Volume, in_plane

__all__ = [
    "Form",
    "Held",
    "OnGrid",
    "Source",
    "Window",
    "grown",
    "moved_by",
    "rows_and_columns",
    "rows_of",
    "tiled",
    "within",
]

OnGrid = HeightField | Image | Volume
# The samples along a side of the data that a plan keeps for its windows, which bring their own.
FEW = 2
# A slice of each axis.
Window = tuple[slice, ...]


@dataclass(frozen=True, eq=False)
class Form:
    """A height field, an image or a volume without its samples.

    :param shape: (h, w), of a volume (d, h, w).
    :param channels: the number of channels; None: its values, or heights, have that shape.
    :param dtype: float32 or float64.
    :param spacing: (dx, dy), dx a number or one per row; of a volume (dz, dy, dx).
    :param kind: the class of the data.
    :param unit: the name of the unit of heights, of a volume that of lengths; empty where it is not known.
    """

    shape: tuple[int, ...]
    channels: int | None
    dtype: np.dtype
    spacing: Spacing | Steps
    kind: type[OnGrid]
    unit: str = ""

    @classmethod
    def of(cls, data: OnGrid) -> "Form":
        """The form of a data object."""
        values, shape = array_of(data), data.missing.shape
        unit = "" if isinstance(data, Image) else data.unit
        channels = values.shape[-1] if values.ndim > len(shape) else None
        return cls(shape, channels, values.dtype, data.spacing, type(data), unit)

    @property
    def samples(self) -> int:
        """The number of samples."""
        return prod(self.shape)

    @property
    def values(self) -> int:
        """The number of values: samples times channels."""
        return self.samples * (self.channels or 1)

    @property
    def tail(self) -> tuple[int, ...]:
        """The shape of the channels of a sample: () or (k,)."""
        return () if self.channels is None else (self.channels,)

    @property
    def plane(self) -> Spacing:
        """(dx, dy) of a height field or an image.

        :raises TypeError: for a volume.
        """
        return in_plane(self.spacing)

    def few(self) -> OnGrid:
        """A few samples of such a grid, at distances of 1, to keep its kind."""
        axes = len(self.shape)
        some, none = np.zeros((*(FEW,) * axes, *self.tail), self.dtype), np.zeros((FEW,) * axes, bool)
        return replace(self, spacing=(1.0, 1.0, 1.0) if axes == 3 else (1.0, 1.0)).data(some, none)

    def data(self, values: Array, missing: Array, rows: slice | Array | None = None) -> OnGrid:
        """Values (r, c) or (r, c, k) of some rows as a data object; of a volume (s, r, c) or (s, r, c, k).

        :param missing: (r, c) or (s, r, c).
        :param rows: of a grid of two axes; None: all.
        :raises InputError: where no sample is present.
        """
        if len(self.spacing) == 3:
            return Volume(values, self.spacing, missing, unit=self.unit)
        spacing = self.spacing if rows is None else rows_of(self.spacing, rows)
        if self.kind is HeightField:
            return HeightField(values, spacing, missing, unit=self.unit)
        return Image(values, spacing, missing)


class Source(Protocol):
    """A height field, an image or a volume that is read by windows."""

    @property
    def form(self) -> Form:
        """What it is, without its samples."""
        ...

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing; of a volume with one axis more."""
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


def rows_and_columns(window: Window) -> tuple[slice, slice]:
    """A window of a grid of two axes as such."""
    rows, columns = window
    return rows, columns


def tiled(shape: tuple[int, ...], sides: tuple[int, ...]) -> Iterator[Window]:
    """Windows of at most ``sides`` that cover a grid, the last axis fastest."""
    yield from product(
        *(
            [slice(begin, min(begin + side, size)) for begin in range(0, size, side)]
            for size, side in zip(shape, sides, strict=True)
        )
    )


def grown(window: Window, by: int, shape: tuple[int, ...]) -> Window:
    """A window with a halo of ``by`` samples, as far as the grid reaches."""
    return tuple(
        slice(max(part.start - by, 0), min(part.stop + by, size)) for part, size in zip(window, shape, strict=True)
    )


def moved_by(window: Window, place: Window) -> Window:
    """A window of a part of a grid as a window of the grid.

    :param place: of the part.
    """
    return tuple(
        slice(part.start + origin.start, part.stop + origin.start) for part, origin in zip(window, place, strict=True)
    )


def within(window: Window, outer: Window) -> Window:
    """A window as part of an outer one that contains it."""
    return tuple(
        slice(inner.start - around.start, inner.stop - around.start)
        for inner, around in zip(window, outer, strict=True)
    )
