"""Things as they are to be drawn: files, objects and nouns as nouns, meshes in their own colours where that is asked."""

from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.gates import Array
from meshflow.geometry.lift import Mesh, Noun
from meshflow.io.adopt import adopt
from meshflow.io.files import Document
from meshflow.view.texture import Texture, Textured, image_of, texture_of

__all__ = ["taken"]


def taken(thing: Any, own_colours: bool = False) -> tuple[Noun, tuple[str, ...]]:
    """The noun of a thing, and what was done on the way.

    :param thing: a :class:`meshflow.Document`, or anything that :func:`meshflow.io.adopt.adopt` recognises.
    :param own_colours: of a mesh, with the colours (n, 3) of its vertices, or of its texture at them, as channels that ride
        along, as the texture itself does.
    :raises InputError: where colours are asked for and there are none.
    """
    if isinstance(thing, Document):
        noun, notes = thing.noun, thing.notes
    else:
        adopted = adopt(thing)
        noun, notes = adopted.noun, adopted.notes
    if not own_colours:
        return noun, notes
    if not isinstance(noun, Mesh):
        raise InputError(f"own_colours: of meshes only, this is a {type(noun).__name__}; leave it out")
    if noun.channels is not None and noun.channels.shape[1] in (3, 4):
        return noun, notes
    colours, texture = _colours(thing, noun)
    if colours is None:
        raise InputError("own_colours: the mesh has neither colours of its vertices nor a texture; leave it out")
    return Textured(noun.points, noun.faces, colours, "points", noun.fixed, texture), notes


def _colours(thing: Any, noun: Mesh) -> tuple[Array | None, Texture | None]:
    """The colours (n, 3), 0 to 255, of the vertices of a noun, and its texture; None where the thing has none."""
    if isinstance(thing, Mesh):
        return None, None
    mesh: Any = None
    if isinstance(thing, Document):
        mesh = thing.about.scene(noun).to_mesh() if hasattr(thing.about, "scene") else None
    elif hasattr(thing, "visual"):
        mesh = thing
    else:
        try:
            found = adopt(thing, channels="colors", moves="points").noun
        except InputError:  # it has none; the caller says so
            return None, None
        assert isinstance(found, Mesh)
        assert found.channels is not None
        bright = found.channels.astype(np.float64)
        return (bright * 255.0 if bright.max() <= 1.0 else bright), None
    worn = None if mesh is None else _worn(mesh)
    if worn is None:
        return None, None
    from scipy.spatial import KDTree

    points, colours = worn
    _, nearest = KDTree(points).query(noun.points[:, :3])  # textures split vertices: places tell which is which
    return colours[nearest].astype(np.float64), texture_of(mesh, noun)


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
