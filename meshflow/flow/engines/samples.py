"""Flows on a grid by finite differences between samples, as the older papers write them."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.ndimage import gaussian_filter

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import System
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.wrapper import Around
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["SampleFlow", "Samples", "Scheme"]


@dataclass(frozen=True, eq=False)
class Samples:
    """Values on a grid, and their differences; over a border or a hole there is none, as if the values went on.

    :ivar values: (k, h, w).
    :ivar there: (h, w), samples that are present.
    :ivar spacing: (dx, dy).
    """

    values: Array
    there: Array
    spacing: tuple[float, float]

    def of(self, values: Array) -> "Samples":
        """Other values on the same grid."""
        return Samples(values, self.there, self.spacing)

    def at(self, down: int, right: int) -> Array:
        """The neighbours' values (k, h, w), those of the sample itself where there is no neighbour; offsets of -1, 0 or 1."""
        v = self.values
        wide = np.pad(v, ((0, 0), (1, 1), (1, 1)), mode="edge")
        has = np.pad(self.there, 1)
        h, w = self.there.shape
        window = slice(1 + down, 1 + down + h), slice(1 + right, 1 + right + w)
        return np.where(has[window], wide[:, *window], v)

    def forward(self) -> tuple[Array, Array]:
        """Difference quotients to the right and to below, 0 without a neighbour."""
        dx, dy = self.spacing
        return (self.at(0, 1) - self.values) / dx, (self.at(1, 0) - self.values) / dy

    def slopes(self) -> tuple[Array, Array]:
        """Central difference quotients u_x to the right, u_y to below."""
        dx, dy = self.spacing
        return (self.at(0, 1) - self.at(0, -1)) / (2 * dx), (self.at(1, 0) - self.at(-1, 0)) / (2 * dy)

    def around(self) -> tuple[Array, Array]:
        """The least and the greatest of a sample and its eight neighbours (k, h, w)."""
        near = [self.at(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return np.minimum.reduce(near), np.maximum.reduce(near)

    def curvatures(self) -> tuple[Array, Array, Array]:
        """u_xx, u_xy, u_yy by central differences."""
        (dx, dy), v = self.spacing, self.values
        xx = (self.at(0, 1) - 2 * v + self.at(0, -1)) / dx**2
        yy = (self.at(1, 0) - 2 * v + self.at(-1, 0)) / dy**2
        xy = (self.at(1, 1) - self.at(1, -1) - self.at(-1, 1) + self.at(-1, -1)) / (4 * dx * dy)
        return xx, xy, yy

    def blurred(self, sigma: float) -> Array:
        """G_sigma * values (k, h, w), sigma in samples, of the samples that are present (normalized convolution)."""
        if sigma == 0:
            return self.values
        weight = gaussian_filter(self.there.astype(np.float64), sigma, mode="nearest")
        weight = np.where(self.there, weight, 1.0)
        return np.stack([gaussian_filter(v * self.there, sigma, mode="nearest") / weight for v in self.values])


class Scheme(Protocol):
    """A finite difference scheme, du/dt of samples."""

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt (k, h, w), unit of the values per squared length.

        :param start: the values at time zero.
        """
        ...

    def fastest(self, spacing: tuple[float, float]) -> float:
        """Upper bound of the fastest decay, per squared length: explicit steps of at most 2 / this are stable."""
        ...

    def reach(self, samples: Samples, start: Samples) -> tuple[Array, Array] | None:
        """The least and the greatest value (k, h, w) that a step may give each sample; None: any.

        Central differences do not keep the range, as the equation does.
        """
        ...


class SampleFlow(Around):
    """A scheme as a flow: missing and fixed samples stay, and no scheme has a system for implicit steps.

    A scheme that keeps the range has rates with which the longest explicit step does. Stages of super-time steps do not, hence
    its pace is zero.

    :param grid: above which the samples move; one spacing for all rows.
    :param scheme: its rate.
    :param name: of the method, for messages.
    :raises InputError: for samples along rays, and rows of different spacing.
    """

    def __init__(self, grid: Grid, scheme: Scheme, name: str, threads: int | None = None) -> None:
        if grid.lines is not None:
            raise InputError(
                f"method={name!r}: only for height fields and images, got a range image; take domain='disparity', or "
                "kind='terrain'"
            )
        if np.ndim(grid.spacing[0]) and np.ptp(grid.spacing[0]):
            raise InputError(f"method={name!r}: one spacing for all rows expected; reproject the raster to metres")
        super().__init__(GridFlow(grid, None, threads))
        self._scheme, self._name, self._planes = scheme, name, grid.planes.shape
        self._spacing = float(np.mean(grid.spacing[0])), float(grid.spacing[1])
        self._there = ~grid.missing
        stays = grid.fixed.copy()
        if grid.boundary == "fixed":
            stays[[0, -1], :] = stays[:, [0, -1]] = True
        self._moves = self._there & ~stays
        self._first = self._samples(self.start())
        if scheme.reach(self._first, self._first) is not None:
            self.pace = 0.0

    def _samples(self, u: Array) -> Samples:
        return Samples(u.T.reshape(self._planes), self._there, self._spacing)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), or what the blend makes of it; zero where a sample is missing or fixed."""
        samples = self._samples(u)
        rate, reach = self._scheme.rate(samples, self._first), self._scheme.reach(samples, self._first)
        if reach is not None:
            fastest = 0.5 * self._scheme.fastest(self._spacing)
            rate = np.clip(rate, fastest * (reach[0] - samples.values), fastest * (reach[1] - samples.values))
        rate = rate * self._moves
        columns = np.ascontiguousarray(rate, dtype=u.dtype).reshape(self._planes[0], -1).T
        return blend.of_rate(u, columns, out)

    def bound(self, u: Array) -> float:
        """That of the scheme."""
        return self._scheme.fastest(self._spacing)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Not available.

        :raises InputError: always.
        """
        raise InputError(f"method={self._name!r}: it has explicit steps only; leave stepper='semi-implicit' out")
