"""Fairing of the surface of a binary volume, which stays between the same grid points."""

from dataclasses import dataclass, field

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.steppers import Stepper, StepperName
from meshflow.flow.within_voxels import Between, Held, VoxelEdges
from meshflow.geometry.validation import Array

__all__ = ["BetweenVoxels"]


@dataclass(frozen=True, kw_only=True)
class BetweenVoxels(Fairing):
    """A fairing whose surface separates the same voxels. It is chosen from the data, not by name."""

    edges: VoxelEdges | None = field(default=None, repr=False, compare=False)

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """The filter between the voxels.

        :raises InputError: for another stepper by name.
        """
        low_pass = self.low_pass()
        own = Between(low_pass.order, low_pass.presmooth, self._known, faces)
        return self.along_which(self.own_stepper(asked, own), faces)

    def hold(self, start: Array, faces: Array) -> Held:
        """The constraint that points (n, 3) stay within half a voxel."""
        return Held(self._known, start, faces)

    @property
    def _known(self) -> VoxelEdges:
        if self.edges is None:
            raise InputError("BetweenVoxels: the edges of the voxels expected; it is chosen from the data, not by name")
        return self.edges
