"""Other people's objects in, the same kind of object out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

from meshflow.errors import InputError
from meshflow.io.files import Document
from meshflow.io.metadata import as_given
from meshflow.surfaces.lift import HeightField, Image, Mesh, Noun, RangeImage

__all__ = ["Adopted", "adopt"]

# Which module of this room knows the objects of which package, by the package of the object's class: nothing of theirs is
# imported before one of their objects has come in.
_HOMES = {
    "numpy": "formats.arrays",
    "builtins": "formats.arrays",
    "xarray": "adapters.xarray",
    "trimesh": "adapters.trimesh",
    "pyvista": "adapters.pyvista",
    "open3d": "adapters.open3d",
    "meshio": "adapters.meshio",
}


@dataclass(frozen=True)
class Adopted:
    """An object of somebody else's, taken in.

    :param noun: its data, shared or copied, never changed.
    :param restore: a noun of the same kind and size becomes an object of the kind that came in; a new one.
    :param notes: what was done on the way in, sentences for the user.
    :param samples: what is given under a word of one number per sample, an array as the thing stores its samples or the name
        of one that it holds, becomes an array of the noun's samples.
    """

    noun: Noun
    restore: Callable[[Any], Any]
    notes: tuple[str, ...] = ()
    samples: Callable[[Any, str], Any] = as_given


def adopt(thing: Any, **hints: Any) -> Adopted:
    """Recognise what a thing is.

    numpy arrays (h, w) are height fields, (h, w, k) images; ``(points, faces)`` is a mesh; objects of xarray, trimesh,
    pyvista, open3d and meshio as they are; what :func:`meshflow.read` gives; the nouns of meshflow pass.

    :param hints: ``kind`` (``terrain | image | depth | mesh``), ``spacing``, ``camera``, ``missing``, ``fixed``, ``channels``,
        ``moves``: what the object itself does not say.
    :raises InputError: for a thing that is none of these, or a hint that does not belong to it.
    """
    hints = {name: hint for name, hint in hints.items() if hint is not None}
    if isinstance(thing, (HeightField, Image, RangeImage, Mesh)):
        if hints:
            raise InputError(f"{type(thing).__name__} already says {', '.join(hints)}; set them there")
        return Adopted(thing, lambda noun: noun)
    if isinstance(thing, Document):
        fixed = hints.pop("fixed", None)
        if hints:
            raise InputError(f"a file already says {', '.join(hints)}; read it with them: meshflow.read(path, ...)")
        noun = thing.noun if fixed is None else replace(thing.noun, fixed=thing.samples(fixed, "fixed"))
        return Adopted(noun, thing.holding, thing.notes, thing.samples)
    for kind in type(thing).__mro__:  # a subclass of numpy.ndarray or trimesh.Trimesh is one of them
        home = _HOMES.get(kind.__module__.partition(".")[0])
        if home is not None and kind is not object:
            return import_module(f"meshflow.io.{home}").adopt(thing, **hints)
    raise InputError(
        f"{type(thing).__module__}.{type(thing).__qualname__}: expected a numpy array, (points, faces), a mesh of "
        "trimesh, pyvista, open3d or meshio, an xarray.DataArray, or a noun of meshflow; read a file with meshflow.read"
    )
