"""Triangles turned so that neighbours agree on which side is out."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.validation import Array

__all__ = ["alike", "parts"]


def parts(faces: Array, n: int) -> tuple[int, Array]:
    """How many parts a mesh has that no triangle joins, and the part (n,) of each vertex; a lone vertex is a part."""
    rows, columns = np.concatenate([faces[:, 0], faces[:, 0]]), np.concatenate([faces[:, 1], faces[:, 2]])
    joined = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))
    count, label = connected_components(joined, directed=False)
    return int(count), label


def alike(faces: Array) -> tuple[Array, int]:
    """The triangles (m, 3), those of each part that are fewer turned round, and how many were turned.

    Across an edge of two triangles these agree where it runs one way in one of them and the other way in the other. A part on
    which no choice makes all agree (a Moebius strip) stays as it is.
    """
    one, other = shared_sides(faces)
    begins = [faces[side // 3, (side + 1) % 3] for side in (one, other)]
    against = begins[0] == begins[1]
    if not against.any():
        return faces, 0
    # Each triangle stands twice, as it is and turned: who agrees is joined with the like, who does not with the other.
    m, left, right = len(faces), one // 3, other // 3
    shift = np.where(against, m, 0)
    rows = np.concatenate([left, left + m])
    columns = np.concatenate([right + shift, right + m - shift])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1]
    kept, turned = label[:m], label[m:]
    size = np.bincount(kept, minlength=int(label.max()) + 1)
    # Of the two ways to see a part that is taken by which more triangles stay; of equal ones that with the first triangle.
    turn = (size[turned] > size[kept]) | ((size[turned] == size[kept]) & (turned < kept))
    turn &= turned != kept
    found = faces.copy()
    found[turn] = found[turn][:, [0, 2, 1]]
    return found, int(turn.sum())
