"""Meshes made by marching cubes from a binary volume. Their steps are not noise of a sensor, and are known exactly."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from meshflow.estimate.voxel_frames import voxel_frames
from meshflow.flow.within_voxels import VoxelEdges
from meshflow.geometry.validation import Array

__all__ = ["blocks_of", "voxels_of"]

# The tolerance of a coordinate as a multiple of half an edge, in halves; the least share of vertices at the middle of an edge
# of the grid, and of triangles within one cell of it; the least number of vertices.
OFF, SHARE, FEW = 1e-3, 0.97, 200
# The largest tolerance, where coordinates are rounded; the numbers of decimals to which they may be.
MOST_OFF, DECIMALS = 0.05, (2, 3, 4, 5)
# The largest ratio of the edges of a voxel.
THICKEST = 16.0
# The bits of odd coordinates, and the least number of vertices of each: some of a body face along each axis. Blocks along the
# axes lie in planes that are at most this share of those of the grid (boxes 0.06 to 0.1, rods 0.5, balls 0.9).
BITS, FACING, BLOCKS = np.array([1, 2, 4]), 5, 0.2
# The runs of triangles on which turned axes are tried first, and how long they are.
RUNS, RUN = 10, 200
# Levels of a coordinate closer than this share of the size count as equal.
LEAST = 1e-5


def voxels_of(points: Array, faces: Array) -> VoxelEdges | None:
    """The edges of the grid if the mesh is a level set of a binary volume; None for any other mesh.

    Each vertex of such a mesh is at the middle of an edge of a regular grid: in units of half an edge, up to a common shift, one
    coordinate is odd and two are even; and each triangle is within one cell of the grid. Coordinates may be rounded, as those of
    files in single precision or of a few decimals are, and the grid may be turned and sheared.

    :param points: (n, 3); those that no triangle uses may be anything.
    :param faces: (m, 3).
    """
    used = np.unique(faces)
    if len(used) < FEW:
        return None
    x = points[used].astype(np.float64)
    place = np.zeros(len(points), np.int64)
    place[used] = np.arange(len(used))
    size = float(np.ptp(x, axis=0).max())
    if size == 0 or not np.isfinite(size):
        return None
    for grid in _grids(x, place[faces], size):
        if _of_blocks(grid.counts, grid.odd):
            return None
        odd = np.zeros((len(points), 3), bool)
        odd[used] = (grid.odd[:, None] & BITS > 0) & np.isin(grid.odd, BITS)[:, None]
        return VoxelEdges(grid.axes, odd)
    return None


@dataclass(frozen=True, eq=False)
class _Grid:
    """A grid of voxels.

    :ivar axes: (3, 3), the edges of a voxel as rows.
    :ivar counts: (n, 3), the coordinates of the vertices in halves of an edge.
    :ivar odd: (n,), the bits of those that are odd, after the shift that makes it one of them.
    """

    axes: Array
    counts: Array
    odd: Array


def _grids(x: Array, faces: Array, size: float) -> Iterator[_Grid]:
    """The grids at the middles of whose edges the points (n, 3) are, of triangles (m, 3) within its cells."""
    roundings = [_rounding(np.unique(values)) for values in x.T]
    yield from _along(x, faces, np.eye(3), size, roundings)
    rounding = float(np.linalg.norm(roundings))
    some, near = np.unique(faces[_runs(len(faces))], return_inverse=True)
    around = x - x.mean(axis=0)
    for frame in voxel_frames(x, faces, rounding):
        if np.linalg.cond(frame) > THICKEST:
            continue
        to_frame, roundings = np.linalg.inv(frame), [2.0 * rounding] * 3
        if any(_along(around[some] @ to_frame, near.reshape(-1, 3), frame, size, roundings)):
            yield from _along(around @ to_frame, faces, frame, size, roundings)


def _runs(count: int) -> Array:
    """Indices of triangles (k,): a few runs of neighbours."""
    starts = np.linspace(0, max(count - RUN, 0), RUNS).astype(np.int64)
    return np.unique(np.minimum(starts[:, None] + np.arange(RUN), count - 1))


def _along(x: Array, faces: Array, frame: Array, size: float, roundings: list[float]) -> Iterator[_Grid]:
    """The grids along the axes of coordinates (n, 3).

    :param frame: (3, 3), the unit vectors of these axes as rows; ``roundings``: of the coordinates.
    """
    for lattice in product(*(_lattices(values, size, r) for values, r in zip(x.T, roundings, strict=True))):
        halves = [half for half, _ in lattice]
        if max(halves) > THICKEST * min(halves):
            continue
        counts = np.stack([count for _, count in lattice], axis=1)
        kinds = (counts & 1) @ BITS
        many = np.bincount(kinds, minlength=8)
        for shift in range(8):
            each = many[BITS ^ shift]
            if each.sum() < SHARE * len(x) or each.min() < FACING:
                continue
            if np.mean(_within_cells(counts + (shift & BITS > 0), faces)) >= SHARE:
                yield _Grid(2.0 * np.array(halves)[:, None] * frame, counts, kinds ^ shift)


def _within_cells(counts: Array, faces: Array) -> Array:
    """Which triangles (m,) are within one cell of a grid, the corners of which are even."""
    corners = counts[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    return (high <= 2 * (low // 2) + 2).all(axis=1)


def blocks_of(edges: VoxelEdges, points: Array, label: Array) -> Array:
    """Which vertices (n,) belong to parts of many vertices that are blocks along the axes of the grid, and have no steps.

    :param label: (n,), the number of the part of each vertex.
    """
    counts = np.rint(2.0 * points.astype(np.float64) @ np.linalg.inv(edges.axes)).astype(np.int64)
    odd, blocks = edges.odd @ BITS, np.zeros(len(points), bool)
    for part in np.flatnonzero(np.bincount(label[odd > 0]) >= FEW):
        mine = label == part
        blocks[mine] = _of_blocks(counts[mine], odd[mine])
    return blocks


def _of_blocks(counts: Array, odd: Array) -> bool:
    """Whether nearly all vertices lie in a few planes of the grid: blocks along its axes have no steps.

    :param counts: (n, 3), coordinates in halves of an edge; ``odd``: (n,), the bits of those that are odd.
    """
    planes, spanned = [], 0.0
    for axis, bit in enumerate(BITS):
        planes.append(np.unique(counts[odd == bit, axis], return_counts=True)[1])
        spanned += 0.5 * float(np.ptp(counts[:, axis]))
    fullest = np.sort(np.concatenate(planes))[::-1]
    needed = int(np.searchsorted(np.cumsum(fullest), SHARE * len(counts))) + 1
    return needed <= BLOCKS * spanned


def _lattices(values: Array, size: float, rounding: float) -> list[tuple[float, Array]]:
    """Halves of an edge of which a coordinate (n,) may be multiples, each with these multiples (n,).

    Along the axis of a rod nearly all levels are a whole edge apart: half of the usual distance may be meant, too.

    :param size: of the mesh; ``rounding``: of the coordinate.
    """
    inside = np.sort(values)
    steps = np.diff(inside)
    apart = steps > LEAST * size
    if apart.sum() < 2 or apart.sum() + 1 > len(values) / 2:
        return []
    starts = np.concatenate([[0], np.flatnonzero(apart) + 1])
    levels = np.add.reduceat(inside, starts) / np.diff([*starts, len(inside)])
    found = []
    for part in (1.0, 0.5):
        half = part * float(np.median(np.diff(levels)))
        many = np.rint((levels[-1] - levels[0]) / half)
        half = float(levels[-1] - levels[0]) / many  # the median is rounded
        counts = (values - levels[0]) / half
        off = min(OFF + (2e-6 * size + 2.0 * rounding) / half, MOST_OFF)
        if np.mean(np.abs(counts - np.rint(counts)) > off) <= 1.0 - SHARE:
            found.append((half, np.rint(counts).astype(np.int64)))
    return found


def _rounding(levels: Array) -> float:
    """How far coordinates are off by the single precision or the few decimals with which they were stored; else 0."""
    for decimals in DECIMALS:
        if np.allclose(np.round(levels, decimals), levels, rtol=0.0, atol=2e-7 * float(np.abs(levels).max())):
            return 0.5 * 10.0**-decimals
    single = bool((levels == levels.astype(np.float32)).all())
    return float(np.spacing(np.float32(np.abs(levels).max()))) if single else 0.0
