"""Consistent orientation of triangles, and connected parts of a mesh."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array

__all__ = ["alike", "parts"]


def parts(faces: Array, n: int) -> tuple[int, Array]:
    """The number of connected parts of a mesh, and the part (n,) of each vertex; an isolated vertex is a part."""
    rows, columns = np.concatenate([faces[:, 0], faces[:, 0]]), np.concatenate([faces[:, 1], faces[:, 2]])
    joined = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))
    count, label = connected_components(joined, directed=False)
    return int(count), label


def alike(faces: Array) -> tuple[Array, int]:
    """Consistently oriented triangles (m, 3), with the minority of each part reversed, and the number of reversed ones.

    Two triangles with a common edge are consistent if they run through it in opposite directions. A part that cannot be
    oriented (a Moebius strip) does not change.
    """
    one, other = shared_sides(faces)
    begins = [faces[side // 3, (side + 1) % 3] for side in (one, other)]
    against = begins[0] == begins[1]
    if not against.any():
        return faces, 0
    # Each triangle occurs twice, unchanged and reversed. Consistent neighbours are joined with the same kind, others with the
    # other one.
    m, left, right = len(faces), one // 3, other // 3
    shift = np.where(against, m, 0)
    rows = np.concatenate([left, left + m])
    columns = np.concatenate([right + shift, right + m - shift])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1]
    kept, turned = label[:m], label[m:]
    size = np.bincount(kept, minlength=int(label.max()) + 1)
    # Of the two orientations of a part the one with fewer reversed triangles is chosen; of equal ones that of the first triangle.
    turn = (size[turned] > size[kept]) | ((size[turned] == size[kept]) & (turned < kept))
    turn &= turned != kept
    found = faces.copy()
    found[turn] = found[turn][:, [0, 2, 1]]
    return found, int(turn.sum())
