"""Arrays of numpy, in memory and in .npy and .npz files."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.depth_units import LARGEST, in_metres
from meshflow.io.files import Document, Kind
from meshflow.io.formats.cameras import calibration_for, camera_for
from meshflow.io.formats.raster_bands import Frame
from meshflow.io.metadata import belong, must_be_mesh
from meshflow.io.objects import Adopted
from meshflow.surfaces.camera import Camera, Measure
from meshflow.surfaces.lift import HeightField, Image, Mesh, Noun, Pace, RangeImage

__all__ = ["adopt", "read", "write"]

_KEYS = ("z", "values", "depth", "data")


@dataclass(frozen=True, eq=False)
class Stored:
    """What a file of arrays held besides the noun.

    :param dtype: of the array as it was stored.
    :param key: its name in an .npz.
    :param others: all other arrays of the .npz, by name.
    """

    dtype: str
    key: str = "values"
    others: Mapping[str, Array] = field(default_factory=dict)


def read(
    path: Path,
    *,
    kind: Kind | None = None,
    spacing: Any = None,
    nodata: float | None = None,
    camera: Camera | str | Path | None = None,
    jump: float | None = None,
    measure: Measure | None = None,
    pace: Pace | None = None,
    depth_scale: float | None = None,
) -> Document:
    """Read an array: (h, w) is a terrain, (h, w, k) an image, with a camera (h, w) are depths, whole numbers as in a PNG.

    An ``.npz`` holds one array, or one of the name z, values, depth or data; or ``points`` and ``faces``: a mesh.

    :param nodata: a value that marks missing samples, as NaN always does.
    :param depth_scale: units per metre of depths, as of :func:`meshflow.io.formats.depth_images.read`.
    :raises FormatError: for a file that numpy cannot read, Python objects, or several arrays of other names.
    :raises InputError: for an array that is no noun, or an option that does not belong to it.
    """
    arrays, notes, unit = _load(path), (), ""
    hints = {"spacing": spacing, "camera": camera, "jump": jump, "measure": measure, "pace": pace}
    if {"points", "faces"} <= arrays.keys() and kind in (None, "mesh"):
        thing: Any = (arrays.pop("points"), arrays.pop("faces"))
        hints["channels"] = arrays.get("channels")
        about = Stored(str(thing[0].dtype), "points", arrays)
    else:
        key = _key(path, arrays)
        thing = arrays.pop(key)
        about = Stored(str(thing.dtype), key, arrays)
        if nodata is not None:
            marked = thing == nodata
            hints["missing"] = marked if marked.ndim == 2 else marked.any(axis=-1)
        if camera is not None and kind in (None, "depth") and thing.ndim == 2 and thing.dtype.kind in "fiu":
            calibration = calibration_for(camera, thing.shape, path.name)
            found = in_metres(thing, calibration, depth_scale, path.name)
            thing, notes, unit = found.depth, found.notes, "m"
            hints["missing"], hints["camera"] = found.missing | hints.get("missing", False), calibration.camera
        elif depth_scale is not None:
            raise InputError(
                f"{path.name}: depth_scale {depth_scale} belongs to depths (h, w) with a camera; leave it out"
            )
    noun = adopt(thing, kind=kind, **{name: hint for name, hint in hints.items() if hint is not None}).noun
    noun = replace(noun, unit=unit) if isinstance(noun, RangeImage) else noun
    kinds: dict[type, Kind] = {HeightField: "terrain", Image: "image", RangeImage: "depth", Mesh: "mesh"}
    return Document(noun, kinds[type(noun)], path, about, "arrays", notes)


def write(document: Document, path: Path, *, tags: Mapping[str, str]) -> tuple[str, ...]:
    """Write the values of a noun, floating point, as ``.npy`` or ``.npz``; a mesh as points and faces (``.npz``).

    What was missing in a raster or a picture is NaN (0 in a depth image); in an array it stays as it was. The other arrays of
    an ``.npz`` that was read are written again.

    :param tags: there is no room for them.
    :returns: notes: what the array could not hold.
    :raises FormatError: when the file cannot be written.
    """
    about = document.about if isinstance(document.about, Stored) else Stored("")
    zipped = path.suffix.lower() == ".npz"
    if isinstance(document.noun, Mesh):
        if not zipped:
            raise FormatError(f"{path.name}: a mesh is two arrays, points and faces; write .npz")
        channels = {} if document.noun.channels is None else {"channels": document.noun.channels}
        arrays = {"points": document.noun.points, "faces": document.noun.faces, **channels}
    else:
        arrays = {about.key: _marked(document)}
    with beside(path) as temporary:
        if zipped:
            np.savez_compressed(temporary, allow_pickle=False, **{**about.others, **arrays})
        else:
            np.save(temporary, arrays[about.key], allow_pickle=False)
    frame = getattr(document.about, "frame", document.about)
    if isinstance(frame, Frame) and (frame.crs is not None or frame.georeferenced or frame.alpha is not None):
        return (f"{path.suffix} has no room for CRS, transform, alpha and tags; .tif has",)
    return ()


def adopt(thing: Any, **hints: Any) -> Adopted:
    """Take in an array, a masked array, or ``(points, faces)``.

    (h, w) is a height field, (h, w, k) an image; with a camera (h, w) are depths. What is restored is a new array in native byte
    order, masked with the same mask if a masked one came in, of floating point: integers come out as float32 or float64, since
    rounding would undo the smoothing. Of a mesh, ``(points, faces)`` is restored, with ``channels`` behind if they came in.

    :param hints: ``kind``; ``spacing``, ``missing``, ``fixed`` of grids; ``camera``, ``missing``, ``fixed``, ``jump``,
        ``measure``, ``pace`` of depths; ``channels``, ``moves``, ``fixed`` of meshes.
    :raises InputError: for anything else, or a hint that does not belong.
    """
    if isinstance(thing, (str, PathLike)):
        raise InputError(f"{thing}: an array expected, got the name of a file; read it with meshflow.read")
    kind = hints.pop("kind", None)
    hints = {name: hint for name, hint in hints.items() if hint is not None}
    if isinstance(thing, (tuple, list)):
        if len(thing) != 2 or [np.ndim(part) for part in thing] != [2, 2]:
            raise InputError(
                f"(points, faces) of shapes (n, d) and (m, 3) expected of a {type(thing).__name__}, got {len(thing)} parts; "
                "make a grid of numbers an array first: numpy.array(...)"
            )
        must_be_mesh(kind, "(points, faces)")
        return _mesh(*thing, **hints)
    if not isinstance(thing, np.ndarray):
        raise InputError(
            f"an array expected, got {type(thing).__name__} {str(thing)[:40]!r}; make it one: numpy.array(...)"
        )
    kind = kind or ("depth" if "camera" in hints else "image" if thing.ndim == 3 else "terrain")
    if kind not in _MAKERS:
        raise InputError(f"kind: {', '.join(_MAKERS)} expected for an array, got {kind!r}; a mesh is (points, faces)")
    return Adopted(_MAKERS[kind](thing, **hints), lambda smoothed: _like(thing, _values(smoothed)))


def _terrain(
    z: Array, *, spacing: Any = (1.0, 1.0), missing: Any = None, fixed: Any = None, **other: object
) -> HeightField:
    belong(other, "an array of heights", ("spacing", "missing", "fixed"))
    return HeightField(z, spacing, missing, fixed)


def _image(
    values: Array, *, spacing: Any = (1.0, 1.0), missing: Any = None, fixed: Any = None, **other: object
) -> Image:
    belong(other, "an array of channels", ("spacing", "missing", "fixed"))
    return Image(values, spacing, missing, fixed)


def _depths(
    depth: Array,
    *,
    camera: Any = None,
    missing: Any = None,
    fixed: Any = None,
    jump: Any = "noise",
    measure: Any = None,
    pace: Any = "footprint",
    **other: object,
) -> RangeImage:
    belong(other, "an array of depths", ("camera", "missing", "fixed", "jump", "measure", "pace"))
    seen_by = camera_for(camera, depth.shape[:2], "the array")
    if depth.dtype.kind in "ui" and np.shape(missing) in ((), depth.shape):
        missing = (depth == LARGEST) | (False if missing is None else np.asarray(missing, bool))
    return RangeImage(depth, seen_by, missing, fixed, jump, measure, pace)


_MAKERS: dict[str, Callable[..., Noun]] = {"terrain": _terrain, "image": _image, "depth": _depths}


def _mesh(
    points: Any, faces: Any, *, channels: Any = None, moves: Any = None, fixed: Any = None, **other: object
) -> Adopted:
    belong(other, "(points, faces)", ("channels", "moves", "fixed"))
    noun = Mesh(np.asarray(points), np.array(faces), channels, moves, fixed)

    def restore(smoothed: Mesh) -> tuple[Array, ...]:
        if smoothed.channels is None:
            return np.array(smoothed.points), np.array(faces)
        return np.array(smoothed.points), np.array(faces), np.array(smoothed.channels).reshape(np.shape(channels))

    return Adopted(noun, restore)


def _values(noun: Noun) -> Array:
    match noun:
        case HeightField():
            return noun.z
        case Image():
            return noun.values
        case RangeImage():
            return noun.depth
    raise InputError(f"samples on a grid expected, got a {type(noun).__name__}")


def _like(thing: Array, values: Array) -> Array:
    """A new array, masked as the one that came in."""
    if not isinstance(thing, np.ma.MaskedArray):
        return np.array(values)
    return np.ma.MaskedArray(np.array(values), mask=np.ma.getmask(thing), copy=True)


def _marked(document: Document) -> Array:
    values = np.array(_values(document.noun))
    if not isinstance(document.about, Stored):
        assert not isinstance(document.noun, Mesh)
        zero = isinstance(document.noun, RangeImage) and not document.noun.camera.signed
        values[document.noun.missing] = 0.0 if zero else np.nan
    return values


def _load(path: Path) -> dict[str, Array]:
    try:
        found = np.load(path, allow_pickle=False)
        return dict(found) if isinstance(found, np.lib.npyio.NpzFile) else {"values": found}
    except (OSError, ValueError, EOFError, BadZipFile, KeyError) as cause:
        raise FormatError(
            f"{path.name} cannot be read ({cause}); an array of numbers, as numpy.save and numpy.savez write it, is expected"
        ) from cause


def _key(path: Path, arrays: Mapping[str, Array]) -> str:
    for key in (*_KEYS, *(arrays if len(arrays) == 1 else ())):
        if key in arrays:
            return key
    names = ", ".join(arrays) or "(none)"
    raise FormatError(
        f"{path.name} holds the arrays {names}; one named {', '.join(_KEYS)} is expected, or points and faces"
    )
