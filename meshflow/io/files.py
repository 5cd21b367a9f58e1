"""Files in and out: which format reads, which one writes, and what must be asked before the work."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Protocol, Unpack, runtime_checkable

from meshflow.errors import FormatError, InputError
from meshflow.io.atomic_write import must_be_free
from meshflow.io.document import Document, Format, WriteOptions, Writing
from meshflow.io.formats.ply_layout import has_grid
from meshflow.io.incoming import set_down
from meshflow.io.metadata import Metadata, ReadOptions

__all__ = ["Document", "read", "read_with", "writable", "write"]

MESHES = frozenset({".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".vtp", ".vtu", ".vtk", ".vtm", ".3mf"})
ARRAYS = frozenset({".npy", ".npz"})
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})
TIFF = frozenset({".tif", ".tiff"})
# What is advised where nothing holds the data.
ROOM = {
    "mesh": tuple(sorted(MESHES - {".gltf", ".3mf"})),
    "depth": (".png", ".tif", ".npy", ".exr", ".ply"),
    "image": (".png", ".tif", ".jpg", ".npy"),
    "terrain": (".tif", ".asc", ".npy"),
}


@runtime_checkable
class Choosy(Protocol):
    """A format that holds some data, or some number types, and refuses others."""

    def must_fit(self, document: Document, path: Path, options: WriteOptions) -> None:
        """Refuse what :func:`write` would refuse.

        :raises FormatError: when the format cannot hold the data so.
        """
        ...


@dataclass(frozen=True)
class Entry:
    """A format in the registry.

    :param load: imports it; nothing of other libraries is imported before one of its files comes in.
    :param written: the extensions that it may write, in lower case.
    :param claims: whether it reads a file: asked in the order of the registry, the first that says so reads it.
    """

    load: Callable[[], Format]
    written: frozenset[str]
    claims: Callable[[Path, ReadOptions], bool]


def _arrays() -> Format:
    from meshflow.io.formats import arrays

    return arrays


def _exr() -> Format:
    from meshflow.io.formats import exr

    return exr


def _range_grids() -> Format:
    from meshflow.io.formats import range_grids

    return range_grids


def _meshes() -> Format:
    from meshflow.io.formats import meshes

    return meshes


def _depth_images() -> Format:
    from meshflow.io.formats import depth_images

    return depth_images


def _pictures() -> Format:
    from meshflow.io.formats import pictures

    return pictures


def _rasters() -> Format:
    from meshflow.io.formats import rasters

    return rasters


def _is_array(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() in ARRAYS


def _is_exr(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() == ".exr"


def _is_range_grid(path: Path, options: ReadOptions) -> bool:
    if path.suffix.lower() != ".ply":
        return False
    return options.kind == "depth" or (options.kind is None and has_grid(path))


def _is_mesh(path: Path, options: ReadOptions) -> bool:
    return options.kind == "mesh" or (options.kind is None and path.suffix.lower() in MESHES)


def _is_depth_image(path: Path, options: ReadOptions) -> bool:
    return options.kind == "depth" or (options.kind is None and options.camera is not None)


def _is_picture(path: Path, options: ReadOptions) -> bool:
    return options.kind == "image" or (options.kind is None and path.suffix.lower() in PICTURES)


def _is_anything(path: Path, options: ReadOptions) -> bool:
    return True


FORMATS = (
    Entry(_arrays, ARRAYS, _is_array),
    Entry(_exr, frozenset({".exr"}), _is_exr),
    Entry(_range_grids, frozenset({".ply"}), _is_range_grid),
    Entry(_meshes, MESHES, _is_mesh),
    Entry(_depth_images, frozenset({".png"}) | TIFF, _is_depth_image),
    Entry(_pictures, PICTURES | TIFF, _is_picture),
    Entry(_rasters, TIFF | {".asc"}, _is_anything),
)


def read(path: str | Path, **metadata: Unpack[Metadata]) -> Document:
    """Read whatever the file holds.

    A mesh by its extension, but a PLY with a range grid as a range image; ``.npy`` and ``.npz`` as arrays; a picture with a
    camera as a depth image, without as an image; everything else as a raster that GDAL opens: one band is a terrain, several are
    an image.

    :param metadata: what the file does not say of itself (:class:`ReadOptions`): ``kind`` (``terrain | image | depth |
        mesh``), where the guess would be wrong; of rasters and arrays ``band``, ``nodata``, ``spacing``; of depths
        ``camera``, ``depth_scale`` (units per metre), ``measure``, ``time_unit``, ``jump``; of scans ``viewpoint``; of
        meshes ``channels``, ``moves``.
    :raises FormatError: when the file cannot be read; the message says why and what would be read.
    :raises InputError: for an option that does not exist or does not apply to the file, with those that do.
    """
    if not isinstance(path, (str, PathLike)):
        raise InputError(
            f"read: a path expected, got {type(path).__name__}; smooth takes arrays and objects as they are"
        )
    return read_with(Path(path), ReadOptions.of(metadata))


def read_with(path: Path, options: ReadOptions) -> Document:
    """:func:`read`, with options that have been checked."""
    path = set_down(path)
    _must_be_a_file(path)
    found = next(entry for entry in FORMATS if entry.claims(path, options)).load()
    options.must_belong(f"{found.NAME} ({path.name})", found.READS)
    return found.read(path, options)


def write(
    document: Document,
    path: str | Path,
    *,
    overwrite: bool = False,
    tags: Mapping[str, str] | None = None,
    **options: Unpack[Writing],
) -> tuple[str, ...]:
    """Write a document in the format that the extension names; beside the old file first, then in its place.

    :param overwrite: replace a file that is there.
    :param tags: words about the run, kept in the file where the format has room for them.
    :param options: for the writer (:class:`WriteOptions`): ``dtype`` (rasters, pictures), ``depth_scale`` and ``left`` (depth
        images).
    :returns: what the user should know (rounding, what the format could not hold).
    :raises FormatError: when the format cannot hold the data, or a file is there and ``overwrite`` is not given.
    :raises InputError: for an option that does not apply to the format.
    """
    if not isinstance(document, Document):
        raise InputError(
            f"write: a Document expected, got {type(document).__name__}; meshflow.read gives one, document.holding(data) puts a "
            "smoothed data object into it; arrays are written by numpy.save, meshes of trimesh by mesh.export"
        )
    path = Path(path)
    found = writable(document, path, overwrite=overwrite, **options)
    names = path.stat().st_nlink if path.exists() else 1
    notes = found.write(document, path, WriteOptions(dict(tags or {}), **options))
    if names > 1:
        notes += (
            f"{path.name} was one of {names} names (hard links) of a file: the others still name what was there before",
        )
    return notes


def writable(document: Document, path: str | Path, *, overwrite: bool = False, **options: Unpack[Writing]) -> Format:
    """The format that would write a document to a path: to be asked before the work whose result goes there.

    :param options: as those of :func:`write`.
    :raises FormatError: as :func:`write`.
    :raises InputError: likewise.
    """
    path = Path(path)
    must_be_free(path, overwrite)
    if not path.parent.is_dir():
        raise FormatError(f"{path.parent} is no folder; make it first")
    suffix = path.suffix.lower()
    for entry in FORMATS:
        if suffix in entry.written and (found := entry.load()).can_write(document, suffix):
            strange = sorted(name for name in options if name not in found.WRITES)
            if strange:
                raise InputError(
                    f"{', '.join(strange)}: no option of {found.NAME} ({path.name}), which is written with "
                    f"{', '.join(found.WRITES) or 'none'}"
                )
            if isinstance(found, Choosy):
                found.must_fit(document, path, WriteOptions(**options))
            return found
    raise FormatError(
        f"{path.name}: a {document.kind} does not fit into {suffix or 'a file without extension'}; "
        f"use {' '.join(ROOM[document.kind])}"
    )


def _must_be_a_file(path: Path) -> None:
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    if path.is_dir():
        raise FormatError(f"{path} is a folder; a file is expected")
    if path.stat().st_size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")
