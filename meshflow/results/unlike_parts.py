"""Parts of one mesh that are so unlike that each group of them is smoothed on its own."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from meshflow.estimate.constraints import Constraints
from meshflow.estimate.mesh_parts import unlike_parts
from meshflow.estimate.request import Request
from meshflow.geometry.validation import Array
from meshflow.results.result import Result
from meshflow.surfaces.mesh import Mesh

__all__ = ["groups_of", "one_by_one"]


def groups_of(data: Mesh, request: Request) -> tuple[Array, ...]:
    """Masks (n,) of the groups; empty where all parts go together, or the caller decides anything that is for all of them."""
    plain = Constraints()
    free = all(getattr(request.constraints, f.name) is getattr(plain, f.name) for f in fields(plain))
    if not free or not request.is_open or data.moves != "points" or data.points.shape[1] != 3 or data.fixed.any():
        return ()
    return unlike_parts(data)


def one_by_one(data: Mesh, groups: tuple[Array, ...], smoothed: Callable[[Mesh], Result]) -> Result:
    """The mesh with each group smoothed on its own; all that is said of the run is that of the first group.

    :param groups: masks (n,).
    :param smoothed: the result of a mesh.
    """
    points, found = data.points.copy(), []
    for mask in groups:
        used, faces = np.unique(data.faces[mask[data.faces[:, 0]]], return_inverse=True)
        found.append(smoothed(Mesh(data.points[used], faces.reshape(-1, 3))))
        points[used] = found[-1].after.points
    first, done = found[0], replace(data, points=points)
    noise = ", ".join(f"{one.noise.sigma:.3g}" for one in found)
    said = f"parts of {len(groups)} sizes were smoothed on their own (noise {noise}); the parameters are those of the first"
    others = (word for one in found[1:] for word in one.warnings)
    warnings = (said, *dict.fromkeys((*first.warnings, *others)))
    return replace(first, data=done, after=done, before=data, warnings=warnings, plan=None)
