"""The search on grids: which samples are looked at, and the boundary."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from meshflow.estimate.grid_risk import probed
from meshflow.estimate.pieces import SIDE, Piece, along_border, pieces_of, spread, whole
from meshflow.estimate.probes import probes
from meshflow.estimate.search_rounds import (
    Best,
    Found,
    GridSearch,
    Runs,
    candidates_of,
    surely_better,
    two_rounds,
    weights_of,
)
from meshflow.estimate.sure import Probed
from meshflow.flow.pools import Pool
from meshflow.surfaces.grid import Grid

__all__ = ["searched_on_grid"]

# The largest grids that are searched whole, with all configurations and with the best ones; and the numbers of tiles of larger
# ones.
WHOLE, WHOLE_FINE, FEW, MANY = 24_000, 70_000, 16, 64
# The largest number of tiles along the border, for the choice of the boundary.
BORDER = 32
# The least number of probed samples: a small grid has several probes, at most PROBES. Correlated noise needs more.
PROBED, PROBED_CORRELATED, PROBES = 16_000, 60_000, 6


def searched_on_grid(grid: Grid, search: GridSearch) -> Found:
    """The result of a search on a grid. The contrast of the grid is ignored."""
    unit = float(np.mean(grid.spacing[0]) * grid.spacing[1])
    with Pool(search.threads) as pool:
        first = Runs(search, _looked_at(grid, search, FEW, WHOLE), pool)
        runs, ranked = two_rounds(first, unit, partial(_more, grid, search))
        if not ranked:
            return Found(())
        neumann = search.border and _less_at_the_border(grid, runs, ranked[0])
        weights = weights_of(runs, ranked, unit) if search.blend else ()
    candidates = candidates_of(runs, ranked, "neumann" if neumann else "")
    return Found(candidates, surely_better(runs, ranked[0]), neumann, weights)


def _more(grid: Grid, search: GridSearch, smooth: bool) -> tuple[Probed, ...] | None:
    """The pieces of the second round; None where the first one had the whole grid."""
    if grid.missing.size <= WHOLE or grid.lines is not None:
        return None
    return _looked_at(grid, search, MANY * (2 if smooth else 1), WHOLE_FINE)


def _looked_at(grid: Grid, search: GridSearch, tiles: int, most: int) -> tuple[Probed, ...]:
    """The pieces of a grid that are used, with their probes; all of it for up to ``most`` samples, and for lines of sight."""
    if grid.lines is not None or grid.missing.size <= most:
        parts: tuple[Piece, ...] = (whole(grid, search.sigma, search.limit, search.speed),)
    else:
        parts = pieces_of(grid, spread(grid, tiles), search.sigma, search.limit, search.speed)
    return _with_probes(parts, search)


def _with_probes(parts: Sequence[Piece], search: GridSearch) -> tuple[Probed, ...]:
    """Pieces with their probes; the smaller they are, the more probes."""
    size, made = sum(len(part.counted) for part in parts), []
    enough = PROBED if search.correlation is None else PROBED_CORRELATED
    count = int(np.clip(-(-enough // max(1, size)), 1, PROBES))
    for seed, part in enumerate(parts):
        shape = (len(part.grid.planes), *part.grid.shape)
        made.append(probed(part, probes(shape, count, search.correlation, search.between, seed)))
    return tuple(made)


def _less_at_the_border(grid: Grid, runs: Runs, best: Best) -> bool:
    """Whether the boundary ``neumann`` has a lower risk along the border."""
    search = replace(runs.search, end=best.time, weights=(best.weight,))
    windows, sums = along_border(grid, BORDER, SIDE // 2), []
    for boundary in (grid.boundary, "neumann"):
        parts = pieces_of(replace(grid, boundary=boundary), windows, search.sigma, search.limit, search.speed)
        bordered = replace(runs, search=search, parts=_with_probes(parts, search))
        steps = (0.125, 0.25, 0.5, 1.0, *((2.0,) if best.weight > 0 else ()))
        found = bordered.best({best.configuration: tuple(best.time * step for step in steps)}, len(steps))
        sums.append(found[0].square if found else np.inf)
    return sums[1] < sums[0]
