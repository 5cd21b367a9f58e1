"""Metadata that data does not contain itself: options of readers, which of them apply, and names of arrays."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from os import PathLike
from typing import Literal, Protocol, TypedDict, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields, refused
from meshflow.geometry.validation import Array, mask_of, truth_of
from meshflow.surfaces.camera import Camera, Measure
from meshflow.surfaces.mesh import Moves
from meshflow.surfaces.range_image import TimeUnit

__all__ = [
    "MASKS",
    "PER_SAMPLE",
    "CameraLike",
    "Found",
    "Intrinsics",
    "Jump",
    "Kind",
    "Metadata",
    "ReadOptions",
    "SpacingLike",
    "as_given",
    "looked_up",
]

SlicesWord = Literal["each", "alike"]
Kind = Literal["terrain", "image", "depth", "mesh", "volume", "tetrahedra", "vectors", "tensors"]
Jump = float | Literal["noise"] | None
SpacingLike = float | Sequence[float | Array]
# Options of one number per sample; each may be the name of an array in the data itself.
PER_SAMPLE = ("fixed", "mask", "mobility", "data_weights", "max_change")
MASKS = ("fixed", "mask")
# The array of a name, and the existing names.
Found = tuple[Array | None, Iterable[str]]


@runtime_checkable
class Intrinsics(Protocol):
    """A camera of open3d (``open3d.camera.PinholeCameraIntrinsic``)."""

    @property
    def intrinsic_matrix(self) -> ArrayLike:
        """(3, 3), in pixels."""
        ...

    @property
    def width(self) -> int:
        """Pixels."""
        ...

    @property
    def height(self) -> int:
        """Pixels."""
        ...


CameraLike = Camera | str | PathLike[str] | Mapping[str, object] | Array | Intrinsics


class Metadata(TypedDict, total=False):
    """The fields of :class:`ReadOptions` as keywords."""

    kind: Kind | None
    spacing: SpacingLike | None
    missing: ArrayLike | None
    unit: str | None
    channels: ArrayLike | None
    moves: Moves | None
    max_edge: float | None
    camera: CameraLike | None
    depth_scale: float | None
    measure: Measure | None
    time_unit: TimeUnit | None
    jump: Jump
    viewpoint: Sequence[float] | None
    band: int | None
    nodata: float | None
    slices: SlicesWord | None
    window: Sequence[int] | None
    bounds: Sequence[float] | None
    crs: str | None
    allow_remote: bool


@named_fields
@dataclass(frozen=True, eq=False)
class ReadOptions:
    """Metadata that the caller gives for a file or an object; None: not given.

    :param kind: ``terrain | image | depth | mesh | volume | vectors | tensors``, where the guess would be wrong.
    :param spacing: for samples on a grid: one number or (dx, dy) in the horizontal unit; dx may be one number per row. For a
        volume: one number or (dz, dy, dx), in the order of the axes.
    :param missing: (h, w), samples that are missing; or one number, as ``nodata``.
    :param unit: the name of the unit of heights or depths, for reports and pictures.
    :param channels: for a mesh: (n, k), or the name of an attribute of its vertices, or ``"colors"``.
    :param moves: for a mesh with channels: ``points | channels | all``.
    :param max_edge: for scattered points: the longest edge of a triangle between them, in the unit of their places.
    :param camera: for depths: the camera itself, the name of a convention, or the path of a file
        (:func:`meshflow.read_camera`).
    :param depth_scale: units per metre of stored depths.
    :param measure: for depths: ``depth`` along the optical axis or ``range`` along the ray.
    :param time_unit: for depths: ``footprint | length | noise``, as in :class:`meshflow.RangeImage`.
    :param jump: for depths: where neighbours are not connected, as in :class:`meshflow.RangeImage`; None: nowhere.
    :param viewpoint: (x, y, z), the position of the scanner of a PLY range grid.
    :param band: for a raster: the one to read, from 1.
    :param nodata: for samples on a grid: the value that marks missing ones.
    :param slices: of a DataArray with a further dimension, such as time: ``each`` slice is smoothed by its own choice, or all
        ``alike`` by one.
    :param window: for a raster: the part to read, (column, row, width, height) in samples.
    :param bounds: likewise, (left, bottom, right, top) in its CRS: the samples whose centres lie inside.
    :param crs: for a raster: its CRS in place of that of the file, such as ``EPSG:25832``.
    :param allow_remote: a file may refer to files outside its folder and in a network; otherwise it is refused.
    """

    kind: Kind | None = None
    spacing: SpacingLike | None = None
    missing: ArrayLike | None = None
    unit: str | None = None
    channels: ArrayLike | None = None
    moves: Moves | None = None
    max_edge: float | None = None
    camera: CameraLike | None = None
    depth_scale: float | None = None
    measure: Measure | None = None
    time_unit: TimeUnit | None = None
    jump: Jump = "noise"
    viewpoint: Sequence[float] | None = None
    band: int | None = None
    nodata: float | None = None
    slices: SlicesWord | None = None
    window: Sequence[int] | None = None
    bounds: Sequence[float] | None = None
    crs: str | None = None
    allow_remote: bool = False

    def __post_init__(self) -> None:
        if self.unit is not None and not isinstance(self.unit, str):
            raise InputError(f"unit: the name of a unit, as 'm', expected, got {self.unit!r}")
        if self.nodata is not None and not _is_number(self.nodata):
            raise InputError(f"nodata: the number that marks missing samples expected, got {self.nodata!r}")

    @classmethod
    def of(cls, metadata: Mapping[str, object]) -> "ReadOptions":
        """Make options of keywords.

        :raises InputError: for a name that is no option; the message suggests the nearest one.
        """
        names = [field.name for field in fields(cls)]
        for name in metadata:
            if name in PER_SAMPLE:
                constraint = "".join(part.capitalize() for part in name.split("_"))
                raise InputError(
                    f"{name}: a constraint, no option of a reader; give constraints={constraint}(...) to smooth"
                )
            if name not in names:
                raise refused(name, names, "option")
        return replace(cls(), **dict(metadata))

    @property
    def given(self) -> tuple[str, ...]:
        """The names of the options that differ from their defaults."""
        return tuple(field.name for field in fields(self) if getattr(self, field.name) is not field.default)

    def missing_in(self, values: Array) -> Array | None:
        """The samples (h, w), of a volume (d, h, w), that ``missing`` or ``nodata`` declare missing; None where neither is given.

        :param values: (h, w) or (h, w, k), as they are stored. A sample is missing where any of its channels is ``nodata``.
        :raises InputError: for a mask of another shape.
        """
        given, shape = self.missing, values.shape[: 3 if self.kind == "volume" else 2]
        marks = [mark for mark in (self.nodata, given if _is_number(given) else None) if mark is not None]
        if given is None and not marks:
            return None
        found = np.zeros(shape, bool) if given is None or _is_number(given) else mask_of(given, shape, "missing")
        for mark in marks:
            marked = np.ma.getdata(values) == mark
            found = found | marked.any(axis=tuple(range(len(shape), marked.ndim)))
        return found

    @property
    def attribute(self) -> str | None:
        """``channels`` where it is a name."""
        return self.channels if isinstance(self.channels, str) else None

    def without(self, *names: str) -> "ReadOptions":
        """The options without those named."""
        defaults = {field.name: field.default for field in fields(self)}
        return replace(self, **{name: defaults[name] for name in names})

    def must_belong(self, what: str, takes: Collection[str]) -> None:
        """Refuse the options that do not apply.

        :param what: the data, with its article.
        :param takes: the names of the options that apply.
        :raises InputError: the message lists the options that do not apply, and those that do.
        """
        others = sorted(set(self.given) - set(takes))
        if others:
            raise InputError(f"{', '.join(others)}: no option of {what}, which takes {', '.join(takes) or 'none'}")

    def must_be_mesh(self, what: str, takes: Collection[str] = ("channels", "moves")) -> None:
        """Refuse options that do not apply to a mesh, and another kind.

        :raises InputError: as :meth:`must_belong`, and for a ``kind`` that is not ``mesh``.
        """
        self.must_belong(what, ("kind", *takes))
        if self.kind not in (None, "mesh"):
            raise InputError(f"kind={self.kind!r}: {what} is a mesh and nothing else; leave the kind out")


def _is_number(given: ArrayLike | None) -> bool:
    """Whether ``missing`` is one number, a value that marks missing samples, and no mask."""
    return given is not None and np.ndim(given) == 0 and np.asarray(given).dtype.kind in "iuf"


def as_given(given: ArrayLike | None, word: str) -> ArrayLike | None:
    """An option of one number per sample, for data without named arrays: the array itself.

    :raises InputError: for a name.
    """
    if isinstance(given, str):
        others = "" if word in MASKS else "a number, 'step' or " if word == "max_change" else "a number or "
        raise InputError(
            f"{word}: {others}an array expected, got {given!r}; names are "
            "those of arrays in the object or the file itself (a mesh of trimesh, pyvista, open3d or meshio, an ImageData); "
            "of a file, give its samples: meshflow.read(path), or numpy.load"
        )
    return given


def looked_up(name: str, word: str, found: Found) -> Array:
    """The numbers (n,) of a named array; for masks, whether they are not zero.

    :param found: the array (n,) of that name, or None, and the existing names.
    :raises InputError: for a name that does not exist, or an array that is not one number per sample.
    """
    array, there = found
    if array is None:
        raise InputError(f"{word}={name!r}: no such array; there are {', '.join(map(str, there)) or 'none'}")
    values = np.asarray(array)
    values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise InputError(f"{word}={name!r}: one number per vertex expected, got shape {values.shape} of {values.dtype}")
    return truth_of(values) if word in MASKS else values
