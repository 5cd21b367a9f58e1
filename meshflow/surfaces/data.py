"""The data objects: a height field, an image, a range image, a mesh, a volume, or a mesh of tetrahedra."""

from typing import TypeVar

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, shown
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

KINDS = (HeightField, Image, RangeImage, Mesh, Volume, TetMesh)

__all__ = ["KINDS", "Data", "SolidData", "SurfaceData", "array_of", "data_from", "likeness_of", "must_be", "on_surface"]

Kind = TypeVar("Kind")

# More rows of three numbers than these are points.
LONE = 8
# Data on a triangulated surface.
SurfaceData = HeightField | Image | RangeImage | Mesh
# Data in a body.
SolidData = Volume | TetMesh
Data = SurfaceData | SolidData


def array_of(data: Data) -> Array:
    """The array of a data object that is smoothed.

    It is z (h, w), values (h, w) or (h, w, k), those of a volume (d, h, w) or (d, h, w, k), of tetrahedra
    (n,) or (n, k), depth (h, w), points (n, d) or channels (n, k); where points and channels of a mesh both move, the channels.
    """
    if isinstance(data, Mesh):
        return data.points if data.channels is None or data.moves == "points" else data.channels
    return data.z if isinstance(data, HeightField) else data.depth if isinstance(data, RangeImage) else data.values


def must_be(data: object, kinds: tuple[type[Kind], ...], what: str) -> Kind:
    """The data itself, where it is of one of these kinds.

    :param what: what takes it, for the message.
    :raises InputError: for anything else, with what came.
    """
    if isinstance(data, kinds):
        return data
    names = [kind.__name__ for kind in kinds]
    listed = " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    raise InputError(f"{what}: {listed} expected, got {shown(data)}")


def data_from(data: object, kinds: tuple[type[Kind], ...], what: str) -> Kind | HeightField | Image:
    """:func:`must_be`, where arrays (h, w) are height fields, and arrays (h, w, k) images, with a spacing of 1.

    :raises InputError: for anything else, with what came, and for arrays that have the shape of something else.
    """
    if isinstance(data, np.ndarray) and data.ndim in (2, 3):
        if likeness := likeness_of(data.shape):
            raise InputError(
                f"{what}: an array of shape {data.shape} looks like {likeness}; make it the data that it is, such as "
                "HeightField, Image, Volume or Mesh"
            )
        return HeightField(data) if data.ndim == 2 else Image(data)
    return must_be(data, kinds, what)


def likeness_of(shape: tuple[int, ...]) -> str:
    """What an array (h, w) or (h, w, k) seems to be that is neither heights nor an image; empty where it may be these.

    :returns: ``points``, ``a volume``, or how many channels come first.
    """
    if len(shape) == 2 and shape[1] == 3 and shape[0] > LONE:
        return "points"
    if len(shape) == 3 and shape[2] > 4 and 2 * shape[2] >= min(shape[:2]):
        return f"{shape[0]} channels that come first" if shape[0] <= 4 else "a volume"
    return ""


def on_surface(data: Data, what: str) -> SurfaceData:
    """Data that is no volume and no mesh of tetrahedra.

    :param what: what needs it, for the message.
    :raises InputError: for these, with the way out.
    """
    if isinstance(data, TetMesh):
        raise InputError(
            f"{what}: not for meshes of tetrahedra; take their skin as a mesh: Mesh(points, data.skin, values)"
        )
    if isinstance(data, Volume):
        raise InputError(f"{what}: not for volumes; take a slice as an image, or an isosurface as a mesh")
    return data
