"""The samples of a grid that a search uses: all of a small grid, tiles side by side of a large one, and a copy per probe."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.roughness import of_every_roughness
from meshflow.geometry.validation import Array
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Grid

__all__ = ["MARGIN", "SIDE", "Piece", "Window", "along_border", "pieces_of", "repeated", "spread", "whole"]

# The side of a tile in samples, and the number of samples at a cut that are not counted.
SIDE, MARGIN = 40, 4
# The number of tiles from which those that are used are chosen.
POOL = 256
# The number of tiles that are run together: rows of that length are fast, and two threads have work.
TOGETHER = 32
# Blocks of a grid that is used as a whole, for standard errors: their largest width, and the least number along a side.
BLOCK, BLOCKS = 32, 4

Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Piece:
    """Tiles of a grid side by side, with a column of missing samples between them.

    :ivar grid: the unchanged samples.
    :ivar counted: (m,), row-major indices in the grid of the samples that are counted, tile by tile.
    :ivar begins: (g,), index in ``counted`` of the first sample of each tile.
    :ivar sigma: the noise of each sample (1, h, w), of each channel (k, 1, 1), or of all (1, 1, 1).
    :ivar limit: (k, h, w), the largest change of each sample; None: none.
    :ivar speed: (1, h, w), the mobility; None: all samples are free.
    :ivar unit: the root mean square of the noise of the whole grid, in which errors are counted where the noise differs.
    """

    grid: Grid
    counted: Array
    begins: Array
    sigma: Array
    limit: Array | None = None
    speed: Array | None = None
    unit: float = 1.0


def whole(grid: Grid, sigma: Array, limit: Array | None = None, speed: Array | None = None) -> Piece:
    """A grid as one piece. Its blocks serve as tiles."""
    h, w = grid.shape
    side = max(2, min(BLOCK, h // BLOCKS, w // BLOCKS))
    rows, columns = np.arange(h) // side, np.arange(w) // side
    label = rows[:, None] * (columns[-1] + 1) + columns
    return _piece(grid, np.where(_counts(grid), label, -1), sigma, limit, speed, _unit(grid, sigma))


def pieces_of(
    grid: Grid, windows: Sequence[Window], sigma: Array, limit: Array | None = None, speed: Array | None = None
) -> tuple[Piece, ...]:
    """Windows of a grid, all of one size, as pieces.

    If rows have different spacings, the windows of a piece lie in the same rows.
    """
    if np.ndim(grid.spacing[0]):
        tops = sorted({window[0].start for window in windows})
        together = [[window for window in windows if window[0].start == top] for top in tops]
    else:
        parts = -(-len(windows) // TOGETHER)
        together = [list(windows[i::parts]) for i in range(parts)]
    return tuple(_joined(grid, part, sigma, limit, speed) for part in together)


def spread(grid: Grid, count: int, side: int = SIDE) -> list[Window]:
    """About ``count`` windows of a grid, of every roughness. Windows with less than half of their samples free are replaced by
    others.
    """
    h, w = grid.shape
    high, wide = min(h, side), min(w, side)
    free, found = ~(grid.missing | grid.fixed), []
    for more in (1, 4, 16):
        windows = _laid(h, w, high, wide, more * max(count, POOL))
        shares = [float(free[window].mean()) for window in windows]
        found = [window for window, share in zip(windows, shares, strict=True) if share >= 0.5]
        if 4 * len(found) >= 3 * count or (more > 1 and found):
            break
        if not found:
            best = np.argsort(shares, kind="stable")[::-1][:count]
            found = [windows[i] for i in np.sort(best) if shares[i] > 0]
    return of_every_roughness(found, count, lambda window: (grid.planes[:, *window], grid.missing[window]))


def along_border(grid: Grid, count: int, side: int = SIDE) -> list[Window]:
    """At most ``count`` evenly spaced windows along the border of a grid."""
    h, w = grid.shape
    high, wide = min(h, side), min(w, side)
    rows = sorted({int(r) for r in np.linspace(0, h - high, max(2, -(-h // high)))})
    columns = sorted({int(c) for c in np.linspace(0, w - wide, max(2, -(-w // wide)))})
    places = [(r, c) for r in rows for c in columns if r in (rows[0], rows[-1]) or c in (columns[0], columns[-1])]
    windows = [(slice(r, r + high), slice(c, c + wide)) for r, c in places]
    windows = [window for window in windows if not (grid.missing[window] | grid.fixed[window]).all()]
    if len(windows) <= count:
        return windows
    return [windows[i] for i in np.linspace(0, len(windows) - 1, count).astype(int)]


def _laid(h: int, w: int, high: int, wide: int, count: int) -> list[Window]:
    """Windows in evenly spaced rows and columns that do not overlap."""
    down = int(np.clip(np.rint(np.sqrt(count * h / w)), 1, max(1, h // high)))
    across = int(np.clip(np.rint(count / down), 1, max(1, w // wide)))
    down = int(np.clip(np.rint(count / across), down, max(1, h // high)))
    tops = ((np.arange(down) + 0.5) * h / down - high / 2).clip(0, h - high).astype(int)
    lefts = ((np.arange(across) + 0.5) * w / across - wide / 2).clip(0, w - wide).astype(int)
    return [(slice(top, top + high), slice(left, left + wide)) for top in tops.tolist() for left in lefts.tolist()]


def _counts(grid: Grid) -> Array:
    """Mask (h, w) of the samples that are counted: those that may move, or if there are none, those that are present."""
    counted = ~(grid.missing | grid.fixed)
    return counted if counted.any() else ~grid.missing


def _piece(grid: Grid, label: Array, sigma: Array, limit: Array | None, speed: Array | None, unit: float) -> Piece:
    """A piece of a grid.

    :param label: (h, w), the number of the tile of each sample, -1 where it is not counted; ``unit``: see :class:`Piece`.
    """
    flat = label.ravel()
    places = np.flatnonzero(flat >= 0)
    places = places[np.argsort(flat[places], kind="stable")]
    begins = np.flatnonzero(np.diff(flat[places], prepend=-1))
    return Piece(grid, places, begins, sigma, limit, speed, unit)


def _unit(grid: Grid, sigma: Array) -> float:
    """The root mean square of the noise of the samples that are present."""
    square = np.square(sigma, dtype=np.float64)
    if sigma.shape[-2:] == (1, 1):
        return float(np.sqrt(square.mean()))
    there = np.broadcast_to(~grid.missing, grid.planes.shape)
    return float(np.sqrt(np.mean(np.broadcast_to(square, there.shape), where=there)))


def _joined(grid: Grid, windows: list[Window], sigma: Array, limit: Array | None, speed: Array | None) -> Piece:
    """Windows of one size side by side."""
    h, w = grid.shape
    label = _beside([_inner(window, h, w, i) for i, window in enumerate(windows)], -1)
    planes, missing, fixed = (
        _beside([array[..., *window] for window in windows], fill)
        for array, fill in ((grid.planes, 0.0), (grid.missing, True), (grid.fixed, False))
    )
    dx, dy = grid.spacing
    widths = dx if np.ndim(dx) == 0 else np.asarray(dx)[windows[0][0]]
    cuts = None if grid.cuts is None else _cuts_beside(grid.cuts, windows)
    spacing, apart = (widths, dy), grid.ragged
    joined = replace(grid, planes=planes, missing=missing, fixed=fixed, spacing=spacing, cuts=cuts, apart=apart)
    label = np.where(_counts(joined), label, -1)
    own = sigma if sigma.shape[-2:] == (1, 1) else _parts_beside(sigma, windows, _unit(grid, sigma))
    parts = (None if array is None else _parts_beside(array, windows, 0.0) for array in (limit, speed))
    return _piece(joined, label, own, *parts, unit=_unit(grid, sigma))


def _inner(window: Window, h: int, w: int, number: int) -> Array:
    """The number of a tile where its samples are counted, else -1. Samples beside a cut do not count; those at the border of
    the grid do.
    """
    rows, columns = window
    label = np.full((rows.stop - rows.start, columns.stop - columns.start), -1)
    label[
        MARGIN * (rows.start > 0) : len(label) - MARGIN * (rows.stop < h),
        MARGIN * (columns.start > 0) : label.shape[1] - MARGIN * (columns.stop < w),
    ] = number
    return label


def _parts_beside(array: Array, windows: list[Window], fill: float) -> Array:
    """Windows of an array (k, h, w) side by side."""
    return _beside([array[..., *window] for window in windows], fill)


def _beside(parts: Sequence[Array], fill: float) -> Array:
    """Arrays (..., h, w) side by side with a column of ``fill`` between them."""
    gap = np.full((*parts[0].shape[:-1], 1), fill, parts[0].dtype)
    row = [array for part in parts for array in (gap, part)]
    return np.concatenate(row[1:], axis=-1)


def _cuts_beside(cuts: Cuts, windows: Sequence[Window]) -> Cuts:
    """The cuts of windows side by side."""
    right, down = [], []
    for rows, columns in windows:
        inner = cuts.right[rows, columns.start : columns.stop - 1]
        right.append(np.pad(inner, ((0, 0), (0, 1))))
        down.append(cuts.down[rows.start : rows.stop - 1, columns])
    return Cuts(_beside(right, False)[:, :-1], _beside(down, False))


def repeated(piece: Piece, planes: Sequence[Array]) -> tuple[Grid, Array, Array | None, Array | None]:
    """Copies of the grid of a piece side by side, one for each of ``planes`` (k, h, w), so that one call of a kernel moves all.

    :returns: the grid; the indices (copies, m) of the counted samples of each copy; the limit (n, k); the mobility (n, 1).
    """
    grid, (h, w), count = piece.grid, piece.grid.shape, len(planes)
    missing, fixed = (_beside([array] * count, fill) for array, fill in ((grid.missing, True), (grid.fixed, False)))
    cuts = None if grid.cuts is None else _cuts_beside(grid.cuts, [(slice(0, h), slice(0, w))] * count)
    wide = replace(grid, planes=_beside(planes, 0.0), missing=missing, fixed=fixed, cuts=cuts, apart=grid.ragged)
    rows, columns = np.divmod(piece.counted, w)
    places = rows * wide.shape[1] + columns + (w + 1) * np.arange(count)[:, None]
    return wide, places, _columns(piece.limit, count), _columns(piece.speed, count)


def _columns(array: Array | None, count: int) -> Array | None:
    """``count`` copies of an array (k, h, w) side by side, as (n, k)."""
    return None if array is None else _beside([array] * count, 0.0).reshape(len(array), -1).T
