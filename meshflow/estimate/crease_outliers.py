"""Residuals that are large beside creases: of coarse parts they look like impulses."""

from typing import Any

import numpy as np

from meshflow.estimate.noise_growth import MAD
from meshflow.geometry.validation import Array

__all__ = ["kurtosis_of", "without_creases"]

# A crease is where the normals of neighbours on a smoothed copy differ by more than this angle, and as many rings around it have
# large residuals. Impulses of an edge turn the normals of the copy by less.
CREASED, RINGS = np.cos(np.radians(25.0)), 2
# Residuals of so many deviations are far off. If they may be anywhere, so many of them are expected among the other vertices; if
# less than this share of that is there, they are at creases.
FAR, EXPECTED, FOUND = 5.0, 6.0, 0.2


def kurtosis_of(values: Array) -> float:
    """The fourth moment of values (k,) over the squared second one."""
    square = float(np.mean(values**2))
    return float(np.mean(values**4)) / max(square * square, np.finfo(float).tiny)


def without_creases(umbrella: Any, normals: Array, residuals: Array, counted: Array, calm: Array) -> Array | None:
    """The mask (n,) of the vertices that are not beside a crease, if residuals are far off at creases alone; None if they are
    not, or too few vertices are left to say so.

    :param umbrella: (n, n), I - A with the means A of the neighbours.
    :param normals: (n, 3), of a smoothed copy.
    :param residuals: (n,).
    :param counted: (n,), mask of the vertices that are used; ``calm``: of those where the surface bends least.
    """
    edges = umbrella.tocoo()
    one, other = edges.row[edges.row != edges.col], edges.col[edges.row != edges.col]
    near = np.zeros(len(normals), bool)
    near[one[np.einsum("ij,ij->i", normals[one], normals[other]) < CREASED]] = True
    for _ in range(RINGS):
        near[one[near[other]]] = True
    level = counted & ~near
    if not near.any() or not level.any():
        return None
    off = np.abs(residuals) > FAR * MAD * float(np.median(np.abs(residuals[level])))
    expected = float(np.mean(off[calm])) * level.sum()
    return level & ~off if expected >= EXPECTED and off[level].sum() <= FOUND * expected else None
