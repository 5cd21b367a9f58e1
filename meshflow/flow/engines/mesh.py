"""The one formula of the flow, on explicit triangles."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.sparse as sparse

from meshflow.flow.blend import RATE, Blend
from meshflow.flow.contract import FEW_RATES
from meshflow.flow.engines.dense import Dense
from meshflow.flow.engines.metric import Given, Measured, Metric
from meshflow.flow.engines.triangulation import Triangulation, triangulations_of
from meshflow.flow.family import Variant
from meshflow.flow.low_pass import filtered
from meshflow.geometry import operator
from meshflow.geometry.blocks import Blocks, blocked, march_blocks
from meshflow.geometry.border import border_operator
from meshflow.geometry.connectivity import Connectivity
from meshflow.geometry.laplacians import (
    cotangent_generator,
    neighbour_means,
    scale_dependent_generator,
    umbrella_generator,
)
from meshflow.geometry.normals import mean_edge
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Surface

__all__ = ["MeshFlow", "MeshSystem"]


# Vertices above which a system is solved in an order in which neighbours are near: less would fit the cache in any order.
LARGE = 50_000


@dataclass(frozen=True, eq=False)
class MeshSystem:
    """A system of explicit triangles.

    :ivar mass: (n,).
    :ivar moves: (n,), vertices that move; rows and columns of others are zero in the stiffness.
    :ivar measured: the triangles.
    :ivar directions: (n, 3), along which vertices move; None where all coordinates are free or along axes.
    :ivar order: the vertices (n,) in an order in which neighbours are near; None where it would bring nothing.
    :ivar border: (n, n), the operator of a border that moves on its own, whose vertices are not among those that move; or None.
    """

    mass: Array
    moves: Array
    measured: Measured
    directions: Array | None
    order: Array | None
    border: Any = None

    @property
    def stiffness(self) -> sparse.csr_matrix:
        """L_ij (d_i . d_j), (n, n)."""
        return _stiffness(self.measured.connectivity, self.measured.weights, self.directions, self.moves)

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, (n, n)."""
        whole = self.stiffness
        whole.data *= dt
        whole.data[self.measured.connectivity.pattern.diagonal] += self.mass
        return whole if self.border is None else sparse.csr_matrix(whole + dt * self.border)


def _stiffness(connectivity: Connectivity, weights: Array, directions: Array | None, moves: Array) -> sparse.csr_matrix:
    stiffness = operator.fill_stiffness(connectivity, weights, directions)
    if not moves.all():
        rows = np.repeat(moves, np.diff(stiffness.indptr))
        stiffness.data[~(rows & moves[stiffness.indices])] = 0.0
    return stiffness


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """The surface at one state: a triangulation, the coordinates x (n, c) that measure it, what they say, and the mass (n,)."""

    triangulation: Triangulation
    x: Array
    measured: Measured
    mass: Array


class MeshFlow(Dense):
    """dX/dt = -s P B on the triangles of a surface, s = (edge indicator)^gamma (7), (10), (14).

    The engine of reference: every other engine must agree with it.

    :param surface: where the points are and where they may go.
    :param variant: which flow of the family.
    :param metric: how triangles are measured; as they are by default.
    :raises InputError: for a variant or a metric that contradicts the surface.
    """

    patience = FEW_RATES
    pace = 1.0

    def __init__(self, surface: Surface, variant: Variant | None = None, metric: Metric | None = None) -> None:
        self.surface, self.variant, metric = surface, variant or Variant(), metric or Given()
        self.variant.check(along_rays=surface.free.per_vertex, on_grid=False)
        above = not surface.is_free and not surface.free.per_vertex and surface.boundary == "neumann"
        self._triangulations = triangulations_of(surface, above and self.variant.conserves)
        self._metrics = tuple(metric.settled(surface, t, self.variant.mass) for t in self._triangulations)
        self._plain = surface.is_free and len(self._metrics) == 1 and surface.time_factor is None
        self.held = surface.fixed.copy()
        if surface.boundary == "fixed":
            for triangulation in self._triangulations:
                self.held |= triangulation.connectivity.rim
        self._stays = self.held if self._border is None else self.held | self._rim

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), free coordinate per time, zero where a vertex is fixed, isolated, or without area; or a blend of it."""
        bare = blend.is_bare
        marched = self._marched(u, blend.keep, blend.dt, out) if bare else self._marched(u, 0.0, 1.0, None)
        if bare and marched is not None:
            return marched
        return blend.of_rate(u, self._rated(u, diagonal) if marched is None else marched, out)

    def _rated(self, u: Array, diagonal: int) -> Array:
        """The rate (n, k), whatever moves."""
        snapshot = self._at(u, diagonal)
        m = snapshot.measured
        gradient = operator.gather_gradient(m.connectivity, m.weights, snapshot.x, self._linear)
        pull, inertia = self.surface.free.along(gradient), self._inertia(snapshot, gradient)
        moves = self._moves(inertia)
        rate = -np.divide(pull, inertia[:, None], out=np.zeros_like(pull), where=moves[:, None])
        if self._border is not None:
            rate[self._rim] = -(self._border @ u)[self._rim]
        return rate

    def _marched(self, u: Array, keep: float, dt: float, out: Array | None) -> Array | None:
        """keep u + dt rate(u), by blocks of triangles; None where that is not what moves, or triangles are too thin for it."""
        thinnest = self._metrics[0].thinnest
        blocks = self._blocks if self._plain and u.shape[1] == 3 and thinnest > 0 else None
        if blocks is None:
            return None
        u, c = np.ascontiguousarray(u, dtype=np.float64), self._triangulations[0].connectivity
        out = np.empty_like(u) if out is None else out
        linear = self._linear and len(c.border) > 0
        inverse = np.empty(len(u)) if linear else None
        sharpest = march_blocks(blocks, u, keep, dt, out, inverse)
        if sharpest > thinnest:
            return None
        if self._border is not None:
            out[self._rim] = keep * u[self._rim] - dt * (self._border @ u)[self._rim]
        elif inverse is not None:
            out[c.rim] -= inverse[c.rim, None] * operator.border_pull(c, u)[c.rim]
        return out

    @cached_property
    def _blocks(self) -> Blocks | None:
        """Made when the first explicit step asks for them."""
        faces, kind = self._triangulations[0].connectivity.faces, operator.mass_kind(self.variant.mass)
        return blocked(self.surface.points, faces, kind, self._stays)

    @cached_property
    def _rim(self) -> Array:
        """Vertices (n,) of a border that moves on its own."""
        return self._triangulations[0].connectivity.rim

    @cached_property
    def _border(self) -> Any:
        """The operator (n, n) of a plane-preserving border of irregular triangles, which moves on its own; None: there is none.

        Its metric is that of the start.
        """
        surface, c = self.surface, self._triangulations[0].connectivity
        if surface.boundary != "plane-preserving" or not surface.irregular or not len(c.border):
            return None
        staying = list(surface.free.staying(surface.points.shape[1]))
        found = border_operator(c, surface.points[:, staying] if staying else surface.points, self.held)
        return found / 3.0 if self.variant.mass == "ring" else found

    def area(self, u: Array) -> float:
        """Area of the surface at u, squared length; the mean over its triangulations."""
        x, pairs = self._measuring(u), zip(self._metrics, self._triangulations, strict=True)
        return sum(m.area(t, x, self.variant.sharpness) for m, t in pairs) / len(self.surface.triangulations)

    def _measuring(self, u: Array) -> Array:
        """The coordinates (n, c) that measure triangles, beside their charts: none where the flow is linear."""
        x = self.surface.free.measured(u)
        return np.zeros_like(x) if self.variant.linear and not self.surface.is_free else x

    def bound(self, u: Array) -> float:
        """max over triangles of lambda_max(M_T^-1 L_T) times the largest factor of time at its corners; per time.

        One channel over charts moves along the gradient of its area, whose second derivatives are at most those of the flat
        Dirichlet energy, whatever the sharpness: the bound of the flat triangles holds as well, times what M / s is less than the
        flat mass.
        """
        return max(self._inner_bound(u), self._border_bound)

    @cached_property
    def _border_bound(self) -> float:
        """That of a border that moves on its own, whose operator is positive semidefinite: its largest row, by Gershgorin."""
        return 0.0 if self._border is None else float(np.asarray(abs(self._border).sum(axis=1)).max())

    def _inner_bound(self, u: Array) -> float:
        """:meth:`bound` of what is not such a border."""
        snapshots = [self._at(u, diagonal) for diagonal in range(len(self._metrics))]
        if self._metrics[0].keeps_range:
            return max(map(self._range_bound, snapshots))
        dynamic, m = max(map(self._dynamic_bound, snapshots)), self.variant
        if u.shape[1] > 1 or m.mass == "voronoi" or (m.gamma < 0 and m.indicator == "projection"):
            return dynamic
        flat = 0.0
        for snapshot in snapshots:
            forms = snapshot.triangulation.forms
            if forms is None:
                return dynamic
            bounds = operator.rate_bound(*operator.form_cotangents(forms), m.mass)
            if (share := snapshot.triangulation.share) is not None:
                bounds = bounds * share[snapshot.triangulation.connectivity.faces].max(axis=1)
            lighter = 1.0 if m.gamma >= -1 else self._lightening(snapshot)
            flat = max(flat, float(bounds.max(initial=0.0)) * lighter)
        return min(dynamic, flat)

    def _range_bound(self, snapshot: _Snapshot) -> float:
        """2 max L_ii s / M, Gershgorin's: an explicit step of 2 / bound takes every vertex to a mean of its neighbours."""
        m, inertia = snapshot.measured, self._inertia(snapshot, None)
        at = 0.5 * (np.roll(m.cot, -1, axis=1) + np.roll(m.cot, -2, axis=1))
        diagonal = np.bincount(m.connectivity.faces.ravel(), at.ravel(), len(inertia))
        moves = self._moves(inertia)
        return 2.0 * float((diagonal[moves] / inertia[moves]).max(initial=0.0))

    def _lightening(self, snapshot: _Snapshot) -> float:
        """The flat mass over M / s where that is greatest."""
        speed, mass = self._speed(snapshot, None), snapshot.mass
        whole = (3.0 if self.variant.mass == "ring" else 1.0) * snapshot.triangulation.flat
        heavier = whole if speed is None else whole * speed
        lighter = np.divide(heavier, mass, out=np.ones_like(mass), where=mass > 0)
        return float(lighter.max(initial=1.0))

    def _dynamic_bound(self, snapshot: _Snapshot) -> float:
        m, factor = snapshot.measured, self._speed(snapshot, None)
        bounds = operator.rate_bound(m.cot, m.area, self.variant.mass)
        if factor is not None:
            bounds = bounds * factor[m.connectivity.faces].max(axis=1)
        return float(bounds.max(initial=0.0))

    def system(self, u: Array, diagonal: int = 0) -> MeshSystem:
        """Mass and stiffness of the surface at u, for implicit steps."""
        snapshot = self._at(u, diagonal)
        inertia, m = self._inertia(snapshot, None), snapshot.measured
        moves = self._moves(inertia)
        mass = np.where(moves, inertia, 1.0)
        border = self._border
        if border is not None and self.held.any():  # held vertices do not change, and the system is symmetric
            border = border @ sparse.diags((~self.held).astype(np.float64))
        return MeshSystem(mass, moves, m, self.surface.free.directions, self._order, border)

    @cached_property
    def _order(self) -> Array | None:
        """That of the blocks, for a mesh that is large."""
        n, d = self.surface.points.shape
        if n <= LARGE or d != 3 or not self._plain or self._blocks is None:
            return None
        return self._blocks.order

    def generator(
        self, u: Array, weights: Literal["cotangent", "uniform", "scale-dependent"], presmooth: float = 0.0
    ) -> Any:
        """A (n, n) with du/dt = -A u in the metric of u; rows of what stays are zero. Along axes, one set of triangles.

        But for ``cotangent`` the border moves as a curve, or, if it is ``neumann``, its neighbours inside draw it in.

        :param presmooth: cotangents are those of u after a bi-Laplacian filter with uniform weights for this time.
        """
        if weights != "cotangent":
            connectivity = self._triangulations[0].connectivity
            moves = ~self.held & (np.diff(connectivity.first) > 0)
            curve = self.surface.boundary != "neumann"
            if weights == "scale-dependent":
                mean = neighbour_means(connectivity.faces.astype(np.int64), len(u), "curve" if curve else "free")
                return scale_dependent_generator(mean, u, moves)
            return umbrella_generator(connectivity, mean_edge(self.surface.points, connectivity.faces), moves, curve)
        snapshot = self._at(filtered(self.generator(u, "uniform"), u, presmooth, 2) if presmooth > 0 else u, 0)
        inertia, m = self._inertia(snapshot, None), snapshot.measured
        whole = cotangent_generator(m.connectivity, m.cot, inertia, self._moves(inertia), self._linear)
        return whole if self._border is None else sparse.csr_matrix(whole + self._border)

    @property
    def _linear(self) -> bool:
        """Whether the conormals of the triangles at border edges are taken out."""
        return self.surface.boundary == "plane-preserving" and not self.surface.irregular

    def _at(self, u: Array, diagonal: int) -> _Snapshot:
        """The surface at u, measured."""
        which = diagonal % len(self._metrics)
        triangulation, x = self._triangulations[which], self.surface.free.measured(u)
        m = self._metrics[which].measured(triangulation, self._measuring(u), self.variant.sharpness)
        return _Snapshot(triangulation, x, m, operator.gather_mass(m.connectivity, m.cot, m.area, self.variant.mass))

    def _inertia(self, snapshot: _Snapshot, gradient: Array | None) -> Array:
        """M |d|^2 / s (n,): what divides the pull to give the rate."""
        inertia, speed = snapshot.mass * self.surface.free.length2, self._speed(snapshot, gradient)
        if speed is None:
            return inertia
        return np.divide(inertia, speed, out=np.zeros_like(inertia), where=speed > 0)

    def _speed(self, snapshot: _Snapshot, gradient: Array | None) -> Array | None:
        """Factor of time (n,): the edge indicator to the power gamma, times those of surface and triangles; None: all are 1."""
        factor, share = self.surface.time_factor, snapshot.triangulation.share
        if share is not None:
            factor = share if factor is None else share * factor
        if self.variant.gamma == 0.0 or self.surface.is_free:
            return factor
        by_metric = self.variant.indicator == "metric"
        indicator = self._expansion(snapshot) if by_metric else self._projection(snapshot, gradient)
        speed = indicator**self.variant.gamma
        return speed if factor is None else speed * factor

    def _expansion(self, snapshot: _Snapshot) -> Array:
        """1/W (3): area across the free directions over true area, of the triangles around each vertex (n,)."""
        m, connectivity = snapshot.measured, snapshot.triangulation.connectivity
        flat, least = self.surface.free.seen(connectivity, snapshot.x, snapshot.triangulation.flat)
        true = operator.gather_mass(connectivity, m.cot, m.area, "barycentric")
        ratio = np.divide(flat, true, out=np.ones_like(true), where=(true > 0) & (flat > 0))
        return np.clip(ratio, least, 1.0)

    def _projection(self, snapshot: _Snapshot, gradient: Array | None) -> Array:
        """|PB| / |B| (10), at least the floor; 1 where the surface is flat and the ratio 0/0."""
        cot, triangulation = snapshot.measured.cot, snapshot.triangulation
        if gradient is None:
            gradient = operator.gather_gradient(triangulation.connectivity, cot, snapshot.x, self._linear)
        free = self.surface.free.share(gradient)
        whole = np.hypot(np.linalg.norm(gradient, axis=1), triangulation.chart_gradient(cot, self._linear))
        # |B| h below 1e-9 is rounding: the gradient of the area there is a length, compared with h = sqrt(M).
        curved = whole > 1e-9 * np.sqrt(snapshot.mass)
        ratio = np.divide(free, whole, out=np.ones_like(whole), where=curved)
        return np.clip(ratio, self.variant.floor, 1.0)

    def _moves(self, inertia: Array) -> Array:
        """Vertices (n,) that are neither fixed, nor without triangles, nor of a border that moves on its own."""
        return (inertia > 0) & np.isfinite(inertia) & ~self._stays
