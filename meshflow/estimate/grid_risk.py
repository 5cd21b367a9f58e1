"""A piece of a grid with its probes: the perturbed copies that are run together with it."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.pieces import Piece, repeated
from meshflow.estimate.risk import PROBE, Configuration
from meshflow.estimate.sure import Probed
from meshflow.flow.constraints import Limit
from meshflow.flow.contract import Flow
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.mobility import slowed
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Grid

__all__ = ["probed"]

# The rounding error of single precision that is negligible, as a share of the noise.
FINE = 1e-3


@dataclass(frozen=True, eq=False)
class _Beside:
    """Copies of a piece side by side.

    :ivar places: (c, m), indices of the samples that are counted, in each copy.
    :ivar limit: (n, k); ``speed``: (n, 1).
    """

    grid: Grid
    places: Array
    limit: Array | None
    speed: Array | None

    def flow(self, configuration: Configuration) -> tuple[Flow, Limit | None]:
        """The flow with one thread, because several runs go on at once, and the limit of their changes."""
        engine = GridFlow(replace(self.grid, contrast=configuration.contrast), configuration.variant, 1)
        start = engine.start()
        limit = None if self.limit is None else Limit(start, self.limit.astype(start.dtype))
        return slowed(engine, self.speed), limit


def probed(piece: Piece, probes: Array) -> Probed:
    """A piece with its probes.

    :param probes: (p, k, h, w), of deviation 1, correlated like the noise.
    """
    grid, lines = piece.grid, piece.grid.lines is not None
    planes = grid.planes if lines else _single(grid, piece.sigma)
    noise, k = (PROBE * piece.sigma).astype(planes.dtype), len(planes)
    starts = [planes, *(planes + noise * probe.astype(planes.dtype) for probe in probes)]
    # Lines of sight end at the sides of their image, so their copies are run one by one.
    groups = [[one] for one in starts] if lines else [starts]
    copies = tuple(_Beside(*repeated(piece, group)) for group in groups)
    at = probes.reshape(*probes.shape[:2], -1)[..., piece.counted].astype(planes.dtype)
    each = np.asarray(piece.sigma, np.float64).reshape(len(piece.sigma), -1)
    if each.shape[1] == 1:
        return Probed(copies, piece.begins, at, np.broadcast_to(each, (k, 1)))
    each = np.broadcast_to(each[:, piece.counted], (k, len(piece.counted)))
    return Probed(copies, piece.begins, at, each, each / piece.unit)


def _single(grid: Grid, sigma: Array) -> Array:
    """Planes in single precision, relative to their middles, if they fit and rounding is far below the noise; else unchanged."""
    there = np.broadcast_to(~grid.missing, grid.planes.shape)
    low = np.min(grid.planes, axis=(1, 2), where=there, initial=np.inf, keepdims=True)
    high = np.max(grid.planes, axis=(1, 2), where=there, initial=-np.inf, keepdims=True)
    single, least = np.finfo(np.float32), np.min(sigma)
    fits = np.max(high - low) < 0.1 * single.max and least > single.tiny / single.eps
    if not fits or not (single.eps * (high - low) < FINE * least).all():
        return grid.planes
    return np.where(grid.missing, 0.0, grid.planes - 0.5 * (low + high)).astype(np.float32)
