"""Quality of a smoothed mesh against the true surface."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from meshflow.errors import InputError
from meshflow.evaluate import metrics
from meshflow.geometry.validation import Array, shown

__all__ = ["MeshQuality", "Shape", "flipped", "mesh_quality"]


@runtime_checkable
class Shape(Protocol):
    """A mesh whose vertices lie on a known surface, as in ``meshflow.synthetic.shapes``."""

    @property
    def name(self) -> str:
        """Its name in messages."""
        ...

    @property
    def points(self) -> Array:
        """(n, 3), on the surface."""
        ...

    @property
    def faces(self) -> Array:
        """(m, 3), normals outwards."""
        ...

    @property
    def edge(self) -> float:
        """Mean length of the edges, each counted once."""
        ...

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from the true surface, not negative."""
        ...


@dataclass(frozen=True)
class MeshQuality:
    """The remaining noise, and the loss of shape.

    :ivar normal_error: mean angle between the normals of a triangle and of the same triangle over the true points, degrees.
    :ivar rms: root mean square distance of the vertices from the true surface, in mean edges of the true mesh.
    :ivar largest: the largest such distance, mean edges.
    :ivar drift: volume over that of the true mesh, minus 1; NaN for a mesh with a border.
    :ivar flipped: number of triangles whose normal is wrong by more than 90 degrees.
    """

    normal_error: float
    rms: float
    largest: float
    drift: float
    flipped: int


def mesh_quality(points: Array, shape: Shape) -> MeshQuality:
    """Measure points (n, 3) on the triangles of a shape.

    Example:

        >>> from meshflow.synthetic import cube
        >>> shape = cube(8)
        >>> mesh_quality(shape.noisy("nrm", 0.2), shape).normal_error > 5
        True

    :param points: (n, 3), one for each vertex of the shape.
    :param shape: with its true surface.
    :raises InputError: when their number differs from that of the shape, or one is not finite.
    """
    if not isinstance(shape, Shape):
        raise InputError(f"mesh_quality: a shape with points and faces expected, got {shown(shape)}")
    if np.shape(points) != shape.points.shape:
        raise InputError(f"{shape.name}: points of shape {shape.points.shape} expected, got {np.shape(points)}")
    points = np.asarray(points, dtype=np.float64)
    if not (finite := np.isfinite(points).all(axis=1)).all():
        raise InputError(f"{shape.name}: finite points expected, got {(~finite).sum()} that are not")
    away = shape.distance(points) / shape.edge
    drift = np.nan
    if metrics.is_closed(shape.faces):
        drift = metrics.volume(points, shape.faces) / metrics.volume(shape.points, shape.faces) - 1.0
    return MeshQuality(
        normal_error=metrics.normal_angle(points, shape.points, shape.faces),
        rms=float(np.sqrt(np.mean(np.square(away)))),
        largest=float(away.max()),
        drift=float(drift),
        flipped=flipped(points, shape.points, shape.faces),
    )


def flipped(points: Array, truth: Array, faces: Array) -> int:
    """Number of triangles (m, 3) whose normals over two sets of points (n, 3) are more than 90 degrees apart.

    Example:

        >>> import numpy as np
        >>> points, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
        >>> flipped(points[[0, 2, 1]], points, faces)
        1

    :param points: (n, 3).
    :param truth: (n, 3), the true points.
    :param faces: (m, 3).
    """
    one, other = (np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]]) for p in (points, truth))
    return int((np.einsum("ij,ij->i", one, other) < 0).sum())
