"""How far the points of a mesh may move after a search, and whether what was found is noise at all."""

import numpy as np

from meshflow.estimate.mesh_noise import IMPULSIVE, PointNoise
from meshflow.estimate.noise import Noise
from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.request import Request
from meshflow.estimate.risk import Candidate
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.geometry.normals import mean_altitude
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["limited", "may_be_shape", "quanta_to_keep"]

# The largest change after a search, in sigma. White noise of 0.03 to 1 edges needs 4.5 along the normals (30 cases), impulses 13;
# where the noise is small, regularization of the sampling would go farther.
MOST, MOST_OF_IMPULSES = 8.0, 20.0
# Noise that is not equally strong everywhere, as that of parts with creases seems to be, is the shape unless the normal filter
# flattens its faces: it then runs for so many squared edges (10 to 50 on organic shapes), and leaves no more than this share.
FLATTENING, FLATTENED = 100.0, 0.65
DETAIL = "data left unchanged: what looks like correlated noise may be detail of the shape; give the noise or a time to remove it"
# Rounded points stay within half a quantum where triangles are at least so high, in mean edges (even ones 0.8, level sets 0.5).
WIDE = 0.58


def quanta_to_keep(data: Mesh, request: Request, noise: Noise) -> Array | None:
    """The quanta (3,) of rounded coordinates within whose half points stay; None where they may move farther.

    The points without rounding are there. Triangles that are thin need more: rounding has turned them, and along the normals
    alone they do not get wider.
    """
    if not isinstance(noise, PointNoise) or not noise.quanta or request.constraints.max_change is not None:
        return None
    if request.method is not None or request.timed or request.strength != 1.0:
        return None
    thin = mean_altitude(data.points, data.faces) < WIDE * data.step
    return None if thin else np.array(noise.quanta)


def limited(plan: Plan, quanta: Array | None) -> Plan:
    """The plan with the largest change after a search, unless the caller gives one.

    :param quanta: the answer of :func:`quanta_to_keep`.
    """
    noise, request = plan.noise, plan.request
    if request.constraints.max_change is not None:
        return plan
    if quanta is not None and isinstance(plan.data, Mesh):
        why = Decided("estimated", "half the quantum of each coordinate, rounding is the noise")
        return plan.with_({"max_change": why}, max_change=np.broadcast_to(0.5 * quanta, plan.data.points.shape))
    impulsive = isinstance(noise, PointNoise) and noise.kurtosis > IMPULSIVE
    most = (MOST_OF_IMPULSES if impulsive else MOST) * request.strength
    why = Decided("estimated", f"{most:g} sigma; larger changes are not noise")
    return plan.with_({"max_change": why}, max_change=most * noise.sigma)


def may_be_shape(plan: Plan, best: Candidate) -> str | None:
    """Why what was found may be the shape, so that nothing is changed; None if it is noise.

    Detail of a shape may have any spectrum. Beneath noise there is a smooth surface, to which a method leads: what is left of the
    noise is little. Beneath detail there is more detail.
    """
    noise = plan.noise
    if not isinstance(noise, PointNoise) or noise.spread == 0 or noise.how == "given":
        return None
    (time, square), share = best.least, noise.sigma**2
    flattened = isinstance(best.configuration, NormalFilter) and time >= FLATTENING * plan.data.step**2
    return None if square <= max(noise.left, FLATTENED if flattened else 0.0) * share else DETAIL
