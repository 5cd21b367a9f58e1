"""Data as it is to be drawn: of files and objects, and meshes in their own colours where that is asked."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.files import Document
from meshflow.io.objects import from_object
from meshflow.surfaces.data import Noun
from meshflow.surfaces.mesh import Mesh
from meshflow.view.texture import Textured, image_of, texture_of

__all__ = ["carried", "flowing_together", "taken"]

_OF_COLOUR = (
    "colors",
    "RGB",
    "RGBA",
    "rgb",
    "rgba",
    "Normals",
    "TCoords",
)  # read as colours, or no quantity on the surface


def taken(thing: object, own_colours: bool = False) -> tuple[Noun, tuple[str, ...]]:
    """The data of an object or a file as a height field, image, range image or mesh, and notes on what was done.

    :param thing: a :class:`meshflow.Document`, or anything that :func:`meshflow.io.objects.from_object` recognises.
    :param own_colours: of a mesh, with the colours (n, 3) of its vertices, or of its texture at them, as channels that ride
        along, as the texture itself does.
    :raises InputError: where colours are asked for and there are none.
    """
    if isinstance(thing, Document):
        noun, notes = thing.noun, thing.notes
    else:
        adopted = from_object(thing)
        noun, notes = adopted.noun, adopted.notes
    if not own_colours:
        return noun, notes
    if not isinstance(noun, Mesh):
        raise InputError(f"own_colours: of meshes only, this is a {type(noun).__name__}; leave it out")
    if noun.channels is not None and noun.channels.shape[1] in (3, 4):
        return noun, notes
    colours, mesh = _colours(thing, noun), _as_trimesh(thing, noun)
    if colours is None:
        raise InputError("own_colours: the mesh has neither colours of its vertices nor a texture; leave it out")
    texture = None if mesh is None else texture_of(mesh, noun)
    return Textured(noun.points, noun.faces, colours, "points", noun.fixed, texture), notes


def carried(thing: object, noun: Mesh) -> dict[str, Array]:
    """The vertex attributes of a mesh by name: arrays (n, k), one row for each vertex.

    :param thing: what the noun came from, as :func:`taken` has it.
    :returns: ``colours`` first, 0 to 255, those of the vertices or of a texture at them; then other vertex attributes of
        numbers. Empty for what carries nothing.
    """
    mesh = _as_trimesh(thing, noun)
    if isinstance(thing, Mesh) or (mesh is None and isinstance(thing, (Document, tuple, list))):
        return {}
    colours = _colours(thing, noun)
    found = {} if colours is None else {"colours": colours}
    if mesh is None:
        names = [name for name in getattr(thing, "point_data", ()) if str(name) not in _OF_COLOUR]
        return {**found, **{str(name): column for name in names if (column := _column(thing, name, noun)) is not None}}
    there = {str(name): np.asarray(values) for name, values in mesh.vertex_attributes.items()}
    numbers = {
        name: v for name, v in there.items() if name not in _OF_COLOUR and v.dtype.kind in "biuf" and v.ndim <= 2
    }
    if numbers:
        nearest = _nearest(mesh.vertices, noun)
        found |= {
            name: values[nearest].astype(np.float64).reshape(len(nearest), -1) for name, values in numbers.items()
        }
    return found


def _column(thing: object, name: str, noun: Mesh) -> Array | None:
    """A point array (n, k) of an object that is no trimesh; None where it cannot be a channel (text, a wrong length)."""
    try:
        channels = from_object(thing, {"channels": name, "moves": "channels"}).noun
    except InputError:  # an array that cannot move does not ride along as one
        return None
    found = channels.channels if isinstance(channels, Mesh) else None
    return None if found is None or len(found) != len(noun.points) else found.astype(np.float64)


def _as_trimesh(thing: object, noun: Mesh) -> Any:
    """The thing as a trimesh.Trimesh, where it is one or was read from a file; else None."""
    if isinstance(thing, Document):
        scene = thing.source.scene(noun) if isinstance(noun, Mesh) else None
        return None if scene is None else scene.to_mesh()
    return thing if hasattr(thing, "visual") else None


def flowing_together(thing: object) -> tuple[str, ...]:
    """A note for files of several parts, which are smoothed together here."""
    if isinstance(thing, Document) and thing.sections:
        return (
            "all parts are smoothed together here, with one noise, method and time; meshflow smooth smooths each by itself",
        )
    return ()


def _colours(thing: object, noun: Mesh) -> Array | None:
    """The colours (n, 3), 0 to 255, of the vertices of a noun; None where the thing has none."""
    if isinstance(thing, Mesh):
        return None
    mesh = _as_trimesh(thing, noun)
    if mesh is None and not isinstance(thing, Document):
        try:
            found = from_object(thing, {"channels": "colors", "moves": "points"}).noun
        except InputError:  # it has none; the caller says so
            return None
        if not isinstance(found, Mesh) or found.channels is None:
            return None
        bright = found.channels.astype(np.float64)
        return bright * 255.0 if bright.max() <= 1.0 else bright
    worn = None if mesh is None else _worn(mesh)
    if worn is None:
        return None
    points, colours = worn
    return colours[_nearest(points, noun)].astype(np.float64)


def _nearest(points: ArrayLike, noun: Mesh) -> Array:
    """For each vertex of a mesh the index of the nearest of these points: textures split vertices, and places identify them."""
    from scipy.spatial import KDTree

    _, nearest = KDTree(np.asarray(points, dtype=np.float64)).query(noun.points[:, :3])
    return np.asarray(nearest)


def _worn(mesh: Any) -> tuple[Array, Array] | None:
    """Places (k, 3) and colours (k, 3) of a trimesh.Trimesh."""
    visual = mesh.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        if image_of(visual) is None:
            return None
        visual = visual.to_color()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(visual.vertex_colors)[:, :3]
