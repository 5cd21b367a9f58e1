"""Things as they are to be drawn: files, objects and nouns as nouns, meshes in their own colours where that is asked."""

from dataclasses import replace
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.gates import Array
from meshflow.geometry.lift import Mesh, Noun
from meshflow.io.adopt import adopt
from meshflow.io.files import Document

__all__ = ["flowing_together", "taken"]


def taken(thing: Any, own_colours: bool = False) -> tuple[Noun, tuple[str, ...]]:
    """The noun of a thing, and what was done on the way.

    :param thing: a :class:`meshflow.Document`, or anything that :func:`meshflow.io.adopt.adopt` recognises.
    :param own_colours: of a mesh, with the colours (n, 3) of its vertices, or of its texture at them, as channels that ride
        along.
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
    colours = _colours(thing, noun)
    if colours is None:
        raise InputError("own_colours: the mesh has neither colours of its vertices nor a texture; leave it out")
    return replace(noun, channels=colours, moves="points"), notes


def flowing_together(thing: Any) -> tuple[str, ...]:
    """A sentence where the parts of a file are shown in one flow."""
    if isinstance(thing, Document) and thing.sections:
        return (
            "all parts flow together here, with one noise, way and time; meshflow smooth takes each as if it were alone",
        )
    return ()


def _colours(thing: Any, noun: Mesh) -> Array | None:
    """The colours (n, 3), 0 to 255, of the vertices of a noun; None where the thing has none."""
    if isinstance(thing, Mesh):
        return None
    if isinstance(thing, Document):
        worn = _worn(thing.about.scene(noun).to_mesh()) if hasattr(thing.about, "scene") else None
    elif hasattr(thing, "visual"):
        worn = _worn(thing)
    else:
        try:
            found = adopt(thing, channels="colors", moves="points").noun
        except InputError:  # it has none; the caller says so
            return None
        assert isinstance(found, Mesh)
        assert found.channels is not None
        bright = found.channels.astype(np.float64)
        return bright * 255.0 if bright.max() <= 1.0 else bright
    if worn is None:
        return None
    from scipy.spatial import KDTree

    points, colours = worn
    _, nearest = KDTree(points).query(noun.points[:, :3])  # textures split vertices: places tell which is which
    return colours[nearest].astype(np.float64)


def _worn(mesh: Any) -> tuple[Array, Array] | None:
    """Places (k, 3) and colours (k, 3) of a trimesh.Trimesh."""
    visual = mesh.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        image = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
        if image is None:
            return None
        visual = visual.to_color()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(visual.vertex_colors)[:, :3]
