"""The border of irregular triangles as a curve that loses its noise, and for which planes do not move."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.geometry.connectivity import Connectivity
from meshflow.geometry.validation import Array

__all__ = ["border_operator", "border_windows"]

# Vertices of a window on each side of its middle.
REACH = 2
# A triangle whose doubled area is below this share of its longest squared edge has none; a spread below this share of the
# largest one in a window is rounding.
FLAT, STRAIGHT = 1e-12, 1e-10


def border_operator(connectivity: Connectivity, points: Array, held: Array) -> Any:
    """S (n, n): the vertices of the border move by du/dt = -S u, on their own; rows of held and of other vertices are zero.

    The border is cut into windows of five consecutive vertices. With P_w the projection of the five values on what is orthogonal
    to all functions a + b . q, q being the coordinates of the five vertices in the tangent plane of the surface there,

        S = sum_w P_w / M_w,    M_w the mean barycentric mass of the five vertices.

    S is symmetric and positive semidefinite, and S u = 0 for every u that is linear on a plane: noise of the border decays, and
    planes, outline and all, do not move. Of points that move, S moves them along the normals alone. The border vertices use no
    values of the interior, and the interior is a flow with the border given. So the generator of the whole is block triangular,
    with the blocks M^-1 L of the interior, and S: all its eigenvalues are real, and zero or positive, whatever the triangles.
    (Taking the conormals of the triangles at the border edges out of the area gradient, as grids do, is the same to the first
    order where triangles are right-angled; but it grows as the inverse height of a triangle. With slivers at the border its
    generator has large negative eigenvalues; the mean gradient of the triangles around a vertex instead leaves small ones.)

    A vertex in which not exactly two border edges meet, and a border of fewer than five vertices, stay.

    :param points: (n, d).
    :param held: (n,), vertices that stay.
    """
    n, windows = len(points), border_windows(connectivity, REACH)
    if not len(windows):
        return sparse.csr_matrix((n, n))
    stars = _Stars.of(connectivity)
    spread, area = stars.tensors(points)
    place = np.full(n, -1)
    place[stars.rim] = np.arange(len(stars.rim))
    at = points[windows] - points[windows].mean(axis=1, keepdims=True)
    if points.shape[1] > 2:
        _, axes = np.linalg.eigh(spread[place[windows]].sum(axis=1))
        at = at @ axes[:, :, -2:]
    basis, sizes, _ = np.linalg.svd(at, full_matrices=False)
    basis *= (sizes > STRAIGHT * np.maximum(sizes[:, :1], np.finfo(float).tiny))[:, None, :]
    count = windows.shape[1]
    away = np.eye(count) - 1.0 / count - basis @ basis.transpose(0, 2, 1)
    mass = area[place[windows]].mean(axis=1) / 3.0
    away *= np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)[:, None, None]
    rows, columns = np.repeat(windows, count, axis=1), np.tile(windows, (1, count))
    whole = sparse.coo_matrix((away.reshape(len(windows), -1).ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
    return sparse.csr_matrix(sparse.diags((~held).astype(np.float64)) @ sparse.csr_matrix(whole))


def border_windows(connectivity: Connectivity, reach: int) -> Array:
    """The windows (w, 2 reach + 1) of consecutive vertices of the border, all different.

    A vertex in which not exactly two border edges meet is not in the middle of one, and ends those beside it.

    :param reach: vertices on each side of the middle.
    """
    faces, corner = connectivity.faces, connectivity.border
    begin, end = (faces[corner // 3, (corner + shift) % 3] for shift in (1, 2))
    ends = np.concatenate([begin, end])
    others = np.concatenate([end, begin])
    regular = np.bincount(ends, minlength=connectivity.size) == 2
    keep = regular[ends]
    order = np.argsort(ends[keep], kind="stable")
    beside = np.full((connectivity.size, 2), -1)
    beside[ends[keep][order][::2]] = others[keep][order].reshape(-1, 2)
    middle = np.flatnonzero(regular)
    chains = [middle]
    for side in (0, 1):
        before, here = middle, beside[middle, side]
        for _ in range(reach):
            chains.insert(0 if side == 0 else len(chains), here)
            both = beside[here]
            before, here = here, np.where(both[:, 0] == before, both[:, 1], both[:, 0])
            here = np.where((before < 0) | (both < 0).all(axis=1), -1, here)
    windows = np.stack(chains, axis=1)
    ordered = np.sort(windows, axis=1)
    return windows[(ordered[:, 0] >= 0) & (np.diff(ordered, axis=1) != 0).all(axis=1)]


@dataclass(frozen=True, eq=False)
class _Stars:
    """The triangles around each vertex of the border.

    :ivar rim: (r,), the vertices.
    :ivar owner: (s,), positions in ``rim``; ``triangles`` (s, 3): the triangles around them.
    """

    rim: Array
    owner: Array
    triangles: Array

    @classmethod
    def of(cls, connectivity: Connectivity) -> "_Stars":
        """The stars of a set of triangles."""
        c, rim = connectivity, np.flatnonzero(connectivity.rim)
        counts = c.first[rim + 1] - c.first[rim]
        begin = np.repeat(np.cumsum(counts) - counts - c.first[rim], counts)
        owner = np.repeat(np.arange(len(rim)), counts)
        return cls(rim, owner, c.faces[c.corners[np.arange(len(owner)) - begin] // 3])

    def tensors(self, points: Array) -> tuple[Array, Array]:
        """The sums of area times the projection on the plane of a triangle (r, d, d), and of the areas (r,)."""
        one, two = (points[self.triangles[:, i]] - points[self.triangles[:, 0]] for i in (1, 2))
        xx, yy, xy = (np.einsum("sd,sd->s", *pair) for pair in ((one, one), (two, two), (one, two)))
        doubled = np.sqrt(np.maximum(xx * yy - xy**2, 0.0))
        there = doubled > FLAT * np.maximum(xx, yy)
        over = np.divide(0.5, doubled, out=np.zeros_like(doubled), where=there)[:, None, None]
        # The projection is (yy a a' + xx b b' - xy (a b' + b a')) / (2 A)^2 with legs a, b.
        mixed = one[:, :, None] * two[:, None, :]
        tensor = (
            yy[:, None, None] * one[:, :, None] * one[:, None, :]
            + xx[:, None, None] * two[:, :, None] * two[:, None, :]
        )
        tensor = over * (tensor - xy[:, None, None] * (mixed + mixed.transpose(0, 2, 1)))
        out = np.zeros((len(self.rim), points.shape[1], points.shape[1]))
        np.add.at(out, self.owner, tensor)
        return out, np.bincount(self.owner, np.where(there, 0.5 * doubled, 0.0), len(self.rim))
