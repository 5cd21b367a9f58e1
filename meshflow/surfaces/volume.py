"""Volumes: values on a grid of three axes. Each sample may move along its values."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError, NothingThere
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import (
    Array,
    mask_of,
    missing_among,
    must_have_squares,
    nowhere,
    positive,
    real,
    shown,
    slim,
)  # fmt: skip
from meshflow.surfaces.grid import Lift, Spacing, held
from meshflow.surfaces.orientation import lattice
from meshflow.surfaces.surface import Boundary, known_boundary
from meshflow.surfaces.triangles import Diagonals, triangulations

__all__ = [
    "Block",
    "Steps",
    "Volume",
    "WholeVolume",
    "coarse_lattice",
    "diagonal_order",
    "in_plane",
    "order_by",
    "steps_of",
]

# (dz, dy, dx).
Steps = tuple[float, float, float]
# Main diagonals of a cell: bit 0 of a number says that it runs against y, bit 1 that it runs against z.
_EVERY = (0, 1, 2, 3)
# The share of the sum of its absolute terms below which a moment is zero.
_ROUNDING = 1e-9


@named_fields
@dataclass(frozen=True, eq=False)
class Volume:
    """Values on a grid of three axes: magnetic resonance, computed tomography, seismics, confocal microscopy.

    All channels are free and coupled, as those of an :class:`Image` are.

    :param values: (d, h, w) or (d, h, w, k); a sample with a channel that is NaN, infinite or masked is missing.
    :param spacing: one number or (dz, dy, dx), the distances of slices, rows and columns; voxels by default.
    :param missing: (d, h, w), further samples that are missing.
    :param fixed: (d, h, w), samples that stay.
    :param unit: the name of the unit of lengths, for reports.
    :raises InputError: for fewer than 2 x 2 x 2 samples, no sample that is present, or a spacing that is not positive.
    """

    values: Array
    spacing: Steps = (1.0, 1.0, 1.0)
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    unit: str = ""
    boundary: Boundary = field(default="neumann", init=False)

    def __post_init__(self) -> None:
        values, missing = _samples(self.values, self.missing)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, missing.shape, "fixed"))
        object.__setattr__(self, "spacing", steps_of(self.spacing))

    def __repr__(self) -> str:
        d, h, w, *channels = self.values.shape
        size = f"{w} x {h} x {d}{''.join(f' x {k}' for k in channels)} {self.values.dtype}"
        dz, dy, dx = self.spacing
        unit = f" {self.unit}" if self.unit else ""
        return f"Volume({size}, spacing {dx:.6g} x {dy:.6g} x {dz:.6g}{unit}, {int(self.missing.sum())} missing)"

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours (the geometric mean of the spacing)."""
        return float(np.prod(self.spacing) ** (1.0 / 3.0))

    def gridded(self, lift: Lift) -> "Block":
        """The grid for an engine; the channels are not copied.

        :raises InputError: for the boundary ``plane-preserving``, which volumes do not have.
        """
        boundary = lift.boundary or self.boundary
        if boundary == "plane-preserving":
            raise InputError("boundary: neumann or fixed expected for a volume, got 'plane-preserving'")
        planes = self.values[None] if self.values.ndim == 3 else np.moveaxis(self.values, 3, 0)
        return Block(planes, self.missing, self.fixed, self.spacing, lift.contrast, lift.diagonals, boundary)

    def lowered(self, u: Array) -> "Volume":
        """A copy with channels u (d * h * w, k), in their unit; missing samples keep their bits."""
        return replace(self, values=held(self.values, u, self.missing))


@dataclass(frozen=True, eq=False)
class WholeVolume:
    """What a window of a volume takes from the whole, so that it computes the same bits.

    :param ends: the least and the greatest present number of its channels.
    :param order: of its diagonals (:func:`diagonal_order`).
    :param ragged: whether samples of it are missing.
    """

    ends: tuple[float, float]
    order: tuple[int, ...]
    ragged: bool = False


@dataclass(frozen=True, eq=False)
class Block:
    """A grid of three axes for an engine; the data object has checked it.

    :param planes: (k, d, h, w), the channels, float32 or float64; any number where missing.
    :param missing: (d, h, w).
    :param fixed: (d, h, w), samples that stay.
    :param spacing: (dz, dy, dx).
    :param contrast: length per unit of the planes.
    :param diagonals: of the four main diagonals of a cell: ``alternate``: in turn, and all four together where samples are
        missing; ``both``: all four together, ``forward``: the one along all axes, ``backward``: the one against y and z.
    :param boundary: ``neumann | fixed``.
    :param whole: of the volume of which this is a window; None: this is the whole.
    :raises InputError: for an unknown word for the diagonals or the boundary.
    """

    planes: Array
    missing: Array
    fixed: Array
    spacing: Steps = (1.0, 1.0, 1.0)
    contrast: float = 1.0
    diagonals: Diagonals = "alternate"
    boundary: Boundary = "neumann"
    whole: WholeVolume | None = None

    def __post_init__(self) -> None:
        triangulations(self.diagonals)
        known_boundary(self.boundary)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(d, h, w)."""
        d, h, w = self.missing.shape
        return d, h, w

    @property
    def ragged(self) -> bool:
        """Whether samples are missing, here or elsewhere in the whole volume."""
        return bool(self.missing.any()) if self.whole is None else self.whole.ragged

    @cached_property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """The main diagonals that a rate averages, first and last (not included), for the rates in turn."""
        # Beside missing samples a mode may be fast with one diagonal and at rest with the others: stages in turn make it grow.
        if self.diagonals == "alternate" and not self.ragged:
            order = diagonal_order(self.planes, self.missing) if self.whole is None else self.whole.order
            return tuple((i, i + 1) for i in order)
        return {"forward": ((0, 1),), "backward": ((3, 4),)}.get(self.diagonals, ((0, len(_EVERY)),))

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest present number."""
        if self.whole is not None:
            return self.whole.ends
        if not self.missing.any():
            return float(self.planes.min()), float(self.planes.max())
        there = np.broadcast_to(~self.missing, self.planes.shape)
        return (
            float(self.planes.min(where=there, initial=np.inf)),
            float(self.planes.max(where=there, initial=-np.inf)),
        )

    @cached_property
    def border(self) -> Array:
        """The samples (d, h, w) at a border: on a face of the volume, or beside a missing sample."""
        around = np.pad(self.missing, 1, constant_values=True)
        for axis in range(3):
            first, middle, last = (_along(around, axis, part) for part in (slice(-2), slice(1, -1), slice(2, None)))
            around = first | middle | last
        return around


def diagonal_order(planes: Array, missing: Array) -> tuple[int, ...]:
    """The four main diagonals of a cell in the order in which rates take them, which turns and mirrors with the data.

    The first one runs along each axis toward the side with more variation; the next ones are reversed along one axis each, first
    along that on which variation is spread most. Then mirrored or transposed data gives the mirrored or transposed result, but
    for rounding.

    :param planes: (k, d, h, w); ``missing``: (d, h, w).
    """
    at = np.ix_(*map(coarse_lattice, missing.shape))
    return order_by(planes[(slice(None), *at)], ~missing[at], missing.shape)


def coarse_lattice(size: int) -> Array:
    """Indices along an axis, symmetric about its middle: the slices that tell the order of the diagonals."""
    at = lattice(size)[:: max(1, size // 128)]
    return np.union1d(at, size - 1 - at)


def order_by(some: Array, there: Array, shape: tuple[int, ...]) -> tuple[int, ...]:
    """:func:`diagonal_order` for the samples of the :func:`coarse_lattice` along each axis.

    :param some: (k, ...); ``there``: those that are present.
    :param shape: (d, h, w), of the whole volume.
    """
    some = np.ascontiguousarray(np.where(there, some, 0), np.float64)
    some /= float(np.abs(some).max(initial=0.0)) or 1.0
    mean = some.sum(axis=(1, 2, 3), keepdims=True) / max(int(there.sum()), 1)
    energy = np.where(there, np.square(some - mean).sum(axis=0), 0.0)
    ways, spreads = [], []
    for axis, size in enumerate(shape):
        t = (2.0 * coarse_lattice(size) - (size - 1)) / (size - 1)
        along = energy.sum(axis=tuple(i for i in range(3) if i != axis))
        ways.append(-1 if any(_below_zero(along, weight) for weight in (t, t**3)) else 1)
        spreads.append(float((along * t * t).sum()))
    first = np.array(ways)
    turned = [first * np.where(np.arange(3) == axis, -1, 1) for axis in sorted(range(3), key=lambda i: -spreads[i])]
    return tuple(int(d[1] * d[2] < 0) | int(d[0] * d[2] < 0) << 1 for d in (first, *turned))


def _below_zero(along: Array, weight: Array) -> bool:
    """Whether a moment is below zero by more than rounding."""
    terms = along * weight
    return bool(terms.sum() < -_ROUNDING * np.abs(terms).sum())


def _along(array: Array, axis: int, part: slice) -> Array:
    """A part of an array along an axis."""
    return array[(slice(None),) * axis + (part,)]


def _samples(values: Any, missing: Any) -> tuple[Array, Array]:
    """Values of a volume and the mask (d, h, w) of missing samples.

    :raises InputError: for a volume of fewer than 2 x 2 x 2 samples, of wrong dimension, or without a sample that is present.
    """
    given = np.ma.getdata(values)
    if np.asarray(given).dtype == bool:
        raise InputError(
            "volume: a mask (booleans) has no noise to smooth; smooth the probability or the distance that it was cut from, or "
            "its isosurface as a mesh"
        )
    array = real(given, "volume")
    if array.ndim not in (3, 4) or array.shape[-1] == 0:
        raise InputError(f"volume: an array (d, h, w) or (d, h, w, k) expected, got shape {array.shape}")
    if min(array.shape[:3]) < 2:
        raise InputError(
            f"volume: at least 2 x 2 x 2 samples expected, got {array.shape}; a single slice is an image: "
            "give the array (h, w) with kind='image'"
        )
    must_have_squares(array, "volume")
    gone = missing_among(values, array, missing, 3)
    if gone.all():
        raise NothingThere(f"volume: all {gone.size} samples are missing (NaN, infinite or masked); nothing to smooth")
    return array, slim(gone)


def in_plane(spacing: Spacing | Steps) -> Spacing:
    """(dx, dy) of a grid of two axes, where a volume is possible.

    :raises TypeError: for the distances of a volume.
    """
    if len(spacing) == 3:
        raise TypeError(f"(dx, dy) expected, got the distances of a volume, {spacing}")
    return spacing


def steps_of(spacing: Any) -> Steps:
    """(dz, dy, dx); a single number is all three.

    :raises InputError: for anything but one or three positive numbers.
    """
    if np.ndim(spacing) == 0:
        same = positive(spacing, "spacing")
        return same, same, same
    if len(spacing) != 3:
        raise InputError(f"spacing: one number or (dz, dy, dx) expected for a volume, got {shown(spacing)}")
    dz, dy, dx = (positive(one, f"spacing {name}") for one, name in zip(spacing, ("dz", "dy", "dx"), strict=True))
    return dz, dy, dx
