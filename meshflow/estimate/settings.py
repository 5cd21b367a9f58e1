"""The words of the front door, checked once, each handed to the part that it steers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.conservation import Keep
from meshflow.flow.controls import AreaChange, Embedded, Fixed
from meshflow.flow.methods.beltrami import Indicator, Member, Method
from meshflow.flow.methods.fairing import LowPass, Weights
from meshflow.flow.methods.motion import Motion
from meshflow.flow.methods.normal_filter import Facets
from meshflow.flow.steppers import Stepper, StepperName, stepper_word
from meshflow.flow.stops import AreaLoss, Displacement, Residual, Stop, When
from meshflow.geometry.delaunay import Triangles
from meshflow.geometry.validation import Array, number, positive, whole
from meshflow.surfaces.surface import Boundary
from meshflow.surfaces.triangles import Diagonals, triangulations

__all__ = ["Settings", "Space"]

Space = Literal["length", "disparity"]


@dataclass(frozen=True)
class Settings:
    """What a caller asks for; what is left out is estimated from the data, or has a default that :class:`Result` names.

    When to stop; what comes first:

    :param time: how far to smooth, in squared length (horizontal unit of a grid, unit of a mesh; pixel footprints of a range
        image, or its own unit where its ``pace`` is ``length``). On flat data the flow is the heat equation.
    :param scale: instead of ``time``: the standard deviation of the Gaussian that the flow equals on flat data, a length; time
        is scale^2 / 2.
    :param steps: the number of steps; then nothing is searched for.
    :param residual: the root mean square change as a share of the noise; about 0.9 is near the best, 1 is too long.
    :param area_loss: the share of the area that is lost (El-Fallah and Ford; section 5.6).
    :param displacement: the largest that a sample has moved, unit of the values (of a mesh: of its points).
    :param stop: a callable (values, time) that says true, or a number that has risen to zero.

    Which flow:

    :param method: a member by name: ``beltrami | graph | mean-curvature | total-variation | perona-malik | geman-mcclure | heat |
        patches``; where the points of a mesh move: ``curvature | conformal | fairing | facets | principal |
        normal-channels`` (:class:`Motion`).
    :param gamma: exponent of the edge indicator, instead of a method. See :class:`Member`, as for the next two.
    :param sharpness: above 1 keeps edges more by the flux across them.
    :param patch: width in samples of the patches in whose space lengths are measured.
    :param contrast: length per unit of the value; 1 for range images and where the points of a mesh move; of facets, principal
        and normal-channels as :class:`Motion` says.
    :param order: of a fairing, 1 (implicit fairing) to 20 (all but an ideal low-pass).
    :param weights: of a fairing, ``cotangent | uniform``.
    :param evened: of facets: a squared length over which the sampling is evened first; points then move along the surface.
    :param along: points of a mesh move in ``all`` directions, or along their ``normals`` alone.
    :param triangles: of a mesh whose points move, ``given``, ``delaunay`` (intrinsic) or ``auto``: where thin ones ask for it;
        of every mesh ``clamped``: weights below zero are zero, and no value leaves its range (the maximum principle; no longer
        the gradient of the area). Of the curvature flow and of channels; of fairings that of order 1 alone keeps it, and is
        what is taken where points move and nothing else is said.
    :param twice: w in [0, 1]: u(t) + w (u(t) - u(2 t)), twicing in time; 0 where a time or a stop is given, else searched for.

    What is known, and how much is wanted:

    :param sigma: the standard deviation of the noise, unit of the values; by default it is estimated.
    :param strength: the data is taken for so much noisier than it is: 1 by default, above it smooths more.
    :param search: whether what is not given is searched for; by default where values stand above a base. Without, one member for
        all data (sharpness 1.5, gamma -1, contrast 3 h / sigma, 7.5 h^2; h the sample distance), and for range images gamma 0 and
        10 sigma / h squared footprints.

    What holds:

    :param limit: no sample leaves its value by more, a number or one per sample, unit of the values, or ``step``: half the step
        of quantised data, of depths at each depth; half the quantum by default where rounding is all the noise that is found,
        of range images none. Where the points of a mesh move: of their way, whichever the axes; an array (n, 3), of each
        coordinate. Where points and channels move: of each coordinate, channels times the contrast.
    :param confidence: weights of a fidelity term, 1 / variance, a number or one per sample; the flow then comes to rest between
        smoothness and data.
    :param only: mask of the samples that may move.
    :param speed: numbers between 0 (stays) and 1 (goes as it would), one per sample or one for all: soft constraints [DMSB99].
        The search runs as slowly (with one for all it finds a longer time, and the same end); the noise is looked for as if all
        went freely.
    :param keep: of a closed mesh whose points move: ``volume``, exact in every step by one length along the normals; ``scale``,
        the volume by scaling [DMSB99]; ``area``.
    :param islands: pieces of a range image of fewer samples are dropped; by default none.
    :param space: ``length``, or of a range image ``disparity``: the graph of the inverse depth moves, with every member,
        contrast, patches and the search; sigma, limit, displacement and confidence then count in inverse depths.

    How it is computed:

    :param indicator: ``metric | projection``.
    :param mass: ``barycentric | voronoi | ring``.
    :param boundary: ``natural | linear | fixed``, of a mesh whose points move also ``curve``: the border moves by its own
        curvature (:class:`Bordered`); by default linear for height fields, range images and meshes, natural for images.
    :param diagonals: of a grid's cells, ``forward | backward | both | alternate``.
    :param stepper: ``auto | explicit | super-time | semi-implicit``, or a stepper with options of its own.
    :param dt: length of a step, squared length; by default what suits the stepper.
    :param control: :class:`Fixed`, :class:`AreaChange` or :class:`Embedded`, instead of ``dt``.
    :param threads: for grids; by default as many as the process may use (``MESHFLOW_NUM_THREADS``).
    :raises InputError: for options that exclude each other or make no sense.
    """

    time: float | None = None
    scale: float | None = None
    steps: int | None = None
    residual: float | None = None
    area_loss: float | None = None
    displacement: float | None = None
    stop: Callable[[Any, float], Any] | None = None
    method: Method | None = None
    gamma: float | None = None
    sharpness: float | None = None
    patch: float | None = None
    contrast: float | None = None
    order: int | None = None
    weights: Weights | None = None
    evened: float | None = None
    along: Literal["all", "normals"] = "all"
    triangles: Triangles = "auto"
    twice: float | None = None
    sigma: float | None = None
    strength: float = 1.0
    search: bool | None = None
    limit: float | Array | Literal["step"] | None = None
    confidence: float | Array | None = None
    only: Array | None = None
    speed: float | Array | None = None
    keep: Keep | None = None
    islands: int | None = None
    space: Space = "length"
    indicator: Indicator = "metric"
    mass: Literal["barycentric", "voronoi", "ring"] = "barycentric"
    boundary: Boundary | Literal["curve"] | None = None
    diagonals: Diagonals = "alternate"
    stepper: Stepper | StepperName = "auto"
    dt: float | None = None
    control: Fixed | AreaChange | Embedded | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        for one, other, why in (
            ("time", "scale", "time is scale^2 / 2"),
            ("dt", "control", "give dt to the control"),
            ("method", "gamma", "the method says it"),
            ("method", "sharpness", "the method says it"),
            ("method", "patch", "the method says it"),
        ):
            if (one, other, self.method) == ("method", "sharpness", "facets"):
                continue  # that of the flux of normals
            if getattr(self, one) is not None and getattr(self, other) is not None:
                values = f"{one} {getattr(self, one)} and {other} {getattr(self, other)}"
                raise InputError(f"{values}: one of them expected; {why}")
        for name in ("time", "scale"):
            value = getattr(self, name)
            if value is not None and number(value, name) < 0:
                raise InputError(f"{name}: a finite number, zero or more, expected, got {value}")
        for name in ("contrast", "sigma", "strength", "residual", "displacement", "dt"):
            if getattr(self, name) is not None:
                positive(getattr(self, name), name)
        for name, least in (("steps", 0), ("threads", 1), ("islands", 1), ("order", 1)):
            if getattr(self, name) is not None:
                whole(getattr(self, name), name, least)
        if self.twice is not None and not 0 <= number(self.twice, "twice") <= 1:
            raise InputError(f"twice: a weight between 0 and 1 expected, got {self.twice}")
        if self.twice and (self.steps is not None or self.confidence is not None or self.stopping):
            raise InputError(f"twice {self.twice}: a time is doubled; leave out steps, confidence and stops")
        self._check_words()

    def _check_words(self) -> None:
        """The gates of the parts, before any of the work."""
        if self.method is not None and self.method not in get_args(Method):
            raise InputError(f"method: {', '.join(get_args(Method))} expected, got {self.method!r}")
        if self.boundary not in (None, "natural", "linear", "fixed", "curve"):
            raise InputError(f"boundary: natural, linear, fixed or curve expected, got {self.boundary!r}")
        if self.space not in get_args(Space):
            raise InputError(f"space: {' or '.join(get_args(Space))} expected, got {self.space!r}")
        if self.control is not None and not isinstance(self.control, (Fixed, AreaChange, Embedded)):
            raise InputError(f"control: Fixed, AreaChange or Embedded expected, got {self.control!r}")
        if self.search is not None and not isinstance(self.search, (bool, np.bool_)):
            raise InputError(f"search: true or false expected, got {self.search!r}")
        if self.triangles == "clamped":
            self._check_range()
        if self.keep not in (None, "volume", "scale", "area"):
            raise InputError(f"keep: volume, scale or area expected, got {self.keep!r}")
        if self.order is not None or self.weights is not None:
            LowPass(self.order or 2, self.weights or "cotangent")
        if self.evened is not None:
            Facets(evened=self.evened)
        Motion(along=self.along, triangles=self.triangles)
        triangulations(self.diagonals)
        stepper_word(self.stepper)
        self.member()
        if self.area_loss is not None:
            AreaLoss(self.area_loss)
        if self.residual is not None:
            Residual(self.residual, 1.0)
        if self.stop is not None:
            When(self.stop)

    def _check_range(self) -> None:
        """What would leave the range that clamped weights keep."""
        if self.boundary == "linear" or self.mass == "voronoi":
            raise InputError(
                f"triangles='clamped': boundary natural or fixed and mass barycentric or ring expected, got "
                f"{self.boundary or 'natural'} and {self.mass}, which have weights below zero"
            )
        if self.twice:
            raise InputError(f"triangles='clamped': twice {self.twice} leaves the range of the values; leave it out")
        if isinstance(self.stepper, str) and self.stepper == "super-time":
            raise InputError(
                "triangles='clamped': stepper explicit or semi-implicit expected, got 'super-time', which may overshoot"
            )

    @property
    def until_time(self) -> float | None:
        """The time asked for, squared length."""
        return self.scale**2 / 2 if self.scale is not None else self.time

    @property
    def rim(self) -> Boundary | None:
        """The boundary as the operator of a surface knows it: one that moves as a curve, is held by that."""
        if self.triangles == "clamped" and self.boundary is None:
            return "natural"  # that of the plane has weights below zero
        return "fixed" if self.boundary == "curve" else self.boundary

    @property
    def stopping(self) -> bool:
        """Whether the caller asks for a stop other than a time or steps."""
        return any(word is not None for word in (self.residual, self.area_loss, self.displacement, self.stop))

    @property
    def named(self) -> bool:
        """Whether the caller says which member it shall be."""
        return any(word is not None for word in (self.method, self.gamma, self.sharpness, self.patch))

    def member(self, **exponents: float) -> Member:
        """The member that is given; what is left out is the paper's (gamma 0, sharpness 1, no patches)."""
        given = {"gamma": self.gamma, "sharpness": self.sharpness, "patch": self.patch}
        chosen = {name: value for name, value in given.items() if value is not None}
        return Member(indicator=self.indicator, mass=self.mass, **{**exponents, **chosen})

    def stops(self, sigma: float, there: float, unit: float, seen: Callable[[Array], Any]) -> tuple[Stop, ...]:
        """The stops that are asked for.

        :param sigma: of a sample with all its channels, unit of u.
        :param there: share of the samples that are there.
        :param unit: units of u for one of the caller's.
        :param seen: what a callable sees of u.
        """
        made: list[Stop] = []
        if self.residual is not None:
            made.append(Residual(self.residual, sigma, there))
        if self.area_loss is not None:
            made.append(AreaLoss(self.area_loss))
        if self.displacement is not None:
            made.append(Displacement(self.displacement * unit, unit))
        if self.stop is not None:
            made.append(When(self.stop, seen))
        return tuple(made)
