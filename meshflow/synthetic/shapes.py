"""Triangle meshes on known surfaces, and noisy measurements of them, each given by a seed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, positive
from meshflow.synthetic.triangulations import box_mesh, dome_mesh, part_mesh, ring_mesh
from meshflow.synthetic.true_surfaces import Blob, Box, Dome, LPart, Ring, TrueSurface

__all__ = ["SHAPES", "Noise", "Shape", "blob", "cube", "dome", "mean_edge", "part", "plate", "ring", "sphere"]

Noise = Literal["iso", "nrm"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A triangle mesh whose vertices lie on a known surface.

    :ivar name: a short name.
    :ivar points: (n, 3), on the surface, whose size is about 1.
    :ivar faces: (m, 3), normals outwards.
    :ivar surface: the true surface; ``surface.distance`` is the distance of a point from it.
    """

    name: str
    points: Array
    faces: Array
    surface: TrueSurface

    @property
    def edge(self) -> float:
        """Mean length of the edges, each counted once."""
        return mean_edge(self.points, self.faces)

    def distance(self, points: Array) -> Array:
        """Distance (k,) of points (k, 3) from the true surface, not negative, in its unit."""
        return self.surface.distance(points)

    def normals(self) -> Array:
        """Unit normals (n, 3) at the vertices: of the triangles around them, weighted by angles (Thürmer, Wüthrich 1998).

        On a crease they are the mean of its sides, independent of the triangulation; inside a flat side they are exact.
        """
        corners = self.points[self.faces]
        a, b, c = np.moveaxis(corners, 1, 0)
        across = np.cross(b - a, c - a)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        total = np.zeros_like(self.points)
        for shift in range(3):
            here, there, beyond = (corners[:, (shift + k) % 3] for k in range(3))
            one, other = there - here, beyond - here
            angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other))
            np.add.at(total, self.faces[:, shift], angle[:, None] * across)
        return total / np.linalg.norm(total, axis=1, keepdims=True)

    def noisy(self, kind: Noise, level: float, seed: int = 7) -> Array:
        """The points (n, 3) with noise.

        :param kind: ``iso``: independent in x, y and z; ``nrm``: along the true normals only.
        :param level: standard deviation of each coordinate, or along the normal, in mean edge lengths; 0 or more.
        :raises InputError: for another kind, or a negative level.
        """
        if kind not in ("iso", "nrm"):
            raise InputError(f"noise: iso or nrm expected, got {kind!r}")
        if not level >= 0:
            raise InputError(f"noise: a level of 0 or more mean edge lengths expected, got {level}")
        rng = np.random.default_rng(seed)
        if kind == "iso":
            return self.points + level * self.edge * rng.normal(size=self.points.shape)
        return self.points + level * self.edge * rng.normal(size=(len(self.points), 1)) * self.normals()


def mean_edge(points: Array, faces: Array) -> float:
    """Mean length of the edges of triangles (m, 3) over points (n, d), each edge counted once; in the unit of the points."""
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    ends = np.unique(ends, axis=0)
    return float(np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1).mean())


def cube(cells: int = 32, irregular: bool = False, seed: int = 0) -> Shape:
    """A cube of edge 1, 6 x cells x cells x 2 triangles: flat sides, sharp edges and corners.

    Example:

        >>> shape = cube(4)
        >>> len(shape.faces)
        192
        >>> float(abs(shape.distance(shape.points)).max())
        0.0

    :param cells: number of cells along each edge.
    :param irregular: vertices are displaced randomly by a third of a cell within sides and along edges, with Delaunay triangles.
    :param seed: of all random numbers.
    :raises InputError: for fewer than 2 cells.
    """
    body = Box((0.5, 0.5, 0.5))
    points, faces = box_mesh(body, (cells, cells, cells), 0.33 if irregular else 0.0, seed)
    return Shape("irregular cube" if irregular else "cube", points, faces, body)


def plate(cells: int = 60, seed: int = 0) -> Shape:
    """A plate of 1 x 1 x 0.03, two cells thick by default, which shrinks easily.

    Example:

        >>> plate(8).points.shape[1]
        3

    :param cells: number of cells along each long side.
    :param seed: of all random numbers.
    :raises InputError: for fewer than 2 cells.
    """
    body = Box((0.5, 0.5, 0.015))
    across = max(1, round(cells * 0.03))
    return Shape("plate", *box_mesh(body, (cells, cells, across), 0.0, seed), body)


def part(spacing: float = 0.016, seed: int = 0) -> Shape:
    """A machine part: an extruded L with a fillet and a hole; creases are exact, and there are slivers.

    Example:

        >>> len(part(0.05).faces) > 100
        True

    :param spacing: of the vertices, in lengths of the longer leg; below 0.1.
    :param seed: of all random numbers.
    :raises InputError: for another spacing.
    """
    if not 0 < positive(spacing, "spacing") < 0.1:
        raise InputError(f"part: a spacing below 0.1 expected, got {spacing}")
    body = LPart()
    return Shape("CAD part", *part_mesh(body, spacing, seed), body)


def sphere(subdivisions: int = 5) -> Shape:
    """A unit sphere, 10 * 4^subdivisions + 2 vertices of a subdivided icosahedron (10242 by default).

    Example:

        >>> sphere(2).points.shape
        (162, 3)

    :param subdivisions: number of subdivisions, at least 1.
    :raises InputError: for less than one subdivision.
    """
    if subdivisions < 1:
        raise InputError(f"sphere: one subdivision or more expected, got {subdivisions}")
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    points = np.array(mesh.vertices, dtype=np.float64)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # A torus without a hole: the surface at distance 1 from a circle of radius 0.
    return Shape("sphere", points, np.array(mesh.faces, dtype=np.int64), Ring(0.0, 1.0))


def ring(around: int = 160, through: int = 64) -> Shape:
    """A torus of radii 1 and 0.4.

    Example:

        >>> ring(16, 8).points.shape
        (128, 3)

    :param around: number of vertices around the axis.
    :param through: number of vertices around the tube.
    :raises InputError: for fewer than 3 vertices in either direction.
    """
    body = Ring(1.0, 0.4)
    return Shape("torus", *ring_mesh(body, around, through), body)


def blob(cells: int = 64) -> Shape:
    """A level set of a sum of Gaussians by marching cubes on a grid of cells^3, with slivers of every size.

    Vertices are moved onto the surface, which makes some triangles even thinner.

    Example:

        >>> blob(16).points.shape[1]
        3

    :param cells: number of cells along each side of the grid.
    :raises InputError: for fewer than 8 cells.
    """
    if cells < 8:
        raise InputError(f"blob: 8 cells or more expected, got {cells}")
    body = Blob()
    import pyvista

    # Shifted slightly, so that no vertex of the grid lies on the surface, where triangles would have no area.
    low, high = -1.013, 1.011
    grid: Any = pyvista.ImageData(dimensions=(cells + 1,) * 3, spacing=((high - low) / cells,) * 3, origin=(low,) * 3)
    values = body.value(np.asarray(grid.points, dtype=np.float64))
    found = grid.contour([0.0], scalars=values, method="marching_cubes", compute_normals=False).clean().triangulate()
    faces = found.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    return Shape("blob", *_outwards(body.projected(np.asarray(found.points, dtype=np.float64)), faces), body)


def dome(count: int = 6000, seed: int = 0) -> Shape:
    """A hemisphere of radius 1 with an open border at z = 0, sampled irregularly.

    Example:

        >>> dome(100).points.shape
        (107, 3)

    :param count: approximate number of vertices.
    :param seed: of all random numbers.
    :raises InputError: for fewer than 100 vertices.
    """
    if count < 100:
        raise InputError(f"dome: 100 vertices or more expected, got {count}")
    return Shape("dome", *dome_mesh(count, seed), Dome())


def _outwards(points: Array, faces: Array) -> tuple[Array, Array]:
    """A closed mesh, oriented to have a positive volume."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inside_out = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() < 0
    return points, np.ascontiguousarray(faces[:, ::-1]) if inside_out else faces


SHAPES: Mapping[str, Callable[[], Shape]] = {
    "cube": cube,
    "irregular cube": partial(cube, irregular=True),
    "CAD part": part,
    "sphere": sphere,
    "torus": ring,
    "blob": blob,
    "plate": plate,
    "dome": dome,
}
