"""How a grid lies: one of its eight turns and mirrors, chosen by the data, so that what is done to it does not depend on it."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.validation import Array, Spacing
from meshflow.surfaces.discontinuities import Cuts

__all__ = ["AS_IT_IS", "Orientation", "orientation_of"]

# Rows and columns that are looked at, at most; and the share of its terms below which a moment is their rounding.
ENOUGH, ROUNDING = 512, 1e-9


@dataclass(frozen=True)
class Orientation:
    """A turn or mirror of a grid: transposed first, then its rows and its columns reversed.

    :ivar transposed: rows become columns.
    :ivar rows: the order of the rows is reversed, ``columns``: that of the columns.
    """

    transposed: bool = False
    rows: bool = False
    columns: bool = False

    @property
    def changes(self) -> bool:
        """Whether anything is moved."""
        return self.transposed or self.rows or self.columns

    @property
    def inverse(self) -> "Orientation":
        """The one that undoes it."""
        rows, columns = (self.columns, self.rows) if self.transposed else (self.rows, self.columns)
        return Orientation(self.transposed, rows, columns)

    def of(self, array: Array) -> Array:
        """An array (h, w, ...) moved, a view."""
        turned = np.swapaxes(array, 0, 1) if self.transposed else array
        return turned[:: -1 if self.rows else 1, :: -1 if self.columns else 1]

    def of_samples(self, columns: Array, shape: tuple[int, int]) -> Array:
        """An array (h * w, k) of a grid (h, w), moved likewise."""
        return self.of(columns.reshape(*shape, -1)).reshape(len(columns), -1) if self.changes else columns

    def of_spacing(self, spacing: Spacing) -> Spacing:
        """(dx, dy) of the grid as it then lies; one dx per row cannot be transposed."""
        dx, dy = spacing
        if self.transposed:
            return float(dy), float(np.mean(dx))
        return (np.asarray(dx)[::-1] if self.rows and np.ndim(dx) else dx), dy

    def of_cuts(self, cuts: Cuts | None) -> Cuts | None:
        """Cuts between the samples as they then lie."""
        if cuts is None:
            return None
        right, down = self.of(cuts.right), self.of(cuts.down)
        return Cuts(down, right) if self.transposed else Cuts(right, down)


AS_IT_IS = Orientation()


def orientation_of(values: Array, missing: Array, spacing: Spacing) -> Orientation:
    """The orientation that data has of itself: turned or mirrored data comes to lie the same.

    What varies lies to the right and below, and extends along the rows: by moments of the squared deviation from the mean, which
    data upside down has, too, and of what is there; by higher ones where lower ones are zero. Data that is symmetric in all of
    them stays as it is.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    :param spacing: (dx, dy); rows of their own spacing stay rows.
    """
    h, w = missing.shape
    rows, columns = _some(h), _some(w)
    there = ~missing[np.ix_(rows, columns)]
    some = values.reshape(h, w, -1)[np.ix_(rows, columns)]
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


def _some(size: int) -> Array:
    """Places along a side, the same from either end."""
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
    """Whether the first moment that is more than rounding is below zero."""
    for field in fields:
        for weight in weights:
            terms = field * weight
            moment = float(terms.sum())
            if abs(moment) > ROUNDING * float(np.abs(terms).sum()):
                return moment < 0
    return False
