"""Windows spread over a grid, as a sample of the whole."""

import numpy as np

__all__ = ["ENOUGH", "Tile", "spread_tiles"]

# The largest number of samples, and the number of windows along each side; more have no significant effect.
ENOUGH, TILES = 1_000_000, 8

Tile = tuple[slice, slice]


def spread_tiles(shape: tuple[int, ...], enough: int = ENOUGH, count: int = TILES) -> list[Tile]:
    """Evenly spread windows with at most ``enough`` samples in total; the whole grid where it is small."""
    h, w = shape
    if h * w <= enough:
        return [(slice(0, h), slice(0, w))]
    side = int(np.sqrt(enough)) // count
    high, wide = min(h, side), min(w, side)
    tops = np.unique(np.linspace(0, h - high, max(1, count * side // high)).astype(int))
    lefts = np.unique(np.linspace(0, w - wide, max(1, count * side // wide)).astype(int))
    return [(slice(top, top + high), slice(left, left + wide)) for top in tops for left in lefts]
