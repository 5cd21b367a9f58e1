"""The base of the methods that move the points of a mesh, with all three coordinates free."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

from meshflow.errors import InputError
from meshflow.flow.blend import euler
from meshflow.flow.conservation import AlongNormals
from meshflow.flow.contract import Flow
from meshflow.flow.controls import Control, FixedStep
from meshflow.flow.steppers import SemiImplicit, Stepper, StepperName, stepper_for
from meshflow.geometry.delaunay import Triangles
from meshflow.geometry.options import option
from meshflow.geometry.validation import Array, number
from meshflow.surfaces.surface import Surface

__all__ = ["Along", "PointMethod", "PointSetting", "Regularizable"]

Along = Literal["all", "normals"]


@dataclass(frozen=True)
class PointSetting:
    """Settings of a method of points in addition to its options.

    :ivar triangles: the triangles whose cotangents are used.
    :ivar curve: whether the border moves as a curve in space.
    """

    triangles: Triangles = "auto"
    curve: bool = False


@dataclass(frozen=True, kw_only=True)
class PointMethod:
    """A method that moves the points of a mesh.

    :ivar word: its name on the command line.
    :ivar once: whether it reaches its time in one step.
    :ivar conserves: what does not change, in words.
    :ivar aliases: other names of it.
    """

    word: ClassVar[str] = ""
    once: ClassVar[bool] = False
    conserves: ClassVar[str] = "nothing, and closed meshes shrink; PreserveVolume keeps their volume"
    aliases: ClassVar[tuple[str, ...]] = ()

    along: Along = option("all", "Points move in all directions, or only along their normals.")

    def __post_init__(self) -> None:
        """Subclasses check their own options."""

    @property
    def words(self) -> dict[str, Any]:
        """The options by name, in reading order; those that are None are left out."""
        own = [f.name for f in fields(self) if f.name not in ("along", "mass")]
        chosen = {name: getattr(self, name) for name in own}
        return {"method": self.word, **{name: value for name, value in chosen.items() if value is not None}}

    def filled(self) -> "PointMethod":
        """The method with the fixed choice for options that are None."""
        return self

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        raise NotImplementedError

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The requested stepper; by default an implicit one, because the metrics are stiff.

        :param faces: (m, 3), for motion along normals.
        """
        asked = SemiImplicit() if asked == "auto" else asked
        return asked if self.along == "all" else AlongNormals(stepper_for(asked, flow, time), faces)

    def control(self, asked: Control | None, time: float | None) -> Control | None:
        """The requested control of the steps; one step for a method that reaches its time in one."""
        return FixedStep(time) if self.once and asked is None and time else asked

    def states(self, flow: Flow, start: Array, times: tuple[float, ...]) -> Iterator[Array]:
        """The coordinates (n, 3) at each of the times, squared length."""
        u, since = start, 0.0
        for count, time in enumerate(times):
            u = flow.rate(u, count, euler(time - since))
            since = time
            yield u

    def must_hold_border(self, setting: PointSetting) -> None:
        """Refuse a border that moves as a curve.

        :raises InputError: where it is requested.
        """
        if setting.curve:
            raise InputError(
                f"boundary='border-curve': only for method curvature, conformal and fairing, got method={self.word!r}; "
                "take one of them, or boundary='fixed'"
            )

    def own_stepper(self, asked: Stepper | StepperName, own: Stepper) -> Stepper:
        """The stepper of the method.

        :raises InputError: where another one is requested by name.
        """
        if isinstance(asked, str) and asked not in ("auto", own.name):
            raise InputError(f"stepper: method {self.word} has its own, got {asked!r}; leave it out")
        return own if isinstance(asked, str) else asked

    def along_which(self, stepper: Stepper, faces: Array) -> Stepper:
        """The stepper, restricted to motion along normals where that is requested."""
        return stepper if self.along == "all" else AlongNormals(stepper, faces)


@dataclass(frozen=True, kw_only=True)
class Regularizable(PointMethod):
    """A method before which the sampling may be evened out."""

    regularize: float | None = option(
        None,
        "Time of an initial bi-Laplacian filter with uniform weights, which evens out the sampling. It is for noise in "
        "all directions, and moves points along the surface. Default: from the noise; without a search, normal-filter: 0.",
        "squared length",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.regularize is not None and number(self.regularize, "regularize") < 0:
            raise InputError(f"regularize: a squared length, zero or more, expected, got {self.regularize}")
