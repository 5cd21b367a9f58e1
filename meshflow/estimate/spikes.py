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
# Spikes are noise if there are at least MANY, with at least the share EITHER on each side. The tip of a cone is not noise.
MANY, EITHER = 8, 0.15
# No spike is a vertex of which this share of the triangles is coplanar (to this cosine) with what lies across.
FLAT, COSINE = 0.5, 1.0 - 1e-6
# Time of the bi-Laplacian filter for the normals, in squared edges, and the largest number of rounds of detection.
NORMALS, ROUNDS = 2.0, 6


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
    x, faces, n = data.points.astype(np.float64), data.faces, len(data.points)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - neighbour_means(faces, n, "free"))
    step = mean_edge(x, faces)
    even = umbrella_generator(connect((faces,), n), step, np.diff(umbrella.indptr) > 1, True)
    spikes, flat = np.zeros(n, bool), _among_flat(x, faces)
    for _ in range(ROUNDS):
        normals = normals_at(filtered(even, x, NORMALS * step**2, 2), faces)
        found = _spikes(umbrella, x, normals) & ~(data.fixed | flat)
        if not spikes.any():
            side = np.einsum("ij,ij->i", umbrella @ x, normals)[found] > 0
            if len(side) < MANY or not EITHER <= side.mean() <= 1.0 - EITHER:
                break
        if not (found & ~spikes).any():
            break
        spikes |= found
        x = _put_back(umbrella, x, normals, spikes)
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


def _spikes(umbrella: Any, x: Array, normals: Array) -> Array:
    """Mask (n,) of the vertices that are far off while their neighbours are not."""
    off = np.abs(np.einsum("ij,ij->i", umbrella @ x, normals))
    edges = umbrella.tocoo()
    apart = edges.row != edges.col
    around = np.zeros(len(x))
    np.maximum.at(around, edges.row[apart], off[edges.col[apart]])
    return (off > AMONG * around) & (off > BEYOND * MAD * float(np.median(off)))


def _put_back(umbrella: Any, x: Array, normals: Array, spikes: Array) -> Array:
    """The points (n, 3), with spikes moved along their normals to minimize fourth differences."""
    energy = sparse.csr_matrix(umbrella.T @ umbrella)
    energy = sparse.csc_matrix(energy @ energy)
    at = np.flatnonzero(spikes)
    away = np.asarray(spsolve(energy[at][:, at], -(energy[at] @ x))).reshape(-1, x.shape[1])
    along = np.einsum("ij,ij->i", away, normals[at])[:, None] * normals[at]
    found = x.copy()
    found[at] += along
    return found
