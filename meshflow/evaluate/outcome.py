"""Measures of a smoothed range image: errors, silhouettes, holes."""

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from meshflow.geometry import operator
from meshflow.geometry.connectivity import boundary_edges
from meshflow.geometry.validation import Array
from meshflow.surfaces.visibility import Sight

__all__ = ["Bends", "Outcome", "Start", "Truth", "face_normals", "rim_edges"]

# Pixels between a jump of the truth and the nearest triangle whose normal is compared.
AWAY = 2


@dataclass(frozen=True, eq=False)
class Outcome:
    """A range image before or after one of the flows. Lengths are in the unit of the depths; errors are None without a truth.

    Errors of depth and normals are those of the surface seen by the camera, on the pixels that every flow has kept.

    :ivar name: ``before``, ``space``, ``normals``, ``z`` or ``rays``.
    :ivar time: of the flow, squared pixel footprints.
    :ivar roughness: mean angle between neighbouring triangles away from the rim, degrees, which is matched.
    :ivar matched: whether it reached the requested roughness.
    :ivar depth_median: median of \\|depth - truth\\|.
    :ivar depth_rms: root mean square of it.
    :ivar depth_tail: 95th percentile of \\|depth - truth\\|.
    :ivar distance_median: median distance of the vertices from the surface of the truth.
    :ivar distance_rms: root mean square of it.
    :ivar normal_error: mean angle to the normals of the truth, of triangles 2 pixels or more away from its jumps, degrees.
    :ivar drift_rms: root mean square distance of vertices of silhouettes and holes from their pixels, pixels; None without such
        vertices.
    :ivar drift_max: the largest such distance.
    :ivar area: over the area before.
    :ivar lost: number of pixels that lost their surface.
    :ivar gained: number of pixels that got a surface.
    :ivar points: (h * w, 3), vertices.
    :ivar depth: (h, w), seen from the camera; NaN without a surface.
    """

    name: str
    time: float
    roughness: float
    matched: bool
    depth_median: float | None
    depth_rms: float | None
    depth_tail: float | None
    distance_median: float | None
    distance_rms: float | None
    normal_error: float | None
    drift_rms: float | None
    drift_max: float | None
    area: float
    lost: int
    gained: int
    points: Array = field(repr=False)
    depth: Array = field(repr=False)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """The numbers by name, without arrays."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("points", "depth")}


@dataclass(frozen=True, eq=False)
class Bends:
    """The inner edges of a triangulation, away from its rim.

    :param faces: (m, 3).
    """

    faces: Array

    @cached_property
    def pairs(self) -> Array:
        """(k, 2), the two triangles of each edge without an end on the rim."""
        ends = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        size = int(self.faces.max(initial=0)) + 1
        key = ends[:, 0] * size + ends[:, 1]
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(key[order][1:] == key[order][:-1])
        rim = np.zeros(size, bool)
        rim[rim_edges(self.faces).ravel()] = True
        inner = ~rim[ends[order[same]]].any(axis=1)
        return np.stack([order[same], order[same + 1]], axis=1)[inner] // 3

    def roughness(self, points: Array) -> float:
        """Mean angle, degrees, between the normals of neighbouring triangles over points (n, 3)."""
        one, other = np.moveaxis(face_normals(points, self.faces)[self.pairs], 1, 0)
        return float(_angles(one, other).mean())


@dataclass(frozen=True, eq=False)
class Start:
    """The surface before smoothing.

    :param sight: of the camera.
    :param points: (h * w, 3).
    :param faces: (m, 3), one diagonal per cell.
    """

    sight: Sight
    points: Array
    faces: Array

    @cached_property
    def used(self) -> Array:
        """(h, w), pixels with a triangle."""
        used = np.zeros(len(self.points), bool)
        used[self.faces.ravel()] = True
        return used.reshape(self.sight.shape)

    @cached_property
    def rim(self) -> Array:
        """Vertices (k,) of silhouettes and holes: of boundary edges that are not on the frame of the image."""
        rim = np.unique(rim_edges(self.faces))
        h, w = self.sight.shape
        row, column = np.divmod(rim, w)
        return rim[(row > 0) & (row < h - 1) & (column > 0) & (column < w - 1)]

    def drift(self, points: Array) -> Array:
        """Distances (k,), in pixels, at which the vertices of the rim are seen from their pixels."""
        row, column = np.divmod(self.rim, self.sight.shape[1])
        pixels, _ = self.sight.pixels(points[self.rim], self.rim)
        return np.hypot(pixels[:, 0] - column, pixels[:, 1] - row)

    def area(self, points: Array) -> float:
        """The area over the area before."""
        return operator.total_area(points, self.faces) / operator.total_area(self.points, self.faces)


@dataclass(frozen=True, eq=False)
class Truth:
    """The true surface.

    :param sight: of the camera.
    :param depth: (h, w), NaN where there is nothing.
    :param faces: (m, 3), one diagonal per cell, none across jumps.
    """

    sight: Sight
    depth: Array
    faces: Array

    def distances(self, points: Array) -> Array:
        """Distances (n,) of points (n, 3) from its triangles."""
        import igl

        true = np.nan_to_num(self.sight.at(self.depth).reshape(-1, 3))
        return np.sqrt(np.asarray(igl.point_mesh_squared_distance(np.ascontiguousarray(points), true, self.faces)[0]))

    @cached_property
    def calm(self) -> Array:
        """Triangles (k, 3) with no corner within :data:`AWAY` pixels of a jump or a hole."""
        from scipy.ndimage import binary_dilation

        size = self.depth.size
        edge = np.ones(size, bool)
        edge[self.faces.ravel()] = False
        edge[rim_edges(self.faces).ravel()] = True
        edge = edge.reshape(self.depth.shape)
        edge[[0, -1]] &= np.isnan(self.depth[[0, -1]])
        edge[:, [0, -1]] &= np.isnan(self.depth[:, [0, -1]])
        near = binary_dilation(edge, np.ones((3, 3), bool), iterations=AWAY).ravel()
        return self.faces[~near[self.faces].any(axis=1)]

    def normal_error(self, depth: Array, kept: Array) -> float | None:
        """Mean angle, degrees, between its normals and those of depths (h, w), for triangles whose corners are all ``kept`` (h,
        w).
        """
        faces = self.calm[kept.ravel()[self.calm].all(axis=1)]
        if len(faces) == 0:
            return None
        one, other = (face_normals(self.sight.at(z).reshape(-1, 3), faces) for z in (depth, self.depth))
        return float(_angles(one, other).mean())


def rim_edges(faces: Array) -> Array:
    """Vertices (b, 2) of the edges that belong to one of the triangles (m, 3) only."""
    triangle, corner = np.divmod(boundary_edges(faces), 3)
    return np.stack([faces[triangle, (corner + shift) % 3] for shift in (1, 2)], axis=1)


def face_normals(points: Array, faces: Array) -> Array:
    """Normals (m, 3) of triangles, of twice the length of the area."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def _angles(one: Array, other: Array) -> Array:
    """Angles (n,), degrees, between vectors (n, 3); 0 where one has no length."""
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other)
    return np.degrees(np.arctan2(sine, cosine))
