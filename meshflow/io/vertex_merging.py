"""Joins vertices that a format has split, for the flow, and splits them again in the result.

STL stores every corner of every triangle; textured formats store a vertex once for each of its texture coordinates or normals.
If the copies moved independently, the surface would tear open along these seams.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from meshflow.errors import Fact, InputError
from meshflow.geometry.normals import mean_edge
from meshflow.geometry.validation import Array, must_be_vertices, real, triangles_of, truth_of
from meshflow.io.document import Section
from meshflow.io.metadata import MASKS, Found, looked_up
from meshflow.surfaces.mesh import Mesh, Moves

__all__ = ["Skin", "fitted", "is_soup", "joined", "normals_after", "said_of"]

# Positions that differ by a few units in the last place of single precision of the largest coordinate count as equal, if that is
# small compared to the edges. Of vertices at an open border, those that differ by less than CLOSE of the shortest edge at either
# do: programs write few digits, and a closed surface has no such border.
WELDED, CLOSE = 4.0 * float(np.finfo(np.float32).eps), 1e-3
# A direction that does not occur in designed meshes.
ASKEW = np.array([0.6180339887, 0.7548776662, 0.2195130126])
# The most names of parts that a note lists.
LISTED = 6


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh as it is stored, the joined mesh for the flow, and the conversion back.

    :param points: (n, 3) as stored, copied.
    :param faces: (m, 3), of the stored points.
    :param channels: (n, k) as stored, or None.
    :param first: (v,), the first stored vertex of each joined vertex.
    :param home: (n,), the joined vertex of each stored vertex.
    :param data: the :class:`Mesh` of v <= n vertices.
    """

    points: Array
    faces: Array
    channels: Array | None
    first: Array
    home: Array
    data: Mesh

    @classmethod
    def of(
        cls,
        points: Array,
        faces: Array,
        *,
        split: bool | Array = False,
        channels: ArrayLike | None = None,
        moves: Moves | None = None,
    ) -> "Skin":
        """Join the vertices of a stored mesh.

        :param split: join vertices at one position (:func:`joined`); as (n,) whole numbers, only those of equal number.
        :param channels: (n,) or (n, k); a joined vertex gets the mean.
        :raises InputError: as :class:`Mesh`.
        """
        points = np.array(points)
        first, home = (
            joined(points, None if isinstance(split, bool) else split, _in_range(faces, np.arange(len(points))))
            if split is not False
            else _apart(len(points))
        )
        stored = None if channels is None else _columns(channels, len(points))
        mean = None if stored is None else _mean(stored, home, len(first))
        triangles = _in_range(faces, home)
        data = Mesh(_usable(points[first], triangles), triangles, mean, moves)
        return cls(points, np.asarray(faces), stored, first, home, data)

    @property
    def note(self) -> tuple[str, ...]:
        """A note when vertices were joined."""
        copies = len(self.home) - len(self.first)
        if not copies:
            return ()
        apart = bool((self.points != self.points[self.first][self.home]).any())
        near = f" (to {WELDED:.1g} of the largest coordinate, at borders to {CLOSE:g} edges)" if apart else ""
        said = (
            f"{len(self.home)} stored vertices are {len(self.first)} of the surface: {copies} copies at the same position{near}, "
            "which the format splits at seams, move together"
        )
        return (said if apart else Fact(said),)

    def samples(self, given: ArrayLike | None, word: str, find: Callable[[str], Found]) -> ArrayLike | None:
        """One number per joined vertex, from one per stored vertex; the most restrictive one of its copies.

        :param given: an array (n, ...), or the name of one; anything else is returned unchanged.
        :param find: looks up a name.
        :raises InputError: for a name that does not exist, with those that do, and for an array that is not of numbers.
        """
        values = looked_up(given, word, find(given)) if isinstance(given, str) else np.asarray(given)
        if values.ndim == 0 or len(values) != len(self.home):
            return given
        if values.dtype.kind not in "biuf":
            what = "a mask of booleans, or of numbers," if word in MASKS else "a number or an array of numbers"
            raise InputError(f"{word}: {what} expected, got dtype {values.dtype}")
        values = truth_of(values) if word in MASKS else values
        order = np.argsort(self.home, kind="stable")
        starts = np.searchsorted(self.home[order], np.arange(len(self.first)))
        most = np.maximum if word in ("fixed", "data_weights") else np.minimum
        return most.reduceat(values[order], starts, axis=0)

    def points_of(self, data: Mesh) -> Array:
        """Positions (n, 3) of the stored vertices, in the stored type.

        :raises InputError: for a mesh of another size.
        """
        if not isinstance(data, Mesh) or data.points.shape != self.data.points.shape:
            raise InputError(
                f"to_object: a mesh with points of shape {self.data.points.shape} expected, got {_shape_of(data)}"
            )
        moved = data.points[self.home].astype(self.points.dtype, copy=False)
        before = self.data.points[self.home]
        apart = (self.points != before).any(axis=1)
        if not apart.any():
            return moved
        still = (data.points == self.data.points).all(axis=1)[self.home] | ~np.isfinite(self.points).all(axis=1)
        beside = moved + (self.points - before).astype(self.points.dtype)
        return np.where(apart[:, None], np.where(still[:, None], self.points, beside), moved)

    def has_moved(self, data: Mesh) -> bool:
        """Whether any point has moved."""
        return not np.array_equal(self.data.points, data.points)

    def channels_of(self, data: Mesh) -> Array | None:
        """Channels (n, k) of the stored vertices, their old values plus the change; None where nothing changed."""
        before, after = self.data.channels, data.channels
        if self.channels is None or before is None or after is None or np.array_equal(before, after):
            return None
        return self.channels + (after.astype(np.float64) - before)[self.home]


def joined(points: Array, groups: Array | None = None, faces: Array | None = None) -> tuple[Array, Array]:
    """Vertices at one position: (first of each (v,), vertex of each point (n,)), in order of appearance.

    :param groups: (n,) whole numbers; only points of the same group are joined.
    :param faces: (m, 3); if given, points are joined that differ by a few units in the last place of single precision, or at open
        borders by a thousandth of an edge, unless a triangle would lose an edge. Otherwise positions must be equal to the bit.
    """
    if not len(points):
        return _apart(0)
    rows = points if groups is None else np.column_stack([points, groups])
    order = np.lexsort(rows.T)  # equal to numpy.unique of the rows, and five times as fast
    is_new = np.ones(len(rows), bool)
    is_new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    first = np.minimum.reduceat(order, np.flatnonzero(is_new))
    rank = np.argsort(np.argsort(first))
    home = np.empty(len(rows), np.int64)
    home[order] = rank[np.cumsum(is_new) - 1]
    first = np.sort(first)
    if faces is None or not len(faces):
        return first, home
    for reach in (_rounding, _at_borders):
        x = np.where(np.isfinite(points[first]), points[first], 0.0).astype(np.float64)
        near = _near(x, None if groups is None else groups[first], home[faces], reach(x, home[faces]))
        if near is None:
            continue
        # The first of several close vertices represents all.
        names, starts = np.unique(near, return_index=True)
        rank = np.empty(int(names.max()) + 1, np.int64)
        rank[near[np.sort(starts)]] = np.arange(len(names))
        first, home = first[np.sort(starts)], rank[near][home]
    return first, home


def _rounding(x: Array, faces: Array) -> Array:
    """The reach (n,) of rounding around points (n, 3); negative for those that no triangle uses."""
    reach = np.full(len(x), -1.0)
    reach[faces] = 0.0
    apart = min(WELDED * float(np.abs(x[reach == 0]).max(initial=0.0)), CLOSE * mean_edge(x, faces))
    return np.where(reach == 0, apart, reach)


def _at_borders(x: Array, faces: Array) -> Array:
    """The share CLOSE of the shortest edge (n,) at points at an open border; negative for all others."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    lengths = np.linalg.norm(x[sides[:, 0]] - x[sides[:, 1]], axis=1)
    shortest = np.full(len(x), np.inf)
    for end in sides.T:
        np.minimum.at(shortest, end, lengths)
    _, at, count = np.unique(np.sort(sides, axis=1) @ np.array([len(x), 1]), return_inverse=True, return_counts=True)
    border = np.zeros(len(x), bool)
    border[sides[count[at] == 1]] = True
    return np.where(border, CLOSE * shortest, -1.0)


def _near(x: Array, groups: Array | None, faces: Array, reach: Array) -> Array | None:
    """The cluster (n,) of points that are in reach of each other; None if all are further apart.

    Points that are close in space are close along any direction. Each is compared with the next ones along a direction that
    does not occur in designed meshes.

    :param reach: (n,), negative for points that are in reach of none.
    """
    used, apart = reach >= 0, float(reach.max(initial=0.0))
    along = x @ ASKEW
    order = np.argsort(along, kind="stable")
    order = order[used[order]]
    found, step = [], 1
    while step < len(order):
        beside = along[order[step:]] - along[order[:-step]] <= apart
        if not beside.any():
            break
        one, other = order[:-step][beside], order[step:][beside]
        same = np.abs(x[one] - x[other]).max(axis=1) <= np.minimum(reach[one], reach[other])
        if groups is not None:
            same &= groups[one] == groups[other]
        found.append(np.stack([one[same], other[same]]))
        step += 1
    pairs = np.concatenate(found, axis=1) if found else np.zeros((2, 0), np.intp)
    if not pairs.size:
        return None
    ones = np.ones(pairs.shape[1], np.int8)
    label = connected_components(sparse.coo_matrix((ones, tuple(pairs)), shape=(len(x), len(x))), directed=False)[1]
    corners = label[faces]
    lost = (corners == np.roll(corners, 1, axis=1)) & (faces != np.roll(faces, 1, axis=1))
    kept = np.isin(label, corners[lost])  # these would take an edge from a triangle
    label[kept] = label.max() + 1 + np.arange(int(kept.sum()))
    return label


def _usable(points: Array, faces: Array) -> Array:
    """The points (n, d), in which unused points that are not finite are replaced by the first used one."""
    lost = np.asarray(~np.isfinite(points).all(axis=1))
    if not lost.any() or not len(faces):
        return points
    lost[faces] = False
    return np.where(lost[:, None], points[faces[0, 0]], points)


def is_soup(faces: Array, n: int) -> bool:
    """Whether every corner of every triangle is a separate vertex, so that no triangles are connected."""
    return len(faces) > 1 and faces.size == n and len(np.unique(faces)) == n


def said_of(sections: tuple[Section, ...]) -> tuple[str, ...]:
    """A note where there are several parts."""
    names = ", ".join(name for name, _ in sections[:LISTED])
    more = f" and {len(sections) - LISTED} more" if len(sections) > LISTED else ""
    return (Fact(f"{len(sections)} parts: {names}{more}"),) if sections else ()


def fitted(values: Array, kind: np.dtype) -> Array:
    """Values in another type; for whole numbers they are rounded, and clipped to the range of the type."""
    if kind.kind in "iu":
        limits = np.iinfo(kind)
        # the largest int64 is no float64; take the next float64 below it
        top = np.nextafter(float(limits.max), 0) if kind.itemsize == 8 else limits.max
        return np.clip(np.rint(values), limits.min, top).astype(kind)
    return values.astype(kind)


def normals_after(points: Array, faces: Array, before: Array, normals: Array) -> Array:
    """Normals (n, 3) of moved vertices; hard edges stay hard, and smooth seams stay smooth.

    Stored vertices share a normal where they shared position and normal before (normals to 1e-3). A vertex without area around
    it keeps its normal.
    """
    import trimesh

    first, home = joined(np.column_stack([before, np.round(normals, 3)]))
    fresh = np.asarray(trimesh.Trimesh(points[first], home[faces], process=False).vertex_normals)[home]
    known = np.isfinite(fresh).all(axis=1) & (np.linalg.norm(fresh, axis=1) > 0.5)
    return np.where(known[:, None], fresh, normals).astype(normals.dtype)


def _apart(n: int) -> tuple[Array, Array]:
    return np.arange(n), np.arange(n)


def _columns(channels: ArrayLike, n: int) -> Array:
    values = real(np.array(channels), "channels")
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or len(values) != n:
        raise InputError(f"channels: shape ({n}, k) expected, got {np.shape(channels)}")
    return values


def _mean(values: Array, home: Array, count: int) -> Array:
    if count == len(values):
        return values.copy()
    total = np.zeros((count, values.shape[1]))
    np.add.at(total, home, values)
    return (total / np.bincount(home, minlength=count)[:, None]).astype(values.dtype)


def _in_range(faces: Array, home: Array) -> Array:
    """Faces of the joined vertices; faces with an index out of range are refused."""
    triangles = triangles_of(faces)
    must_be_vertices(triangles, len(home))
    return home[triangles]


def _shape_of(data: object) -> str:
    return str(data.points.shape) if isinstance(data, Mesh) else type(data).__name__
