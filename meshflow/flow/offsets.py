"""Offsets of a smoothed mesh from its data, averaged over smooth regions, and their removal.

A method that smooths also shrinks: balls lose radius, plates lose thickness, creases are pulled inwards. Noise has the mean zero.
Therefore the mean distance from the data along the normals, over many triangles between creases, is an error of the method.
Without it the normals are as they were, and the volume of a closed mesh is that of the data. Its expectation is the volume
without noise, because volume is linear in each corner of a triangle.
"""

import numpy as np

from meshflow.geometry.connectivity import connect
from meshflow.geometry.nearness import nearest_first
from meshflow.geometry.normals import (
    NormalDiffusion,
    averaged,
    beyond,
    conductances,
    corner_means,
    crease_weights,
    mean_edge,
    measured,
    shifted,
)  # fmt: skip
from meshflow.geometry.validation import Array

__all__ = ["AVERAGED", "without_offsets"]

# The time of the diffusion that averages offsets, in squared edges; the greatest rate of it over the squared edge, as of
# equilateral triangles; and the number of its stages, by which what alternates between neighbours is left to 1e-4.
AVERAGED, FASTEST, STAGES = 200.0, 24.0, 155
# Contrast and sharpness of the creases over which nothing is averaged, as in the normal filter.
CONTRAST, SHARPNESS = 8.0, 4.0
# A vertex moves along a direction only as far as the normals around it agree on it: share of the sum of their squares.
RIDGE = 0.01


def without_offsets(points: Array, before: Array, faces: Array, held: Array) -> Array:
    """The points (n, 3) of a smoothed mesh, moved along normals so that they have no mean offset from the data.

    :param points: (n, 3), after a method.
    :param before: (n, 3), the data.
    :param held: (n,), points that stay.
    """
    # A power of two changes no digits: solving squares volumes, which in other units would be beyond double precision.
    unit = 2.0 ** np.rint(np.log2(mean_edge(points, faces)))
    order, near = nearest_first(before, connect((faces,), len(points)).faces)
    at = slice(None) if order is None else order
    x, change = np.ascontiguousarray(points[at], dtype=np.float64) / unit, np.empty(points.shape)
    normals, areas = measured(x, near)
    own = np.einsum("ij,ij->i", normals, corner_means(before[at] / unit - x, near))
    offset = _averaged(own, x, near, normals, areas)
    change[at] = shifted(connect((near,), len(x)), normals, areas, offset, RIDGE)
    return np.where(held[:, None], points, points + unit * change).astype(points.dtype)


def _averaged(values: Array, x: Array, faces: Array, normals: Array, areas: Array) -> Array:
    """The means (m,) of values on the triangles around each, by area, over what a diffusion reaches that stops at creases.

    Triangles that are joined to others much better than their area is large count as larger in the diffusion, which would need
    shorter steps for them.
    """
    m, across, square = len(faces), beyond(faces), mean_edge(x, faces) ** 2
    diffusion = NormalDiffusion(areas, conductances(x, faces, across), across, CONTRAST, SHARPNESS)
    joined = crease_weights(normals, diffusion)
    mass = np.maximum(areas, joined.sum(axis=1) * (2.0 * square / FASTEST))
    mass[mass == 0] = 1.0
    joined *= (2.0 * square / FASTEST / mass)[:, None]
    now = np.stack([areas * values, areas], axis=1) / mass[:, None]
    sums = averaged(now, joined, across, 0.5 * AVERAGED * FASTEST, STAGES)
    return np.divide(sums[:, 0], sums[:, 1], out=np.zeros(m), where=sums[:, 1] > 0)
