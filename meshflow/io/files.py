"""Reading and writing files: selects the format, and checks before the work that the result can be written."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Protocol, Unpack, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_free
from meshflow.io.document import Document, Format, WriteOptions, Writing
from meshflow.io.formats.elsewhere import must_be_known
from meshflow.io.formats.ply_layout import has_grid
from meshflow.io.incoming import absent, set_down
from meshflow.io.metadata import Metadata, ReadOptions
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["Document", "format_of", "read", "read_with", "writable", "write"]

MESHES = frozenset({".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".vtp", ".vtu", ".vtk", ".vtm", ".3mf"})
ARRAYS = frozenset({".npy", ".npz"})
TABLES = frozenset({".csv", ".tsv", ".xyz"})
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})
TIFF = frozenset({".tif", ".tiff"})
VOLUMES = frozenset({".nii", ".nii.gz", ".nrrd"})
# The extensions suggested where a format does not hold the data.
ROOM = {
    "mesh": tuple(sorted(MESHES)),
    "depth": (".png", ".tif", ".npy", ".exr", ".ply"),
    "image": (".png", ".tif", ".jpg", ".npy"),
    "terrain": (".tif", ".asc", ".npy"),
    "volume": (".nii.gz", ".nrrd", ".npy", ".tif"),
    "tetrahedra": (".vtu", ".vtk", ".msh"),
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

    :param load: imports it; other libraries are imported only when one of its files is read.
    :param written: the extensions that it can write, in lower case.
    :param claims: whether it reads a file; the first format of the registry that claims a file reads it.
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


def _pcd() -> Format:
    from meshflow.io.formats import pcd

    return pcd


def _e57() -> Format:
    from meshflow.io.formats import e57

    return e57


def _meshes() -> Format:
    from meshflow.io.formats import meshes

    return meshes


def _depth_images() -> Format:
    from meshflow.io.formats import depth_images

    return depth_images


def _pictures() -> Format:
    from meshflow.io.formats import pictures

    return pictures


def _point_tables() -> Format:
    from meshflow.io.formats import point_tables

    return point_tables


def _volumes() -> Format:
    from meshflow.io.formats import volumes

    return volumes


def _stacks() -> Format:
    from meshflow.io.formats import stacks

    return stacks


def _field_arrays() -> Format:
    from meshflow.io.formats import field_arrays

    return field_arrays


def _dicom() -> Format:
    from meshflow.io.formats import dicom

    return dicom


def _bodies() -> Format:
    from meshflow.io.formats import bodies

    return bodies


def _rasters() -> Format:
    from meshflow.io.formats import rasters

    return rasters


def _is_series(path: Path, options: ReadOptions) -> bool:
    from meshflow.io.formats.dicom import is_dicom

    return path.is_dir() or is_dicom(path)


def _is_field(path: Path, options: ReadOptions) -> bool:
    return options.kind in ("vectors", "tensors")


def _is_array(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() in ARRAYS


def _is_exr(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() == ".exr"


def _is_range_grid(path: Path, options: ReadOptions) -> bool:
    if path.suffix.lower() != ".ply":
        return False
    return options.kind == "depth" or (options.kind is None and has_grid(path))


def _is_pcd(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() == ".pcd"


def _is_e57(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() == ".e57"


def _is_mesh(path: Path, options: ReadOptions) -> bool:
    return options.kind in ("mesh", "tetrahedra") or (options.kind is None and path.suffix.lower() in MESHES)


def _is_point_table(path: Path, options: ReadOptions) -> bool:
    suffix = path.suffix.lower()
    if suffix != ".xyz" or options.kind != "terrain":
        return suffix in (".csv", ".tsv")
    from meshflow.io.formats.point_tables import is_scattered

    return is_scattered(path)  # GDAL reads grids as lines of x, y, z


def _is_volume(path: Path, options: ReadOptions) -> bool:
    return suffix_of(path) in VOLUMES


def _is_msh(path: Path, options: ReadOptions) -> bool:
    return path.suffix.lower() == ".msh"


def _is_stack(path: Path, options: ReadOptions) -> bool:
    return options.kind == "volume" and path.suffix.lower() in TIFF


def _is_depth_image(path: Path, options: ReadOptions) -> bool:
    return options.kind == "depth" or (options.kind is None and options.camera is not None)


def _is_picture(path: Path, options: ReadOptions) -> bool:
    return options.kind == "image" or (options.kind is None and path.suffix.lower() in PICTURES)


def _is_anything(path: Path, options: ReadOptions) -> bool:
    return True


FORMATS = (
    Entry(_dicom, frozenset({""}), _is_series),
    Entry(_field_arrays, ARRAYS | VOLUMES, _is_field),
    Entry(_arrays, ARRAYS, _is_array),
    Entry(_volumes, VOLUMES, _is_volume),
    Entry(_stacks, TIFF, _is_stack),
    Entry(_exr, frozenset({".exr"}), _is_exr),
    Entry(_range_grids, frozenset({".ply"}), _is_range_grid),
    Entry(_pcd, frozenset({".pcd"}), _is_pcd),
    Entry(_e57, frozenset({".e57"}), _is_e57),
    Entry(_point_tables, TABLES, _is_point_table),
    Entry(_bodies, frozenset({".vtu", ".vtk", ".msh"}), _is_msh),
    Entry(_meshes, MESHES, _is_mesh),
    Entry(_depth_images, frozenset({".png"}) | TIFF, _is_depth_image),
    Entry(_pictures, PICTURES | TIFF, _is_picture),
    Entry(_rasters, TIFF | {".asc", ".img", ".nc", ".gpkg", ".bil"}, _is_anything),
)


def read(path: str | Path, **metadata: Unpack[Metadata]) -> Document:
    """Read a file.

    Meshes are recognized by their extension, except that a PLY with a range grid is a range image. ``.npy`` and ``.npz`` are
    arrays, ``.csv`` tables of points, ``.nii.gz`` and ``.nrrd`` volumes. A picture is a depth image if a camera is given, else
    an image. Everything else is a raster that GDAL opens: one band is a terrain, several bands are an image.

    Example:

        >>> document = read("data/terrain.tif")
        >>> document.kind, document.data.z.shape
        ('terrain', (256, 256))

    :param path: of the file, or of a folder with a DICOM series.
    :param metadata: what the file does not contain itself (:class:`ReadOptions`): ``kind`` (``terrain | image | depth |
        mesh | volume | vectors | tensors``), where the guess would be wrong; for rasters and arrays ``band``, ``nodata``,
        ``spacing``; for depths ``camera``, ``depth_scale`` (units per metre), ``measure``, ``time_unit``, ``jump``; for scans
        ``viewpoint``; for meshes ``channels``, ``moves``; for tables of points ``channels``, ``max_edge``.
    :raises FormatError: when the file cannot be read; the message says why, and what can be read.
    :raises InputError: for an option that does not exist or does not apply to the file; the message lists those that do.
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
    if options.kind is None and options.camera is None:
        must_be_known(path)
    found = format_of(path, options)
    options.must_belong(f"{found.NAME} ({path.name})", found.READS)
    return found.read(path, options)


def format_of(path: Path, options: ReadOptions) -> Format:
    """The format that reads a file."""
    return next(entry for entry in FORMATS if entry.claims(path, options)).load()


def write(
    data: Document | Data | Array | tuple[ArrayLike, ArrayLike],
    path: str | Path,
    *,
    overwrite: bool = False,
    tags: Mapping[str, str] | None = None,
    **options: Unpack[Writing],
) -> tuple[str, ...]:
    """Write a document in the format of the extension; an existing file is replaced only when the new one is complete.

    Example:

        >>> from meshflow import read, smooth
        >>> notes = write(smooth(read("data/terrain.tif"), method="quick"), "smoothed.tif")
        >>> read("smoothed.tif").data.spacing
        (10.0, 10.0)

    :param data: a document, with all that its file held; or a data object, an array (h, w) or (h, w, k), or ``(points, faces)``,
        which have no CRS, no tags and no texture.
    :param path: of the file; its extension selects the format.
    :param overwrite: replace an existing file.
    :param tags: text about the run, kept in the file where the format supports it.
    :param options: for the writer (:class:`WriteOptions`): ``dtype`` (rasters, pictures), ``driver`` and ``creation`` (rasters:
        of GDAL), ``depth_scale`` and ``left`` (depth
        images).
    :returns: notes for the user (rounding, what the format does not hold).
    :raises FormatError: when the format cannot hold the data, or the file exists and ``overwrite`` is false.
    :raises InputError: for an option that does not apply to the format.
    """
    document = _documented(data, Path(path))
    path = Path(path)
    found = writable(document, path, overwrite=overwrite, **options)
    names = path.stat().st_nlink if path.exists() else 1
    notes = found.write(document, path, WriteOptions(dict(tags or {}), **options))
    if names > 1:
        notes += (
            f"{path.name} was one of {names} names (hard links) of a file: the others still name what was there before",
        )
    return notes


def _documented(data: object, path: Path) -> Document:
    """A document of what shall be written.

    :raises InputError: for an object of another library, which has its own writer and more than its samples.
    """
    if isinstance(data, Document):
        return data
    if isinstance(data, (HeightField, Image, RangeImage, Mesh, Volume, TetMesh)):
        return Document(data, path)
    if type(data) in (np.ndarray, tuple):
        from meshflow.io.formats.arrays import from_object

        return Document(from_object(data, ReadOptions()).data, path)
    raise InputError(
        f"write: a Document, a data object, an array or (points, faces) expected, got {type(data).__name__}; meshflow.read gives "
        "a Document, document.holding(data) puts a smoothed data object into it; objects of other libraries have their own "
        "writers, as mesh.export of trimesh"
    )


def writable(document: Document, path: str | Path, *, overwrite: bool = False, **options: Unpack[Writing]) -> Format:
    """The format that would write a document to a path; call it before the work whose result is written there.

    :param options: as those of :func:`write`.
    :raises FormatError: as :func:`write`.
    :raises InputError: likewise.
    """
    path = Path(path)
    must_be_free(path, overwrite)
    if not path.parent.is_dir():
        raise FormatError(f"{path.parent} is not a folder; create it first")
    named = options.get("driver") is not None
    suffix = ".tif" if named else suffix_of(path)
    for entry in (FORMATS[-1],) if named or options.get("creation") else FORMATS:  # GDAL writes: it is a raster
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
    if named or options.get("creation"):
        raise InputError(f"driver, creation: of rasters (a terrain or an image), got a {document.kind}; leave them out")
    raise FormatError(
        f"{path.name}: a {document.kind} does not fit into {suffix or 'a file without extension'}; "
        f"use {' '.join(ROOM[document.kind])}"
    )


def _must_be_a_file(path: Path) -> None:
    if not path.exists():
        raise absent(path)
    if path.is_dir():
        from meshflow.io.formats.dicom import holds_series

        if holds_series(path):
            return
        raise FormatError(f"{path} is a folder; a file is expected, or a folder with a series of DICOM")
    if path.stat().st_size == 0:
        raise FormatError(f"{path} is empty (0 bytes)")
