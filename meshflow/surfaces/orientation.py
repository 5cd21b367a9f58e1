"""Rotations and reflections of a grid. Data is brought to a standard orientation, so that results do not depend on the given
one.
"""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.validation import Array, Spacing, false_on
from meshflow.surfaces.discontinuities import Cuts

__all__ = ["AS_IT_IS", "Orientation", "lattice", "orientation_by", "orientation_of"]

# The largest numbers of rows and of columns that are used; and the share of the sum of its absolute terms below which a moment
# is zero.
ENOUGH, ROUNDING = 512, 1e-9


@dataclass(frozen=True)
class Orientation:
    """A rotation or reflection of a grid: a transposition, followed by reversals of rows and of columns.

    :ivar transposed: whether rows become columns.
    :ivar rows: whether the order of the rows is reversed; ``columns``: that of the columns.
    """

    transposed: bool = False
    rows: bool = False
    columns: bool = False

    @property
    def changes(self) -> bool:
        """Whether it differs from the identity."""
        return self.transposed or self.rows or self.columns

    @property
    def inverse(self) -> "Orientation":
        """The inverse orientation."""
        rows, columns = (self.columns, self.rows) if self.transposed else (self.rows, self.columns)
        return Orientation(self.transposed, rows, columns)

    def of(self, array: Array) -> Array:
        """A reoriented view of an array (h, w, ...)."""
        turned = np.swapaxes(array, 0, 1) if self.transposed else array
        return turned[:: -1 if self.rows else 1, :: -1 if self.columns else 1]

    def of_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """The shape of a reoriented array."""
        return shape[1::-1] + shape[2:] if self.transposed else shape

    def of_window(self, window: tuple[slice, ...], shape: tuple[int, ...]) -> tuple[slice, ...]:
        """A window of a grid as one of the reoriented grid.

        :param shape: of the grid, before.
        """
        parts, sizes = (window[1::-1], shape[1::-1]) if self.transposed else (window[:2], shape[:2])
        turned = (
            slice(size - part.stop, size - part.start) if reversed_ else part
            for part, size, reversed_ in zip(parts, sizes, (self.rows, self.columns), strict=True)
        )
        return (*turned, *window[2:])

    def of_mask(self, mask: Array) -> Array:
        """A reoriented mask (h, w) in the order of memory; one that is false everywhere takes no memory."""
        turned = self.of(mask)
        return np.ascontiguousarray(turned) if turned.any() else false_on(turned.shape)

    def of_samples(self, columns: Array, shape: tuple[int, int]) -> Array:
        """The reoriented array (h * w, k) of a grid (h, w)."""
        return self.of(columns.reshape(*shape, -1)).reshape(len(columns), -1) if self.changes else columns

    def of_spacing(self, spacing: Spacing) -> Spacing:
        """The spacing (dx, dy) of the reoriented grid; one dx per row cannot be transposed."""
        dx, dy = spacing
        if self.transposed:
            return float(dy), float(np.mean(dx))
        return (np.asarray(dx)[::-1] if self.rows and np.ndim(dx) else dx), dy

    def of_cuts(self, cuts: Cuts | None) -> Cuts | None:
        """The cuts of the reoriented grid."""
        if cuts is None:
            return None
        right, down = self.of(cuts.right), self.of(cuts.down)
        return Cuts(down, right) if self.transposed else Cuts(right, down)


AS_IT_IS = Orientation()


def orientation_of(values: Array, missing: Array, spacing: Spacing) -> Orientation:
    """The orientation that brings data to its standard orientation, the same for rotated and reflected data.

    In the standard orientation most variation is at the right and below, and extends along the rows. This is decided by moments
    of the squared deviation from the mean, which do not change for data upside down, and of the mask of present samples; by
    higher moments if the lower ones are zero. Data for which all of them are zero keeps its orientation.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    :param spacing: (dx, dy); a grid with one dx per row is not transposed.
    """
    h, w = missing.shape
    at = np.ix_(lattice(h), lattice(w))
    return orientation_by(values.reshape(h, w, -1)[at], ~missing[at], (h, w), spacing)


def orientation_by(some: Array, there: Array, shape: tuple[int, int], spacing: Spacing) -> Orientation:
    """:func:`orientation_of` for the samples of the :func:`lattice` along both sides.

    :param some: (r, c, k); ``there``: (r, c), those that are present.
    :param shape: (h, w), of the whole grid.
    """
    h, w = shape
    rows, columns = lattice(h), lattice(w)
    with np.errstate(over="ignore", invalid="ignore"):
        energy = _energy(np.where(there[..., None], some, 0).astype(np.float64), there)
    fields = [field for field in (energy, there.astype(np.float64)) if np.isfinite(field).all()]
    y, x = ((2.0 * at - (size - 1)) / max(size - 1, 1) for at, size in ((rows[:, None], h), (columns[None, :], w)))
    mirrored = [_negative(fields, (a, a**3, a * b * b)) for a, b in ((y, x), (x, y))]
    if np.ndim(spacing[0]):
        return Orientation(False, *mirrored)
    dx, dy = float(spacing[0]), float(spacing[1])
    transposed = h > w if h != w else dy > dx
    if h == w and dx == dy:
        transposed = _negative(fields, (x * x - y * y, x**4 - y**4))
    return Orientation(transposed, *(mirrored[::-1] if transposed else mirrored))


def lattice(size: int) -> Array:
    """Indices along a side, symmetric about its middle: the rows or columns that tell an orientation."""
    places = np.arange(size) if size <= ENOUGH else np.linspace(0, size - 1, ENOUGH // 2).astype(int)
    return np.unique(np.concatenate([places, size - 1 - places]))


def _energy(some: Array, there: Array) -> Array:
    """The squared deviation (h, w) of samples (h, w, k) from their mean, all channels together; zero where missing."""
    count = max(int(there.sum()), 1)
    size = float(np.abs(some).max(initial=0.0)) or 1.0
    some = some / size
    mean = some.sum(axis=(0, 1)) / count
    return np.where(there, np.square(some - mean).sum(axis=2), 0.0)


def _negative(fields: list[Array], weights: tuple[Array, ...]) -> bool:
    """Whether the first moment that is not zero up to rounding is negative."""
    for field in fields:
        for weight in weights:
            terms = field * weight
            moment = float(terms.sum())
            if abs(moment) > ROUNDING * float(np.abs(terms).sum()):
                return moment < 0
    return False
