"""The rim of an open mesh: noise across the border curve, of which the surface says nothing, is removed along the curve."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from meshflow.estimate.mesh_noise import PointNoise
from meshflow.estimate.noise import Noise
from meshflow.estimate.noise_growth import MAD
from meshflow.estimate.request import Request
from meshflow.geometry.border import border_windows
from meshflow.geometry.connectivity import Connectivity, connect
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import SurfaceData
from meshflow.surfaces.mesh import Mesh

__all__ = ["with_smooth_rims"]

# Weights of the spline, in h^3 of the border: what is longer than 2 pi WEIGHT^(1/4) edges passes. Zero: nothing moves.
WEIGHTS = tuple(4.0**power for power in range(-1, 10))
# Directions of the border are fitted to so many edges that their error is ANGLE, radians, within the bounds REACH.
ANGLE, REACH = 0.12, (3, 9)
# A corner turns by more than TURN radians and thrice the error of the turn; over twice as many edges a round curve turns twice
# as far, a corner does not: its share is above ALIKE.
TURN, SURELY, ALIKE = np.radians(30.0), 3.0, 0.7
# Noise across the border is no more than MOST of that of the surface: what is rougher is cut so. Below LEAST of it there is none.
MOST, LEAST = 1.6, 0.05
# The least number of border vertices, and the largest motion, in sigmas.
FEW, FARTHEST = 16, 4.0
# Border vertices on each side over which normals are averaged, and the weight of the spline for the tangents.
BESIDE, TANGENTS = 3, 4.0


@dataclass(frozen=True, eq=False)
class _Rim:
    """The vertices of the border that may move.

    :ivar at: (r,), their indices; ``windows`` (r, 2 BESIDE + 1): the border vertices around each, itself in the middle.
    :ivar smooth: (r,), whether the border has no corner there.
    """

    at: Array
    windows: Array
    smooth: Array

    def spline(self, x: Array, lengths: Array, weight: float) -> Array:
        """The points (r, 3) of a smoothing spline through x (n, 3), with fourth powers of frequencies; bent freely at corners.

        It minimizes |y - x|^2 + weight |D y|^2, D the second differences by the lengths (r, 2) of the edges to either side, in
        mean edges. What is no vertex of the rim stays.
        """
        count, mid = len(self.at), BESIDE
        rows = np.flatnonzero(self.smooth)
        over = 1.0 / np.maximum(lengths[rows], 0.2)
        scale = np.sqrt(2.0 / (1.0 / over).sum(axis=1))
        entries = np.stack([over[:, 0], -over.sum(axis=1), over[:, 1]], axis=1) * scale[:, None]
        columns = self.windows[rows][:, [mid - 1, mid, mid + 1]]
        bend: Any = sparse.csr_matrix(
            (entries.ravel(), (np.repeat(np.arange(len(rows)), 3), columns.ravel())), shape=(len(rows), len(x))
        )
        free = bend[:, self.at]
        system = sparse.csc_matrix(sparse.identity(count) + weight * (free.T @ free))
        pull = -weight * (free.T @ (bend @ x))
        return x[self.at] + np.asarray(spsolve(system, pull)).reshape(count, -1)


def with_smooth_rims(data: SurfaceData, request: Request, noise: Noise) -> tuple[SurfaceData, str]:
    """The mesh with its rim moved across the border curve, along and across the surface, and in words how much, if it was.

    The rim is a smoothing spline between its corners. Its weight is the one of the least risk, mean (y - x)^2 - s^2 +
    2 s^2 tr H / n (Stein 1981), for both directions across the curve on their own, with the noise s that the border itself has:
    the residuals from cubic polynomials over five vertices. Corners are those of the border if the risk with them is less than
    without. They do not move any further, because a flow would round them. A border without noise stays to the bit, and so does
    one that is rougher than the surface: it was cut so. Borders of few vertices stay as well.

    :param data: what is no mesh of which the points move has no rim, and stays as it is.
    :param request: the caller's; a border that moves as requested stays.
    :param noise: of the surface along its normals.
    """
    asked = not request.is_open or request.boundary is not None or request.constraints.mobility is not None
    if (
        asked
        or not isinstance(data, Mesh)
        or not isinstance(noise, PointNoise)
        or noise.sigma == 0
        or noise.voxels is not None
    ):
        return data, ""
    connectivity, x = connect((data.faces,), len(data.points)), data.points.astype(np.float64)
    rim = _rim_of(connectivity, x, noise.sigma, data.fixed)
    if rim is None:
        return data, ""
    curves = [_Curve.through(x, rim, connectivity, noise.sigma)]
    if not rim.smooth.all():
        round_rim = replace(rim, smooth=np.ones_like(rim.smooth))
        curves.append(replace(curves[0], rim=round_rim))
    best, (found, _) = min(((c, c.moved(x)) for c in curves), key=lambda pair: pair[1][1])
    points, fixed = data.points.copy(), data.fixed.copy()
    points[rim.at] = found
    count = int((points != data.points).any(axis=1).sum())
    if count == 0:
        return data, ""
    fixed[rim.at[~best.rim.smooth]] = True
    return replace(data, points=points, fixed=fixed), f"{count} points moved across the border curve first"


@dataclass(frozen=True, eq=False)
class _Curve:
    """The border as a curve.

    :ivar rim: its vertices, and which of them are corners.
    :ivar along: (r, 3), where its points are moved along it, so that the sampling is even.
    :ivar lengths: (r, 2), of the edges to either side.
    :ivar axes: (2, r, 3), across the border, along the normal of the surface and along the surface.
    :ivar noise: the noise along each of them; 0: none is removed.
    :ivar farthest: the largest motion.
    """

    rim: _Rim
    along: Array
    lengths: Array
    axes: tuple[Array, Array]
    noise: tuple[float, float]
    farthest: float

    @classmethod
    def through(cls, x: Array, rim: _Rim, connectivity: Connectivity, sigma: float) -> "_Curve":
        """The curve through the rim of points (n, 3) with noise."""
        smooth = x.copy()
        smooth[rim.at] = rim.spline(x, np.ones((len(rim.at), 2)), TANGENTS)
        axes = _across(connectivity, smooth, rim)
        found = [_noise_across(smooth, x, rim, axis) for axis in axes]
        one, other = (own if LEAST * sigma < own < MOST * sigma else 0.0 for own in found)
        along = np.cross(*axes)
        # Where there is noise in the surface across the border, there is noise along the border as well.
        way = np.einsum("ij,ij->i", smooth[rim.at] - x[rim.at], along) if other > 0 else np.zeros(len(rim.at))
        held = np.clip(way, -FARTHEST * sigma, FARTHEST * sigma)[:, None] * along
        return cls(rim, held, _lengths(smooth, rim), axes, (one, other), FARTHEST * sigma)

    def moved(self, x: Array) -> tuple[Array, float]:
        """The points (r, 3) of the rim without noise, and their estimated mean square error."""
        here = x[self.rim.at]
        if not any(self.noise):
            return here, 0.0
        splines = [self.rim.spline(x, self.lengths, weight) - here for weight in WEIGHTS]
        found, risk = here + self.along, 0.0
        for axis, noise in zip(self.axes, self.noise, strict=True):
            ways = [np.einsum("ij,ij->i", one, axis) for one in splines]
            risks = [_risk(way, noise, self.rim, weight) for way, weight in zip(ways, WEIGHTS, strict=True)]
            best = int(np.argmin(risks))
            if noise > 0 and risks[best] < noise**2:
                found = found + np.clip(ways[best], -self.farthest, self.farthest)[:, None] * axis
                risk += risks[best] - noise**2
        return found, risk


def _rim_of(connectivity: Connectivity, x: Array, sigma: float, fixed: Array) -> _Rim | None:
    """The vertices that may move, with the corners of the border; None for few."""
    if len(connectivity.border) < FEW:
        return None
    windows = border_windows(connectivity, 1)
    if len(windows) < FEW:
        return None
    step = float(np.linalg.norm(x[windows[:, 1]] - x[windows[:, 2]], axis=1).mean())
    reach = REACH[0]
    while reach < REACH[1] and _error(reach, sigma, step) > ANGLE:
        reach += 1
    wide = border_windows(connectivity, 2 * reach)
    if len(wide) < FEW:
        return None
    middle = wide.shape[1] // 2
    turns = _turns(x, wide, reach)
    over = (turns > TURN + SURELY * _error(reach, sigma, step)) & (turns > ALIKE * _turns(x, wide, 2 * reach))
    place = np.full(len(x), -1)
    place[wide[:, middle]] = np.arange(len(wide))
    near = place[wide[:, middle - reach : middle + reach + 1]]
    highest = turns >= np.where(near >= 0, turns[near], 0.0).max(axis=1)
    corner = np.zeros(len(x), bool)
    for one in np.flatnonzero(over & highest):
        corner[_hinge(x, wide[one], reach)] = True
    at = wide[:, middle]
    kept = ~fixed[at]
    around = wide[:, middle - BESIDE : middle + BESIDE + 1]
    return _Rim(at[kept], around[kept], ~corner[at[kept]]) if kept.sum() >= FEW else None


def _error(reach: int, sigma: float, step: float) -> float:
    """The standard deviation of the turn between two directions that are fitted to so many edges, radians."""
    return float(np.sqrt(2.0 * 12.0 / (reach * (reach + 1) * (reach + 2))) * sigma / max(step, np.finfo(float).tiny))


def _turns(x: Array, windows: Array, reach: int) -> Array:
    """The angle (w,) by which the border turns in the middle of windows, between lines fitted to either side."""
    middle = windows.shape[1] // 2
    slope = np.arange(reach + 1) - 0.5 * reach
    ahead = np.einsum("j,wjd->wd", slope, x[windows[:, middle : middle + reach + 1]])
    behind = np.einsum("j,wjd->wd", slope, x[windows[:, middle - reach : middle + 1]])
    size = np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1)
    cosine = np.divide(np.einsum("ij,ij->i", ahead, behind), size, out=np.ones(len(size)), where=size > 0)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _hinge(x: Array, window: Array, reach: int) -> int:
    """The vertex near the middle of a window at which two lines meet that fit its vertices best."""
    middle = len(window) // 2
    low, high = middle - reach, middle + reach + 1
    shifts = sorted(range(-(reach // 2), reach // 2 + 1), key=abs)
    left = [_off_line(x[window[low : middle + s + 1]]) + _off_line(x[window[middle + s : high]]) for s in shifts]
    return int(window[middle + shifts[int(np.argmin(left))]])


def _off_line(points: Array) -> float:
    """The squared distance of points (k, 3) from their line of least squares."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float((sizes[1:] ** 2).sum())


def _lengths(x: Array, rim: _Rim) -> Array:
    """The lengths (r, 2) of the border edges to either side of each vertex, in mean edges."""
    here = x[rim.windows[:, BESIDE]]
    beside = [np.linalg.norm(x[rim.windows[:, BESIDE + side]] - here, axis=1) for side in (-1, 1)]
    both = np.stack(beside, axis=1)
    return both / max(float(both.mean()), np.finfo(float).tiny)


def _across(connectivity: Connectivity, smooth: Array, rim: _Rim) -> tuple[Array, Array]:
    """Two unit vectors (r, 3) across the border: along the normal of the surface, and along the surface."""
    c = connectivity.faces
    near = np.flatnonzero(np.isin(c, rim.windows).any(axis=1))
    corners = smooth[c[near]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(smooth)
    np.add.at(sums, c[near].ravel(), np.repeat(normals, 3, axis=0))
    tangents = _unit(smooth[rim.windows[:, BESIDE + 1]] - smooth[rim.windows[:, BESIDE - 1]])
    normals = sums[rim.windows].sum(axis=1)
    normals = _unit(normals - np.einsum("ij,ij->i", normals, tangents)[:, None] * tangents)
    return normals, np.cross(tangents, normals)


def _unit(vectors: Array) -> Array:
    """Vectors (k, 3) of length 1; zero where undefined."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)


def _noise_across(smooth: Array, x: Array, rim: _Rim, axis: Array) -> float:
    """The standard deviation of the border along an axis (r, 3), from residuals of cubic polynomials over five vertices."""
    windows = rim.windows[:, BESIDE - 2 : BESIDE + 3]
    smooth_at = np.zeros(len(x), bool)
    smooth_at[rim.at] = rim.smooth
    windows, axis = windows[smooth_at[windows].all(axis=1)], axis[smooth_at[windows].all(axis=1)]
    if len(windows) < FEW:
        return 0.0
    edges = np.linalg.norm(np.diff(smooth[windows], axis=1), axis=2)
    s = np.concatenate([np.zeros((len(edges), 1)), np.cumsum(edges, axis=1)], axis=1)
    s = (s - s.mean(axis=1, keepdims=True)) / np.maximum(s[:, -1:], np.finfo(float).tiny)
    cubic = np.linalg.qr(s[:, :, None] ** np.arange(4), mode="complete")[0][:, :, 4]  # orthogonal to 1, s, s^2, s^3
    values = np.einsum("wjd,wd->wj", x[windows], axis)
    return MAD * float(np.median(np.abs(np.einsum("wj,wj->w", cubic, values))))


def _risk(way: Array, noise: float, rim: _Rim, weight: float) -> float:
    """The mean square error of a spline, from the distances (r,) that it moves the points."""
    waves = 2.0 - 2.0 * np.cos(np.pi * (np.arange(512) + 0.5) / 512)
    kept = float(np.mean(1.0 / (1.0 + weight * waves**2))) + float((~rim.smooth).sum()) / len(way)
    return float(np.mean(way**2)) - noise**2 + 2.0 * noise**2 * min(kept, 1.0)
