"""Principal curvatures and their directions on triangles (Meyer, Desbrun, Schröder, Barr 2002). Arrays in, arrays out."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.connectivity import connect
from meshflow.geometry.facets import normals_at
from meshflow.geometry.gates import Array
from meshflow.geometry.operator import cotangents, fill_stiffness, gather_gradient, gather_mass

__all__ = ["Curvatures", "anisotropy", "curvatures", "directions"]


@dataclass(frozen=True, eq=False)
class Curvatures:
    """Curvatures at each vertex, per length; positive where the surface bends away from its normal, as a sphere does.

    :ivar mean: kappa_H (n,), and ``gauss``: K (n,), per squared length.
    :ivar greatest: kappa_1 (n,), and ``least``: kappa_2, kappa_H +- sqrt(kappa_H^2 - K).
    """

    mean: Array
    gauss: Array
    greatest: Array
    least: Array


def curvatures(points: Array, faces: Array) -> Curvatures:
    """Mean curvature by the cotangent formula, Gaussian curvature by the defect of angles, over Voronoi areas (sections 3 and 4).

    Zero at the border, where the defect is not the surface's, and at isolated vertices.

    :param points: (n, 3).
    :param faces: (m, 3), turned alike: the sign is that of the normals.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    connectivity = connect((faces,), len(points))
    cot, area = cotangents(points, faces)
    mass = gather_mass(connectivity, cot, area, "voronoi")
    known = (mass > 0) & ~connectivity.rim
    pull = np.einsum("ij,ij->i", gather_gradient(connectivity, cot, points, False), normals_at(points, faces))
    angles = np.where(area[:, None] > 0, np.arctan2(1.0, cot), 0.0)
    around: Array = np.bincount(connectivity.faces.ravel(), angles.ravel(), len(points))
    defect = np.subtract(2.0 * np.pi, around)
    mean, gauss = (np.divide(part, mass, out=np.zeros_like(mass), where=known) for part in (0.5 * pull, defect))
    root: Array = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return Curvatures(mean, gauss, mean + root, mean - root)


def directions(points: Array, faces: Array) -> Array:
    """Unit directions (n, 2, 3) of the greatest and of the least curvature, tangent to the surface (section 5.2 of the paper).

    Each edge measures the curvature along it, 2 (x_i - x_j) . n / |x_i - x_j|^2; trace and determinant are given by
    :func:`curvatures`, so the turn of the ellipse is left, by least squares over the edges, weighted by their parts of the
    Voronoi area where these are positive. Zero where there is no normal; any two at umbilics.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    n, found = len(points), curvatures(points, faces)
    edges = fill_stiffness(connect((faces,), n), cotangents(points, faces)[0]).tocoo()
    off = edges.row != edges.col
    stiff: Array = edges.data[off]
    i, j, weights = edges.row[off], edges.col[off], np.maximum(-stiff, 0.0)
    normals = normals_at(points, faces)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    lengths = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.divide(first, lengths, out=np.zeros_like(first), where=lengths > 0)
    second = np.cross(normals, first)
    way = points[j] - points[i]
    square = np.maximum(np.einsum("ij,ij->i", way, way), np.finfo(float).tiny)
    along, across = (np.einsum("ij,ij->i", way, basis[i]) for basis in (first, second))
    flat = np.maximum(along**2 + across**2, np.finfo(float).tiny)
    cosine, sine = (along**2 - across**2) / flat, 2.0 * along * across / flat  # of twice the angle
    off_mean = -2.0 * np.einsum("ij,ij->i", way, normals[i]) / square - found.mean[i]
    weights = weights * square
    cc, cs, ss, ck, sk = (
        np.bincount(i, weights * part, n)
        for part in (cosine**2, cosine * sine, sine**2, cosine * off_mean, sine * off_mean)
    )
    # Of kappa(angle) = kappa_H + R cos 2 (angle - theta): R cos 2 theta and R sin 2 theta, times a determinant of zero and above.
    theta = 0.5 * np.arctan2(cc * sk - cs * ck, ss * ck - cs * sk)[:, None]
    return np.stack(
        [np.cos(theta) * first + np.sin(theta) * second, np.cos(theta) * second - np.sin(theta) * first], axis=1
    )


def anisotropy(found: Curvatures, threshold: float) -> Array:
    """w (n,) in [-1, 1], by which the speed of mean curvature flow is multiplied (section 6 of the paper).

    1 where both curvatures are within the threshold: noise; 0 where both are beyond it and of one sign: a corner; else an edge,
    which moves by its least curvature: kappa_1 / kappa_H or kappa_2 / kappa_H, or 1 where kappa_H is the least of the three.

    :param threshold: T, per length.
    """
    one, two, mean = found.greatest, found.least, found.mean
    sizes = np.abs(np.stack([one, two, mean]))
    which = sizes.argmin(axis=0)
    least = np.where(which == 0, one, two)
    edge = np.divide(least, mean, out=np.ones_like(mean), where=(which < 2) & (mean != 0))
    high = sizes[:2] > threshold
    corner = high.all(axis=0) & (found.gauss > 0)
    return np.where(~high.any(axis=0), 1.0, np.where(corner, 0.0, edge))
