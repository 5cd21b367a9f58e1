"""Delaunay triangulations of places on a plane and on a sphere, and what bounds them: a longest edge, an outline, flat rims."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["delaunay_on_plane", "delaunay_on_sphere", "must_be_apart", "rings_of", "shorter_than", "within"]

# A triangle at the border that faces it with more than this angle is left out. On 4000 random points heat of time 2 leaves noise
# of 1.16 with the whole convex hull, 0.83 with 150 degrees, 0.82 with 120 and 0.83 with 100 (a surface of slope 1, noise 2).
FLAT = 120.0
# The largest number of rounds in which such triangles are sought, each beside those of the last.
ROUNDS = 20
# The distance from the centre of a sphere beyond which a side of a hull lies beside it.
INSIDE = 1e-9


def must_be_apart(places: Array, what: str) -> None:
    """Refuse places of which two are the same.

    :param places: (n, d).
    :param what: the data, for the message.
    :raises InputError: with two of them, and what to do.
    """
    order = np.lexsort(places.T)
    same = (places[order[1:]] == places[order[:-1]]).all(axis=1)
    if not same.any():
        return
    one, other = sorted(int(i) for i in order[int(np.argmax(same)) + np.arange(2)])
    raise InputError(
        f"{what}: points apart from each other expected, got {int(same.sum())} at the place of another (points {one} and {other} "
        f"at {tuple(float(x) for x in places[one])}); take their means first, as with pandas: "
        "table.groupby(['x', 'y']).mean()"
    )


def delaunay_on_plane(places: Array, what: str) -> Array:
    """The Delaunay triangulation (m, 3) of points of a plane, without flat triangles at its rim, counterclockwise.

    The convex hull has long triangles of next to no height between points that have nothing to do with each other; their
    cotangents are large and of both signs.

    :param places: (n, 2), none twice.
    :param what: the data, for messages.
    :raises InputError: for fewer than three points, and for points on one line.
    """
    from scipy.spatial import Delaunay, QhullError  # a tenth of the time that the command takes to start

    must_be_apart(places, what)
    if len(places) < 3:
        raise InputError(f"{what}: three points or more expected, which span a triangle, got {len(places)}")
    middle = places.mean(axis=0)
    size = float(np.abs(places - middle).max())
    try:
        found = Delaunay((places - middle) / size)  # coordinates of a map have many digits before the ones that differ
    except QhullError:
        found = None
    if found is None or not len(found.simplices):
        raise InputError(
            f"{what}: points that span triangles expected, got {len(places)} on one line; values along a line are no surface"
        )
    return _without_flat_rims(places, np.ascontiguousarray(found.simplices, dtype=np.int64))


def delaunay_on_sphere(directions: Array, what: str) -> Array:
    """The Delaunay triangulation (m, 3) of points of a sphere, which is their convex hull, counterclockwise seen from outside.

    Of points on less than half of the sphere, the side of the hull that faces its centre is left out, as are flat triangles at
    the rim.

    :param directions: (n, 3), unit vectors, none twice.
    :param what: the data, for messages.
    :raises InputError: for fewer than four points, and for points on one circle.
    """
    from scipy.spatial import ConvexHull, QhullError

    must_be_apart(directions, what)
    try:
        hull = ConvexHull(directions)
    except (QhullError, ValueError) as cause:
        raise InputError(
            f"{what}: points around a sphere expected, got {len(directions)}, which span no body (on one circle, or too few)"
        ) from cause
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(directions[faces], 1, 0)
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[turned] = faces[turned][:, [0, 2, 1]]
    return _without_flat_rims(directions, faces[hull.equations[:, 3] < -INSIDE])


def shorter_than(points: Array, faces: Array, most: float) -> Array:
    """The triangles all of whose edges are at most so long.

    :param points: (n, d).
    """
    sides = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
    return faces[(sides <= most).all(axis=1)]


def rings_of(outline: ArrayLike | Sequence[ArrayLike], what: str) -> tuple[Array, ...]:
    """The rings (k, 2) of an outline: one, or several of which those inside others are holes.

    :raises InputError: for anything but rings of three points or more.
    """
    alone = all(np.ndim(ring) == 1 for ring in outline)  # type: ignore[union-attr]
    rings = tuple(np.asarray(ring, dtype=np.float64) for ring in ([outline] if alone else outline))  # type: ignore[list-item]
    for ring in rings:
        if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.isfinite(ring).all():
            raise InputError(f"{what}: rings of three points (x, y) or more expected, got shape {ring.shape}")
    return rings


def within(points: Array, faces: Array, rings: Sequence[Array]) -> Array:
    """The triangles whose centres lie inside an outline: inside an odd number of its rings.

    :param points: (n, 2).
    :param rings: (k, 2) each, closed or not.
    """
    x, y = points[faces].mean(axis=1).T
    inside = np.zeros(len(faces), bool)
    for ring in rings:
        for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            if y0 != y1:
                crosses = (y0 > y) != (y1 > y)
                inside ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return faces[inside]


def _without_flat_rims(points: Array, faces: Array) -> Array:
    """The triangles without those with one border edge, which they face with a wide angle, from the border inwards."""
    for _ in range(ROUNDS):
        border = _on_border(faces, len(points))
        corners = points[faces]
        one, other = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
        length = np.linalg.norm(one, axis=2) * np.linalg.norm(other, axis=2)
        cosine = np.divide((one * other).sum(axis=2), length, out=-np.ones_like(length), where=length > 0)
        flat = (border & (cosine < np.cos(np.radians(FLAT)))).any(axis=1) & (border.sum(axis=1) == 1)
        if not flat.any() or flat.all():
            break
        faces = faces[~flat]
    return faces


def _on_border(faces: Array, n: int) -> Array:
    """Whether the side (m, 3) opposite to each corner has a triangle on one side only."""
    ends = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    _, which, count = np.unique(ends[:, 0] * n + ends[:, 1], return_inverse=True, return_counts=True)
    return (count[which.reshape(-1)] == 1).reshape(-1, 3)
