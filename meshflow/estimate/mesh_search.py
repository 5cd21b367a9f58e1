"""The choice of variant, contrast and time for channels of a mesh: a search for the least estimated risk."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.mesh_pieces import pieces
from meshflow.estimate.risk import FINER, PROBE, Candidate, Configuration, ranked
from meshflow.estimate.sure import Probed, risks_on
from meshflow.estimate.vertex_numbers import signs_of
from meshflow.flow.contract import Flow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.mobility import slowed
from meshflow.geometry.validation import Array
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh

__all__ = ["LOOKED_AT", "TIMES", "MeshSearch", "searched", "searched_on_mesh"]

# Times at which the risk is estimated, in squared sample distances; each is twice the one two places before it.
TIMES = tuple(2.0**power * part for power in range(-3, 7) for part in (1.0, 1.5))
# The largest time for meshes, in squared sample distances; their rate costs thirty times as much.
LOOKED_AT = 16.0
# The largest number of refinements of the contrast.
FINE = 3


@dataclass(frozen=True)
class MeshSearch:
    """The input of a search.

    :ivar configurations: variants with their contrasts.
    :ivar times: squared length, increasing.
    :ivar free: whether contrasts between those of the configurations may be tried.
    :ivar sigma: the noise, unit of the values.
    :ivar end: the given time, at which variants are compared; None: the time is also searched for.
    :ivar weights: of twicing.
    :ivar speed: the mobility of each sample (n, 1); None: all are free.
    """

    configurations: tuple[Configuration, ...]
    times: tuple[float, ...]
    free: bool
    sigma: float
    end: float | None = None
    weights: tuple[float, ...] = (0.0,)
    speed: Array | None = None

    def tried(self, probed: Probed, configuration: Configuration) -> list[Candidate]:
        """The candidates of a configuration, one for each weight of twicing; empty if its run was not stable."""
        patience, made = 2 if self.end is None else len(self.times), []
        curve = risks_on(probed, configuration, self.times, self.weights, patience)
        for weight, at in curve.sums.items() if curve.sound else ():
            times = sorted(at) if self.end is None else [self.end] if self.end in at else []
            squares = [curve.mean(weight, time) for time in times]
            if self.end is None:
                times, squares = [0.0, *times], [probed.square, *squares]
            if times:
                made.append(Candidate(replace(configuration, twice=weight), tuple(times), tuple(squares)))
        return made


@dataclass(frozen=True, eq=False)
class _Channels:
    """The channels of a mesh."""

    data: Mesh
    lift: Lift
    places: Array
    speed: Array | None

    def flow(self, configuration: Configuration) -> tuple[Flow, None]:
        """The flow of the channels, without a limit."""
        surface = self.data.lifted(replace(self.lift, contrast=configuration.contrast))
        return slowed(MeshFlow(surface, configuration.variant), self.speed), None


def searched_on_mesh(data: Mesh, lift: Lift, search: MeshSearch) -> tuple[Candidate, ...]:
    """The candidates of a search on the channels of a mesh, the best first."""
    return searched(_probed(data, lift, search), search)


def searched(probed: Probed, search: MeshSearch) -> tuple[Candidate, ...]:
    """The candidates of a search on probed data without a grid, the best first."""
    found = ranked(one for configuration in search.configurations for one in search.tried(probed, configuration))
    factors = [FINER, 1.0 / FINER]
    for _ in range(FINE if search.free and found else 0):
        best = found[0]
        if best.configuration.variant.linear:
            break
        contrast = best.configuration.contrast
        steps = [replace(best.configuration, contrast=contrast * factor, twice=0.0) for factor in factors]
        found = ranked((*found, *(one for step in steps for one in search.tried(probed, step))))
        if found[0] is best or found[0].configuration.variant != best.configuration.variant:
            break
        factors = [FINER if found[0].configuration.contrast > contrast else 1.0 / FINER]
    return found


def _probed(data: Mesh, lift: Lift, search: MeshSearch) -> Probed:
    """A mesh, or pieces of a large one, and a copy whose channels are perturbed by random signs."""
    data, counts, kept = pieces(data)
    if data.channels is None:
        raise InputError("search: a mesh with channels expected, got one without")
    channels = data.channels
    probe = signs_of(data.points, data.faces, channels)
    twin = replace(data, channels=channels + PROBE * search.sigma * probe)
    counted, speed = np.flatnonzero(counts), None if search.speed is None else search.speed[kept]
    copies = tuple(_Channels(one, lift, counted[None], speed) for one in (data, twin))
    sigma = np.full((channels.shape[1], 1), search.sigma)
    return Probed(copies, np.zeros(1, np.intp), probe[counted].T[None], sigma, implicit=True)
