"""Documents and imported objects: their data, what must be kept around it, and the conversion back."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.io.metadata import Kind, ReadOptions, as_given
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "Imported",
    "Document",
    "Format",
    "MeshSource",
    "Section",
    "Source",
    "WriteOptions",
    "Writing",
    "depths_of",
    "kind_of",
    "samples_of",
]

# One of several meshes of a file: its name, and its vertices in the data (rows).
Section = tuple[str, Array]
_KINDS: Mapping[type, Kind] = {
    HeightField: "terrain",
    Image: "image",
    RangeImage: "depth",
    Mesh: "mesh",
    Volume: "volume",
    TetMesh: "tetrahedra",
}


class Source:
    """What a reader keeps of a file in addition to its data; each format has its own class for its writer.

    This base class is for files that contain only samples.
    """

    @property
    def sections(self) -> tuple[Section, ...]:
        """The meshes of a file with several; empty for a file with one."""
        return ()

    def places(self, part: tuple[slice, slice]) -> tuple[Array, Array] | None:
        """x and y of the samples of some rows and columns on a map; None where the file lies on none."""
        return None

    @property
    def bands(self) -> tuple[str, ...]:
        """The names of bands of an image that are smoothed one by one; empty where they are smoothed together."""
        return ()

    @property
    def ground_unit(self) -> str:
        """The unit of the lengths between samples; empty where the file does not define it."""
        return ""

    @property
    def north_up(self) -> bool:
        """Whether the file lies on a map, its rows from north to south and its columns from west to east."""
        return False

    @property
    def stored_as(self) -> str:
        """The type in which samples were stored, as numpy names it."""
        return "float32"

    @property
    def placed(self) -> bool:
        """Whether the file contains more than samples: a CRS, a transform, an alpha band."""
        return False

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per sample of the data, given as an array or by the name of an array in the file.

        :raises InputError: for a name, where the file has no named arrays, or none of that name.
        """
        return as_given(given, word)

    def scene(self, data: Mesh) -> "trimesh.Scene | None":
        """The file as a scene with another mesh of equal size; None for files that are no meshes."""
        return None


class MeshSource(Source, ABC):
    """What a reader keeps of a mesh file."""

    @abstractmethod
    def writes(self, suffix: str) -> bool:
        """Whether an extension, in lower case, belongs to the format of the file."""

    @abstractmethod
    def scene(self, data: Mesh) -> "trimesh.Scene":
        """The file as a scene with another mesh of equal size, for any other format."""

    @abstractmethod
    def save(self, data: Mesh, path: Path, target: Path, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write the file with another mesh to ``path``, which is then moved to ``target``.

        :returns: notes on what the format does not hold, and on files written beside it.
        """


@named_fields
@dataclass(frozen=True)
class Document:
    """The contents of a file.

    :param data: the data, as a height field, image, range image or mesh.
    :param path: of the file.
    :param source: everything that must be kept around the data.
    :param notes: what the reader did, sentences for the user.
    """

    data: Data
    path: Path
    source: Source = field(default_factory=Source)
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """``terrain | image | depth | mesh | volume``."""
        return kind_of(self.data)

    @property
    def sections(self) -> tuple[Section, ...]:
        """The meshes of a file with several: name and vertices in the data (rows) of each; empty for a file with one."""
        return self.source.sections

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """One number per sample of the data; for a mesh also by the name of a vertex attribute of the file.

        :param given: an array, or a name.
        :param word: ``fixed | mask | mobility | data_weights | max_change``: what it is for.
        :raises InputError: for a name that does not exist; the message lists those that do.
        """
        return self.source.samples(given, word)

    def holding(self, data: Data) -> "Document":
        """The same document with other data of the same kind and size."""
        return replace(self, data=data)


@dataclass(frozen=True)
class Imported:
    """An imported object of another library.

    :param data: its data, shared or copied, never changed.
    :param to_object: converts data of the same kind and size to a new object of the original kind.
    :param notes: what the import did, sentences for the user.
    :param samples: converts an option of one number per sample, an array in the order of the object or the name of an array in
        it, to an array in the order of the data.
    """

    data: Data
    to_object: Callable[[Any], Any]
    notes: tuple[str, ...] = ()
    samples: Callable[[ArrayLike | None, str], ArrayLike | None] = as_given


@dataclass(frozen=True)
class Multipart:
    """Data of several parts that do not influence each other.

    :param parts: name and part; no name twice.
    :param to_object: converts their data, in the same order, to a new object of the original kind.
    :param whole: whether one number per sample may be given as one array for all parts; otherwise only by name.
    """

    parts: tuple[tuple[str, Imported], ...]
    to_object: Callable[[Sequence[Data]], Any]
    whole: bool = False


class Writing(TypedDict, total=False):
    """The fields of :class:`WriteOptions` as keywords, except for the tags."""

    dtype: str | None
    driver: str | None
    creation: Mapping[str, str]
    depth_scale: float | None
    left: float | None


@dataclass(frozen=True)
class WriteOptions:
    """How to write a file; None: as it was read.

    :param tags: text about the run, kept in the file where the format supports it.
    :param dtype: number type of the samples of a raster or a picture; ``source``: that of the file.
    :param driver: of GDAL, for a raster, such as ``COG``; None: that of the extension.
    :param creation: its creation options, such as ``{"COMPRESS": "ZSTD"}``.
    :param depth_scale: units per metre of stored depths.
    :param left: standard deviation of the noise left in the depths, metres, with which rounding is compared.
    """

    tags: Mapping[str, str] = field(default_factory=dict)
    dtype: str | None = None
    driver: str | None = None
    creation: Mapping[str, str] = field(default_factory=dict)
    depth_scale: float | None = None
    left: float | None = None


class Format(Protocol):
    """A family of files, read and written by one module of :mod:`meshflow.io.formats`: the module itself is the format.

    :ivar NAME: what a file of it is, with its article, for the messages.
    :ivar READS: the options that its reader takes.
    :ivar WRITES: the options that its writer takes.
    """

    NAME: str
    READS: tuple[str, ...]
    WRITES: tuple[str, ...]

    def read(self, path: Path, options: ReadOptions) -> Document:
        """Read a file.

        :raises FormatError: when it cannot be read; the message says why and what would be read.
        """
        ...

    def can_write(self, document: Document, suffix: str) -> bool:
        """Whether files of this extension, in lower case, hold such data."""
        ...

    def write(self, document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
        """Write the data and what the source keeps of the file that they came from.

        :returns: what the user should know: rounding, what the format could not hold.
        :raises FormatError: when the file cannot be written, or cannot hold the data.
        """
        ...


def kind_of(data: Data) -> Kind:
    """What kind of data this is: ``terrain | image | depth | mesh``."""
    return next(kind for cls, kind in _KINDS.items() if isinstance(data, cls))


def depths_of(document: Document) -> RangeImage:
    """The range image of a document.

    :raises InputError: where it contains other data.
    """
    if not isinstance(document.data, RangeImage):
        raise InputError(f"{document.path.name}: a range image expected, got a {type(document.data).__name__}")
    return document.data


def samples_of(document: Document) -> HeightField | Image | RangeImage:
    """The data of a document of samples on a grid.

    :raises InputError: for a mesh, a volume and tetrahedra.
    """
    if isinstance(document.data, Mesh):
        raise InputError(
            f"{document.path.name}: samples on a grid expected, got a Mesh; write it as .ply, .obj or .vtp"
        )
    if isinstance(document.data, Volume):
        raise InputError(
            f"{document.path.name}: samples on a grid expected, got a Volume; write it as .npy, .nii.gz or .nrrd"
        )
    if isinstance(document.data, TetMesh):
        raise InputError(f"{document.path.name}: samples on a grid expected, got a TetMesh; write it as .vtu")
    return document.data


def distinct_names(parts: Iterable[tuple[str, Imported]]) -> tuple[tuple[str, Imported], ...]:
    """Parts with a number after each name that occurred before."""
    made: dict[str, Imported] = {}
    for name, part in parts:
        count, own = 1, name
        while own in made:
            count += 1
            own = f"{name} ({count})"
        made[own] = part
    return tuple(made.items())
