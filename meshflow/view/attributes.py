"""Differences of vertex attributes between two meshes with identical geometry."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh
from meshflow.view.appearance import carried

__all__ = ["AttributeChange", "attribute_change"]


@dataclass(frozen=True, eq=False)
class AttributeChange:
    """A vertex attribute that differs between two meshes with identical geometry.

    :ivar name: of the attribute.
    :ivar before: (n, k).
    :ivar after: (n, k).
    :ivar others: names of other attributes that differ.
    """

    name: str
    before: Array
    after: Array
    others: tuple[str, ...] = ()

    @property
    def removed(self) -> tuple[Array, str]:
        """Before minus after (n,), the mean over the columns, and its name.

        Where the means are equal but the columns differ, as for red and blue, it is the length of the difference, without sign.
        """
        lost = self.before - self.after
        if lost.shape[1] > 1 and not np.nanmax(np.abs(lost.mean(axis=1)), initial=0.0) > 0:
            return np.linalg.norm(lost, axis=1), f"length of the difference of {self.name}"
        mean = "" if lost.shape[1] == 1 else "mean of "
        return lost.mean(axis=1), f"{mean}{self.name}, before − after"

    @property
    def rms(self) -> float:
        """Root mean square of the difference, all columns together."""
        return float(np.sqrt(np.nanmean(np.square(self.before - self.after).sum(axis=1))))

    @property
    def reported(self) -> str:
        """A sentence on what is compared."""
        more = f"; so do {', '.join(self.others)}" if self.others else ""
        return f"before and after are equal in their points; {self.name} differ, and are compared{more}"

    def worn(self, mesh: Mesh, values: Array) -> Mesh:
        """The mesh with this attribute as the channels that move."""
        return replace(mesh, channels=values, moves="channels")


def attribute_change(before: object, after: object, one: Mesh, other: Mesh) -> AttributeChange | None:
    """The attribute in which two meshes with the same points differ, colours first; None where no attribute differs.

    :param before: the original of ``one``, as for :func:`meshflow.view.appearance.taken`.
    :param after: the original of ``other``.
    """
    if one.moves != "points" or other.moves != "points" or one.points.shape != other.points.shape:
        return None
    if not (np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)):
        return None
    first, second = carried(before, one), carried(after, other)
    both = [name for name in first if name in second and first[name].shape == second[name].shape]
    unlike = [name for name in both if not np.array_equal(first[name], second[name], equal_nan=True)]
    if not unlike:
        return None
    name, *others = unlike
    return AttributeChange(name, first[name], second[name], tuple(others))
