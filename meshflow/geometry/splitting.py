"""Cells of a body as tetrahedra: each quadrilateral is cut from its vertex of the lowest number, so that neighbours agree.

From the lowest vertex of a cell, tetrahedra lead to the triangles of the faces that do not touch it (Dompierre, Labbé, Vallet,
Camarero 1999). A cube becomes six of equal volume; on a grid numbered along its axes they are those of Freudenthal.
"""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["CellKind", "split"]

CellKind = Literal["tetrahedron", "hexahedron", "wedge", "pyramid"]
# The faces of each cell by its corners: the lower face, the upper one in the same turn, as VTK and Gmsh number them.
_FACES: Mapping[CellKind, tuple[tuple[int, ...], ...]] = {
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid": ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def split(kind: CellKind, cells: Array) -> Array:
    """Tetrahedra (m, 4) of cells (c, corners) of one kind."""
    if kind == "tetrahedron" or not len(cells):
        return cells.reshape(-1, 4)
    apex, found = cells.argmin(axis=1), []
    for face in _FACES[kind]:
        far = cells[~np.isin(apex, face)]
        tip, corners = far.min(axis=1), far[:, face]
        begin = corners.argmin(axis=1)[:, None]
        turned = np.take_along_axis(corners, (begin + np.arange(len(face))) % len(face), axis=1)
        for second in range(1, len(face) - 1):
            found.append(np.column_stack([tip, turned[:, 0], turned[:, second], turned[:, second + 1]]))
    return np.concatenate(found)
