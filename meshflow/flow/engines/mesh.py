"""The one formula of the flow, on explicit triangles."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.sparse as sparse

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend
from meshflow.flow.engines.dense import Dense
from meshflow.flow.engines.sheets import Metric, Sheet
from meshflow.flow.methods.beltrami import Member
from meshflow.geometry import operator
from meshflow.geometry.blocks import Blocks, blocked, march_blocks
from meshflow.geometry.connectivity import Connectivity, connect, shared_sides
from meshflow.geometry.delaunay import (
    THIN,
    Triangles,
    clamped,
    delaunay,
    is_thin,
    length_cotangents,
    mollified,
    side_lengths,
)
from meshflow.geometry.laplacians import cotangent_generator, umbrella_generator
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.geometry.validation import Array
from meshflow.surfaces.surface import Axes, Rays, Surface

__all__ = ["MeshFlow", "MeshSystem"]


@dataclass(frozen=True, eq=False)
class MeshSystem:
    """A system of explicit triangles.

    :ivar mass: (n,).
    :ivar stiffness: (n, n), L_ij (d_i . d_j); rows and columns of vertices that do not move are zero.
    """

    mass: Array
    stiffness: sparse.csr_matrix

    def matrix(self, dt: float) -> Any:
        """mass + dt stiffness, (n, n)."""
        whole = sparse.csr_matrix((dt * self.stiffness.data, self.stiffness.indices, self.stiffness.indptr), copy=False)
        whole.setdiag(whole.diagonal() + self.mass)
        return whole


class MeshFlow(Dense):
    """dX/dt = -s P B on the triangles of a surface, s = (edge indicator)^gamma (7), (10), (14).

    The engine of reference: every other engine must agree with it.

    :param surface: where the points are and where they may go.
    :param member: which flow of the family.
    :param conformal: the stiffness stays that of the start, the mass is that of now (Kazhdan, Solomon, Ben-Chen 2012): no neck
        pinches off, and what is like a sphere becomes one. Where all coordinates are free.
    :param triangles: ``given``; ``delaunay``: those of the intrinsic Delaunay triangulation of the same surface, sides of all but
        flat ones made longer by a hair, so that no weight is below zero and no system singular; ``auto``: where thin ones ask for
        it. Where all coordinates are free. ``clamped``: weights below zero are zero, so that no coordinate leaves its range (the
        maximum principle); not the gradient of the area. With the natural boundary, or a fixed one.
    :param normals: above 0, a length: triangles are measured in (x, normals n), n the vertex normals of now, and move in x alone:
        what turns counts as far away, so faces become flat and creases stay. Points in R^3, all coordinates free.
    :raises InputError: for ``clamped`` with a linear boundary or Voronoi mass, which have weights below zero of their own.
    """

    slivers = True

    def __init__(
        self,
        surface: Surface,
        member: Member | None = None,
        conformal: bool = False,
        triangles: Triangles = "given",
        normals: float = 0.0,
    ) -> None:
        self.surface = surface
        self.member = member or Member()
        self.member.check(along_rays=isinstance(surface.free, Rays), on_grid=False)
        n = len(surface.points)
        charts = self._charts(surface)
        if surface.turns:
            self._sheets = tuple(Sheet.of((f,), c, n) for f, c in zip(surface.sheets, charts, strict=True))
        else:
            joined = None if charts[0] is None else np.concatenate([c for c in charts if c is not None])
            self._sheets = (Sheet.of(surface.sheets, joined, n),)
        assert surface.fixed is not None
        every = isinstance(surface.free, Axes) and surface.free.columns == tuple(range(surface.points.shape[1]))
        self._every = every and len(self._sheets) == 1
        self.triangles: Triangles = triangles if self._every or triangles == "clamped" else "given"
        if triangles == "clamped":
            self._check_clamped()
            self._sheets = tuple(replace(s, pairs=shared_sides(s.connectivity.faces)) for s in self._sheets)
        self._normals = normals if self._every else 0.0
        self._first: Array | None = None
        self._first = self._triangulated(self._sheets[0], surface.points)[1] if conformal else None
        self.held = surface.fixed.copy()
        if surface.boundary == "fixed":
            for sheet in self._sheets:
                self.held |= sheet.connectivity.rim

    def _check_clamped(self) -> None:
        if self.surface.boundary == "linear":
            raise InputError(
                "triangles='clamped': boundary natural or fixed expected, got 'linear', which leaves the range"
            )
        if self.member.mass == "voronoi":
            raise InputError(
                "triangles='clamped': mass barycentric or ring expected, got 'voronoi', which asks for all angles"
            )

    @staticmethod
    def _charts(surface: Surface) -> tuple[Array | None, ...]:
        """Corners of the triangles in the coordinates that stay, (m, 3, c) for each sheet; None where none stay."""
        if surface.charts is not None:
            return surface.charts
        if isinstance(surface.free, Rays):
            return (None,) * len(surface.sheets)
        assert surface.free is not None
        stay = [q for q in range(surface.points.shape[1]) if q not in surface.free.columns]
        return tuple(surface.points[:, stay][faces] if stay else None for faces in surface.sheets)

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """du/dt (n, k), free coordinate per time, zero where a vertex is fixed, isolated, or without area; or a blend of it."""
        bare = blend.is_bare
        marched = self._marched(u, blend.keep, blend.dt, out) if bare else self._marched(u, 0.0, 1.0, None)
        if bare and marched is not None:
            return marched
        return blend.of_rate(u, self._rated(u, diagonal) if marched is None else marched, out)

    def _rated(self, u: Array, diagonal: int) -> Array:
        """The rate (n, k), whatever moves."""
        sheet = self._sheets[diagonal % len(self._sheets)]
        x = self._moving(u)
        metric = self._measured(sheet, x)
        cot = self._drawn(metric, x)
        gradient = operator.gather_gradient(metric.connectivity, cot, x, self.surface.boundary == "linear")
        pull, inertia = self._along(gradient), self._inertia(sheet, x, metric, gradient)
        moves = self._moves(inertia)
        return -np.divide(pull, inertia[:, None], out=np.zeros_like(pull), where=moves[:, None])

    def _marched(self, u: Array, keep: float, dt: float, out: Array | None) -> Array | None:
        """keep u + dt rate(u), by blocks of triangles; None where that is not what moves, or triangles are too thin for it."""
        plain = (
            self._every and u.shape[1] == 3 and self.surface.pace is None and self._first is None and not self._normals
        )
        blocks = self._blocks if plain and self.triangles in ("auto", "given") else None
        if blocks is None:
            return None
        u, c = np.ascontiguousarray(u, dtype=np.float64), self._sheets[0].connectivity
        out = np.empty_like(u) if out is None else out
        linear = self.surface.boundary == "linear" and len(c.border) > 0
        inverse = np.empty(len(u)) if linear else None
        kind = operator.mass_kind(self.member.mass)
        sharpest = march_blocks(blocks, u, kind, self.held, keep, dt, out, inverse)
        if self.triangles == "auto" and sharpest > THIN:
            return None
        if inverse is not None:
            out[c.rim] -= inverse[c.rim, None] * operator.border_pull(c, u)[c.rim]
        return out

    @cached_property
    def _blocks(self) -> Blocks | None:
        """Made when the first explicit step asks for them."""
        return blocked(self.surface.points, self._sheets[0].connectivity.faces)

    def area(self, u: Array) -> float:
        """Area of the surface at u, squared length; the mean over its triangulations."""
        x = self._moving(u)
        if self._normals:  # of the surface itself, without its normals
            return operator.total_area(x, self._sheets[0].connectivity.faces)
        total = sum(float(self._measured(s, x).area.sum()) for s in self._sheets)
        return total / len(self.surface.sheets)

    def bound(self, u: Array) -> float:
        """max over triangles of lambda_max(M_T^-1 L_T) times the largest factor of time at its corners; per time.

        One channel over charts moves along the gradient of its area, whose second derivatives are at most those of the flat
        Dirichlet energy, whatever the sharpness: the bound of the flat triangles holds as well, times what M / s is less than the
        flat mass.
        """
        if self.triangles == "clamped":
            return self._range_bound(u)
        dynamic, m = self._dynamic_bound(u), self.member
        alone = isinstance(self.surface.free, Axes) and len(self.surface.free.columns) == 1
        if not alone or m.mass == "voronoi" or (m.gamma < 0 and m.indicator == "projection"):
            return dynamic
        flat = 0.0
        for sheet in self._sheets:
            if sheet.forms is None:
                return dynamic
            bounds = operator.rate_bound(*operator.form_cotangents(sheet.forms), m.mass)
            lighter = 1.0 if m.gamma >= -1 else self._lightening(sheet, self._moving(u))
            flat = max(flat, float(bounds.max(initial=0.0)) * lighter)
        return min(dynamic, flat)

    def _range_bound(self, u: Array) -> float:
        """2 max L_ii s / M, Gershgorin's: an explicit step of 2 / bound takes every vertex to a mean of its neighbours."""
        x, fastest = self._moving(u), 0.0
        for sheet in self._sheets:
            metric = self._measured(sheet, x)
            inertia = self._inertia(sheet, x, metric, None)
            at = 0.5 * (np.roll(metric.cot, -1, axis=1) + np.roll(metric.cot, -2, axis=1))
            diagonal = np.bincount(metric.connectivity.faces.ravel(), at.ravel(), len(inertia))
            moves = self._moves(inertia)
            fastest = max(fastest, float((diagonal[moves] / inertia[moves]).max(initial=0.0)))
        return 2.0 * fastest

    def _lightening(self, sheet: Sheet, x: Array) -> float:
        """The flat mass over M / s where that is greatest."""
        metric = self._measured(sheet, x)
        speed = self._speed(sheet, x, metric, None)
        assert speed is not None
        assert sheet.flat is not None
        whole = 3.0 if self.member.mass == "ring" else 1.0
        lighter = np.divide(whole * sheet.flat * speed, metric.mass, out=np.ones_like(speed), where=metric.mass > 0)
        return float(lighter.max(initial=1.0))

    def _dynamic_bound(self, u: Array) -> float:
        x, fastest = self._moving(u), 0.0
        for sheet in self._sheets:
            metric = self._measured(sheet, x)
            bounds = operator.rate_bound(metric.cot, metric.area, self.member.mass)
            factor = self._speed(sheet, x, metric, None)
            if factor is not None:
                bounds = bounds * factor[metric.connectivity.faces].max(axis=1)
            fastest = max(fastest, float(bounds.max(initial=0.0)))
        return fastest

    def system(self, u: Array, diagonal: int = 0) -> MeshSystem:
        """Mass and stiffness of the surface at u, for implicit steps."""
        sheet = self._sheets[diagonal % len(self._sheets)]
        x = self._moving(u)
        metric = self._measured(sheet, x)
        inertia = self._inertia(sheet, x, metric, None)
        moves = self._moves(inertia)
        rays = self.surface.free.directions if isinstance(self.surface.free, Rays) else None
        stiffness = operator.fill_stiffness(metric.connectivity, self._drawn(metric, x), rays)
        if not moves.all():
            rows = np.repeat(moves, np.diff(stiffness.indptr))
            stiffness.data[~(rows & moves[stiffness.indices])] = 0.0
        return MeshSystem(np.where(moves, inertia, 1.0), stiffness)

    def generator(self, u: Array, weights: Literal["cotangent", "uniform"]) -> Any:
        """A (n, n) with du/dt = -A u in the metric of u; rows of what stays are zero. Along axes, one set of triangles.

        With uniform weights the border moves as a curve, but for a ``natural`` one, which its neighbours inside draw in.
        """
        sheet, x = self._sheets[0], self._moving(u)
        if weights == "uniform":
            isolated = np.diff(sheet.connectivity.first) == 0
            step = mean_edge(self.surface.points, sheet.connectivity.faces)
            curve = self.surface.boundary != "natural"
            return umbrella_generator(sheet.connectivity, step, ~(self.held | isolated), curve)
        metric = self._measured(sheet, x)
        inertia = self._inertia(sheet, x, metric, None)
        linear = self.surface.boundary == "linear"
        return cotangent_generator(metric.connectivity, metric.cot, inertia, self._moves(inertia), linear)

    def _moving(self, u: Array) -> Array:
        """Coordinates in which triangles are measured by points: the free ones, or all where the free ones are rays."""
        return self.surface.points_at(u) if isinstance(self.surface.free, Rays) else np.ascontiguousarray(u)

    def _measured(self, sheet: Sheet, x: Array) -> Metric:
        connectivity, cot, area = self._triangulated(sheet, x)
        return Metric(connectivity, cot, area, operator.gather_mass(connectivity, cot, area, self.member.mass))

    def _drawn(self, metric: Metric, x: Array) -> Array:
        """The weights (m, 3) by which neighbours draw each other: cotangents."""
        return metric.cot

    def _triangulated(self, sheet: Sheet, x: Array) -> tuple[Connectivity, Array, Array]:
        """Triangles of the surface, its own or Delaunay's, with their cotangents (m, 3) and areas (m,)."""
        faces, measured = sheet.connectivity.faces, x
        if self._normals:
            measured = np.column_stack([x, self._normals * normals_at(x, faces)])
        cot, area = operator.cotangents(measured, faces, sheet.forms, self.member.sharpness)
        if self._first is not None:
            return sheet.connectivity, self._first, area
        if sheet.pairs is not None:
            return sheet.connectivity, clamped(cot, *sheet.pairs), area
        if self.triangles == "given" or (self.triangles == "auto" and not is_thin(cot)):
            return sheet.connectivity, cot, area
        flipped, lengths = delaunay(faces, mollified(side_lengths(measured, faces)))
        return connect((flipped,), sheet.connectivity.size), *length_cotangents(lengths)

    def _along(self, gradient: Array) -> Array:
        """P of a gradient, as free coordinates (n, k): for rays, per squared length of d in the inertia."""
        if isinstance(self.surface.free, Axes):
            return gradient
        assert isinstance(self.surface.free, Rays)
        return np.einsum("ij,ij->i", gradient, self.surface.free.directions)[:, None]

    def _inertia(self, sheet: Sheet, x: Array, metric: Metric, gradient: Array | None) -> Array:
        """M |d|^2 / s (n,): what divides the pull to give the rate."""
        inertia = metric.mass
        if isinstance(self.surface.free, Rays):
            inertia = inertia * np.einsum("ij,ij->i", self.surface.free.directions, self.surface.free.directions)
        speed = self._speed(sheet, x, metric, gradient)
        if speed is None:
            return inertia
        return np.divide(inertia, speed, out=np.zeros_like(inertia), where=speed > 0)

    def _speed(self, sheet: Sheet, x: Array, metric: Metric, gradient: Array | None) -> Array | None:
        """Factor of time (n,): the edge indicator to the power gamma, times the pace; None where it is 1 everywhere."""
        pace = self.surface.pace
        free_all = sheet.charts is None and not isinstance(self.surface.free, Rays)
        if self.member.gamma == 0.0 or free_all:
            return pace
        if self.member.indicator == "metric":
            indicator = self._expansion(sheet, x, metric)
        else:
            indicator = self._projection(sheet, x, metric, gradient)
        speed = indicator**self.member.gamma
        return speed if pace is None else speed * pace

    def _expansion(self, sheet: Sheet, x: Array, metric: Metric) -> Array:
        """1/W (3): area across the free directions over true area, of the triangles around each vertex (n,)."""
        least = 0.0
        if isinstance(self.surface.free, Rays):
            flat = operator.gather_seen(sheet.connectivity, x, self.surface.free.directions) / 3.0
            # A vertex seen exactly edge-on has no footprint at all; it must not divide by zero where gamma < 0.
            least = 1e-6
        else:
            assert sheet.flat is not None
            flat = sheet.flat
        true = operator.gather_mass(sheet.connectivity, metric.cot, metric.area, "barycentric")
        ratio = np.divide(flat, true, out=np.ones_like(true), where=(true > 0) & (flat > 0))
        return np.clip(ratio, least, 1.0)

    def _projection(self, sheet: Sheet, x: Array, metric: Metric, gradient: Array | None) -> Array:
        """|PB| / |B| (10), at least the floor; 1 where the surface is flat and the ratio 0/0."""
        linear = self.surface.boundary == "linear"
        if gradient is None:
            gradient = operator.gather_gradient(sheet.connectivity, metric.cot, x, linear)
        if isinstance(self.surface.free, Rays):
            directions = self.surface.free.directions
            length = np.linalg.norm(directions, axis=1)
            free = np.divide(np.abs(self._along(gradient)[:, 0]), length, out=np.zeros_like(length), where=length > 0)
            whole = np.linalg.norm(gradient, axis=1)
        else:
            assert sheet.charts is not None
            stays = operator.gather_chart_gradient(sheet.connectivity, metric.cot, sheet.charts, linear)
            free = np.linalg.norm(gradient, axis=1)
            whole = np.hypot(free, np.linalg.norm(stays, axis=1))
        # |B| h below 1e-9 is rounding: the gradient of the area there is a length, compared with h = sqrt(M).
        curved = whole > 1e-9 * np.sqrt(metric.mass)
        ratio = np.divide(free, whole, out=np.ones_like(whole), where=curved)
        return np.clip(ratio, self.member.floor, 1.0)

    def _moves(self, inertia: Array) -> Array:
        """Vertices (n,) that are neither fixed nor without triangles."""
        return (inertia > 0) & np.isfinite(inertia) & ~self.held
