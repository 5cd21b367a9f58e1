"""Warnings about what a run has done to the data, and about what it could not move."""

import numpy as np

from meshflow.estimate.plan import Plan
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.march import VANISHED, State
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.steppers import SemiImplicit
from meshflow.surfaces.data import Data
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

__all__ = ["of_area", "of_excess", "of_lag", "of_lone_samples"]

# A warning is given where more than this number, and this share, of the samples have no triangle.
ALONE, ALONE_SHARE = 10, 1e-3
# The share of its area below which a mesh is warned of.
LOST = 0.8
# The multiple of the noise from which on more was removed than that.
EXCESS = 2.0


def of_area(done: Data, plan: Plan, start: State, end: State) -> tuple[str, ...]:
    """A warning about a surface that has vanished, or a mesh whose points move and that lost much of its area.

    After a search it is the area of the noise.
    """
    if end.reason is not None and VANISHED in end.reason:
        return (end.reason,)
    if not isinstance(done, Mesh) or done.moves != "points" or plan.candidates or end.area > LOST * start.area:
        return ()
    return (f"the surface lost {1 - end.area / start.area:.0%} of its area; a smaller time keeps more",)


def of_excess(before: Data, done: Data, plan: Plan) -> tuple[str, ...]:
    """A warning about a method with its own time that moved the points of a mesh by far more than the noise."""
    if (
        not isinstance(before, Mesh)
        or not isinstance(done, Mesh)
        or before.moves != "points"
        or before.points.shape[1] != 3
    ):
        return ()
    noise = plan.noise.sigma * plan.request.strength
    if plan.candidates or plan.request.asked or noise == 0:
        return ()
    along = np.einsum("ij,ij->i", before.points - done.points, np.asarray(before.normals))
    times = float(np.sqrt(np.mean(np.square(along)))) / noise
    if times < EXCESS:
        return ()
    return (
        f"{times:.1f} times the noise was removed: the mesh is too coarse for this method, which removed a part of its shape; a "
        "smaller time keeps more, and so does no method",
    )


def of_lag(plan: Plan, end: State) -> tuple[str, ...]:
    """A warning about a run on a grid for which implicit steps were taken, since explicit ones would be too many.

    The metric is then that of the start of each step: a disc of steep sides hardly shrinks, and a cone does so too fast.
    """
    method = plan.method
    if (
        plan.request.compute.stepper != "auto"
        or end.stepper != SemiImplicit.name
        or not isinstance(method, HeightMethod)
    ):
        return ()
    if isinstance(plan.data, Mesh) or method.once:
        return ()
    return (
        "too many explicit steps would be needed, so implicit ones were taken, in which steep edges lag behind; a smaller "
        "contrast or time allows others, and stepper='super-time' takes them however many there are",
    )


def of_lone_samples(engine: GridFlow, plan: Plan) -> tuple[str, ...]:
    """A warning about samples that have no triangle, where they are more than a few."""
    rays = isinstance(plan.data, RangeImage)
    if plan.idle is not None or not (rays or engine.grid.missing.any() or engine.grid.cuts is not None):
        return ()
    lone, size = engine.grid.lone, int((~engine.grid.missing).sum())
    if lone <= max(ALONE, ALONE_SHARE * size):
        return ()
    cut = ", cut off by discontinuities or by missing samples" if rays or engine.grid.cuts is not None else ""
    return (f"{lone} of {size} samples have no triangle{cut}: they do not change",)
