"""Quantities at each sample of a surface: curvature, edges, quality of triangles, missing samples."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry import operator
from meshflow.geometry.connectivity import connect
from meshflow.geometry.curvature import signed_mean
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, on_surface
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.surface import Surface
from meshflow.view.appearance import taken
from meshflow.view.numbers import brief
from meshflow.view.scale import Scale, ranging, symmetric

__all__ = ["QUANTITIES", "Quantity", "measured"]

Quantity = Literal["curvature", "edges", "triangles", "samples"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
_STRIP = 400_000  # samples of a grid that are triangulated at a time, to limit the memory
_KINDS = ("move", "fixed", "missing")


def measured(data: object, quantity: Quantity, contrast: float = 1.0) -> Scale:
    """A quantity on a surface, with its unit and its colours.

    ``curvature``: the mean curvature (11), per length, for a grid that of the graph in its true proportions. It is positive where
    the surface bulges outwards, upwards or towards its camera, and has no sign for colours and outside of R^3. It uses mixed
    Voronoi areas (Meyer et al. 2002).
    ``edges``: the edge indicator 1/W (3), the projected area of the triangles around a sample over their true area: 1 on flat
    parts, near 0 on edges.
    ``triangles``: 4 sqrt(3) area over the sum of the squared edges: 1 for an equilateral triangle, 0 without area; for grids the
    least around a sample.
    ``samples``: which samples move, are fixed, or are missing.

    Example:

        >>> from meshflow import Mesh
        >>> from meshflow.synthetic import sphere
        >>> ball = sphere(3)
        >>> bool(abs(measured(Mesh(ball.points, ball.faces), "curvature").values.mean() - 1) < 0.05)
        True

    :param data: a data object, or anything that :func:`meshflow.smooth` takes. The numbers are the ``values`` of the result.
    :param quantity: ``curvature``, ``edges``, ``triangles`` or ``samples``.
    :param contrast: length per unit of the values, for ``edges`` of height fields and images.
    :raises InputError: for an unknown quantity, and the edge indicator of a mesh whose points move, which is 1 everywhere.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"quantity: one of {', '.join(QUANTITIES)} expected, got {quantity!r}")
    surface, _ = taken(data)
    if quantity == "samples":
        return _samples(surface)
    if quantity == "edges" and isinstance(surface, Mesh) and surface.moves == "points":
        raise InputError(
            "edges: all directions of a mesh are free, its edge indicator is 1; show its curvature instead"
        )
    if quantity == "triangles" and isinstance(surface, Mesh):
        return replace(_scale(surface, quantity, _qualities(surface.points, surface.faces)), of_triangles=True)
    return _scale(surface, quantity, _over(surface, quantity, contrast), contrast)


def _scale(data: Data, quantity: Quantity, values: Array, contrast: float = 1.0) -> Scale:
    """Values with their label, unit and colours."""
    if not np.isfinite(values).any():
        raise InputError(f"{quantity}: nothing to show, no sample of the {type(data).__name__} has a triangle")
    if quantity == "triangles":
        where = "" if isinstance(data, Mesh) else ", the worst at each sample"
        return ranging(values, f"quality of the triangles{where} (1: equilateral)", "", (0.0, 1.0))
    if quantity == "edges":
        word = "" if contrast == 1.0 else f", contrast {contrast:g}"
        return ranging(values, f"edge indicator 1/W{word} (1: flat)", "", (0.0, 1.0))
    unit = getattr(data, "unit", "") or ("pixel" if isinstance(data, Image) else "length")
    if (np.nan_to_num(values) < 0).any():
        return symmetric(values, "mean curvature", f"1/{unit}", "flat everywhere")
    most = float(np.nanpercentile(values, 99.0)) or float(np.nanmax(values)) or 1.0
    scale = ranging(values, "mean curvature", f"1/{unit}", (0.0, most))
    return replace(
        scale, ends=f"colours end at {brief(most)}, the 99th percentile; largest {brief(float(np.nanmax(values)))}"
    )


def _samples(data: Data) -> Scale:
    """Which samples move (0), are fixed (1), or missing (2)."""
    gone = np.zeros(len(data.points), bool) if isinstance(data, Mesh) else data.missing
    kinds = np.where(gone, 2.0, 0.0 if data.fixed is None else data.fixed)
    names = _KINDS[:2] if isinstance(data, Mesh) else _KINDS
    shares = [f"{100 * float((kinds == k).mean()):.3g} % {name}" for k, name in enumerate(names)]
    return Scale(kinds, -0.5, len(names) - 0.5, "viridis", f"samples: {', '.join(shares)}", names=names)


def _over(data: Data, quantity: Quantity, contrast: float) -> Array:
    """A quantity of every sample (h, w) or (n,), NaN where there is no triangle."""
    if not isinstance(data, (HeightField, Image)) or (isinstance(data, HeightField) and data.cuts is not None):
        values = _local(data, quantity, contrast)
        return values if isinstance(data, Mesh) else values.reshape(data.missing.shape)
    h, w = data.missing.shape
    rows = max(_STRIP // w, 2)
    # A sample depends on its neighbours only: strips with one additional row on either side give the same result as the whole.
    parts = []
    for first in range(0, h, rows):
        low, high = max(first - 1, 0), min(first + rows + 1, h)
        low = min(low, high - 2)
        if data.missing[low:high].all():  # would be no valid data object, and is not needed
            parts.append(np.full((min(first + rows, h) - first, w), np.nan))
            continue
        values = _local(_rows(data, low, high), quantity, contrast).reshape(high - low, w)
        parts.append(values[first - low : min(first + rows, h) - low])
    return np.concatenate(parts)


def _rows(data: HeightField | Image, low: int, high: int) -> HeightField | Image:
    """Some rows of a grid."""
    dx, dy = data.spacing
    part, missing = slice(low, high), data.missing[low:high]
    spacing = (dx if np.ndim(dx) == 0 else np.asarray(dx)[part], dy)
    if isinstance(data, HeightField):
        return replace(data, z=data.z[part], spacing=spacing, missing=missing, fixed=None)
    return replace(data, values=data.values[part], spacing=spacing, missing=missing, fixed=None)


@dataclass(frozen=True, eq=False)
class _Triangles:
    """One triangulation of a data object."""

    surface: Surface
    faces: Array

    def at_samples(self, values: Array) -> Array:
        """Values (n,), NaN where there is no triangle."""
        used = np.zeros(len(self.surface.points), bool)
        used[self.faces] = True
        return np.where(used, values, np.nan)


def _local(data: Data, quantity: Quantity, contrast: float) -> Array:
    """A quantity of every sample (n,) of data that is triangulated as a whole."""
    factor = contrast if quantity == "edges" and isinstance(data, (HeightField, Image)) else 1.0
    surface = on_surface(data, quantity).lifted(Lift(diagonals="forward", contrast=factor))
    if isinstance(data, Mesh) and quantity == "curvature":
        surface = Surface(data.points, (data.faces,))
    there = _Triangles(surface, surface.triangulations[0])
    if len(there.faces) == 0:
        return np.full(len(surface.points), np.nan)
    if quantity == "curvature":
        return there.at_samples(_curvature(surface.points, there.faces))
    if quantity == "triangles":
        worst = np.full(len(surface.points), np.inf)
        np.minimum.at(worst, there.faces, _qualities(surface.points, there.faces)[:, None])
        return there.at_samples(worst)
    return there.at_samples(_edges(surface, there.faces))


def _curvature(points: Array, faces: Array) -> Array:
    """Mean curvature (n,), positive where the surface bulges towards its normals; outside of R^3 its absolute value."""
    if points.shape[1] != 3:
        return operator.mean_curvature(points, faces)
    return signed_mean(points, faces)


def _edges(surface: Surface, faces: Array) -> Array:
    """Projected area over true area (n,) of the triangles around each vertex."""
    connectivity = connect((faces,), len(surface.points))
    if surface.free.directions is not None:
        seen = operator.gather_seen(connectivity, surface.points, surface.free.directions)
    else:
        stays = list(surface.free.staying(surface.points.shape[1]))
        seen = operator.mass(surface.points[:, stays], faces, "ring")
    true = operator.mass(surface.points, faces, "ring")
    return np.clip(np.divide(seen, true, out=np.ones_like(true), where=true > 0), 0.0, 1.0)


def _qualities(points: Array, faces: Array) -> Array:
    """4 sqrt(3) area over the sum of squared edges (m,): that is sqrt(3) over the sum of the cotangents."""
    cot, area = operator.cotangents(points, faces)
    total = cot.sum(axis=1)
    sound = (area > 0) & np.isfinite(total) & (total > 0)
    return np.clip(np.divide(np.sqrt(3.0), total, out=np.zeros_like(total), where=sound), 0.0, 1.0)
