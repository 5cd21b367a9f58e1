"""Vector fields on a grid of two or three axes: velocities, displacements, gradients."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, Spacing, mask_of, nowhere, real, spacing_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Steps, Volume, steps_of

__all__ = ["Vectors", "with_channels"]


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class Vectors:
    """Vectors of two or three components on a grid, as a whole, or direction and magnitude apart.

    As a whole, the components are coupled channels, in any coordinate system; where directions meet, the mean is short.
    Apart, magnitudes are smoothed separately, and directions are those of the vectors smoothed as a whole, in which short
    vectors, whose directions are uncertain, count less: a stream keeps its speed around a bend. Noise makes vectors too long
    in the mean, by about its variance over the length, and short ones by more; smoothing does not correct this.

    Example:

        >>> import numpy as np
        >>> from meshflow import Vectors, smooth
        >>> truth = np.zeros((32, 32, 2))
        >>> truth[:, :16], truth[:, 16:] = (1.0, 0.0), (0.0, 1.0)  # a line of shear
        >>> wind = Vectors(truth + 0.2 * np.random.default_rng(0).normal(size=truth.shape), unit="m/s")
        >>> bool(np.std(smooth(wind).values - truth) < 0.06)
        True

    :param values: (h, w, 2) or (h, w, 3), in space (d, h, w, 2) or (d, h, w, 3); NaN: missing.
    :param spacing: one number or (dx, dy), in space (dz, dy, dx).
    :param missing: (h, w) or (d, h, w), further samples that are missing.
    :param unit: the name of the unit of the components, such as m/s.
    :param smoothed: ``whole``; or ``direction-and-magnitude``, of which there is a result each (:class:`meshflow.Results`).
    :raises InputError: for another shape.
    """

    values: Array
    spacing: Spacing | Steps | float = 1.0
    missing: Array = field(default_factory=nowhere)
    unit: str = ""
    smoothed: Literal["whole", "direction-and-magnitude"] = "whole"

    def __post_init__(self) -> None:
        values = real(np.ma.filled(self.values, np.nan), "vectors")
        if values.ndim not in (3, 4) or values.shape[-1] not in (2, 3):
            raise InputError(
                f"vectors: shape (h, w, 2), (h, w, 3) or (d, h, w, 3) expected, got {values.shape}; components come last: "
                "numpy.stack([u, v], axis=-1)"
            )
        gone = mask_of(self.missing, values.shape[:-1], "missing") | ~np.isfinite(values).all(axis=-1)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", gone)
        object.__setattr__(self, "spacing", self.image.spacing)

    def __repr__(self) -> str:
        *size, k = self.values.shape
        unit = f" {self.unit}" if self.unit else ""
        kind = f"{k} components{unit} {self.values.dtype}"
        return f"Vectors({' x '.join(map(str, size))} of {kind}, {int(self.missing.sum())} missing)"

    @property
    def image(self) -> Image | Volume:
        """The components as channels, of an image or a volume."""
        return with_channels(self.values, self.spacing, self.missing)

    @property
    def magnitude(self) -> Array:
        """The lengths (h, w) or (d, h, w), in the unit of the components; NaN where missing."""
        return np.where(self.missing, np.nan, np.linalg.norm(self.values, axis=-1)).astype(self.values.dtype)

    @property
    def parts(self) -> tuple[tuple[str, Image | HeightField | Volume], ...]:
        """What is smoothed where they are apart: the vectors, for their directions, and the magnitudes."""
        found = self.magnitude
        if found.ndim == 3:
            return ("direction", self.image), ("magnitude", Volume(found, steps_of(self.spacing), self.missing))
        magnitude = HeightField(found, spacing_of(self.spacing, len(found)), self.missing, unit=self.unit)
        return ("direction", self.image), ("magnitude", magnitude)

    def holding(self, image: Image | Volume) -> "Vectors":
        """A copy with the components of a smoothed image or volume."""
        return replace(self, values=image.values)

    def holding_parts(self, direction: Image | Volume, magnitude: HeightField | Volume) -> "Vectors":
        """A copy with the directions of smoothed vectors, and with magnitudes, none of which is below zero.

        Vectors without a direction stay as they were.
        """
        length = np.linalg.norm(direction.values, axis=-1)
        found = magnitude.z if isinstance(magnitude, HeightField) else magnitude.values
        known = ~self.missing & (length > 0)
        scale = np.divide(np.maximum(found, 0.0), length, out=np.zeros_like(length), where=known)
        values = np.where(known[..., None], scale[..., None] * direction.values, self.values)
        return replace(self, values=values.astype(self.values.dtype))


def with_channels(values: Array, spacing: Spacing | Steps | float, missing: Array) -> Image | Volume:
    """Components that come last, as the channels of an image (h, w, k), or of a volume (d, h, w, k)."""
    if values.ndim == 4:
        return Volume(values, steps_of(spacing), missing)
    return Image(values, spacing_of(spacing, len(values)), missing, intensity=False)
