"""Implicit fairing of meshes [DMSB99]: one implicit step with the operator that is named."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.low_pass import generator_of
from meshflow.flow.methods.curvature import CurvatureFlow
from meshflow.flow.methods.points import PointSetting
from meshflow.flow.steppers import SemiImplicit, Stepper, StepperName
from meshflow.flow.workspace import Workspace
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["ImplicitFairing"]

Operator = Literal["curvature", "umbrella", "scale-dependent"]


@dataclass(frozen=True)
class _Linear:
    """(I + dt A) x+ = x with an operator that need not be symmetric.

    :ivar operator: A, by the name of its weights.
    """

    operator: Literal["uniform", "scale-dependent"]
    name = "implicit"
    rates = 1

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The points (n, 3) after time dt; points that stay keep their bits."""
        generator = generator_of(flow, u, self.operator)
        matrix = sparse.csc_matrix(sparse.identity(len(u)) + dt * generator)
        return u + splu(matrix).solve(-dt * np.asarray(generator @ u))

    def largest(self, flow: Flow, u: Array) -> float:
        """Infinite."""
        return np.inf


@named_fields
@dataclass(frozen=True, kw_only=True)
class ImplicitFairing(CurvatureFlow):
    """Implicit fairing: (I + t A) x+ = x, one step of any length [DMSB99]. It shrinks; ``preserve`` keeps the volume.

    A is M^-1 L, the curvature normal (``curvature``: nothing moves in planes), the umbrella 4 / h^2 (x_i - mean of the
    neighbours), or the scale-dependent umbrella 4 / E sum (x_i - x_j) / |e_ij|, E = sum |e_ij| (both even out the sampling;
    scaled so that all three agree on equilateral triangles). M. Desbrun, M. Meyer, P. Schroeder, A. Barr, SIGGRAPH 1999,
    317-324. Soft constraints are ``Mobility``, and their scaling about the centroid is ``PreserveVolume(by="scaling")``. What
    is named is what runs: nothing is searched for. Use it for large smoothing in one solve.
    """

    word: ClassVar[str] = "implicit-fairing"
    conserves: ClassVar[str] = (
        "of a closed mesh the centre of its vertices, weighted by their areas at the start, with operator curvature; the volume "
        "with PreserveVolume"
    )
    aliases: ClassVar[tuple[str, ...]] = ("dmsb99",)
    once: ClassVar[bool] = True

    operator: Operator = option(
        "curvature", "Laplacian: curvature (the curvature normal), umbrella or scale-dependent umbrella."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.operator not in ("curvature", "umbrella", "scale-dependent"):
            raise InputError(f"operator: curvature, umbrella or scale-dependent expected, got {self.operator!r}")

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3) of a surface."""
        if self.operator == "scale-dependent":
            self.must_hold_border(setting)
        return super().engine(surface, setting)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """One implicit step.

        :raises InputError: for another stepper by name.
        """
        return self.along_which(self.own_stepper(asked, self._own), faces)

    @property
    def _own(self) -> Stepper:
        if self.operator == "curvature":
            return SemiImplicit()
        return _Linear("uniform" if self.operator == "umbrella" else "scale-dependent")

    def states(self, flow: Flow, start: Array, times: tuple[float, ...]) -> Iterator[Array]:
        """The coordinates (n, 3) at each time, each from the start."""
        for time in times:
            yield self._own.step(flow, start, time)
