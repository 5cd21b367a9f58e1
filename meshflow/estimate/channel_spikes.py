"""Spikes of values on a mesh, or of scattered points: single values far off while those around them lie near a plane."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse

from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.laplacians import cotangent_means, neighbour_means
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["ValueSpikes", "without_value_spikes"]

# A suspect differs from the mean of its neighbours by more than BEYOND deviations of all vertices (more where there are many, of
# which the largest is near sqrt(2 log n)); if more than MOST of all are suspects, the values are rough, and nothing is a spike.
BEYOND, MOST = 6.0, 0.25
# A suspect is a spike if it is farther from the plane through those around it, two edges far, than RANGE times the range of their
# distances from it: the tip of a cone is not. AROUND of them are needed. Where deviations are less than the share ROUNDING of the
# range of all values there is no noise, and steps and peaks are of the data.
RANGE, AROUND, ROUNDING = 2.5, 5, 1e-5
# Spikes are looked for so often, without those found before.
ROUNDS = 4


@dataclass(frozen=True, eq=False)
class ValueSpikes:
    """The spikes of a mesh of which the channels move.

    :ivar mask: (n,).
    :ivar channels: (n, k), as they came.
    :ivar replaced: whether the result has them from those around them, else as they came.
    :ivar insists: whether also where nothing is smoothed.
    """

    mask: Array
    channels: Array
    replaced: bool
    insists: bool

    def restored(self, done: Mesh, idle: bool) -> Mesh:
        """The result for the caller.

        :param idle: whether nothing was smoothed.
        """
        if done.channels is None or (self.replaced and (self.insists or not idle)):
            return done
        return replace(done, channels=np.where(self.mask[:, None], self.channels, done.channels))

    def warning(self, idle: bool) -> str:
        """A sentence: how many there are, what became of them, and the options that change it."""
        count, n = int(self.mask.sum()), len(self.mask)
        one = count == 1
        done = "excluded and left unchanged"
        if self.replaced and (self.insists or not idle):
            done = "replaced by a plane through those around"
        return (
            f"{count} of {n} values {'is a spike' if one else 'are spikes'}, far from all around: {done}; outliers='repair' "
            f"replaces {'it' if one else 'them'}, 'keep' leaves {'it' if one else 'them'}, 'include' takes "
            f"{'it' if one else 'them'} for data"
        )


def without_value_spikes(data: Mesh, word: str | None = None) -> tuple[Mesh, ValueSpikes | None]:
    """The mesh with its spikes on the planes through the values around them, and the spikes; None where there are none.

    :param word: ``keep``: they come back as they were; ``repair``: on their planes. None: the latter for several channels.
    """
    if data.channels is None:
        return data, None
    channels = data.channels.astype(np.float64)
    mask, cleaned = _spikes(data, channels)
    if not mask.any():
        return data, None
    found = ValueSpikes(
        mask, data.channels, word == "repair" or (word is None and channels.shape[1] > 1), word is not None
    )
    return replace(data, channels=cleaned.astype(data.channels.dtype)), found


def _spikes(data: Mesh, channels: Array) -> tuple[Array, Array]:
    """Mask (n,) of the spikes, and the values (n, k) with those of the planes there.

    Spikes beside others are found once these have been replaced.
    """
    n = len(channels)
    umbrella: Any = sparse.csr_matrix(sparse.identity(n) - cotangent_means(data.points, data.faces))
    gain = np.sqrt(np.asarray(umbrella.multiply(umbrella).sum(axis=1)).ravel())
    near = sparse.csr_matrix(sparse.identity(n) + neighbour_means(data.faces, n, "free"))
    beyond = max(BEYOND, float(np.sqrt(2.0 * np.log(n))) + 1.0)
    mask, cleaned = np.zeros(n, bool), channels.copy()
    for _ in range(ROUNDS):
        off = np.abs(umbrella @ cleaned) / np.maximum(gain, 1.0)[:, None]
        usual = MAD * np.median(off, axis=0)
        least = np.where(usual > ROUNDING * np.ptp(cleaned, axis=0), beyond * usual, np.inf)
        suspects = (off > least).any(axis=1) & (gain > 1.0) & ~mask
        if suspects.mean() > MOST:
            return np.zeros(n, bool), channels
        around, free = (near, suspects), np.flatnonzero(suspects & ~data.fixed).tolist()
        found = [i for i in free if _put_on_plane(i, data.points, cleaned, around, least)]
        if not found:
            break
        mask[found] = True
    return mask, cleaned


def _put_on_plane(i: int, points: Array, channels: Array, around: tuple[Any, Array], least: Array) -> bool:
    """Whether a suspect is a spike; if so it is put on the plane through those around it.

    :param channels: (n, k); row i is changed.
    :param around: which vertices are neighbours (n, n), and the suspects (n,), which do not count.
    :param least: the least distance from the plane of each channel.
    """
    near, suspects = around
    first = near.indices[near.indptr[i] : near.indptr[i + 1]]
    ring = np.unique(np.concatenate([near.indices[near.indptr[j] : near.indptr[j + 1]] for j in first]))
    ring = ring[~suspects[ring]]
    if len(ring) < AROUND:
        return False
    places = np.column_stack([np.ones(len(ring)), points[ring] - points[i]])
    plane = np.linalg.lstsq(places, channels[ring], rcond=None)[0]
    apart = np.ptp(channels[ring] - places @ plane, axis=0)
    away = np.abs(channels[i] - plane[0])
    if not ((away > RANGE * apart) & (away > least)).any():
        return False
    channels[i] = plane[0]
    return True
