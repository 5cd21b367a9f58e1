"""Fields of symmetric tensors on a grid of two or three axes: diffusion, stress, covariance, structure tensors."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.symmetric import exponential, held_definite, least_eigenvalue, logarithm, packed, unpacked
from meshflow.geometry.validation import Array, Spacing, mask_of, nowhere, real
from meshflow.geometry.whitening import whitening
from meshflow.surfaces.image import Image
from meshflow.surfaces.vectors import with_channels
from meshflow.surfaces.volume import Steps, Volume

__all__ = ["Tensors", "grid_of"]

# The largest difference of a tensor and its transpose, as a share of its largest entry, that counts as rounding.
ROUNDING = 1e-3


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class Tensors:
    """Symmetric tensors on a grid; all their components move, coupled.

    They are channels of an image, entries beside the diagonal with the weight √2: then the metric of the image is that of the
    tensors, and the result does not depend on the frame in which they are written.

    Positive definite tensors stay so. In the heat equation (explicit steps within the stable bound, and implicit ones) each
    step is a mean of neighbours with weights w ≥ 0 of sum 1. Then x'Sx = Σ w x'S_i x > 0 for every x, and the smallest
    eigenvalue, a concave function of S, never falls below the smallest one of the input. Twicing, patches, the second stage
    and obtuse triangles are no such means; there the change of a tensor is cut off where it would fall below that value. With
    the log-Euclidean metric (Arsigny et al. 2006) the logarithms are smoothed, and every result is positive definite.

    Example:

        >>> import numpy as np
        >>> from meshflow import Tensors, smooth
        >>> draw = np.random.default_rng(0).normal(size=(24, 24, 3, 40))
        >>> covariance = draw @ np.swapaxes(draw, 2, 3) / 40  # (h, w, 3, 3), of 40 samples each
        >>> after = smooth(Tensors(covariance))
        >>> bool(np.linalg.eigvalsh(after.values).min() > 0)
        True
        >>> bool(np.std(after.values - np.eye(3)) < 0.3 * np.std(covariance - np.eye(3)))
        True

    :param values: (h, w, 2, 2) or (h, w, 3, 3); or components (h, w, 3): xx, yy, √2 xy, or (h, w, 6): xx, yy, zz, √2 yz, √2 xz,
        √2 xy; in space with an axis before these: (d, h, w, 3, 3) or (d, h, w, 6). NaN: missing.
    :param spacing: one number or (dx, dy), in space (dz, dy, dx).
    :param missing: (h, w) or (d, h, w), further samples that are missing.
    :param metric: ``euclidean``, the distance is the norm of the difference; ``noise``, the same in components in which the noise
        is equal and not correlated (Mahalanobis), as that of tensors which are fitted to signals is not; or ``log-euclidean``,
        the distance of the logarithms, of positive definite tensors only.
    :param definite: whether the tensors are positive definite by nature, so that results are held so. None: where all that came
        are.
    :param unit: the name of their unit.
    :raises InputError: for other shapes, tensors that are not symmetric, and with ``log-euclidean`` or ``definite`` none that is
        positive definite.
    """

    values: Array
    spacing: Spacing | Steps | float = 1.0
    missing: Array = field(default_factory=nowhere)
    metric: Literal["euclidean", "noise", "log-euclidean"] = "euclidean"
    definite: bool | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        values = real(np.ma.filled(self.values, np.nan), "tensors")
        shape = grid_of(values.shape)
        square = values.ndim == len(shape) + 2
        if len(shape) not in (2, 3) or not (square or values.shape[-1] in (3, 6)):
            raise InputError(
                "tensors: shape (h, w, 2, 2) or (h, w, 3, 3) expected, or components (h, w, 3) or (h, w, 6), or these with d "
                f"before h, got {values.shape}"
            )
        gone = mask_of(self.missing, shape, "missing")
        gone = np.asarray(gone | ~np.isfinite(values.reshape(*shape, -1)).all(axis=-1))
        if square and not gone.all():
            _must_be_symmetric(values[~gone])
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "missing", gone)
        object.__setattr__(self, "spacing", self.image.spacing)

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.missing.shape))
        d = self._whole.shape[-1]
        return f"Tensors({size} of {d} x {d} {self.values.dtype}, {self.metric}, {int(self.missing.sum())} missing)"

    @property
    def _square(self) -> bool:
        """Whether they are matrices, and no components."""
        return self.values.ndim == self.missing.ndim + 2

    @cached_property
    def _whole(self) -> Array:
        """The tensors (..., d, d)."""
        return self.values if self._square else unpacked(self.values)

    @cached_property
    def _least(self) -> float:
        """The smallest eigenvalue above zero; 0 where results need not be positive definite.

        :raises InputError: where they must be, and some or none are.
        """
        logs = self.metric == "log-euclidean"
        if self.definite is False and not logs:
            return 0.0
        values = least_eigenvalue(self._whole[~self.missing])
        good = values > 0
        if logs and not good.all():
            raise InputError(
                f"metric='log-euclidean': positive definite tensors expected, {int((~good).sum())} of {len(good)} are not "
                f"(smallest eigenvalue {values.min():.3g}); mark them as missing, or take metric='euclidean', definite=True"
            )
        if self.definite and not good.any():
            raise InputError("definite: at least one positive definite tensor expected, got none")
        return float(values[good].min()) if good.all() or self.definite else 0.0

    @cached_property
    def _whitening(self) -> Array:
        """With ``noise``: the matrix by which components are multiplied."""
        return whitening(self._components, self.missing)

    @property
    def _components(self) -> Array:
        """(..., 3) or (..., 6)."""
        return packed(self.values) if self._square else self.values

    @cached_property
    def image(self) -> Image | Volume:
        """The components as channels of an image or a volume, those of the logarithms with ``log-euclidean``."""
        least = self._least if not self.missing.all() else 0.0
        if self.metric == "euclidean":
            return with_channels(self._components, self.spacing, self.missing)
        if self.metric == "noise":
            white = (self._components @ self._whitening).astype(self.values.dtype)
            return with_channels(white, self.spacing, self.missing)
        there = np.where(self.missing[..., None, None], least * np.eye(self._whole.shape[-1]), self._whole)
        return with_channels(packed(logarithm(there.astype(self.values.dtype))), self.spacing, self.missing)

    def holding(self, image: Image | Volume) -> "Tensors":
        """A copy with the components of a smoothed image or volume; missing samples keep theirs."""
        components = image.values
        if self.metric == "noise":
            components = (components @ np.linalg.inv(self._whitening)).astype(components.dtype)
        whole = unpacked(components)
        there = ~self.missing
        if self.metric == "log-euclidean":
            whole = exponential(np.where(self.missing[..., None, None], 0.0, whole).astype(whole.dtype))
        elif self._least > 0:
            whole[there] = held_definite(self._whole[there], whole[there], self._least)[0]
        back = whole if self._square else packed(whole)
        kept = self.missing.reshape(*self.missing.shape, *(1,) * (self.values.ndim - self.missing.ndim))
        return replace(self, values=np.where(kept, self.values, back).astype(image.values.dtype))


def grid_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of the samples of tensors (..., d, d), or of components (..., k)."""
    return shape[:-2] if len(shape) > 3 and shape[-2:] in ((2, 2), (3, 3)) else shape[:-1]


def _must_be_symmetric(tensors: Array) -> None:
    """Refuse tensors (n, d, d) that differ from their transposes by more than rounding."""
    apart = np.abs(tensors - np.swapaxes(tensors, 1, 2)).max(axis=(1, 2))
    wrong = apart > ROUNDING * np.abs(tensors).max()
    if wrong.any():
        raise InputError(
            f"tensors: symmetric ones expected, {int(wrong.sum())} of {len(wrong)} differ from their transpose by up to "
            f"{apart.max():.3g}; take their symmetric part first: (t + t.swapaxes(-1, -2)) / 2"
        )
