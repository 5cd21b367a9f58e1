"""Isosurfaces of volumes and of meshes of tetrahedra, before and after, in one picture."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, number
from meshflow.io.atomic_write import beside
from meshflow.io.files import Document
from meshflow.io.objects import from_object
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume
from meshflow.view.look import OF_PAIRS, Looks, looking
from meshflow.view.numbers import brief
from meshflow.view.pictures import writable
from meshflow.view.renderer import renderer_for

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["isosurfaces"]

# The bins of the histogram by which a level is chosen.
BINS = 256
# The height of the labels, and dots per inch of the page.
TITLE, DPI = 34, 100


def isosurfaces(
    before: object,
    after: object,
    path: str | Path,
    *,
    level: float | None = None,
    overwrite: bool = False,
    **look: Unpack[Looks],
) -> Path:
    """Draw the surface where a volume, or values in a body, have one value, before and after.

    Example:

        >>> import numpy as np
        >>> from meshflow import Volume
        >>> from meshflow.synthetic import head
        >>> noisy = Volume(head(24) + 0.05 * np.random.default_rng(0).normal(size=(24, 24, 24)))
        >>> isosurfaces(noisy, Volume(head(24)), "surface.png", size=(600, 300)).name
        'surface.png'

    :param before: a volume, or values on tetrahedra, of one channel; ``after``: the same after smoothing.
    :param path: the picture to write (.png, .jpg, .tif).
    :param level: the value. None: that which parts the values of ``after`` best in two (Otsu 1979).
    :param overwrite: replace an existing file.
    :param look: the options of :class:`meshflow.view.Look` by name, except those for pairs.
    :returns: the path.
    :raises InputError: for other data, several channels, and a level that no value reaches.
    :raises FormatError: for a path that cannot be written, or a file that exists.
    :raises MissingPackage: where VTK cannot draw.
    """
    target, seen = writable(path, overwrite=overwrite), looking(OF_PAIRS, **look)
    seen = replace(seen, up=seen.up or "z")
    bodies = [_body(data) for data in (before, after)]
    chosen = _parting(bodies[1]) if level is None else number(level, "level")
    surfaces = [_surface(body, chosen) for body in bodies]
    renderer = renderer_for(tuple(surfaces), replace(seen, renderer="pyvista"), True)
    width, height = seen.size[0] // 2, seen.size[1] - TITLE
    drawn = [
        renderer.panel(one, shape, (width, height))
        for one, shape in zip(surfaces, renderer.geometries(*surfaces), strict=True)
    ]
    _save(target, drawn, [f"{word}: surface of {brief(chosen)}" for word in seen.labels])
    return target


def _save(target: Path, pictures: list[Array], labels: list[str]) -> None:
    """Write pictures (h, w, 3) side by side, each under its label."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    high, wide = pictures[0].shape[:2]
    figure = Figure(figsize=(2 * wide / DPI, (high + TITLE) / DPI), dpi=DPI)
    FigureCanvasAgg(figure)
    for k, (picture, label) in enumerate(zip(pictures, labels, strict=True)):
        axis = figure.add_axes((k / 2, 0.0, 0.5, high / (high + TITLE)))
        axis.imshow(picture, interpolation="nearest")
        axis.set_axis_off()
        axis.set_title(label, fontsize=11)
    with beside(target) as draft:
        figure.savefig(draft, format=target.suffix[1:].lower(), dpi=DPI)


def _body(data: object) -> Volume | TetMesh:
    """The data of an object, if it is a body of one channel.

    :raises InputError: for anything else.
    """
    found = data.data if isinstance(data, Document) else from_object(data).data
    if not isinstance(found, (Volume, TetMesh)):
        raise InputError(f"isosurfaces: of volumes and of values on tetrahedra, got a {type(found).__name__}")
    if found.values.size != found.missing.size:
        raise InputError(
            f"isosurfaces: one channel expected, got values of shape {found.values.shape}; take one of them"
        )
    return found


def _parting(body: Volume | TetMesh) -> float:
    """The value that parts the others in two with the least variance within each part."""
    known = body.values.reshape(body.missing.shape)[~body.missing]
    counts, ends = np.histogram(known, BINS)
    middles = (ends[1:] + ends[:-1]) / 2
    below, total = np.cumsum(counts), np.cumsum(counts * middles)
    above = below[-1] - below
    apart = np.where(
        (below > 0) & (above > 0), total / np.maximum(below, 1) - (total[-1] - total) / np.maximum(above, 1), 0.0
    )
    return float(ends[1 + int(np.argmax(below * above * np.square(apart)))])


def _surface(body: Volume | TetMesh, level: float) -> Mesh:
    """The isosurface as a mesh.

    :raises InputError: where it is empty.
    """
    grid = _as_grid(body)
    found = grid.contour([level], scalars="values").triangulate()
    if not found.n_cells:
        known = body.values[~body.missing]
        raise InputError(f"level: a value between {known.min():.4g} and {known.max():.4g} expected, got {level:.4g}")
    return Mesh(np.array(found.points), np.array(found.regular_faces))


def _as_grid(body: Volume | TetMesh) -> "pv.DataSet":
    """A body for VTK, its missing values at the least one."""
    import pyvista as pv

    values = np.where(body.missing, body.values[~body.missing].min(), body.values.reshape(body.missing.shape))
    if isinstance(body, Volume):
        grid: pv.DataSet = pv.ImageData(dimensions=body.missing.shape[::-1], spacing=body.spacing[::-1])
    else:
        grid = pv.UnstructuredGrid({pv.CellType.TETRA: np.array(body.cells)}, np.array(body.points[:, :3], np.float64))
    grid.point_data["values"] = values.astype(np.float64).ravel()
    return grid
