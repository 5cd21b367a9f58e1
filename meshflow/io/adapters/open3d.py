"""Imports triangle meshes of open3d: the legacy class and the tensor class."""

from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.adapters import open3d_images as images
from meshflow.io.document import Imported
from meshflow.io.metadata import Found, ReadOptions
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.mesh import Mesh

if TYPE_CHECKING:
    import open3d

__all__ = ["from_object"]


def from_object(data: object, options: ReadOptions) -> Imported:
    """Import a TriangleMesh, legacy or tensor; results are new ones of the same class with all attributes.

    Existing vertex and triangle normals are recomputed. Depth images go to :mod:`meshflow.io.adapters.open3d_images`.

    :param options: ``channels`` (n, k), or ``"colors"``, for a tensor mesh also the name of a vertex attribute; ``moves``.
    :raises InputError: for a point cloud or another geometry, an unknown name, or an option that does not apply.
    """
    if images.is_image(data):
        return images.from_object(data, options)
    options.must_be_mesh("an open3d mesh")
    taken = _taken(data)
    points, faces = taken.array("positions"), taken.faces()
    name = options.attribute
    values = taken.array(name) if name is not None else options.channels
    skin = Skin.of(points, faces, split=is_soup(faces, len(points)), channels=values, moves=options.moves)
    samples = partial(skin.samples, find=taken.found)
    return Imported(skin.data, partial(_to_object, taken, skin, name), skin.note, samples)


def _taken(data: object) -> "_Legacy | _Tensor":
    module = need("open3d", "scan")
    if isinstance(data, module.geometry.TriangleMesh):
        return _Legacy(cast("open3d.geometry.TriangleMesh", data))
    if isinstance(data, module.t.geometry.TriangleMesh):
        return _Tensor(cast("open3d.t.geometry.TriangleMesh", data))
    raise InputError(
        f"{type(data).__module__}.{type(data).__name__}: a TriangleMesh expected; a cloud has no surface, "
        "reconstruct one first (TriangleMesh.create_from_point_cloud_poisson)"
    )


def _to_object(
    taken: "_Legacy | _Tensor", skin: Skin, name: str | None, data: Mesh
) -> "open3d.geometry.TriangleMesh | open3d.t.geometry.TriangleMesh":
    new = taken.copy()
    points = skin.points_of(data)
    if skin.has_moved(data):
        new.put("positions", points)
        if "normals" in new.names():
            new.put("normals", normals_after(points, skin.faces, skin.points, new.array("normals")))
        new.renew_triangle_normals()
    values = skin.channels_of(data)
    if name is not None and values is not None:
        old = new.array(name)
        new.put(name, fitted(values, old.dtype).reshape(old.shape))
    return new.mesh


class _Legacy:
    """open3d.geometry.TriangleMesh, all of it in float64."""

    _HOMES = {"positions": "vertices", "normals": "vertex_normals", "colors": "vertex_colors"}

    def __init__(self, mesh: "open3d.geometry.TriangleMesh") -> None:
        self.mesh = type(mesh)(mesh)

    def copy(self) -> "_Legacy":
        """Another copy."""
        return _Legacy(self.mesh)

    def names(self) -> list[str]:
        """The existing vertex attributes."""
        return [name for name, home in self._HOMES.items() if len(getattr(self.mesh, home))]

    def faces(self) -> Array:
        """Triangles (m, 3)."""
        return np.array(self.mesh.triangles, dtype=np.int64).reshape(-1, 3)

    def array(self, name: str) -> Array:
        """A copy of a vertex attribute."""
        if name != "positions":
            _must_have(name, self.names())
        return np.array(getattr(self.mesh, self._HOMES[name])).reshape(-1, 3)

    def found(self, name: str) -> Found:
        """None, because the class has no other attributes."""
        return None, ()

    def put(self, name: str, values: Array) -> None:
        """Set a vertex attribute."""
        utility = need("open3d", "scan").utility
        setattr(self.mesh, self._HOMES[name], utility.Vector3dVector(values))

    def renew_triangle_normals(self) -> None:
        """Recompute the normals of triangles, if there are any."""
        if self.mesh.has_triangle_normals():
            self.mesh.compute_triangle_normals()


class _Tensor:
    """open3d.t.geometry.TriangleMesh, any attributes in any type."""

    def __init__(self, mesh: "open3d.t.geometry.TriangleMesh") -> None:
        self.mesh = mesh.clone()  # copy.deepcopy shares the memory of all attributes; clone() drops the material
        if mesh.has_valid_material():
            self.mesh.material = mesh.material
            for name, image in mesh.material.texture_maps.items():
                self.mesh.material.texture_maps[name] = image.clone()

    def copy(self) -> "_Tensor":
        """Another copy."""
        return _Tensor(self.mesh)

    def names(self) -> list[str]:
        """The existing vertex attributes."""
        return [name for name, _ in self.mesh.vertex.items()]

    def faces(self) -> Array:
        """Triangles (m, 3)."""
        if "indices" not in self.mesh.triangle:
            return np.zeros((0, 3), np.int64)
        return self.mesh.triangle.indices.cpu().numpy().astype(np.int64)

    def array(self, name: str) -> Array:
        """A copy of a vertex attribute."""
        _must_have(name, self.names())
        return self.mesh.vertex[name].cpu().numpy().copy()

    def found(self, name: str) -> Found:
        """A vertex attribute or None, and the existing names."""
        there = [word for word in self.names() if word not in ("positions", "normals")]
        return (self.array(name) if name in there else None), there

    def put(self, name: str, values: Array) -> None:
        """Set a vertex attribute, on the device of the old one."""
        core = need("open3d", "scan").core
        self.mesh.vertex[name] = core.Tensor(np.ascontiguousarray(values), device=self.mesh.device)

    def renew_triangle_normals(self) -> None:
        """Recompute the normals of triangles, if there are any."""
        if "normals" in self.mesh.triangle:
            self.mesh.compute_triangle_normals()


def _must_have(name: str, there: list[str]) -> None:
    if name not in there:
        rest = [word for word in there if word not in ("positions", "normals")]
        raise InputError(
            f"channels={name!r}: the mesh has no such vertex attribute; it has {', '.join(rest) or 'none'}"
        )
