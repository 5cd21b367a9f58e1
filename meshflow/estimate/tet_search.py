"""Noise and search on meshes of tetrahedra: those of meshes, by the edges of the tetrahedra; large meshes are tried on pieces."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshflow.estimate.mesh_noise import noise_beside
from meshflow.estimate.mesh_search import MeshSearch, searched
from meshflow.estimate.noise import Noise
from meshflow.estimate.risk import PROBE, Candidate, Configuration
from meshflow.estimate.sure import Probed
from meshflow.estimate.vertex_numbers import numbers_of, signs_of
from meshflow.flow.contract import Flow
from meshflow.flow.engines.tetrahedra import TetFlow
from meshflow.flow.mobility import slowed
from meshflow.geometry.laplacians import means_of
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.tet_mesh import TetMesh

__all__ = ["noise_in_body", "searched_on_tetrahedra"]

# The largest number of vertices of a mesh without pieces, the number of pieces, and of layers at their cuts that are not counted.
ENOUGH, PIECES, LAYERS = 12_000, 3, 2
# Rounds of means before vertices are told apart by how much the values bend.
ROUNDS = 3


def noise_in_body(data: TetMesh, mask: Array | None = None) -> Noise:
    """The noise of values on tetrahedra, in their unit.

    :param mask: (n,), the vertices used; None: all.
    """
    there = ~data.missing
    values, means = data.values.reshape(len(there), -1)[there], means_of(data.spanned.stiffness())
    means, rim = means[there][:, there], data.spanned.rim[there]
    used = _calm(values, means) & ~(rim | (means @ rim > 0))
    return noise_beside(values, means, used if mask is None or not np.any(mask) else used & mask[there])


def _calm(values: Array, means: Any) -> Array:
    """The half of the vertices (n,) at which smoothed values bend least, so that edges do not count as noise."""
    smooth = values.astype(np.float64)
    for _ in range(ROUNDS):
        smooth = 0.5 * (smooth + means @ smooth)
    bends = np.square(smooth - means @ smooth)
    bends = (bends / np.maximum(bends.mean(axis=0), np.finfo(float).tiny)).sum(axis=1)
    for _ in range(ROUNDS):
        bends = 0.5 * (bends + means @ bends)
    return bends <= np.median(bends)


def searched_on_tetrahedra(data: TetMesh, lift: Lift, search: MeshSearch) -> tuple[Candidate, ...]:
    """The candidates of a search, the best first."""
    piece, counted, kept = pieces(data)
    columns = piece.columns(lift)
    probe = signs_of(piece.points, piece.sides, columns)
    twin = replace(piece, values=columns + PROBE * search.sigma * probe)
    speed = None if search.speed is None else search.speed[kept]
    copies = tuple(_Body(one, lift, counted[None], speed) for one in (replace(piece, values=columns), twin))
    sigma = np.full((columns.shape[1], 1), search.sigma)
    return searched(Probed(copies, np.zeros(1, np.intp), probe[counted].T[None], sigma, implicit=True), search)


@dataclass(frozen=True, eq=False)
class _Body:
    """Values on tetrahedra."""

    data: TetMesh
    lift: Lift
    places: Array
    speed: Array | None

    def flow(self, configuration: Configuration) -> tuple[Flow, None]:
        """The flow, without a limit."""
        lift = replace(self.lift, contrast=configuration.contrast)
        return slowed(TetFlow(self.data, lift, configuration.variant), self.speed), None


def pieces(data: TetMesh) -> tuple[TetMesh, Array, Array]:
    """The mesh, or pieces of a large one; the indices (c,) of its counted vertices; and of all of its vertices (v,) in the whole.

    A piece consists of layers around a vertex, chosen by lengths alone, so that neither the order of the vertices nor the place
    of the mesh matters.
    """
    free = ~(data.missing | data.fixed)
    used = np.zeros(len(free), bool)
    used[data.cells] = True
    if used.sum() <= ENOUGH:
        return data, np.flatnonzero(free & used), np.arange(len(free))
    joined = data.spanned.stiffness() != 0
    taken = np.zeros(len(free), bool)
    seeds = np.argsort(np.where(free & used, numbers_of(data.points, data.sides), np.inf))[: 64 * PIECES]
    for _ in range(PIECES):
        left = seeds[~taken[seeds]]
        if not len(left):
            break
        own = np.zeros(len(free), bool)
        own[left[0]] = True
        while own.sum() < ENOUGH // PIECES:
            wider = (joined @ own) | own
            if (wider == own).all():
                break
            own = wider
        taken |= own
    cells = data.cells[taken[data.cells].all(axis=1)]
    kept, inverse = np.unique(cells, return_inverse=True)
    cut = (joined @ ~taken) & taken
    for _ in range(LAYERS):
        cut = (joined @ cut) | cut
    piece = TetMesh(data.points[kept], inverse.reshape(-1, 4), data.values[kept], fixed=data.fixed[kept])
    counted = (free & ~cut)[kept]
    return piece, np.flatnonzero(counted if counted.any() else free[kept]), kept
