"""numpy arrays, in memory and in .npy and .npz files."""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import FormatError, InputError, said_by
from meshflow.geometry.validation import Array, must_be_real, nowhere, real, shown, spacing_of, triangles_of
from meshflow.io.atomic_write import beside
from meshflow.io.depth_units import LARGEST, doubtful_depths, in_metres
from meshflow.io.document import Document, Imported, Source, WriteOptions, samples_of
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.formats.fields import field_from
from meshflow.io.formats.volume_arrays import volume_from
from meshflow.io.metadata import Found, Kind, ReadOptions, as_given
from meshflow.io.vertex_merging import Skin, is_soup
from meshflow.surfaces.data import likeness_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.volume import Volume

__all__ = ["can_write", "from_object", "key_of", "loaded", "must_be_meant", "read", "write"]

NAME: str = "an array file"
READS: tuple[str, ...] = (
    "kind",
    "spacing",
    "nodata",
    "camera",
    "jump",
    "measure",
    "time_unit",
    "depth_scale",
    "channels",
    "moves",
    "unit",
)
WRITES: tuple[str, ...] = ()
# What numpy raises for invalid files; it allocates as much as a header claims.
_BROKEN = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    TypeError,
    BadZipFile,
    TokenError,
    struct.error,
    zlib.error,
)
_KEYS = ("z", "values", "depth", "data")
# The options of each kind of array, and its name.
_TAKES: Mapping[Kind, tuple[str, tuple[str, ...]]] = {
    "terrain": ("an array of heights", ("spacing", "missing", "nodata", "unit")),
    "image": ("an array of channels", ("spacing", "missing", "nodata")),
    "depth": (
        "an array of depths",
        ("camera", "missing", "nodata", "depth_scale", "jump", "measure", "time_unit", "unit"),
    ),
}


@dataclass(frozen=True, eq=False)
class Stored(Source):
    """What a file of arrays contains besides the data.

    :param dtype: of the array as it was stored.
    :param key: its name in an .npz.
    :param others: all other arrays of the .npz, by name.
    """

    dtype: str
    key: str = "values"
    others: Mapping[str, Array] = field(default_factory=dict)

    @property
    def stored_as(self) -> str:
        """The type of the array."""
        return self.dtype


def read(path: Path, options: ReadOptions) -> Document:
    """Read an array: (h, w) is a terrain, (h, w, k) an image; with a camera, (h, w) are depths.

    Depths in whole numbers are interpreted as in a PNG. An ``.npz`` contains one array, or one named z, values, depth or data, or
    ``points`` and ``faces`` of a mesh.

    :param options: ``nodata``, a value that marks missing samples, as NaN always does; ``depth_scale``, units per metre of
        depths, as in :func:`meshflow.io.formats.depth_images.read`; ``channels`` of a mesh are those of the file.
    :raises FormatError: for a file that numpy cannot read, Python objects, or several arrays of other names.
    :raises InputError: for an array that is no data, or an option that does not apply.
    """
    arrays = loaded(path)
    if {"points", "faces"} <= arrays.keys() and options.kind in (None, "mesh"):
        points, faces = arrays.pop("points"), arrays.pop("faces")
        own = options if options.channels is not None else replace(options, channels=arrays.get("channels"))
        return Document(from_object((points, faces), own).data, path, Stored(str(points.dtype), "points", arrays))
    key = key_of(path, arrays)
    array = arrays.pop(key)
    source, notes = Stored(str(array.dtype), key, arrays), ()
    scale, options = options.depth_scale, options.without("depth_scale")
    if options.camera is not None and options.kind in (None, "depth") and array.ndim == 2 and array.dtype.kind in "fiu":
        calibration = calibration_for(options.camera, (array.shape[0], array.shape[1]), path.name)
        found = in_metres(array, calibration, scale, path.name)
        notes = found.notes
        declared = options.missing_in(array)
        missing = found.missing if declared is None else found.missing | declared
        options = replace(
            options.without("nodata"), missing=missing, camera=calibration.camera, unit=options.unit or "m"
        )
        array = found.depth
    elif scale is not None:
        raise InputError(f"{path.name}: depth_scale {scale} belongs to depths (h, w) with a camera; leave it out")
    imported = from_object(array, options)
    return Document(imported.data, path, source, (*notes, *imported.notes))


def can_write(document: Document, suffix: str) -> bool:
    """Whether the document can be written: meshes only as ``.npz``."""
    return suffix == ".npz" or (suffix == ".npy" and not isinstance(document.data, Mesh))


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write the values of the data, floating point, as ``.npy`` or ``.npz``; a mesh as points and faces (``.npz``).

    Missing samples of a raster or a picture become NaN (0 for a depth image); those of an array are unchanged. The other arrays
    of an ``.npz`` that was read are written again.

    :param options: tags cannot be stored.
    :returns: notes on what the array does not hold.
    :raises FormatError: when the file cannot be written.
    """
    source = document.source if isinstance(document.source, Stored) else Stored("")
    zipped = path.suffix.lower() == ".npz"
    if isinstance(document.data, Mesh):
        if not zipped:
            raise FormatError(f"{path.name}: a mesh is two arrays, points and faces; write .npz")
        channels = {} if document.data.channels is None else {"channels": document.data.channels}
        arrays = {"points": document.data.points, "faces": document.data.faces, **channels}
    else:
        arrays = {source.key: _marked(document)}
    with beside(path) as temporary:
        if zipped:
            np.savez_compressed(temporary, allow_pickle=False, **{**source.others, **arrays})
        else:
            content = BytesIO()  # numpy itself does not say why a disk takes no more
            np.save(content, arrays[source.key], allow_pickle=False)
            temporary.write_bytes(content.getbuffer())
    if document.source.placed:
        return (f"{path.suffix} has no room for CRS, transform, alpha and tags; .tif has",)
    return ()


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import an array, a masked array, or ``(points, faces)``.

    (h, w) is a height field, (h, w, k) an image; with a camera, (h, w) are depths. The result is a new array of floating point in
    native byte order, with the mask of a masked array. Integers become float32 or float64, because rounding would undo the
    smoothing. For a mesh the result is ``(points, faces)``, followed by ``channels`` if they were given.

    :param options: ``kind``; ``spacing``, ``missing``, ``nodata`` of grids, ``unit`` of heights; ``camera``, ``missing``,
        ``nodata``, ``depth_scale``, ``jump``, ``measure``, ``time_unit``, ``unit`` of depths; ``channels``, ``moves`` of meshes.
    :raises InputError: for anything else, or an option that does not apply.
    """
    arrays = [one for one in data if isinstance(one, np.ndarray)] if isinstance(data, list) else []
    if len(arrays) > 1 and not (arrays[1].dtype.kind in "iu" and arrays[1].shape[1:] == (3,)):
        raise InputError(
            f"one array expected, got a list of {len(arrays)}; smooth them one by one, stack them as channels "
            "(numpy.dstack), or fuse frames of one view: meshflow.fuse_frames"
        )
    if isinstance(data, (tuple, list)):
        if len(data) != 2 or [np.ndim(part) for part in data] != [2, 2]:
            raise InputError(
                f"(points, faces) of shapes (n, d) and (m, 3) expected of a {type(data).__name__}, got {len(data)} parts; "
                "make a grid of numbers an array first: numpy.array(...)"
            )
        options.must_be_mesh("(points, faces)")
        return _mesh(data[0], data[1], options)
    if not isinstance(data, np.ndarray):
        raise InputError(
            f"data: an array expected, got {'nothing (None)' if data is None else f'{type(data).__name__} {shown(data):.40}'}"
            f"{'' if data is None else '; make it one: numpy.array(...)'}"
        )
    must_be_real(data, "array")
    if options.kind == "volume":
        return volume_from(data, options)
    if options.kind in ("vectors", "tensors"):
        return field_from(data, options)
    if options.kind is None and options.camera is None:
        must_be_meant(data.shape)
    kind = options.kind or ("depth" if options.camera is not None else "image" if data.ndim == 3 else "terrain")
    if kind not in _TAKES:
        raise InputError(
            f"kind: {', '.join(_TAKES)}, volume, vectors or tensors expected for an array, got {kind!r}; a mesh is (points, "
            "faces)"
        )
    what, takes = _TAKES[kind]
    of_depths = [name for name in options.given if name in ("depth_scale", "measure", "jump", "time_unit")]
    if of_depths and kind != "depth" and options.kind is None:
        raise InputError(f"{', '.join(of_depths)}: of depths, which need their camera; give camera= beside it")
    options.must_belong(what, ("kind", *takes))
    if kind == "depth":
        return _depths(data, options)
    missing = nowhere(options.missing_in(data))
    spacing = (1.0, 1.0) if options.spacing is None else spacing_of(options.spacing, len(np.atleast_1d(data)))
    if kind == "image":
        found: HeightField | Image = Image(data, spacing, missing)
    else:
        found = HeightField(data, spacing, missing, unit=options.unit or "")
    return Imported(found, lambda smoothed: _like(data, _values(smoothed)))


def _depths(data: Array, options: ReadOptions) -> Imported:
    """Import depths; with ``depth_scale`` they are metres for the flow, and again in the units of the array afterwards."""
    if data.ndim != 2:
        raise InputError(f"depths: an array of 2 dimensions expected, got shape {data.shape}")
    calibration = calibration_for(options.camera, (data.shape[0], data.shape[1]), "the array")
    missing, depth, units, notes = options.missing_in(data), data, 1.0, ()
    if options.depth_scale is not None:
        found = in_metres(np.ma.getdata(data), calibration, options.depth_scale, "the array")
        gone = found.missing | np.ma.getmaskarray(data)
        depth, units, notes = found.depth, found.units, found.notes
        missing = gone if missing is None else gone | missing
    elif data.dtype.kind in "ui":
        missing = (data == LARGEST) | (False if missing is None else missing)
    elif not options.unit:
        notes = doubtful_depths(np.ma.masked_invalid(data).compressed(), calibration)
    image = RangeImage(
        depth,
        calibration.camera,
        nowhere(missing),
        jump=options.jump,
        measure=options.measure,
        time_unit=options.time_unit or "footprint",
        unit=options.unit or ("m" if options.depth_scale is not None else ""),
    )

    def to_object(smoothed: RangeImage) -> Array:
        """The depths in the units of the array; those that did not move keep their numbers."""
        if units == 1.0:
            return _like(data, _values(smoothed))
        still = np.asarray(image.missing) | (smoothed.depth == image.depth)
        return _like(data, np.where(still, np.ma.getdata(data), smoothed.depth * smoothed.depth.dtype.type(units)))

    return Imported(image, to_object, notes)


def must_be_meant(shape: tuple[int, ...]) -> None:
    """Refuse an array whose shape is that of something else, unless its kind is said.

    :raises InputError: for points (n, 3), volumes, and channels that come first.
    """
    likeness = likeness_of(shape)
    if likeness == "points":
        raise InputError(
            f"an array of shape {shape} looks like points: a mesh is (points, faces), and a cloud has no surface; for heights on "
            f"a grid of {shape[0]} x 3 give kind='terrain'"
        )
    if likeness == "a volume":
        raise InputError(
            f"an array of shape {shape} looks like a volume; give kind='volume' to smooth it as one, slices first and with "
            f"spacing=(dz, dy, dx); for an image of {shape[2]} channels give kind='image'"
        )
    if likeness:
        raise InputError(
            f"an array of shape {shape} looks like {likeness}; they come last: "
            "numpy.moveaxis(array, 0, -1); or give kind='image'"
        )
    if len(shape) == 4:
        raise InputError(
            f"an array of shape {shape}: which axis is what? A volume of {shape[3]} channels that are smoothed together has them "
            "last: give kind='volume'; of a series smooth each volume: array[..., i]"
        )


def _mesh(points: ArrayLike, faces: ArrayLike, options: ReadOptions) -> Imported:
    given = as_given(options.channels, "channels")
    channels = None if given is None else np.asarray(given)
    first, second = np.asarray(points), np.asarray(faces)
    if first.dtype.kind in "iu" and second.dtype.kind == "f" and (second != np.rint(second)).any():
        raise InputError(
            "(points, faces) expected, got whole numbers first and real numbers second; are they swapped? Give (points, faces)"
        )
    triangles, places = triangles_of(second), real(first, "mesh points")
    split = places.shape[-1] == 3 and triangles.shape[-1] == 3 and is_soup(triangles, len(places))
    skin = Skin.of(places, triangles, split=split, channels=channels, moves=options.moves)

    def to_object(smoothed: Mesh) -> tuple[Array, ...]:
        """Arrays of the smoothed mesh: points, faces, channels."""
        moved = np.array(skin.points_of(smoothed))
        if smoothed.channels is None or channels is None:
            return moved, np.array(faces)
        values = skin.channels_of(smoothed)
        values = skin.channels if values is None else values
        kind = smoothed.channels.dtype
        return moved, np.array(faces), np.array(values, dtype=kind).reshape(channels.shape)

    return Imported(skin.data, to_object, skin.note, partial(skin.samples, find=_no_name))


def _no_name(name: str) -> Found:
    """Arrays have no named attributes."""
    return None, {}


def _values(data: HeightField | Image | RangeImage | Volume) -> Array:
    match data:
        case HeightField():
            return data.z
        case Image() | Volume():
            return data.values
        case RangeImage():
            return data.depth


def _like(data: Array, values: Array) -> Array:
    """A new array with the mask of the original."""
    if not isinstance(data, np.ma.MaskedArray):
        return np.array(values)
    return np.ma.MaskedArray(np.array(values), mask=np.ma.getmask(data), copy=True)


def _marked(document: Document) -> Array:
    data = document.data if isinstance(document.data, Volume) else samples_of(document)
    values = np.array(_values(data))
    if not isinstance(document.source, Stored):
        zero = isinstance(data, RangeImage) and not data.camera.signed
        values[np.asarray(data.missing)] = 0.0 if zero else np.nan
    return values


def loaded(path: Path) -> dict[str, Array]:
    """The arrays of a file by name.

    :raises FormatError: for a file that numpy cannot read.
    """
    try:
        found = np.load(path, allow_pickle=False)
        return dict(found) if isinstance(found, np.lib.npyio.NpzFile) else {"values": found}
    except _BROKEN as cause:
        raise FormatError(
            f"{path.name} cannot be read ({said_by(cause)}); an array of numbers, as numpy.save and numpy.savez write it, "
            "is expected"
        ) from cause


def key_of(path: Path, arrays: Mapping[str, Array]) -> str:
    """The name of the array that is the data.

    :raises FormatError: where it is not clear which one.
    """
    for key in (*_KEYS, *(arrays if len(arrays) == 1 else ())):
        if key in arrays:
            return key
    names = ", ".join(arrays) or "(none)"
    raise FormatError(
        f"{path.name} holds the arrays {names}; one named {', '.join(_KEYS)} is expected, or points and faces"
    )
