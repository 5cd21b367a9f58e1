"""The request of a caller: typed parts, each checked when it is made. Options that are None are estimated from the data."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraint, Constraints
from meshflow.estimate.preparation import OutlierWord
from meshflow.estimate.stripes import Level
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Method, method_of
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.methods.points import PointMethod
from meshflow.flow.methods.searched import Quick, Search
from meshflow.flow.stops import AreaLoss, Displacement, Residual, Steps, Stop, When
from meshflow.geometry.options import must_be_object, named_fields, option
from meshflow.geometry.validation import Array, number, positive, shown
from meshflow.surfaces.surface import Boundary

__all__ = ["BoundaryWord", "Domain", "Request", "Stopping"]

Domain = Literal["auto", "length", "disparity", "luv", "lab", "linear-rgb", "stabilized", "magnitudes"]
BoundaryWord = Boundary | Literal["border-curve"]
Stopping = Steps | Residual | AreaLoss | Displacement | When | Callable[[Array, float], object]
# The largest scale: its square must be a number.
WIDEST = 1e150


@named_fields
@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """The options of a run that the caller gives.

    :raises InputError: for options that exclude each other, or invalid values.
    """

    method: Method | None = None
    time: float | None = option(
        None,
        "Time of the flow, a squared length: m² for a terrain, pixels² for an image, pixel footprints² for a range "
        "image. Default: from the data.",
        "squared length",
    )
    scale: float | None = option(
        None,
        "In place of time: the standard deviation of the Gaussian filter with the same effect on flat data. time = "
        "scale²/2.",
        "length",
    )
    strength: float = option(1.0, "Factor on the noise. Above 1 more is removed, below 1 less.")
    noise: float | None = option(None, "Standard deviation of the noise. Default: estimated.", "unit of the values")
    steps: int | None = None
    stops: tuple[Stop, ...] = ()
    constraints: Constraints = Constraints()
    boundary: BoundaryWord | None = option(
        None,
        "plane-preserving: tilted planes do not change at borders and holes. neumann: no flux. fixed: borders stay. "
        "border-curve: the borders of a mesh move by their own curvature. Default: neumann for images, else "
        "plane-preserving.",
    )
    domain: Domain = option(
        "auto",
        "The values in which the data is smoothed. length: as they are (depths along their rays). disparity: inverse "
        "depths, for stereo and structured light; planes stay planes. luv, lab: colours in CIE L*u*v* or L*a*b*. "
        "linear-rgb: colours in linear light. stabilized: values with the same noise at every intensity, for photon "
        "noise. magnitudes: the same for MRI magnitudes in a volume; it also removes their Rician bias. auto: disparity "
        "for depths of a pinhole camera, stabilized for images whose noise depends on the intensity, magnitudes for "
        "volumes with the noise of magnitudes in the air, else length. A method, a time, a stop or data weights switch "
        "auto off; so does, for depths, a boundary, and for the others, a noise or a largest change. The noise and the "
        "largest change of depths are always given in depths.",
    )
    outliers: OutlierWord | None = option(
        None,
        "Outliers: undeclared nodata, impulses, spikes. keep excludes them from the flow and leaves them unchanged. "
        "repair replaces them from their neighbours. include treats them as data. Default: repair for single ones in "
        "images, else keep.",
    )
    level: Level | None = option(
        None, "Remove offsets of rows or columns, as line scanners produce them. Default: none."
    )
    compute: Compute = Compute()

    def __post_init__(self) -> None:
        if self.time is not None and self.scale is not None:
            raise InputError(
                f"time={self.time} and scale={self.scale}: they say the same, time = scale² / 2; give one of them"
            )
        for name in ("time", "scale"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or number(value, name) < 0):
                raise InputError(f"{name}: a finite number, zero or more, expected, got {value}")
        if self.scale is not None and self.scale > WIDEST:
            raise InputError(f"scale: a length up to {WIDEST:g} expected, whose square is a number, got {self.scale}")
        for name in ("strength", "noise"):
            if getattr(self, name) is not None and not 1.0 / WIDEST <= positive(getattr(self, name), name) <= WIDEST:
                raise InputError(f"{name}: {1.0 / WIDEST:g} to {WIDEST:g} expected, got {getattr(self, name)}")
        for name in ("time", "scale", "strength", "noise"):
            if isinstance(value := getattr(self, name), np.ndarray):  # of one number
                object.__setattr__(self, name, float(value))
        must_be_object(self.compute, "compute: a Compute")
        if not isinstance(self.compute, Compute):
            raise InputError(f"compute: a Compute expected, got {shown(self.compute)}")
        if isinstance(self.method, Search) and self.compute.search is isinstance(self.method, Quick):
            raise InputError(
                f"method={self.method.word!r} and search={self.compute.search}: they contradict each other; leave one of them out"
            )
        if self.heights.twicing and (self.steps is not None or self.weighted or self.stops):
            raise InputError(
                f"twicing {self.heights.twicing}: a time is doubled; leave out steps, data weights and stops"
            )
        if self.compute.triangles == "clamped":
            self._must_keep_range()

    @classmethod
    def of(
        cls,
        method: Method | str | None = None,
        stop: "Stopping | Iterable[Stopping] | None" = (),
        constraints: "Constraint | Iterable[Constraint] | None" = (),
        **numbers: object,
    ) -> "Request":
        """A request from the keywords of :func:`meshflow.smooth`.

        :param numbers: the other fields, by name.
        :raises InputError: for unknown words and invalid values.
        """
        steps, stops = _stops(() if stop is None else stop)
        chosen = None if method is None else method_of(method)
        held = Constraints.of(() if constraints is None else constraints)
        return cls(method=chosen, steps=steps, stops=stops, constraints=held, **numbers)  # type: ignore[arg-type]

    @property
    def until_time(self) -> float | None:
        """The requested time, squared length."""
        return self.scale**2 / 2 if self.scale is not None else self.time

    @property
    def heights(self) -> HeightMethod:
        """The options of the method for values above a base; those of a search where no method is named."""
        return self.method if isinstance(self.method, HeightMethod) else Search()

    @property
    def twicing(self) -> float | None:
        """The given weight of twicing; zero where values must stay in range."""
        return 0.0 if self.compute.triangles == "clamped" else self.heights.twicing

    @property
    def named(self) -> bool:
        """Whether a method for values above a base is named."""
        return isinstance(self.method, HeightMethod) and not isinstance(self.method, Search)

    @property
    def searching(self) -> bool:
        """Whether options that are not given may be searched for."""
        return self.compute.search is not False and not isinstance(self.method, Quick)

    @property
    def timed(self) -> bool:
        """Whether the caller says when the flow ends."""
        return self.until_time is not None or self.steps is not None or bool(self.stops)

    @property
    def is_open(self) -> bool:
        """Whether the caller gave neither noise, nor method, nor end."""
        named = self.named or isinstance(self.method, (PointMethod, Quick))
        return self.noise is None and not self.timed and not named and self.searching

    @property
    def insisting(self) -> bool:
        """Whether a search is requested where it is not the default."""
        return self.compute.search is True or type(self.method) is Search

    @property
    def weighted(self) -> bool:
        """Whether there are data weights."""
        return self.constraints.data_weights is not None

    @property
    def asked(self) -> bool:
        """Whether the flow runs even where no noise is found."""
        return self.timed or self.weighted

    @property
    def rim(self) -> Boundary | None:
        """The boundary for the operator; a border that moves as a curve is fixed there."""
        if self.compute.triangles == "clamped" and self.boundary is None:
            return "neumann"  # the plane-preserving boundary has negative weights
        return "fixed" if self.boundary == "border-curve" else self.boundary

    def _must_keep_range(self) -> None:
        """Refuse options with which values could leave the range that clamped weights keep."""
        mass = getattr(self.method, "mass", "barycentric")
        if self.boundary == "plane-preserving" or mass == "voronoi":
            raise InputError(
                f"triangles='clamped': boundary neumann or fixed and mass barycentric or ring expected, got "
                f"{self.boundary or 'neumann'} and {mass}, which have negative weights"
            )
        if self.heights.twicing:
            raise InputError(
                f"triangles='clamped': twicing {self.heights.twicing} leaves the range of the values; leave it out"
            )


def _stops(given: object) -> tuple[int | None, tuple[Stop, ...]]:
    """The number of steps, and the stops, from one or several given ones.

    :raises InputError: for an object that is no stop, and two of one kind.
    """
    several = list(given) if isinstance(given, (tuple, list)) else [given]
    steps: int | None = None
    found: list[Stop] = []
    for one in several:
        must_be_object(one, "stop: a stop")
        if isinstance(one, Steps):
            if steps is not None:
                raise InputError("stop: Steps is given twice")
            steps = int(one.count)
        elif isinstance(one, (Residual, AreaLoss, Displacement, When)):
            if any(type(one) is type(other) and not isinstance(one, When) for other in found):
                raise InputError(f"stop: {type(one).__name__} is given twice")
            found.append(one)
        elif callable(one):
            found.append(When(one))
        else:
            raise InputError(
                f"stop: Steps, Residual, AreaLoss, Displacement, or a callable (values, time) expected, got {shown(one)}"
            )
    return steps, tuple(found)
