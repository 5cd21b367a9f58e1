"""How the points of a mesh move, all three coordinates free: which engine, and which stepper it asks for."""

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from meshflow.errors import InputError
from meshflow.flow.blend import euler
from meshflow.flow.conservation import AlongNormals
from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.engines.metric import Clamped, Conformal, Given, NormalChannels, metric_of
from meshflow.flow.methods.beltrami import Member
from meshflow.flow.methods.border_curve import Bordered
from meshflow.flow.methods.fairing import LowPass, Weights
from meshflow.flow.methods.normal_filter import FacetFlow, Facets
from meshflow.flow.methods.principal import Principal
from meshflow.flow.steppers import Explicit, SemiImplicit, Stepper, StepperName, stepper_for
from meshflow.geometry.delaunay import Triangles
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.surface import Surface

__all__ = ["Motion", "MotionName"]

MotionName = Literal["curvature", "conformal", "fairing", "facets", "principal", "normal-channels"]


@dataclass(frozen=True)
class Motion:
    """A way for points to move.

    :param kind: ``curvature``: mean curvature flow [DMSB99], which shrinks what it smooths; ``conformal``: the same with the
        stiffness of the start, for large times (:class:`MeshFlow`); ``fairing``: a low-pass of an order
        (:class:`LowPass`); ``facets``: normals flow and points follow (:class:`FacetFlow`), creases kept; ``principal``:
        curvature along directions that are bent little (:class:`Principal`); ``normal-channels``: curvature, lengths measured in
        (x, contrast n) (:class:`MeshFlow`).
    :param order: of a fairing.
    :param weights: of a fairing.
    :param facets: how normals flow.
    :param contrast: of the last two, a length: what is curved more than 1 / contrast is a feature; the factor on the normals.
    :param along: ``all`` directions, or ``normals``: what moves points across the surface is left out (:class:`AlongNormals`).
    :param triangles: of the curvature flow and of cotangent weights, as of :class:`MeshFlow`.
    :param curve: the border moves as a curve (:class:`Bordered`); not of facets.
    :raises InputError: for an unknown word.
    """

    kind: MotionName = "curvature"
    order: int = 2
    weights: Weights = "cotangent"
    facets: Facets = Facets()
    contrast: float = 1.0
    along: Literal["all", "normals"] = "all"
    triangles: Triangles = "auto"
    curve: bool = False

    def __post_init__(self) -> None:
        if self.kind not in get_args(MotionName):
            raise InputError(f"method: {', '.join(get_args(MotionName))} expected, got {self.kind!r}")
        if self.along not in ("all", "normals"):
            raise InputError(f"along: all or normals expected, got {self.along!r}")
        if self.triangles not in get_args(Triangles):
            raise InputError(f"triangles: {', '.join(get_args(Triangles))} expected, got {self.triangles!r}")
        if self.curve and self.kind not in ("curvature", "conformal", "fairing"):
            raise InputError(
                f"boundary='curve': of method curvature, conformal and fairing, got method={self.kind!r}; "
                "take one of them, or boundary='fixed'"
            )
        if self.kind == "principal" and self.triangles not in ("auto", "given"):
            raise InputError(
                f"triangles={self.triangles!r}: principal measures directions on the triangles as they are; leave it out"
            )
        positive(self.contrast, "contrast")
        LowPass(self.order, self.weights)

    def engine(self, surface: Surface, member: Member) -> Flow:
        """What moves the points."""
        if self.kind == "facets":
            return FacetFlow(surface, self.facets)
        inside = replace(surface, boundary="fixed") if self.curve else surface
        if self.kind == "principal":
            return Principal(inside, member, self.contrast)
        metric = metric_of(self.triangles)
        if self.kind == "conformal":
            metric = Conformal(Clamped() if self.triangles == "clamped" else Given())
        elif self.kind == "normal-channels":
            metric = NormalChannels(self.contrast, metric)
        flow = MeshFlow(inside, member, metric)
        return Bordered(flow, inside) if self.curve else flow

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The stepper, of a caller who may have asked for one.

        :raises InputError: where the kind has one of its own and the caller asks for another.
        """
        if self.kind not in ("fairing", "facets"):
            asked = SemiImplicit() if self.kind != "curvature" and asked == "auto" else asked
            return asked if self.along == "all" else AlongNormals(stepper_for(asked, flow, time), faces)
        way: Stepper = LowPass(self.order, self.weights) if self.kind == "fairing" else Explicit()
        if isinstance(asked, str) and asked not in ("auto", way.name):
            raise InputError(f"stepper: {self.kind} steps in its own way, got {asked!r}; leave it out")
        way = way if isinstance(asked, str) else asked
        return way if self.along == "all" else AlongNormals(way, faces)

    @property
    def once(self) -> bool:
        """Whether it reaches its time in one step."""
        return self.kind == "fairing"

    @property
    def words(self) -> dict[str, Any]:
        """Names to numbers and words, in reading order."""
        if self.kind == "fairing":
            return {"method": "fairing", "order": self.order, "weights": self.weights}
        if self.kind == "facets":
            how = self.facets
            return {
                "method": "facets", "contrast": how.contrast, "sharpness": how.sharpness, "evened": how.evened,
            }  # fmt: skip
        if self.kind in ("principal", "normal-channels"):
            return {"method": self.kind, "contrast": self.contrast}
        return {"method": self.kind}

    def states(self, flow: Flow, start: Array, times: tuple[float, ...]) -> Any:
        """The coordinates at each of the times, one by one: a fairing from its start, anything else going on."""
        u, since = start, 0.0
        for count, time in enumerate(times):
            if self.once:
                u = LowPass(self.order, self.weights).step(flow, start, time, count)
            else:
                u = flow.rate(u, count, euler(time - since))
            since = time
            yield u
