"""Exports range images as points, normals and meshes of trimesh, open3d and pyvista, with the colours of a picture."""

from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError, need
from meshflow.geometry.normals import normals_at
from meshflow.geometry.validation import Array, shown
from meshflow.io.grid_mesh import mesh_of_grid
from meshflow.surfaces.data import data_from
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

if TYPE_CHECKING:
    import pyvista as pv
    import trimesh

__all__ = ["to_mesh", "to_normals", "to_open3d", "to_points", "to_pyvista"]


@dataclass(frozen=True, eq=False)
class _Shell:
    """The surface that the camera sees.

    :param points: (h * w, 3), NaN where missing.
    :param faces: (m, 3), oriented towards the camera.
    :param there: (h * w,), samples that are not missing.
    :param sights: (h * w, 3), unit vectors away from the camera.
    """

    points: Array
    faces: Array
    there: Array
    sights: Array

    @property
    def normals(self) -> Array:
        """(h * w, 3), area-weighted means of the triangles around; without triangles, towards the camera."""
        towards = -self.sights
        if len(self.faces) == 0:
            return towards
        mesh = normals_at(np.where(self.there[:, None], self.points, 0.0), self.faces)
        return np.where((mesh != 0).any(axis=1)[:, None], mesh, towards)


@overload
def to_points(image: RangeImage, colours: None = None) -> Array: ...
@overload
def to_points(image: RangeImage, colours: ArrayLike) -> tuple[Array, Array]: ...


def to_points(image: RangeImage, colours: ArrayLike | None = None) -> Array | tuple[Array, Array]:
    """The points (n, 3) of the samples that are not missing, row by row, in the frame of the camera.

    Example:

        >>> from meshflow import read
        >>> to_points(read("data/scene_depth.png", camera="data/scene_camera.json").data).shape[1]
        3

    :param image: a range image.
    :param colours: as in :func:`to_mesh`.
    :returns: the points, or with colours (points, colours), these (n, 3) in uint8.
    :raises InputError: for colours of another size or type.
    """
    paint, shell = _painted(image, colours), _shell(image)
    points = shell.points[shell.there]
    return points if paint is None else (points, paint[shell.there])


def to_normals(image: RangeImage) -> Array:
    """Unit normals (n, 3) of :func:`to_points`, towards the camera, from triangles that do not cross a jump.

    Example:

        >>> from meshflow import read
        >>> to_normals(read("data/scene_depth.png", camera="data/scene_camera.json").data).shape
        (73214, 3)

    :param image: a range image.
    """
    shell = _shell(image)
    return shell.normals[shell.there]


def to_mesh(
    image: RangeImage | HeightField | Image | Array, colours: ArrayLike | None = None, *, every: int = 1
) -> "trimesh.Trimesh":
    """The triangles between samples that do not cross a jump, oriented towards the camera; isolated points are left out.

    Of a height field or an image, and of their arrays (h, w) and (h, w, k), they are those of
    :func:`meshflow.io.grid_mesh.mesh_of_grid`; the channels of an image are the vertex attribute ``channels``.

    Example:

        >>> from meshflow import read
        >>> mesh = to_mesh(read("data/scene_depth.png", camera="data/scene_camera.json").data)  # trimesh
        >>> len(mesh.faces) > 100_000
        True

    :param image: a range image, a height field or an image; or an array of heights or channels.
    :param colours: of a range image, the picture of the same pixels, (h, w, 3) or (h, w, 4): whole numbers of 8 or 16 bit, or
        floating point from 0 to 1.
    :param every: of a height field or an image, keep every n-th row and column.
    :raises InputError: for colours of another size or type, or where there is no triangle.
    """
    import trimesh

    seen = data_from(image, (RangeImage, HeightField, Image), "to_mesh")
    if not isinstance(seen, RangeImage):
        if colours is not None:
            raise InputError(f"colours: only for range images, got {type(seen).__name__}")
        mesh = mesh_of_grid(seen, every)
        attributes: Any = {} if mesh.channels is None else {"channels": mesh.channels}
        return trimesh.Trimesh(mesh.points, mesh.faces, process=False, vertex_attributes=attributes)
    if every != 1:
        raise InputError(f"every: only for height fields and images, got {every} for a range image")
    points, faces, paint = _parts(seen, colours)
    return trimesh.Trimesh(points, faces, vertex_colors=paint, process=False)


def to_open3d(
    image: RangeImage,
    colours: ArrayLike | None = None,
    kind: Literal["mesh", "points"] = "mesh",
    *,
    tensor: bool = False,
) -> Any:
    """Export to open3d: a TriangleMesh as :func:`to_mesh`, or a PointCloud as :func:`to_points`, with normals.

    Example:

        >>> from meshflow import read
        >>> image = read("data/scene_depth.png", camera="data/scene_camera.json").data
        >>> type(to_open3d(image)).__name__  # needs meshflow[scan]
        'TriangleMesh'

    :param image: a range image.
    :param colours: as in :func:`to_mesh`.
    :param kind: ``mesh`` or ``points``.
    :param tensor: use the tensor classes of open3d (float32) instead of the legacy ones.
    :raises InputError: as :func:`to_mesh`, and for another kind.
    """
    if kind not in ("mesh", "points"):
        raise InputError(f"kind: mesh or points expected, got {kind!r}")
    open3d = need("open3d", "scan")
    shell = _shell(image)
    if kind == "mesh":
        points, faces, paint = _parts(image, colours)
        normals = shell.normals[np.unique(shell.faces)]
    else:
        points, faces, paint = shell.points[shell.there], None, _painted(image, colours)
        normals, paint = shell.normals[shell.there], None if paint is None else paint[shell.there]
    if tensor:
        return _tensor(open3d, points, faces, normals, paint)
    vectors = open3d.utility.Vector3dVector
    if faces is None:
        made = open3d.geometry.PointCloud(vectors(points))
        made.normals = vectors(normals)
        if paint is not None:
            made.colors = vectors(paint / 255.0)
        return made
    made = open3d.geometry.TriangleMesh(vectors(points), open3d.utility.Vector3iVector(faces.astype(np.int32)))
    made.vertex_normals = vectors(normals)
    if paint is not None:
        made.vertex_colors = vectors(paint / 255.0)
    return made


def to_pyvista(image: RangeImage, colours: ArrayLike | None = None) -> "pv.StructuredGrid":
    """A StructuredGrid of h x w points, with the array ``depth`` (and ``colours``); missing samples are hidden (ghosts).

    A structured grid cannot leave triangles out: unlike :func:`to_mesh`, it connects samples across jumps.

    Example:

        >>> from meshflow import read
        >>> to_pyvista(read("data/scene_depth.png", camera="data/scene_camera.json").data).n_points > 70_000
        True

    :param image: a range image.
    :param colours: as in :func:`to_mesh`.
    :raises InputError: for colours of another size or type.
    """
    import pyvista as pv

    _must_have_rays(image)
    paint, missing = _painted(image, colours), np.asarray(image.missing)
    depth = np.where(missing, np.median(image.depth[~missing]), image.depth).astype(np.float64)
    points = image.points_at(depth)
    grid = pv.StructuredGrid(*(np.ascontiguousarray(points[..., axis]) for axis in range(3)))
    order = np.arange(missing.size).reshape(missing.shape).ravel(order="F")  # in VTK the first axis runs fastest
    grid.point_data["depth"] = np.where(missing, np.nan, image.depth).ravel()[order]
    if paint is not None:
        grid.point_data["colours"] = paint[order]
    if missing.any():
        grid.hide_points(missing.ravel()[order])
    return grid


def _tensor(open3d: ModuleType, points: Array, faces: Array | None, normals: Array, paint: Array | None) -> Any:
    def tensor(array: Array, kind: type[np.generic] = np.float32) -> Any:
        """The array as a tensor of a type."""
        return open3d.core.Tensor(np.ascontiguousarray(array, dtype=kind))

    if faces is None:
        made = open3d.t.geometry.PointCloud(tensor(points))
        attributes = made.point
    else:
        made = open3d.t.geometry.TriangleMesh(tensor(points), tensor(faces, np.int64))
        attributes = made.vertex
    attributes.normals = tensor(normals)
    if paint is not None:
        attributes.colors = tensor(paint / 255.0)
    return made


def _must_have_rays(image: object) -> None:
    """Refuse anything but a range image.

    :raises InputError: with what came.
    """
    if not isinstance(image, RangeImage):
        raise InputError(f"a RangeImage expected, got {shown(image)}; read one with meshflow.read(..., camera=...)")


def _shell(image: RangeImage) -> _Shell:
    _must_have_rays(image)
    points, there = image.cloud.reshape(-1, 3), ~image.missing.ravel()
    step = (image.points_at(image.depth + np.float64(1.0)) - image.points_at(image.depth)).reshape(-1, 3)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    sights = np.divide(step, length, out=np.zeros_like(step), where=length > 0)
    faces = image.lifted(Lift(diagonals="forward")).triangulations[0]
    a, b, c = (points[faces[:, i]] for i in range(3))
    if (np.cross(b - a, c - a) * sights[faces[:, 0]]).sum() > 0:
        faces = faces[:, ::-1]
    return _Shell(points, faces, there, sights)


def _parts(image: RangeImage, colours: ArrayLike | None) -> tuple[Array, Array, Array | None]:
    """Points, faces and colours of the samples that triangles use."""
    paint, shell = _painted(image, colours), _shell(image)
    if len(shell.faces) == 0:
        raise InputError(
            f"no triangle between the {int(shell.there.sum())} depths that are there: too much is missing, or across a jump "
            f"(jump={image.jump!r}); give a larger jump, or to_points"
        )
    used, corners = np.unique(shell.faces, return_inverse=True)
    return shell.points[used], corners.reshape(-1, 3), None if paint is None else paint[used]


def _painted(image: RangeImage, colours: ArrayLike | None) -> Array | None:
    """Colours (h * w, 3) in uint8."""
    if colours is None:
        return None
    picture, (h, w) = np.asarray(colours), image.depth.shape
    if picture.ndim != 3 or picture.shape[2] not in (3, 4) or picture.shape[:2] != (h, w):
        raise InputError(
            f"colours: a picture of shape ({h}, {w}, 3), as the depths, expected, got {picture.shape}; register it to the "
            "depths, or resample it (cv2.resize) if it shows the same field of view"
        )
    picture = picture[..., :3].reshape(-1, 3)
    if picture.dtype == np.uint8:
        return picture
    if picture.dtype == np.uint16:
        return (picture // 257).astype(np.uint8)
    if picture.dtype.kind == "f" and np.nanmin(picture) >= 0 and np.nanmax(picture) <= 1:
        return np.rint(np.nan_to_num(picture) * 255).astype(np.uint8)
    raise InputError(
        f"colours: uint8, uint16, or floating point from 0 to 1 expected, got {picture.dtype} up to {picture.max()}"
    )
