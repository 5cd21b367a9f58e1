"""Compares four flows on a range image, each stopped when its surface is equally smooth."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.evaluate.outcome import Bends, Outcome, Start, Truth, rim_edges
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.steppers import SemiImplicit
from meshflow.geometry.normals import normals_at
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.free import ALL, Axes, Rays
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.surface import Boundary, Surface
from meshflow.surfaces.visibility import Sight

__all__ = ["FLOWS", "FlowComparison", "Panel", "compare_flows"]

FLOWS = {
    "space": "3D mean curvature flow",
    "normals": "3D flow along normals",
    "z": "graph flow of z",
    "rays": "ray flow",
}
HEADS = {"before": "before", "space": "3D", "normals": "3D, normals", "z": "z graph", "rays": "rays"}
# A flow that has not reached the smoothness of the ray flow after this multiple of its time is measured there.
PATIENCE = 3.0


@dataclass(frozen=True, eq=False)
class Panel:
    """A surface as seen by its camera, for a picture.

    :ivar label: its name.
    :ivar note: its numbers.
    :ivar pixels: (n, 2), column and row at which each vertex is seen.
    :ivar depth: (n,), of each vertex.
    :ivar points: (n, 3).
    :ivar faces: (m, 3).
    :ivar rim: (k, 2), edges with a triangle on one side only.
    """

    label: str
    note: str
    pixels: Array
    depth: Array
    points: Array
    faces: Array
    rim: Array


@dataclass(frozen=True, eq=False)
class FlowComparison:
    """The results of four flows on a range image, at equal roughness.

    :ivar before: the image before smoothing.
    :ivar after: the results of the flows, by the names of :data:`FLOWS`.
    :ivar roughness: at which each was stopped, degrees.
    :ivar start: the surface before smoothing.
    :ivar truth: the true surface; None where it is not known.
    """

    before: Outcome
    after: dict[str, Outcome]
    roughness: float
    start: Start = field(repr=False)
    truth: Truth | None = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """All numbers, for JSON."""
        return {
            "matched": "mean angle between neighbouring triangles away from the rim, degrees",
            "roughness": self.roughness,
            "before": self.before.as_dict(),
            "flows": {name: outcome.as_dict() for name, outcome in self.after.items()},
        }

    def rows(self) -> list[tuple[str, ...]]:
        """The table as text, with the header first; columns without any number are left out."""
        columns: list[tuple[str, Callable[[Outcome], Any], str]] = [
            ("time [px²]", lambda o: o.time, ".2f"),
            ("roughness [°]", lambda o: o.roughness, ".2f"),
            ("|depth error| median", lambda o: o.depth_median, ".3g"),
            ("|depth error| rms", lambda o: o.depth_rms, ".3g"),
            ("|depth error| 95 %", lambda o: o.depth_tail, ".3g"),
            ("distance to surface, median", lambda o: o.distance_median, ".3g"),
            ("distance to surface, rms", lambda o: o.distance_rms, ".3g"),
            ("normals off by [°]", lambda o: o.normal_error, ".2f"),
            ("silhouette drift, rms [px]", lambda o: o.drift_rms, ".2g"),
            ("silhouette drift, max [px]", lambda o: o.drift_max, ".2g"),
            ("area after / before", lambda o: o.area, ".3f"),
            ("pixels lost", lambda o: o.lost, "d"),
            ("pixels gained", lambda o: o.gained, "d"),
        ]
        outcomes = (self.before, *self.after.values())
        shown = [column for column in columns if any(column[1](o) is not None for o in outcomes)]
        table = [("", *(head for head, _, _ in shown))]
        for outcome in outcomes:
            label = HEADS[outcome.name] + ("" if outcome.matched else " (rougher)")
            cells = ("" if (v := ask(outcome)) is None else format(v, form) for _, ask, form in shown)
            table.append((label, *cells))
        return table

    def __str__(self) -> str:
        """The transposed table: one line per number, one column per flow."""
        lines = list(zip(*self.rows(), strict=True))
        first = max(len(line[0]) for line in lines)
        wide = [max(len(line[k]) for line in lines) for k in range(1, len(lines[0]))]
        return "\n".join(
            line[0].ljust(first) + "".join(f"  {cell:>{w}}" for cell, w in zip(line[1:], wide, strict=True))
            for line in lines
        )

    def panels(self) -> tuple[Panel, ...]:
        """Before, the truth if known, and the four flows."""
        start, truth = self.start, self.truth
        kinds = [("before", _noted(self.before), self.before.points, start.faces)]
        if truth is not None:
            kinds.append(("truth", "", np.nan_to_num(start.sight.at(truth.depth).reshape(-1, 3)), truth.faces))
        kinds += [(FLOWS[name], _noted(o), o.points, start.faces) for name, o in self.after.items()]
        return tuple(
            Panel(label, note, *start.sight.pixels(points), points, faces, rim_edges(faces))
            for label, note, points, faces in kinds
        )


def compare_flows(
    depth: ArrayLike,
    camera: Any,
    truth: ArrayLike | None = None,
    *,
    time: float = 5.0,
    dt: float = 0.25,
    jump: float | None = 0.05,
    boundary: Boundary = "plane-preserving",
    variant: Variant | None = None,
) -> FlowComparison:
    """Run four flows on a range image until they are equally smooth, and measure their results.

    ``space``: mean curvature flow of the triangulated mesh, all of R^3 free; ``normals``: the same along vertex normals only,
    which are updated after each step; ``z``: each point along the axis of the camera, off its ray; ``rays``: each along its
    ray. All use the same triangles, boundary condition and unit of time (the squared footprint of each pixel at the start).

    The flows are matched in roughness, the mean angle between neighbouring triangles that do not touch the rim: the ray flow runs
    for ``time``, and each of the others until it is equally smooth. Steps are semi-implicit; the last one is shortened to meet
    the roughness. A flow that does not reach it within three times ``time`` is measured there and marked. (It has more than six
    parameters because they are independent of each other.)

    Example:

        >>> from meshflow import Pinhole
        >>> from meshflow.synthetic import depth_scene
        >>> camera = Pinhole(fx=50.0, fy=50.0, cx=26.5, cy=19.5)
        >>> sample = depth_scene(camera, (40, 54))
        >>> flows = compare_flows(sample.noisy, camera, sample.truth, time=1.0)
        >>> sorted(flows.after)
        ['normals', 'rays', 'space', 'z']

    :param depth: (h, w); 0 and NaN are missing.
    :param camera: a camera that :class:`RangeImage` takes.
    :param truth: (h, w), the true depths; 0 and NaN where there are none.
    :param time: of the ray flow, squared pixel footprints.
    :param dt: of one step.
    :param jump: as in :class:`RangeImage`, for the image and the truth.
    :param boundary: ``neumann | plane-preserving | fixed``.
    :param variant: of the family; the Beltrami flow by default. It has no effect where all of R^3 is free.
    :raises InputError: for a truth of another shape, an image without two neighbouring triangles, or no pixel to compare.
    """
    positive(time, "time", "squared pixel footprints")
    dt = min(positive(dt, "dt", "squared pixel footprints"), time)
    surface, start = _opened(depth, camera, jump, boundary)
    known = None if truth is None else _truth(truth, camera, jump, start)
    bends = Bends(start.faces)
    if len(bends.pairs) == 0:
        raise InputError("compare flows: no two triangles meet away from the rim; a larger image, or a larger jump")
    run = _Run(start.faces, bends, variant or Variant(), dt)
    rays = run.until(surface, "rays", time)
    ends = {"rays": rays} | {
        name: run.until(surface, name, PATIENCE * time, rays.roughness) for name in FLOWS if name != "rays"
    }
    before = _End(start.points, 0.0, bends.roughness(start.points), True)
    seen = {name: start.sight.rendered(end.points, start.faces) for name, end in ends.items()}
    first = start.sight.rendered(start.points, start.faces)
    kept = np.logical_and.reduce([np.isfinite(z) for z in (first, *seen.values())])
    if known is not None:
        kept &= np.isfinite(known.depth)
    if not kept.any():
        raise InputError("compare flows: no pixel has a truth, and a surface before and after each flow")
    after = {name: _measured(name, ends[name], seen[name], start, known, kept) for name in FLOWS}
    return FlowComparison(_measured("before", before, first, start, known, kept), after, rays.roughness, start, known)


@dataclass(frozen=True, eq=False)
class _End:
    """The end of a run."""

    points: Array
    time: float
    roughness: float
    matched: bool


@dataclass(frozen=True, eq=False)
class _Run:
    """Common parameters of the runs."""

    faces: Array
    bends: Bends
    variant: Variant
    dt: float

    def until(self, surface: Surface, name: str, time: float, roughness: float | None = None) -> _End:
        """Run a flow to a time, or to a roughness."""
        move, points, now, diagonal = self._mover(surface, name), surface.points, 0.0, 0
        reached = self.bends.roughness(points)
        while now < time * (1.0 - 1e-12) and (roughness is None or reached > roughness):
            dt = min(self.dt, time - now)
            new = move(points, dt, diagonal)
            found = self.bends.roughness(new)
            if roughness is not None and found <= roughness:
                share = self._share(points, new, roughness)
                points = points + share * (new - points)
                return _End(points, now + share * dt, self.bends.roughness(points), True)
            points, reached, now, diagonal = new, found, now + dt, diagonal + 1
        return _End(points, now, reached, roughness is None or reached <= roughness)

    def _share(self, old: Array, new: Array, roughness: float) -> float:
        """The share of a step that leads to a roughness."""
        from scipy.optimize import brentq

        def over(share: float) -> float:
            """The roughness after a share of the step, minus the requested one."""
            return self.bends.roughness(old + share * (new - old)) - roughness

        return float(brentq(over, 0.0, 1.0, xtol=1e-3)) if over(0.0) > 0 > over(1.0) else 1.0  # pyright: ignore[reportArgumentType]

    def _mover(self, surface: Surface, name: str) -> Callable[[Array, float, int], Array]:
        """A step of a flow: (points, dt, diagonal) to points."""
        stepper = SemiImplicit()
        if name == "normals":

            def along(points: Array, dt: float, diagonal: int) -> Array:
                """A step along the vertex normals of these points."""
                normals = normals_at(points, self.faces)
                here = replace(surface, points=points, free=Rays(points, normals, np.zeros((len(points), 1))))
                flow = MeshFlow(here, self.variant)
                return here.points_at(stepper.step(flow, flow.start(), dt, diagonal))

            return along
        moving = replace(surface, free={"space": ALL, "z": Axes((2,))}.get(name, surface.free))
        flow = MeshFlow(moving, self.variant)

        def step(points: Array, dt: float, diagonal: int) -> Array:
            """A step along the free directions, which do not change."""
            return moving.points_at(stepper.step(flow, moving.free.coordinates(points), dt, diagonal))

        return step


def _opened(depth: ArrayLike, camera: Any, jump: float | None, boundary: Boundary) -> tuple[Surface, Start]:
    """The moving surface, and the quantities at the start."""
    image = RangeImage(np.asarray(depth), camera, jump=jump)
    grid = image.gridded(Lift(boundary=boundary))
    surface = grid.surface()
    faces = replace(grid, diagonals="forward").surface().triangulations[0]
    return surface, Start(
        Sight.along(image.camera.lines(grid.shape, image.measure or image.camera.usual), grid.shape),
        surface.points,
        faces,
    )


def _truth(truth: ArrayLike, camera: Any, jump: float | None, start: Start) -> Truth:
    """The true surface.

    :raises InputError: for another shape than that of the image.
    """
    if np.shape(truth) != start.sight.shape:
        raise InputError(f"truth: the shape of the image, {start.sight.shape}, expected, got {np.shape(truth)}")
    image = RangeImage(np.asarray(truth), camera, jump=jump)
    return Truth(
        start.sight,
        np.where(np.asarray(image.missing), np.nan, image.depth.astype(np.float64)),
        image.lifted(Lift(diagonals="forward")).triangulations[0],
    )


def _measured(name: str, end: _End, depth: Array, start: Start, truth: Truth | None, kept: Array) -> Outcome:
    """All numbers of one surface."""
    errors, distances, normals = None, None, None
    if truth is not None:
        errors = np.abs(depth - truth.depth)[kept]
        distances = truth.distances(end.points[(start.used & np.isfinite(truth.depth)).ravel()])
        normals = truth.normal_error(depth, kept)
    drift, seen = start.drift(end.points), np.isfinite(depth)
    return Outcome(
        name=name,
        time=end.time,
        roughness=end.roughness,
        matched=end.matched,
        depth_median=None if errors is None else float(np.median(errors)),
        depth_rms=None if errors is None else float(np.sqrt(np.mean(errors**2))),
        depth_tail=None if errors is None else float(np.percentile(errors, 95.0)),
        distance_median=None if distances is None else float(np.median(distances)),
        distance_rms=None if distances is None else float(np.sqrt(np.mean(distances**2))),
        normal_error=normals,
        drift_rms=float(np.sqrt(np.mean(drift**2))) if drift.size else None,
        drift_max=float(drift.max()) if drift.size else None,
        area=start.area(end.points),
        lost=int((start.used & ~seen).sum()),
        gained=int((seen & ~start.used).sum()),
        points=end.points,
        depth=depth,
    )


def _noted(outcome: Outcome) -> str:
    """The numbers below a panel."""
    words = [f"normals {outcome.normal_error:.1f}° off"] if outcome.normal_error is not None else []
    if outcome.depth_median is not None:
        words.append(f"median error {outcome.depth_median:.2g}")
    if outcome.drift_rms is not None and outcome.time > 0:
        words.append(f"drift {outcome.drift_rms:.2f} px")
    if not outcome.matched:
        words.append("rougher")
    return ", ".join(words)
