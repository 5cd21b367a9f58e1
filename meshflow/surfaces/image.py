"""Images: channels on a grid. Each sample may move along its channels."""

from dataclasses import dataclass, field, replace

import numpy as np

from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, Spacing, brief, mask_of, nowhere, samples, spacing_of, whole
from meshflow.surfaces.grid import Grid, Lift, OnGrid, held
from meshflow.surfaces.orientation import Orientation
from meshflow.surfaces.surface import Surface

__all__ = ["Image"]


@named_fields
@dataclass(frozen=True, eq=False)
class Image(OnGrid):
    """Channels on a grid: grey values, colours, a vector or tensor field. All channels are free and coupled.

    :param values: (h, w) or (h, w, k); a sample with a channel that is NaN, infinite or masked is missing.
    :param spacing: one number or (dx, dy), pixels by default.
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param period: the number of columns after which rows repeat, as in :class:`HeightField`.
    :param intensity: whether the values are intensities, on which the noise may depend; components of vectors are not.
    :raises InputError: as :class:`HeightField`.
    """

    values: Array
    spacing: Spacing = (1.0, 1.0)
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    period: int = 0
    intensity: bool = True

    def __post_init__(self) -> None:
        values, missing = samples(self.values, self.missing, (2, 3), "image")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, missing.shape, "fixed"))
        object.__setattr__(self, "spacing", spacing_of(self.spacing, missing.shape[0]))
        whole(self.period, "period", 0)

    def __repr__(self) -> str:
        return brief(self, self.values, self.missing)

    @property
    def step(self) -> float:
        """h: the typical distance of neighbours (the geometric mean of dx and dy)."""
        return float(np.sqrt(np.mean(self.spacing[0]) * self.spacing[1]))

    def gridded(self, lift: Lift) -> Grid:
        """The grid for an engine; the channels are not copied."""
        planes = self.values[None] if self.values.ndim == 2 else np.moveaxis(self.values, 2, 0)
        return self.grid(planes, self.missing, self.fixed, self.spacing, lift)

    def lifted(self, lift: Lift) -> Surface:
        """The surface (x, y, contrast c1, ..., contrast ck), of h * w vertices."""
        return self.gridded(lift).surface()

    def lowered(self, u: Array) -> "Image":
        """A copy with channels u (h * w, k), in their unit; missing samples keep their bits."""
        return replace(self, values=held(self.values, u, self.missing))

    def oriented(self, orientation: Orientation) -> "Image":
        """A reoriented copy; the same object if nothing changes."""
        if not orientation.changes:
            return self
        values = np.ascontiguousarray(orientation.of(self.values))
        missing, fixed = orientation.of_mask(self.missing), orientation.of_mask(self.fixed)
        spacing, period = orientation.of_spacing(self.spacing), 0 if orientation.transposed else self.period
        return replace(self, values=values, missing=missing, fixed=fixed, spacing=spacing, period=period)
