"""Height fields: elevations on a grid. Each sample may move along z."""

from dataclasses import dataclass, field, replace

import numpy as np

from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import (
    Array,
    Spacing,
    brief,
    mask_of,
    noise_of_samples,
    nowhere,
    samples,
    spacing_of,
    whole,
)
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Grid, Lift, OnGrid, held
from meshflow.surfaces.orientation import Orientation
from meshflow.surfaces.surface import Boundary, Surface

__all__ = ["HeightField"]


@named_fields
@dataclass(frozen=True, eq=False)
class HeightField(OnGrid):
    """Elevations on a grid; only z is free.

    :param z: (h, w), row 0 in the north; NaN, infinite and masked samples are missing. Integers become floating point.
    :param spacing: one number or (dx, dy) in the horizontal unit, dx a number or one per row (degrees on an ellipsoid).
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param unit: the name of the unit of z, for reports and pictures.
    :param cuts: edges of the grid that no triangle contains, for example across a fault.
    :param period: the number of columns after which rows repeat, as on a grid around a globe; 0: they do not repeat. Rows of
        w = period columns, or of one more whose last column repeats the first, are smoothed across their ends.
    :param sigma: the standard deviation of the noise, a number or (h, w), in the unit of z. Default: estimated, one number. Where
        it differs, the search counts each error in units of its own.
    :raises InputError: for fewer than 2 x 2 samples, no sample that is present, or a spacing that is not positive.
    """

    z: Array
    spacing: Spacing = (1.0, 1.0)
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    unit: str = ""
    cuts: Cuts | None = None
    period: int = 0
    sigma: Array | float | None = None
    boundary: Boundary = field(default="plane-preserving", init=False)

    def __post_init__(self) -> None:
        z, missing = samples(self.z, self.missing, (2,), "height field")
        object.__setattr__(self, "z", z)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, z.shape, "fixed"))
        if self.sigma is not None:
            object.__setattr__(self, "sigma", noise_of_samples(self.sigma, missing, "heights"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, z.shape[0]))
        whole(self.period, "period", 0)

    def __repr__(self) -> str:
        return brief(self, self.z, self.missing, f"spacing {self.step:.6g}", self.unit and f"heights in {self.unit}")

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours, in the horizontal unit (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Grid:
        """The grid for an engine; z is not copied."""
        grid = self.grid(self.z[None], self.missing, self.fixed, self.spacing, lift)
        return replace(grid, cuts=self.cuts)

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast z) of h * w vertices; missing samples have no triangles."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array) -> "HeightField":
        """A copy with elevations u (h * w, 1), in their unit; missing samples keep their bits."""
        return replace(self, z=held(self.z, u, self.missing))

    def oriented(self, orientation: Orientation) -> "HeightField":
        """A reoriented copy; the same object if nothing changes."""
        if not orientation.changes:
            return self
        z = np.ascontiguousarray(orientation.of(self.z))
        missing, fixed = orientation.of_mask(self.missing), orientation.of_mask(self.fixed)
        spacing, cuts = orientation.of_spacing(self.spacing), orientation.of_cuts(self.cuts)
        period = 0 if orientation.transposed else self.period
        sigma = orientation.of(self.sigma) if isinstance(self.sigma, np.ndarray) else self.sigma
        return replace(self, z=z, missing=missing, fixed=fixed, spacing=spacing, cuts=cuts, period=period, sigma=sigma)
