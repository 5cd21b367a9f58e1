"""Anisotropic diffusion along a vector field, from noise: flow visualization on grids and surfaces [PR99]."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from meshflow.errors import InputError
from meshflow.geometry.operator import mass
from meshflow.geometry.validation import Array, positive, whole

__all__ = ["field_diffusion", "field_picture"]


def field_diffusion(
    points: Array,
    faces: Array,
    field: Array,
    time: float = 20.0,
    steps: int = 8,
    across: float = 0.02,
) -> Array:
    """Stripes along a vector field on a triangulated surface: rho_t = div(A grad rho) + f(rho), from white noise [PR99].

    A has the eigenvalue 1 along the field and ``across`` G(|grad rho|) perpendicular to it, G(s) = 1 / (1 + (h s)^2), h the
    mean edge; f(rho) = (2 rho - 1)(1 - (2 rho - 1)^2) / (4 h^2) drives rho to 0 and 1 and keeps the contrast. T. Preusser, M.
    Rumpf, IEEE Visualization 1999, 323-332, as surveys give it; the paper itself was not at hand: its f
    and its presmoothed gradient are replaced by these. Linear finite elements, semi-implicit steps, as there; where the field
    is zero diffusion is equal in all directions.

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(2)
        >>> around = np.cross([0.0, 0.0, 1.0], ball.points)
        >>> field_diffusion(ball.points, ball.faces, around, time=4.0, steps=2).shape == (len(ball.points),)
        True

    :param points: (n, d), d of 2 or 3.
    :param faces: (m, 3).
    :param field: (n, d), vectors at the vertices; their component in the triangles counts.
    :param time: of all steps together, in squared mean edges.
    :param steps: number of steps, 1 or more.
    :param across: diffusion across the field, in (0, 1].
    :returns: rho (n,), from 0 to 1, the same for the same input.
    :raises InputError: for invalid arrays or parameters.
    """
    x, v = np.asarray(points, dtype=np.float64), np.asarray(field, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] not in (2, 3) or v.shape != x.shape or not np.isfinite(v).all():
        raise InputError(
            f"field: finite vectors (n, d) of points (n, d), d of 2 or 3, expected, got {v.shape} and {x.shape}"
        )
    if not 0 < across <= 1:
        raise InputError(f"across: a share above 0, at most 1, expected, got {across}")
    positive(time, "time", "squared mean edges")
    gradients, area, along = _elements(x, np.asarray(faces), v)
    h2, n = float(np.mean(area)) * 4.0 / np.sqrt(3.0), len(x)
    dt = time * h2 / whole(steps, "steps", 1)
    lumped, rho = mass(x, faces), np.random.default_rng(0).random(n)
    lumped = np.where(lumped > 0, lumped, 1.0)
    for _ in range(steps):
        slope = np.einsum("mad,ma->md", gradients, rho[faces])
        beside = across / (1.0 + h2 * np.einsum("md,md->m", slope, slope))
        stiffness = _stiffness(gradients, area, along, beside, np.asarray(faces), n)
        matrix = sparse.csc_matrix(sparse.diags(lumped) + dt * stiffness)
        rho = splu(matrix).solve(lumped * rho)
        rho = _driven(rho, dt / (4.0 * h2))
    return rho


def field_picture(field: Array, time: float = 20.0, steps: int = 8, across: float = 0.02) -> Array:
    """:func:`field_diffusion` on a grid: a picture (h, w) of the vectors (h, w, 2), x to the right and y to below.

    Example:

        >>> import numpy as np
        >>> y, x = np.mgrid[-1:1:24j, -1:1:24j]
        >>> field_picture(np.dstack([-y, x]), time=4.0, steps=2).shape
        (24, 24)

    :param field: samples that are not finite have no stripes (0.5).
    :param time: as in :func:`field_diffusion`, in squared samples.
    :param steps: as in :func:`field_diffusion`.
    :param across: as in :func:`field_diffusion`.
    """
    v = np.asarray(field, dtype=np.float64)
    if v.ndim != 3 or v.shape[2] != 2:
        raise InputError(f"field: vectors (h, w, 2) expected, got shape {v.shape}")
    h, w = v.shape[:2]
    row, column = np.mgrid[0:h, 0:w]
    index = np.arange(h * w).reshape(h, w)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    even = ((row + column)[:-1, :-1] % 2 == 0).ravel()  # diagonals alternate, so that none is preferred
    one = np.stack([a, c, b, d, b, c], axis=-1).reshape(-1, 2, 3)[even]
    other = np.stack([b, a, d, c, d, a], axis=-1).reshape(-1, 2, 3)[~even]
    faces = np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])
    there = np.isfinite(v).all(axis=2).ravel()
    points = np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64)
    faces = faces[there[faces].all(axis=1)]
    rho = field_diffusion(points, faces, np.where(there[:, None], v.reshape(-1, 2), 0.0), time, steps, across)
    return np.where(there, rho, 0.5).reshape(h, w)


def _elements(x: Array, faces: Array, v: Array) -> tuple[Array, Array, Array]:
    """Gradients (m, 3, d) of the hat functions, areas (m,), and the unit field (m, d) in the triangles, 0 where there is none."""
    legs = x[faces[:, 1:]] - x[faces[:, :1]]  # (m, 2, d)
    gram = np.einsum("mad,mbd->mab", legs, legs)
    det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    if not (det > 0).all():
        raise InputError(f"faces: triangles with area expected, got {int((det <= 0).sum())} without")
    two = np.einsum("mab,mbd->mad", np.linalg.inv(gram), legs)
    gradients = np.concatenate([-two.sum(axis=1, keepdims=True), two], axis=1)
    mean = v[faces].mean(axis=1)
    within = np.einsum("mad,mab,mb->md", legs, np.linalg.inv(gram), np.einsum("mad,md->ma", legs, mean))
    length = np.linalg.norm(within, axis=1, keepdims=True)
    return gradients, 0.5 * np.sqrt(det), np.divide(within, length, out=np.zeros_like(within), where=length > 0)


def _stiffness(gradients: Array, area: Array, along: Array, beside: Array, faces: Array, n: int) -> sparse.csr_matrix:
    """Of div(A grad): eigenvalue 1 along the field, ``beside`` across it; 1 in all directions where there is no field."""
    onto = np.einsum("mad,md->ma", gradients, along)
    beside = np.where((along != 0).any(axis=1), beside, 1.0)
    plain = np.einsum("mad,mbd->mab", gradients, gradients)
    local = beside[:, None, None] * plain + (1.0 - beside)[:, None, None] * onto[:, :, None] * onto[:, None, :]
    rows, columns = np.repeat(faces, 3, axis=1), np.tile(faces, (1, 3))
    entries = (area[:, None, None] * local).reshape(len(faces), 9)
    return sparse.csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))


def _driven(rho: Array, much: float) -> Array:
    """rho after s' = s (1 - s^2), s = 2 rho - 1, for a time ``2 much``, exactly: s e^t / sqrt(1 + s^2 (e^2t - 1))."""
    s, grown = 2.0 * np.clip(rho, 0.0, 1.0) - 1.0, np.exp(2.0 * much)
    return 0.5 + 0.5 * s * grown / np.sqrt(1.0 + s**2 * (grown**2 - 1.0))
