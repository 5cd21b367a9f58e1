"""Round parts of a mesh after a long run of the normal filter, which leaves facets on them.

A long run makes flat parts flat and creases sharp. A fillet of a few edges, or the wall of a hole, becomes a prism by it, up to
half an edge off. A short run with a flux that falls more slowly leaves it round, with more noise. So the points are taken from
the short run where both runs differ by more than that noise, and the short one is nearer to the data.
"""

from typing import Any

import numpy as np

from meshflow.flow.conjugate_gradients import rows_of
from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.normals import normals_at
from meshflow.geometry.validation import Array
from meshflow.kernels.conjugate_gradients import matrix_product

__all__ = ["with_round_parts"]

# The mean square of what the short run leaves of the noise, in sigma^2. From LOW to HIGH times that is the difference of the runs
# where the points of the short one come in, and from LITTLE to MUCH is the share of it by which its square distance from the
# data is less. Where it rounds creases, it is farther from the data.
LEFT, LOW, HIGH, LITTLE, MUCH = 0.1, 2.0, 4.0, 0.2, 0.6
# Rounds of the neighbours over which both are averaged, some 130 vertices: with half as many, patches of flat parts come in.
AROUND = 20
# Distances count up to this many sigma, because of impulses.
CLIPPED = 3.0


def with_round_parts(long: Array, short: Array, before: Array, faces: Array, sigma: float) -> Array:
    """The points (n, 3) of a long run, those of round parts from a short one, with a gradual transition.

    :param short: (n, 3), of the short run.
    :param before: (n, 3), the data.
    :param sigma: of the noise, unit of the points.
    """
    x, one, other = (points.astype(np.float64) / sigma for points in (before, long, short))
    normals, mean = normals_at(other, faces), neighbour_means(faces, len(x), "free")
    apart, off, near = (
        np.clip(np.einsum("ij,ij->i", difference, normals), -CLIPPED, CLIPPED)
        for difference in (other - one, x - one, x - other)
    )
    averages = _averaged(mean, np.stack([apart**2, off**2 - near**2], axis=1))
    differs, nearer = averages.T
    share = np.divide(nearer, differs, out=np.zeros(len(x)), where=differs > 0)
    weight = _ramp(differs, LEFT * LOW, LEFT * HIGH) * _ramp(share, LITTLE, MUCH)
    return (long + weight[:, None] * (short - long)).astype(long.dtype)


def _averaged(mean: Any, values: Array) -> Array:
    """Values (n, k) averaged over rounds of the neighbours."""
    rows, now, before = rows_of(mean), np.ascontiguousarray(values), np.empty(values.shape)
    for _ in range(AROUND + 1):
        matrix_product(*rows, now, before)
        now, before = before, now
    return 0.5 * (before + now)


def _ramp(values: Array, low: float, high: float) -> Array:
    """0 below ``low``, 1 above ``high``, linear between."""
    return np.clip((values - low) / (high - low), 0.0, 1.0)
