"""Spikes: single vertices of a mesh that are far off while their neighbours are not. They are detected and moved back."""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from meshflow.estimate.mesh_pieces import pieces
from meshflow.estimate.noise_growth import MAD
from meshflow.flow.low_pass import filtered
from meshflow.geometry.connectivity import connect, shared_sides
from meshflow.geometry.laplacians import neighbour_means, umbrella_generator
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["without_spikes"]

# The distance of a spike from the mean of its neighbours is AMONG times that of each neighbour, and BEYOND deviations of all
# vertices.
AMONG, BEYOND = 2.5, 6.0
# Once there are spikes, those side by side are looked for: vertices that are far, by BEYOND deviations, from the planes around
# them, and that are NEARER to these when all such vertices are put back. Planes steeper than the cosine STEEP do not count. What
# was put back is then moved to the planes in FITTED rounds.
NEARER, STEEP, FITTED = 0.5, 0.3, 3
# They are not looked for below the share SCARCE of spikes, which are hardly ever neighbours by chance: what lies side by side
# then is the shape, as on raw scans. They stay if there are more spikes than the share SPARSE, which filters remove better
# (six shapes: up to 0.1 the distance from the surface is a third less than by filters); they are off by more than SMALLEST
# times the median of the first spikes.
SCARCE, SPARSE, SMALLEST = 0.005, 0.12, 0.05
# Spikes are noise if there are at least MANY, with at least the share EITHER on each side. The tip of a cone is not noise.
MANY, EITHER = 8, 0.15
# A spike goes back no farther than FARTHEST times the distance from the mean of its neighbours, its own or the largest one of
# theirs. What would go farther has nothing around it that says where it belongs, as a piece of which every vertex is far off.
FARTHEST = 4.0
# No spike is a vertex of which this share of the triangles is coplanar (to this cosine) with what lies across.
FLAT, COSINE = 0.5, 1.0 - 1e-6
# Time of the bi-Laplacian filter for the normals, in squared edges, and the largest number of rounds of detection.
NORMALS, ROUNDS = 2.0, 16


def without_spikes(data: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh with its spikes moved back along the normals, and a sentence if there were some.

    They are moved to where the fourth differences of the points are least. A large mesh is searched only if its pieces have
    spikes.
    """
    piece = pieces(data)[0]
    if piece is not data and not _put_all_back(piece)[1].any():
        return data, ()
    x, spikes = _put_all_back(data)
    if not spikes.any():
        return data, ()
    points = np.where(spikes[:, None], x, data.points).astype(data.points.dtype)
    said = f"{spikes.sum()} of {len(x)} points are spikes: they were moved back to the surface"
    return replace(data, points=points), (said,)


def _put_all_back(data: Mesh) -> tuple[Array, Array]:
    """The points (n, 3) without spikes, and the mask (n,) of these."""
    x, spikes = _rounds(data, True)
    return (x, spikes) if spikes.mean() <= SPARSE else _rounds(data, False)


def _rounds(data: Mesh, close: bool) -> tuple[Array, Array]:
    """The points (n, 3) without spikes, and the mask (n,) of these, found in rounds; ``close``: also of spikes side by side."""
    x, faces, n = data.points.astype(np.float64), data.faces, len(data.points)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - neighbour_means(faces, n, "free"))
    step = mean_edge(x, faces)
    even = umbrella_generator(connect((faces,), n), step, np.diff(umbrella.indptr) > 1, True)
    spikes, out, least = np.zeros(n, bool), data.fixed | _among_flat(x, faces), 0.0
    for _ in range(ROUNDS):
        normals = normals_at(filtered(even, x, NORMALS * step**2, 2), faces)
        off = np.einsum("ij,ij->i", umbrella @ x, normals)
        found = _spikes(umbrella, np.abs(off), AMONG)
        if close and spikes.mean() >= SCARCE:
            found |= _side_by_side(umbrella, x, faces, (normals, spikes, least))
        found &= ~out
        if not spikes.any():
            side = off[found] > 0
            if len(side) < MANY or not EITHER <= side.mean() <= 1.0 - EITHER:
                break
            least = SMALLEST * float(np.median(np.abs(off[found])))
        if not (found & ~spikes).any():
            break
        spikes |= found
        x, lost = _put_back_near(umbrella, x, data.points, normals, spikes)
        spikes, out = spikes & ~lost, out | lost
    if close and spikes.any():
        normals = normals_at(filtered(even, x, NORMALS * step**2, 2), faces)
        x = _fitted(umbrella, x, faces, spikes, normals)
    return x, spikes


def _among_flat(x: Array, faces: Array) -> Array:
    """Mask (n,) of the vertices most of whose triangles continue, in one plane, those across their opposite edges.

    So do those of flat faces and straight edges, however uneven the triangles; a spike tilts all of its triangles.
    """
    one, two = shared_sides(faces)
    normals = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    level = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3]) > COSINE
    count = np.zeros(len(x))
    for side in (one, two):
        np.add.at(count, faces[side // 3, side % 3][level], 1.0)
    return count >= FLAT * np.maximum(np.bincount(faces.ravel(), minlength=len(x)), 1)


def _spikes(umbrella: Any, off: Array, among: float) -> Array:
    """Mask (n,) of the vertices that are far off (n,) while their neighbours are not."""
    return (off > among * _largest_around(umbrella, off)) & (off > BEYOND * MAD * float(np.median(off)))


def _largest_around(umbrella: Any, off: Array) -> Array:
    """The largest number (n,) of the neighbours of each vertex."""
    edges = umbrella.tocoo()
    apart = edges.row != edges.col
    around = np.zeros(len(off))
    np.maximum.at(around, edges.row[apart], off[edges.col[apart]])
    return around


def _side_by_side(umbrella: Any, x: Array, faces: Array, known: tuple[Array, Array, float]) -> Array:
    """Mask (n,) of further spikes, which may be neighbours of each other.

    :param known: the normals (n, 3), the mask (n,) of the spikes so far, and the least distance of a spike.
    """
    normals, spikes, least = known
    off = np.abs(_off_planes(x, faces, normals))
    far = max(least, BEYOND * MAD * float(np.median(off)))
    doubtful = (off > far) & ~spikes
    away = _put_back(umbrella, x, normals, doubtful | spikes) - x
    back = _off_planes(x + away, faces, normals)
    here = np.abs(back - np.einsum("ij,ij->i", away, normals))
    return doubtful & (here > far) & (np.abs(back) < NEARER * here)


def _fitted(umbrella: Any, x: Array, faces: Array, spikes: Array, normals: Array) -> Array:
    """The points (n, 3), with spikes as far from the planes around them as their neighbours are, so that creases stay sharp."""
    n = len(x)
    good: Any = (sparse.identity(n) - umbrella) @ sparse.diags((~spikes).astype(float))
    total = np.asarray(good.sum(axis=1)).ravel()
    x = x.copy()
    for _ in range(FITTED):
        off = _off_planes(x, faces, normals)
        usual = np.divide(good @ off, total, out=off.copy(), where=total > 0)
        x[spikes] -= ((off - usual)[:, None] * normals)[spikes]
    return x


def _off_planes(x: Array, faces: Array, normals: Array) -> Array:
    """The median distance (n,) of vertices, along their normals, from the planes of the triangles across their opposite edges.

    One spike among the neighbours does not change the median much, and at creases and corners these planes meet.
    """
    one, other = shared_sides(faces)
    planes = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    planes /= np.maximum(np.linalg.norm(planes, axis=1, keepdims=True), np.finfo(float).tiny)
    vertex = faces.ravel()[np.concatenate([one, other])]
    plane = planes[np.concatenate([other, one]) // 3]
    on_edge = x[faces[one // 3, (one + 1) % 3]]
    height = np.einsum("ij,ij->i", x[vertex] - np.concatenate([on_edge, on_edge]), plane)
    tilt = np.einsum("ij,ij->i", normals[vertex], plane)
    seen = tilt > STEEP
    vertex, height = vertex[seen], height[seen] / tilt[seen]
    order = np.lexsort((height, vertex))
    vertex, height = vertex[order], height[order]
    count = np.bincount(vertex, minlength=len(x))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    known = count > 0
    low, high = (height[(first + (count - shift) // 2)[known]] for shift in (1, 0))
    found = np.zeros(len(x))
    found[known] = np.where(np.abs(low) < np.abs(high), low, high)
    return found


def _put_back_near(umbrella: Any, x: Array, before: Array, normals: Array, spikes: Array) -> tuple[Array, Array]:
    """The points (n, 3), with spikes put back, and the mask (n,) of those that stay as before, since they would go too far.

    :param before: (n, 3), the data.
    """
    off = np.abs(np.einsum("ij,ij->i", umbrella @ before, normals))
    reach, lost = FARTHEST * np.maximum(off, _largest_around(umbrella, off)), np.zeros(len(x), bool)
    while True:
        found = _put_back(umbrella, x, normals, spikes & ~lost)
        far = spikes & ~lost & ~(np.linalg.norm(found - before, axis=1) <= reach)
        if not far.any():
            return found, lost
        lost |= far
        x = np.where(lost[:, None], before, x)


def _put_back(umbrella: Any, x: Array, normals: Array, spikes: Array) -> Array:
    """The points (n, 3), with spikes moved along their normals to minimize fourth differences."""
    if not spikes.any():
        return x
    energy = sparse.csr_matrix(umbrella.T @ umbrella)
    energy = sparse.csc_matrix(energy @ energy)
    at = np.flatnonzero(spikes)
    away = np.asarray(spsolve(energy[at][:, at], -(energy[at] @ x))).reshape(-1, x.shape[1])
    along = np.einsum("ij,ij->i", away, normals[at])[:, None] * normals[at]
    found = x.copy()
    found[at] += along
    return found
