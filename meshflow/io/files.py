"""Files in and out: which reader, which writer, and what must survive between them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, Literal

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_free
from meshflow.io.metadata import as_given
from meshflow.surfaces.camera import Camera
from meshflow.surfaces.lift import Noun

__all__ = ["Document", "Kind", "read", "writable", "write"]

Kind = Literal["terrain", "image", "depth", "mesh"]

MESHES = frozenset({".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".vtp", ".vtk", ".vtm", ".3mf"})
ARRAYS = frozenset({".npy", ".npz"})
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})


@dataclass(frozen=True)
class Document:
    """What a file held.

    :param noun: the data, as a noun of ``meshflow.surfaces.lift``.
    :param kind: what it is.
    :param path: where it came from.
    :param about: everything that must survive around the data; known to the reader and the writer of ``family`` alone.
    :param family: the module of ``meshflow.io`` that reads and writes it: rasters, pictures, depths, exrs, ...
    :param notes: what was done on the way in, sentences for the user.
    """

    noun: Noun
    kind: Kind
    path: Path
    about: Any
    family: str
    notes: tuple[str, ...] = ()

    def samples(self, given: Any, word: str) -> Any:
        """One number per sample of the noun: of a mesh also by the name of a vertex attribute of the file.

        :param given: an array, or a name.
        :param word: ``fixed | mask | mobility | data_weights | max_change``: what it is for.
        :raises InputError: for a name that is not there, with those that there are.
        """
        return (self.about.samples if self.family == "meshes" else as_given)(given, word)

    @property
    def sections(self) -> tuple[tuple[str, Array], ...]:
        """The meshes of a file of several: name and vertices of the noun (rows) of each; empty where there is one thing."""
        return self.about.sections if self.family == "meshes" else ()

    def holding(self, noun: Noun) -> "Document":
        """The same document around another noun."""
        return replace(self, noun=noun)


def read(
    path: str | Path, *, kind: Kind | None = None, camera: Camera | str | Path | None = None, **options: Any
) -> Document:
    """Read whatever the file holds.

    A mesh by its extension, but a PLY with a range grid as a range image; ``.npy`` and ``.npz`` as arrays; a picture with a
    camera as a depth image, without as an image; everything else as a raster that GDAL opens: one band is a terrain, several are
    an image.

    :param kind: ``terrain | image | depth | mesh``, where the guess would be wrong.
    :param camera: of a depth image: itself, the name of a convention or the path of its file (:func:`read_camera`).
    :param options: for the reader: ``band``, ``nodata``, ``spacing`` (rasters, arrays), ``depth_scale`` (units per metre),
        ``measure`` and ``pace`` (depths).
    :raises FormatError: when the file cannot be read; the message says why and what would be read.
    """
    path = Path(path)
    _must_be_a_file(path)
    family = _family(path, kind, camera)
    if camera is not None:
        options["camera"] = camera
    reader = _module(family).read
    _must_belong(options, reader, path, family)
    return reader(path, kind=kind, **options)


def write(
    document: Document,
    path: str | Path,
    *,
    overwrite: bool = False,
    tags: Mapping[str, str] | None = None,
    **options: Any,
) -> tuple[str, ...]:
    """Write a document in the format that the extension names; beside the old file first, then in its place.

    :param overwrite: replace a file that is there.
    :param tags: words about the run, kept in the file where the format has room for them.
    :param options: for the writer: ``dtype`` (rasters, pictures), ``depth_scale``.
    :returns: what the user should know (rounding, what the format could not hold).
    :raises FormatError: when the format cannot hold the data, or a file is there and ``overwrite`` is not given.
    """
    if not isinstance(document, Document):
        raise InputError(
            f"write: a Document expected, got {type(document).__name__}; meshflow.read gives one, document.holding(noun) puts a "
            "smoothed noun into it; arrays are written by numpy.save, meshes of trimesh by mesh.export"
        )
    path = Path(path)
    family = writable(document, path, overwrite=overwrite)
    writer = _module(family).write
    _must_belong(options, writer, path, family)
    return writer(document, path, tags=dict(tags or {}), **options)


def writable(document: Document, path: str | Path, *, overwrite: bool = False) -> str:
    """The family that would write a document to a path: to be asked before the work whose result goes there.

    :raises FormatError: as :func:`write`.
    """
    path = Path(path)
    must_be_free(path, overwrite)
    if not path.parent.is_dir():
        raise FormatError(f"{path.parent} is no folder; make it first")
    return _target(document, path)


def _must_belong(options: Mapping[str, Any], function: Callable[..., Any], path: Path, family: str) -> None:
    known = signature(function).parameters
    for option in options:
        if option not in known:
            raise InputError(f"{path.name}: the option {option} does not belong to {family}")


def _module(family: str) -> Any:
    return import_module(f"meshflow.io.formats.{family}")


def _must_be_a_file(path: Path) -> None:
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    if path.is_dir():
        raise FormatError(f"{path} is a folder; a file is expected")
    if path.stat().st_size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")


def _family(path: Path, kind: Kind | None, camera: object) -> str:
    suffix = path.suffix.lower()
    if suffix in ARRAYS:
        return "arrays"
    if suffix == ".exr":
        return "exr"
    if suffix == ".ply" and (kind == "depth" or (kind is None and _has_range_grid(path))):
        return "range_grids"
    if kind == "mesh" or (kind is None and suffix in MESHES):
        return "meshes"
    if kind == "depth" or (kind is None and camera is not None):
        return "depth_images"
    if kind == "image" or (kind is None and suffix in PICTURES):
        return "pictures"
    return "rasters"


def _has_range_grid(path: Path) -> bool:
    return _module("range_grids").has_grid(path)


def _target(document: Document, path: Path) -> str:
    """The family that writes a document to this extension."""
    suffix = path.suffix.lower()
    fits: dict[str, Callable[[], bool]] = {
        "meshes": lambda: document.kind == "mesh" and suffix in MESHES,
        "arrays": lambda: suffix in ARRAYS and (document.kind != "mesh" or suffix == ".npz"),
        "range_grids": lambda: document.kind == "depth" and suffix == ".ply",
        "exr": lambda: document.kind == "depth" and suffix == ".exr",
        "depth_images": lambda: document.kind == "depth" and suffix in {".png", ".tif", ".tiff"},
        "pictures": lambda: (
            document.kind == "image" and document.family != "rasters" and suffix in PICTURES | {".tif", ".tiff"}
        ),
        "rasters": lambda: document.kind in ("terrain", "image") and suffix in {".tif", ".tiff", ".asc"},
    }
    for family, fit in fits.items():
        if fit():
            return family
    room = {
        "mesh": sorted(MESHES - {".gltf", ".3mf"}),
        "depth": [".png", ".tif", ".npy", ".exr", ".ply"],
        "image": [".png", ".tif", ".jpg", ".npy"],
        "terrain": [".tif", ".asc", ".npy"],
    }[document.kind]
    raise FormatError(
        f"{path.name}: a {document.kind} does not fit into {suffix or 'a file without extension'}; use {' '.join(room)}"
    )
