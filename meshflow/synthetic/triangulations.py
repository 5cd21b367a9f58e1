"""Triangulations of known surfaces: regular, random, or with slivers. Vertices lie on the surface, and on its creases."""

from collections.abc import Callable

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.synthetic.true_surfaces import Box, LPart, Ring

__all__ = ["box_mesh", "dome_mesh", "part_mesh", "ring_mesh"]

# Triangles of collinear border points have a doubled area of rounding only, in squared spacings.
NOTHING = 1e-9
# The smallest distance of a vertex from a border, in spacings, which makes triangles as thin.
NEAREST = 0.03
# A function from shares (k,) of a wall to points (k, 2); its length; its number of steps.
Wall = tuple[Callable[[Array], Array], float, int]


def box_mesh(body: Box, cells: tuple[int, int, int], shake: float, seed: int) -> tuple[Array, Array]:
    """Points (n, 3) and faces (m, 3) of a box.

    :param cells: along x, y and z.
    :param shake: random displacement of the vertices within sides and along edges, in cells; above 0 the triangles are Delaunay.
    :raises InputError: for no cells along an axis, or fewer than 2 along two.
    """
    if min(cells) < 1 or sorted(cells)[1] < 2:
        raise InputError(f"box: 2 cells or more along two axes and one along the third expected, got {cells}")
    size = np.array(cells) + 1
    at = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1).astype(np.float64)
    within = (at > 0) & (at < np.array(cells))
    at += np.where(within, shake * np.random.default_rng(seed).uniform(-1, 1, at.shape), 0.0)
    points = ((2.0 * at / np.array(cells) - 1.0) * np.array(body.half)).reshape(-1, 3)
    index, faces = np.arange(len(points)).reshape(size), []
    for axis in range(3):
        # (axis, u, v) is right-handed, so that normals of triangles anticlockwise in (u, v) point along the axis.
        sides = np.transpose(index, (axis, (axis + 1) % 3, (axis + 2) % 3))
        for side, outwards in ((sides[-1], True), (sides[0], False)):
            flat = points[side.ravel()][:, [(axis + 1) % 3, (axis + 2) % 3]]
            found = _delaunay(flat) if shake > 0 else _grid_faces(side.shape[0], side.shape[1])
            found = side.ravel()[found]
            faces.append(found if outwards else found[:, ::-1])
    return _used(points, np.concatenate(faces))


def ring_mesh(body: Ring, around: int, through: int) -> tuple[Array, Array]:
    """Points (around * through, 3) and faces of a :class:`~meshflow.synthetic.true_surfaces.Ring`, a regular grid.

    :raises InputError: for fewer than 3 vertices in either direction.
    """
    if min(around, through) < 3:
        raise InputError(f"ring: 3 vertices or more either way expected, got {around} and {through}")
    theta, roll = np.meshgrid(
        2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(through) / through, indexing="ij"
    )
    out = body.radius + body.thickness * np.cos(roll)
    points = np.stack([out * np.cos(theta), out * np.sin(theta), body.thickness * np.sin(roll)], axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape(around, through)
    a, b = index, np.roll(index, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return points, np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


def dome_mesh(count: int, seed: int) -> tuple[Array, Array]:
    """Points (about count, 3) and faces of the upper unit half sphere: a random spiral, Delaunay in Lambert's projection."""
    rng, gap = np.random.default_rng(seed), np.sqrt(2 * np.pi / count)
    reach, angle = np.sqrt(2.0 * (np.arange(count) + 0.5) / count), np.pi * (1 + 5**0.5) * np.arange(count)
    inner = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
    inner += rng.uniform(-0.3, 0.3, inner.shape) * gap
    inner = inner[np.hypot(*inner.T) < np.sqrt(2.0) - 0.5 * gap]
    theta = 2 * np.pi * np.arange(k := int(2 * np.pi / gap)) / k
    flat = np.concatenate([inner, np.sqrt(2.0) * np.stack([np.cos(theta), np.sin(theta)], axis=1)])
    square = np.einsum("ij,ij->i", flat, flat)
    points = np.column_stack([flat * np.sqrt(1.0 - square / 4.0)[:, None], 1.0 - square / 2.0])
    points[len(inner) :, 2] = 0.0
    return points, _delaunay(flat)


def part_mesh(body: LPart, spacing: float, seed: int) -> tuple[Array, Array]:
    """Points (n, 3) and faces (m, 3) of the part, vertices ``spacing`` apart, some as near a crease as :data:`NEAREST`."""
    rng, half = np.random.default_rng(seed), 0.5 * body.depth
    walls = [_straight(np.array(a), np.array(b), spacing) for a, b in body.corners]
    # Fillet and hole are traversed clockwise, so that the material is on the left of every wall.
    walls.append(_arc(body.centre, body.fillet, (1.5 * np.pi, np.pi), spacing))
    walls.append(_arc(body.middle, body.hole, (2 * np.pi, 0.0), spacing))
    pieces = [_wall(wall, half, spacing, rng) for wall in walls]
    rim = np.concatenate([wall(np.linspace(0.0, 1.0, steps + 1)[:-1]) for wall, _, steps in walls])
    inner = _shaken(np.zeros(2), np.array([1.0, body.height]), spacing, rng)
    inner = inner[body.from_outline(inner) < -NEAREST * spacing]
    flat, found = _within(body, rim, inner)
    pieces += [
        (np.column_stack([flat, np.full(len(flat), z)]), found[:, ::-1] if z < 0 else found) for z in (half, -half)
    ]
    return _welded(pieces, spacing)


def _within(body: LPart, rim: Array, inner: Array) -> tuple[Array, Array]:
    """Points (n, 2) and triangles (m, 3) between the points of a rim, with those of the inner ones that hide no edge of it.

    A point just inside of a concave wall can be joined with points across the gap, so that an edge of the wall is missing.
    """
    while True:
        flat = np.concatenate([rim, inner])
        found = _delaunay(flat)
        found = found[body.from_outline(flat[found].mean(axis=1)) < 0]
        sides = np.sort(found[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        sides, uses = np.unique(sides, axis=0, return_counts=True)
        hiding = np.unique(sides[uses == 1])
        hiding = hiding[hiding >= len(rim)] - len(rim)
        if not len(hiding):
            return flat, found
        inner = np.delete(inner, hiding, axis=0)


def _straight(a: Array, b: Array, spacing: float) -> Wall:
    """A straight wall."""
    length = float(np.linalg.norm(b - a))
    return (lambda share: a + share[:, None] * (b - a)), length, int(np.ceil(length / spacing))


def _arc(centre: tuple[float, float], radius: float, angles: tuple[float, float], spacing: float) -> Wall:
    """A round wall."""
    length = radius * abs(angles[1] - angles[0])

    def along(share: Array) -> Array:
        """Points (n, 2) at shares (n,) of the arc."""
        theta = angles[0] + share * (angles[1] - angles[0])
        return np.array(centre) + radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)

    return along, length, int(np.ceil(length / spacing))


def _wall(wall: Wall, half: float, spacing: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points and faces of a wall between z = -half and half, in the chart (length along it, z)."""
    along, length, steps = wall
    run, rise = length * np.linspace(0, 1, steps + 1), np.linspace(-half, half, int(np.ceil(2 * half / spacing)) + 1)
    rows = [np.column_stack([run, np.full(len(run), z)]) for z in (-half, half)]
    columns = [np.column_stack([np.full(len(rise) - 2, s), rise[1:-1]]) for s in (0.0, length)]
    near = NEAREST * spacing
    inner = _shaken(np.array([0.0, -half]), np.array([length, half]), spacing, rng)
    keep = (inner > [near, near - half]) & (inner < [length - near, half - near])
    flat = np.concatenate([*rows, *columns, inner[keep.all(axis=1)]])
    return np.column_stack([along(flat[:, 0] / length), flat[:, 1]]), _delaunay(flat)


def _shaken(low: Array, high: Array, spacing: float, rng: np.random.Generator) -> Array:
    """A grid of points (k, 2), spacing apart, rotated by 20 degrees and displaced randomly by a quarter of the spacing."""
    reach = int(np.ceil(np.linalg.norm(high - low) / spacing))
    at = np.stack(np.meshgrid(np.arange(-reach, reach), np.arange(-reach, reach)), axis=-1).reshape(-1, 2)
    at = spacing * (at + rng.uniform(-0.25, 0.25, at.shape))
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    at = 0.5 * (low + high) + at @ np.array([[c, s], [-s, c]])
    return at[((at > low) & (at < high)).all(axis=1)]


def _delaunay(flat: Array) -> Array:
    """Faces (m, 3), anticlockwise, of points (k, 2); triangles of collinear points are left out."""
    from scipy.spatial import Delaunay

    faces = Delaunay(flat).simplices.astype(np.int64)
    a, b, c = np.moveaxis(flat[faces], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces[twice < 0] = faces[twice < 0][:, ::-1]
    return faces[np.abs(twice) > NOTHING * np.median(np.abs(twice))]


def _grid_faces(rows: int, columns: int) -> Array:
    """Faces of a regular grid, indices row by row, anticlockwise in (row, column)."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


def _used(points: Array, faces: Array) -> tuple[Array, Array]:
    """The mesh without isolated points."""
    used, corners = np.unique(faces, return_inverse=True)
    return points[used], corners.reshape(-1, 3)


def _welded(pieces: list[tuple[Array, Array]], spacing: float) -> tuple[Array, Array]:
    """Join pieces into one mesh; points closer than a millionth of the spacing are merged."""
    points, faces, count = [], [], 0
    for some, triangles in pieces:
        points.append(some)
        faces.append(triangles + count)
        count += len(some)
    whole = np.concatenate(points)
    keys = np.rint(whole / (1e-6 * spacing)).astype(np.int64)
    _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return _used(whole[first], same.ravel()[np.concatenate(faces)])
