"""Conservation of volume or area while a mesh is smoothed; and motion along normals only."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.steppers import Stepper
from meshflow.flow.workspace import Workspace
from meshflow.geometry.connectivity import connect
from meshflow.geometry.normals import normals_at
from meshflow.geometry.operator import total_area
from meshflow.geometry.validation import Array
from meshflow.geometry.volume import is_closed, volume, volume_gradient

__all__ = ["AlongNormals", "Keep", "Kept", "free_of"]

Keep = Literal["volume", "scale", "area"]
# Newton steps for the volume, which is a cubic function of a short displacement.
NEWTON = 20
EXACT = 1e-14


def free_of(faces: Array, fixed: Array, speed: Array | None, rim: bool) -> Array:
    """The mobility (n,) of each point, from 0 (fixed) to 1.

    :param fixed: (n,) mask.
    :param speed: (n, 1) or None.
    :param rim: whether the border is fixed.
    """
    free = (~fixed).astype(np.float64)
    if rim:
        free[connect((faces,), len(fixed)).rim] = 0.0
    return free if speed is None else free * speed[:, 0]


@dataclass(frozen=True, eq=False)
class Kept:
    """After every step the points are moved so that the volume, or the area, stays the same.

    :param how: ``volume``: all free points move by one length along their normals, exact to rounding; ``scale``: the volume is
        kept by scaling about the centroid [DMSB99]; ``area``: the area is kept by scaling.
    :param faces: (m, 3), closed and oriented for a volume.
    :param start: points (n, 3).
    :param free: (n,), the mobility of each point, from 0 (fixed) to 1.
    :raises InputError: for a volume of an open mesh, or scaling where points are fixed or slowed.
    """

    how: Keep
    faces: Array
    start: Array
    free: Array

    def __post_init__(self) -> None:
        if self.how not in ("volume", "scale", "area"):
            raise InputError(f"preserve: volume, scale or area expected, got {self.how!r}")
        if self.how != "volume" and (self.free < 1).any():
            raise InputError(
                f"{self._word}: all points are scaled, and {int((self.free < 1).sum())} are fixed or slowed; "
                "leave it out, or take PreserveVolume where the mesh is closed"
            )
        if self.how == "area":
            return
        if self.start.shape[1] != 3:
            raise InputError(f"{self._word}: points in R^3 expected for a volume, got R^{self.start.shape[1]}")
        if not is_closed(self.faces):
            raise InputError(
                f"{self._word}: the mesh is open, or its triangles are not oriented alike, so that it has no inside; close its "
                "holes, or leave it out (method='normal-filter' and 'fairing' hardly shrink)"
            )
        if abs(self._value(self.start)) <= 1e-12 * total_area(self.start, self.faces) ** 1.5:
            raise InputError(
                f"{self._word}: the mesh has no volume, because its triangles face each other; orient them alike"
            )

    def hold(self, u: Array) -> Array:
        """u, moved in place."""
        goal = self._value(self.start)
        if self.how == "volume":
            direction = normals_at(u, self.faces) * self.free[:, None]
            for _ in range(NEWTON):
                off = self._value(u) - goal
                if abs(off) <= EXACT * abs(goal):
                    break
                u -= off / float(np.einsum("ij,ij->", volume_gradient(u, self.faces), direction)) * direction
            return u
        home, value = u.mean(axis=0), self._value(u)
        if value == 0:
            return u
        u -= home
        u *= (goal / value) ** (1 / 2 if self.how == "area" else 1 / 3)
        u += home
        return u

    @property
    def _word(self) -> str:
        """The name of the constraint."""
        return {"volume": "PreserveVolume", "scale": "PreserveVolume by scaling", "area": "PreserveArea"}[self.how]

    def _value(self, points: Array) -> float:
        return total_area(points, self.faces) if self.how == "area" else volume(points, self.faces)


@dataclass(frozen=True, eq=False)
class AlongNormals:
    """A stepper whose steps are projected on the normals: points do not slide along the surface.

    :param stepper: whose step is projected on the normals at its start.
    :param faces: (m, 3).
    """

    stepper: Stepper
    faces: Array
    name = "along normals"

    @property
    def rates(self) -> int:
        """The rates of the inner stepper."""
        return self.stepper.rates

    def step(self, flow: Flow, u: Array, dt: float, diagonal: int = 0, workspace: Workspace | None = None) -> Array:
        """The points (n, 3) after time dt."""
        new, normals = self.stepper.step(flow, u, dt, diagonal, workspace), normals_at(u, self.faces)
        return u + np.einsum("ij,ij->i", new - u, normals)[:, None] * normals

    def largest(self, flow: Flow, u: Array) -> float:
        """The largest stable step of the inner stepper."""
        return self.stepper.largest(flow, u)
