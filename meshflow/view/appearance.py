"""Prepares data for drawing: from files and objects, and meshes with their own colours on request."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.files import Document
from meshflow.io.objects import from_object
from meshflow.surfaces.data import SurfaceData
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume
from meshflow.view.slices import skin_mesh, three_slices
from meshflow.view.texture import Textured, image_of, of_open3d, texture_of

__all__ = ["carried", "flowing_together", "taken"]

_OF_COLOUR = (
    "colors",
    "RGB",
    "RGBA",
    "rgb",
    "rgba",
    "Normals",
    "TCoords",
)  # read as colours, or not attributes of the surface


def taken(data: object, own_colours: bool = False) -> tuple[SurfaceData, tuple[str, ...]]:
    """The data of an object or a file as a height field, image, range image or mesh, and notes; of a volume three slices, of
    tetrahedra their skin.

    :param data: a :class:`meshflow.Document`, or anything that :func:`meshflow.io.objects.from_object` recognizes.
    :param own_colours: for a mesh: add the colours (n, 3) of its vertices, or of its texture at the vertices, as channels, and
        the texture itself.
    :raises InputError: where colours are requested and there are none.
    """
    if isinstance(data, Document):
        surface, notes = data.data, data.notes
    else:
        imported = from_object(data)
        surface, notes = imported.data, imported.notes
    if isinstance(surface, Volume):
        surface = three_slices(surface)
    if isinstance(surface, TetMesh):
        surface = skin_mesh(surface)
    if not own_colours:
        return surface, notes
    if not isinstance(surface, Mesh):
        raise InputError(f"own_colours: of meshes only, this is a {type(surface).__name__}; leave it out")
    if surface.channels is not None and surface.channels.shape[1] in (3, 4):
        return surface, notes
    colours, mesh = _colours(data, surface), _as_trimesh(data, surface)
    if colours is None:
        outside = getattr(data, "active_texture_coordinates", None) is not None
        where = " (pyvista keeps the picture of a texture outside of the mesh)" if outside else ""
        raise InputError(
            f"own_colours: the mesh has neither colours of its vertices nor a texture{where}; leave it out"
        )
    texture = None if mesh is None else texture_of(mesh, surface)
    return Textured(surface.points, surface.faces, colours, "points", surface.fixed, texture), notes


def carried(data: object, surface: Mesh) -> dict[str, Array]:
    """The vertex attributes of a mesh by name: arrays (n, k), one row for each vertex.

    :param data: the original of the mesh, as for :func:`taken`.
    :returns: ``colours`` first, 0 to 255, of the vertices or of a texture at the vertices; then other numeric vertex attributes.
        Empty without attributes.
    """
    mesh = _as_trimesh(data, surface)
    if isinstance(data, Mesh) or (mesh is None and isinstance(data, (Document, tuple, list))):
        return {}
    colours = _colours(data, surface)
    found = {} if colours is None else {"colours": colours}
    if mesh is None:
        names = [name for name in getattr(data, "point_data", ()) if str(name) not in _OF_COLOUR]
        return {
            **found,
            **{str(name): column for name in names if (column := _column(data, name, surface)) is not None},
        }
    there = {str(name): np.asarray(values) for name, values in mesh.vertex_attributes.items()}
    numbers = {
        name: v for name, v in there.items() if name not in _OF_COLOUR and v.dtype.kind in "biuf" and v.ndim <= 2
    }
    if numbers:
        nearest = _nearest(mesh.vertices, surface)
        found |= {
            name: values[nearest].astype(np.float64).reshape(len(nearest), -1) for name, values in numbers.items()
        }
    return found


def _column(data: object, name: str, surface: Mesh) -> Array | None:
    """A point array (n, k) of an object that is no trimesh; None where it cannot be a channel (text, wrong length)."""
    try:
        channels = from_object(data, {"channels": name, "moves": "channels"}).data
    except InputError:  # an array that cannot be a channel is not compared
        return None
    found = channels.channels if isinstance(channels, Mesh) else None
    return None if found is None or len(found) != len(surface.points) else found.astype(np.float64)


def _as_trimesh(data: object, surface: Mesh) -> Any:
    """The data as a trimesh.Trimesh, where it is one, was read from a file, or has a texture of open3d; else None."""
    if isinstance(data, Document):
        scene = data.source.scene(surface) if isinstance(surface, Mesh) else None
        return None if scene is None else scene.to_mesh()
    return data if hasattr(data, "visual") else of_open3d(data)


def flowing_together(data: object) -> tuple[str, ...]:
    """A note for files of several parts, which are smoothed together here."""
    if isinstance(data, Document) and data.sections:
        return (
            "all parts are smoothed together here, with one noise, method and time; meshflow smooth smooths each by itself",
        )
    return ()


def _colours(data: object, surface: Mesh) -> Array | None:
    """The colours (n, 3), 0 to 255, of the vertices; None where there are none."""
    if isinstance(data, Mesh):
        return None
    mesh = _as_trimesh(data, surface)
    if mesh is None and not isinstance(data, Document):
        try:
            found = from_object(data, {"channels": "colors", "moves": "points"}).data
        except InputError:  # it has none; the caller reports it
            return None
        if not isinstance(found, Mesh) or found.channels is None:
            return None
        bright = found.channels.astype(np.float64)
        return bright * 255.0 if bright.max() <= 1.0 else bright
    worn = None if mesh is None else _worn(mesh)
    if worn is None:
        return None
    points, colours = worn
    return colours[_nearest(points, surface)].astype(np.float64)


def _nearest(points: ArrayLike, data: Mesh) -> Array:
    """The index of the nearest of these points for each vertex; textures split vertices, which positions identify."""
    from scipy.spatial import KDTree

    _, nearest = KDTree(np.asarray(points, dtype=np.float64)).query(data.points[:, :3])
    return np.asarray(nearest)


def _worn(mesh: Any) -> tuple[Array, Array] | None:
    """Positions (k, 3) and colours (k, 3) of a trimesh.Trimesh."""
    visual = mesh.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        if image_of(visual) is None:
            return None
        visual = visual.to_color()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(visual.vertex_colors)[:, :3]
