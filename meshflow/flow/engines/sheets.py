"""Triangles of a flow: what of them stays whatever moves, and what is measured at one moment."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry import operator
from meshflow.geometry.connectivity import Connectivity, connect
from meshflow.geometry.validation import Array

__all__ = ["Metric", "Sheet"]


@dataclass(frozen=True, eq=False)
class Sheet:
    """One set of triangles and what of it never changes."""

    connectivity: Connectivity
    charts: Array | None
    forms: Array | None
    flat: Array | None
    pairs: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, faces: tuple[Array, ...], charts: Array | None, n: int) -> "Sheet":
        """Triangulations together, (m, 3) each, of n vertices; charts (m, 3, c), corners in the coordinates that stay."""
        connectivity = connect(faces, n)
        if charts is None:
            return cls(connectivity, None, None, None)
        forms = operator.forms(charts)
        third = np.repeat(0.5 * np.sqrt(forms[:, 3]) / 3.0, 3)
        flat = np.bincount(connectivity.faces.ravel(), weights=third, minlength=n)
        return cls(connectivity, charts, forms, flat)


@dataclass(frozen=True, eq=False)
class Metric:
    """The surface at one moment, by its triangles or others of the same surface: cotangents (m, 3), areas (m,), mass (n,)."""

    connectivity: Connectivity
    cot: Array
    area: Array
    mass: Array
