"""The search on volumes: all configurations on few cubes, the best on more; the rounds are those of grids."""

import numpy as np

from meshflow.estimate.probes import probes
from meshflow.estimate.search_rounds import (
    Found,
    GridSearch,
    Runs,
    candidates_of,
    surely_better,
    two_rounds,
    weights_of,
)
from meshflow.estimate.sure import Probed
from meshflow.estimate.volume_pieces import SIDE, VolumePiece, cubes, piece_of, probed, whole_piece
from meshflow.flow.pools import Pool
from meshflow.surfaces.volume import Block

__all__ = ["searched_on_volume"]

# The numbers of cubes in the first round and in the second, and the largest volumes that are searched whole: they have no more
# samples than the cubes of the first round.
FEW, MANY = 6, 16
WHOLE = FEW * SIDE**3
# Cubes that are run together.
TOGETHER = 6


def searched_on_volume(block: Block, search: GridSearch) -> Found:
    """The result of a search on a volume. The contrast of the block is ignored."""
    unit = float(np.prod(block.spacing) ** (2.0 / 3.0))
    small = block.missing.size <= WHOLE
    with Pool(search.threads) as pool:
        runs, ranked = two_rounds(
            Runs(search, _looked_at(block, search, FEW), pool),
            unit,
            lambda smooth: None if small else _looked_at(block, search, MANY * (2 if smooth else 1)),
        )
        if not ranked:
            return Found(())
        weights = weights_of(runs, ranked, unit) if search.blend else ()
    return Found(candidates_of(runs, ranked), surely_better(runs, ranked[0]), False, weights)


def _looked_at(block: Block, search: GridSearch, count: int) -> tuple[Probed, ...]:
    """The pieces of a volume that are used, with their probes; all of it where it is small."""
    pieces: list[VolumePiece] = []
    if block.missing.size > WHOLE:
        windows = cubes(block, count)
        parts = max(1, -(-len(windows) // TOGETHER))
        pieces = [
            piece_of(block, windows[i::parts], search.sigma, search.limit, search.speed)
            for i in range(parts)
            if windows
        ]
    pieces = pieces or [whole_piece(block, search.sigma, search.limit, search.speed)]
    return tuple(
        probed(piece, probes((len(block.planes), *piece.block.shape), 1, search.correlation, search.between, seed))
        for seed, piece in enumerate(pieces)
    )
