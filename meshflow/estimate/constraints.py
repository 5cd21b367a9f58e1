"""Constraints of a run: fixed or slower samples, a largest change, data weights, a volume."""

from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.flow.conservation import Keep
from meshflow.geometry.options import must_be_object, named_fields, option
from meshflow.geometry.validation import Array, shown, whole
from meshflow.surfaces.orientation import Orientation

__all__ = [
    "Constraint", "Constraints", "DataWeights", "Fixed", "Mask", "MaxChange", "MinComponent", "Mobility", "PreserveArea",
    "PreserveVolume",
]  # fmt: skip

# One number per sample: a number for all, an array in the order of the data, or the name of an array in the data.
PerSample = ArrayLike | str


def _must_be_given(value: PerSample | None, name: str) -> None:
    """Refuse None in the place of numbers or a name.

    :raises InputError: for None.
    """
    if value is None:
        raise InputError(f"{name}: a value expected, got nothing")


def _must_be_within(value: PerSample | None, name: str, most: float) -> None:
    """Refuse None, and one number for all samples that is negative or too large; arrays are checked with their data.

    :raises InputError: for None, text that is a number, and a number outside of 0 to ``most``.
    """
    _must_be_given(value, name)
    if np.ndim(value) != 0 or isinstance(value, str):  # type: ignore[arg-type]
        return
    finite = not isinstance(value, (bool, np.bool_)) and isinstance(value, (int, float, np.number))
    if not (finite and 0 <= float(value) <= most):  # type: ignore[arg-type]
        upper = "or more" if np.isinf(most) else f"to {most:g}"
        raise InputError(f"{name}: a number, zero {upper}, or an array expected, got {shown(value)}")


@named_fields
@dataclass(frozen=True, eq=False)
class Fixed:
    """Samples that do not move, in addition to those that the data itself fixes."""

    mask: PerSample = option(
        MISSING,
        "Samples that must not move: a mask, non-zero where they stay (a raster, picture, .npy file or vertex "
        "attribute); in the shell also an expression such as 'z > 2'.",
        flag="fixed",
    )

    def __post_init__(self) -> None:
        _must_be_given(self.mask, "Fixed")


@named_fields
@dataclass(frozen=True, eq=False)
class Mask:
    """The samples that may move; all others stay. The noise is estimated from them."""

    mask: PerSample = option(
        MISSING,
        "Samples that may move: a mask, non-zero where they may (a raster, picture, .npy file or vertex attribute); in "
        "the shell also an expression such as 'sphere(0,0,0,5)'.",
        flag="mask",
    )

    def __post_init__(self) -> None:
        _must_be_given(self.mask, "Mask")


@named_fields
@dataclass(frozen=True, eq=False)
class MaxChange:
    """The largest change of a sample.

    By default half the quantum where rounding is the only noise found; for range images none. Where the points of a mesh move, it
    limits their displacement, independent of the axes; an array (n, 3) limits each coordinate.
    """

    most: PerSample = option(
        MISSING,
        "Largest change of a sample: a number, a raster or .npy file, the name of a vertex attribute, or 'step' for "
        "half the step of quantized data. Default: half the step if rounding is the noise, else none.",
        "unit of the values",
        "max-change",
    )

    def __post_init__(self) -> None:
        _must_be_within(self.most, "max_change", np.inf)


@named_fields
@dataclass(frozen=True, eq=False)
class DataWeights:
    """Weights w of a fidelity term: the steady state of the flow balances smoothness and data.

    The steady state minimizes the area of the surface (values times the contrast alpha) plus the sum of w (u - u0)^2 / 2 over the
    samples. On flat data it smooths over a length of alpha / sqrt(w). With w = 1 / sigma^2 this is the contrast in h / sigma, one
    to three sample distances for the contrasts that a search finds; a quarter of the weights smooths over twice the length. The
    ratios of the weights of samples should be those of 1 / variance, where the variance of each sample is known.
    """

    weights: PerSample = option(
        MISSING,
        "Weights of a fidelity term, 1 / variance: a number, a raster or .npy file, or the name of a vertex attribute.",
        "1 / squared value",
        "data-weights",
    )

    def __post_init__(self) -> None:
        _must_be_within(self.weights, "data_weights", np.inf)


@named_fields
@dataclass(frozen=True, eq=False)
class Mobility:
    """A factor on the rate of each sample, from 0 (fixed) to 1 (free): the soft constraints of [DMSB99].

    The search uses it; the noise is estimated as if all samples were free.
    """

    mobility: PerSample = option(
        MISSING,
        "Factor on the rate of each sample, from 0 (fixed) to 1 (free): a number, a raster or .npy file, or the name of "
        "a vertex attribute.",
        flag="mobility",
    )

    def __post_init__(self) -> None:
        _must_be_within(self.mobility, "mobility", 1.0)


@named_fields
@dataclass(frozen=True)
class PreserveVolume:
    """A closed mesh whose points move keeps its volume.

    :param by: ``normals``: all free points move by one length along their normals, exact in every step; ``scaling``: scale about
        the centroid [DMSB99].
    """

    by: Literal["normals", "scaling"] = "normals"


@named_fields
@dataclass(frozen=True)
class PreserveArea:
    """A mesh whose points move keeps its area by scaling about the centroid."""


@named_fields
@dataclass(frozen=True)
class MinComponent:
    """Remove components of a range image that have fewer samples."""

    samples: int = option(
        1,
        "Remove components of a range image that have fewer samples than this. Default: none.",
        "samples",
        "min-component",
    )

    def __post_init__(self) -> None:
        whole(self.samples, "min_component", 1)


Constraint = Fixed | Mask | MaxChange | DataWeights | Mobility | PreserveVolume | PreserveArea | MinComponent
KINDS = (Fixed, Mask, MaxChange, DataWeights, Mobility, PreserveVolume, PreserveArea, MinComponent)


@dataclass(frozen=True, eq=False)
class Constraints:
    """All constraints of a run, at most one of each kind; arrays are in the order of the data object.

    :ivar fixed: mask of the samples that stay; ``mask``: of those that may move.
    :ivar max_change: a number, an array, or ``step``.
    :ivar data_weights: a number or an array.
    :ivar mobility: a number or an array.
    :ivar preserve: for a mesh whose points move.
    :ivar min_component: for a range image, number of samples.
    """

    fixed: Any = field(default=None)
    mask: Any = field(default=None)
    max_change: Any = field(default=None)
    data_weights: Any = field(default=None)
    mobility: Any = field(default=None)
    preserve: Keep | None = None
    min_component: int | None = None

    @classmethod
    def of(cls, given: "Constraint | Iterable[Constraint]") -> "Constraints":
        """Collect one or several constraints.

        :raises InputError: for an object that is no constraint, and two of one kind.
        """
        if isinstance(given, np.ndarray):
            raise InputError(
                f"constraints: a constraint expected, got {shown(given)}; give Mask(array) for the samples that may move, "
                "or Fixed(array) for those that stay"
            )
        several: list[Any] = [given]
        if isinstance(given, Iterable) and not isinstance(given, (str, type)):
            several = list(given)
        found: dict[str, Any] = {}
        for one in several:
            must_be_object(one, "constraints: a constraint")
            if not isinstance(one, KINDS):
                names = ", ".join(kind.__name__ for kind in KINDS)
                raise InputError(f"constraints: one of {names} expected, got {shown(one)}")
            name, value = _said(one)
            if name == "preserve" and name in found:
                raise InputError(
                    "constraints: one of PreserveVolume and PreserveArea expected, got two; the mesh keeps one of them"
                )
            if name in found:
                raise InputError(f"constraints: {type(one).__name__} is given twice; combine them")
            found[name] = value
        return cls(**found)

    def sampled(self, samples: Callable[[Any, str], Any]) -> "Constraints":
        """The constraints with arrays in the order of the data object.

        :param samples: converts an array or its name, given the name of the constraint.
        """
        changed = {}
        for name in ("fixed", "mask", "max_change", "data_weights", "mobility"):
            value = getattr(self, name)
            if value is not None and not (name == "max_change" and isinstance(value, str) and value == "step"):
                changed[name] = samples(value, name)
        return replace(self, **changed)

    def oriented(self, orientation: Orientation, shape: tuple[int, ...]) -> "Constraints":
        """The constraints of a rotated or reflected grid.

        :param shape: of the original data, (h, w) or (h, w, k).
        """
        return self._laid_out(orientation.of, shape)

    def of_columns(self, columns: Array, shape: tuple[int, ...]) -> "Constraints":
        """The constraints of these columns of a grid.

        :param shape: of the original data, (h, w) or (h, w, k).
        """
        return self._laid_out(lambda array: np.take(array, columns, axis=1), shape)

    def _laid_out(self, of: Callable[[Array], Array], shape: tuple[int, ...]) -> "Constraints":
        """The constraints with each array broadcast to the data, and then laid out as its samples are."""
        changed = {}
        for name in self.arrays:
            array = np.asarray(getattr(self, name))
            full = shape[:2] if array.shape == shape[:2] else shape
            changed[name] = of(np.broadcast_to(array, full))
        return replace(self, **changed)

    @property
    def arrays(self) -> tuple[str, ...]:
        """The names of the constraints with an array of one number per sample."""
        return tuple(f.name for f in fields(self) if np.ndim(getattr(self, f.name)) > 0)


def _said(one: Constraint) -> tuple[str, Any]:
    """The field of :class:`Constraints` for a constraint, and its value."""
    if isinstance(one, Fixed):
        return "fixed", one.mask
    if isinstance(one, Mask):
        return "mask", one.mask
    if isinstance(one, MaxChange):
        return "max_change", one.most
    if isinstance(one, DataWeights):
        return "data_weights", one.weights
    if isinstance(one, Mobility):
        return "mobility", one.mobility
    if isinstance(one, MinComponent):
        return "min_component", one.samples
    if isinstance(one, PreserveArea):
        return "preserve", "area"
    return "preserve", "volume" if one.by == "normals" else "scale"
