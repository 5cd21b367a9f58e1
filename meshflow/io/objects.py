"""Imports objects of other libraries, and converts results back to the same kind of object."""

from collections.abc import Callable
from functools import partial
from os import PathLike
from pathlib import Path

from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import must_be_object
from meshflow.io.document import Document, Imported
from meshflow.io.files import read_with
from meshflow.io.metadata import Metadata, ReadOptions, as_given
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.irregular import Irregular
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tensors import Tensors
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.vectors import Vectors
from meshflow.surfaces.volume import Volume

# What says that an object has an array, and how it is made; results are arrays, which no such object takes back by itself.
ARRAYS = {
    "to_numpy": "data.to_numpy()",
    "__array__": "numpy.asarray(data)",
    "__dlpack__": "numpy.from_dlpack(data)",
}

__all__ = ["Imported", "from_object", "opened", "taken_in"]


def from_object(data: object, metadata: Metadata | None = None) -> Imported:
    """Recognize and import data.

    numpy arrays (h, w) are height fields, arrays (h, w, k) images, with ``kind="volume"`` arrays (d, h, w) volumes;
    ``(points, faces)`` is a mesh. Objects of xarray, trimesh, pyvista, open3d and meshio, documents of :func:`meshflow.read`, and
    data objects of meshflow are accepted. A path is read.

    :param metadata: what the object does not contain itself (:class:`ReadOptions`).
    :raises InputError: for any other object, and for an option that does not exist or does not apply.
    :raises FormatError: for a file that cannot be read.
    """
    return taken_in(data, ReadOptions.of({} if metadata is None else metadata))


def taken_in(data: object, options: ReadOptions) -> Imported:
    """:func:`from_object`, with options that have been checked."""
    if isinstance(data, (HeightField, Image, RangeImage, Mesh, Volume, TetMesh)):
        if options.given:
            raise InputError(f"{type(data).__name__} already says {', '.join(options.given)}; set them there")
        return Imported(data, lambda same: same)
    if isinstance(data, (Tensors, Vectors)):
        options.must_belong(f"a {type(data).__name__}, which says all of its samples", ())
        return Imported(data.image, data.holding)
    if isinstance(data, Irregular):
        options.must_belong(f"a {type(data).__name__}, which says all of its samples", ())
        return Imported(data.mesh, data.holding, samples=partial(_aligned, data))
    must_be_object(data, "data: an array or an object with data")
    data, options = opened(data, options)
    if isinstance(data, Document):
        return _from_document(data, options)
    adapter = _adapter(data)
    if adapter is None:
        raise InputError(
            f"{type(data).__module__}.{type(data).__qualname__}: expected {_as_array(data)}a numpy array, (points, faces), a "
            "mesh of trimesh, pyvista, open3d or meshio, an xarray.DataArray, a picture of Pillow, a path, or a data object of "
            "meshflow"
        )
    return adapter(data, options)


def _as_array(data: object) -> str:
    """How an object of another library becomes an array, as the beginning of what is expected; empty where it does not say."""
    for name, way in ARRAYS.items():
        if hasattr(data, name):
            return f"{way}, which gives the numbers; else "
    return ""


def _aligned(data: Irregular, given: ArrayLike | None, word: str) -> ArrayLike | None:
    """An option of one number per sample, in the order of the vertices."""
    return data.aligned(as_given(given, word))


def opened(data: object, options: ReadOptions) -> tuple[object, ReadOptions]:
    """The document of a path, read with the options, and no options; anything else is returned unchanged.

    :raises FormatError: for a file that cannot be read.
    """
    if type(data).__module__.startswith("rasterio.") and isinstance(getattr(data, "name", None), str):
        data = Path(getattr(data, "name"))  # noqa: B009 - a dataset that is open stands for its file
        if not data.is_file():
            raise InputError(
                "a rasterio dataset of a file expected; smooth its band: meshflow.smooth(dataset.read(1, masked=True))"
            )
    if not isinstance(data, (str, PathLike)):
        return data, options
    return read_with(Path(data), options), ReadOptions()


def _from_document(document: Document, options: ReadOptions) -> Imported:
    if options.given:
        raise InputError(f"a file already says {', '.join(options.given)}; read it with them: meshflow.read(path, ...)")
    return Imported(document.data, document.holding, document.notes, document.samples)


def _adapter(data: object) -> Callable[[object, ReadOptions], Imported] | None:
    """The adapter of the package that defines the class of the data, or one of its base classes.

    An adapter is imported only when an object of its package is given.
    """
    for kind in type(data).__mro__:  # a subclass of numpy.ndarray or trimesh.Trimesh is one of them
        match kind.__module__.partition(".")[0]:
            case "numpy":
                from meshflow.io.formats.arrays import from_object as adapter
            case "builtins" if kind is not object:
                from meshflow.io.formats.arrays import from_object as adapter
            case "xarray":
                from meshflow.io.adapters.xarray import from_object as adapter
            case "trimesh":
                from meshflow.io.adapters.trimesh import from_object as adapter
            case "pyvista":
                from meshflow.io.adapters.pyvista import from_object as adapter
            case "PIL":
                from meshflow.io.adapters.pillow import from_object as adapter
            case "open3d":
                from meshflow.io.adapters.open3d import from_object as adapter
            case "meshio":
                from meshflow.io.adapters.meshio import from_object as adapter
            case _:
                continue
        return adapter
    return None
