"""open3d triangle meshes in, new ones out: the legacy class and the tensor class."""

from functools import partial
from typing import Any

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.adapters import open3d_images as images
from meshflow.io.metadata import Found, belong, must_be_mesh
from meshflow.io.objects import Adopted
from meshflow.io.vertex_merging import Skin, fitted, is_soup, normals_after
from meshflow.surfaces.lift import Mesh

__all__ = ["adopt"]


def adopt(
    thing: Any, *, channels: Any = None, moves: Any = None, fixed: Any = None, kind: Any = None, **other: Any
) -> Adopted:
    """Take a TriangleMesh in, legacy or tensor; what comes back is a new one of the same class, attributes and all.

    Vertex and triangle normals are recomputed where there are some. Depth images go to :mod:`meshflow.io.adapters.open3d_images`.

    :param channels: (n, k), or ``"colors"``; of a tensor mesh also the name of a vertex attribute.
    :param moves: ``points | channels | all``.
    :param fixed: (n,), vertices that stay.
    :raises InputError: for a point cloud or another geometry, an unknown name, or a hint that does not belong.
    """
    if images.is_image(thing):
        meant = {"channels": channels, "moves": moves, "fixed": fixed, "kind": kind}
        return images.adopt(thing, **{name: hint for name, hint in meant.items() if hint is not None}, **other)
    belong(other, "an open3d mesh", ("channels", "moves", "fixed"))
    must_be_mesh(kind, "an open3d mesh")
    open3d = need("open3d", "scan")
    is_legacy = isinstance(thing, open3d.geometry.TriangleMesh)
    if not is_legacy and not isinstance(thing, open3d.t.geometry.TriangleMesh):
        raise InputError(
            f"{type(thing).__module__}.{type(thing).__name__}: a TriangleMesh expected; a cloud has no surface, "
            "reconstruct one first (TriangleMesh.create_from_point_cloud_poisson)"
        )
    taken = _Legacy(thing) if is_legacy else _Tensor(thing)
    points, faces = taken.array("positions"), taken.faces()
    name = channels if isinstance(channels, str) else None
    values: Any = taken.array(name) if name is not None else channels
    skin = Skin.of(points, faces, split=is_soup(faces, len(points)), channels=values, moves=moves, fixed=fixed)
    samples = partial(skin.samples, find=taken.found)
    return Adopted(skin.noun, partial(_restored, taken, skin, name), skin.note, samples)


def _restored(taken: Any, skin: Skin, name: str | None, noun: Mesh) -> Any:
    new = taken.copy()
    points = skin.points_of(noun)
    if skin.has_moved(noun):
        new.put("positions", points)
        if "normals" in new.names():
            new.put("normals", normals_after(points, skin.faces, skin.points, new.array("normals")))
        new.renew_triangle_normals()
    values = skin.channels_of(noun)
    if name is not None and values is not None:
        old = new.array(name)
        new.put(name, fitted(values, old.dtype).reshape(old.shape))
    return new.mesh


class _Legacy:
    """open3d.geometry.TriangleMesh, all of it in float64."""

    _HOMES = {"positions": "vertices", "normals": "vertex_normals", "colors": "vertex_colors"}

    def __init__(self, mesh: Any) -> None:
        self.mesh = type(mesh)(mesh)

    def copy(self) -> "_Legacy":
        """Another copy."""
        return _Legacy(self.mesh)

    def names(self) -> list[str]:
        """The vertex attributes that are there."""
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
        """None: the class knows no other attributes than those three."""
        return None, ()

    def put(self, name: str, values: Array) -> None:
        """Set a vertex attribute."""
        utility = need("open3d", "scan").utility
        setattr(self.mesh, self._HOMES[name], utility.Vector3dVector(values))

    def renew_triangle_normals(self) -> None:
        """Compute the normals of triangles again, if there are some."""
        if self.mesh.has_triangle_normals():
            self.mesh.compute_triangle_normals()


class _Tensor:
    """open3d.t.geometry.TriangleMesh, any attributes in any type."""

    def __init__(self, mesh: Any) -> None:
        self.mesh = (
            mesh.clone()
        )  # copy.deepcopy shares the memory of all attributes; clone() leaves the material behind
        if mesh.has_valid_material():
            self.mesh.material = mesh.material
            for name, image in mesh.material.texture_maps.items():
                self.mesh.material.texture_maps[name] = image.clone()

    def copy(self) -> "_Tensor":
        """Another copy."""
        return _Tensor(self.mesh)

    def names(self) -> list[str]:
        """The vertex attributes that are there."""
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
        """A vertex attribute, or None, and the names of those that there are."""
        there = [word for word in self.names() if word not in ("positions", "normals")]
        return (self.array(name) if name in there else None), there

    def put(self, name: str, values: Array) -> None:
        """Set a vertex attribute, on the device of the old one."""
        core = need("open3d", "scan").core
        self.mesh.vertex[name] = core.Tensor(np.ascontiguousarray(values), device=self.mesh.device)

    def renew_triangle_normals(self) -> None:
        """Compute the normals of triangles again, if there are some."""
        if "normals" in self.mesh.triangle:
            self.mesh.compute_triangle_normals()


def _must_have(name: str, there: list[str]) -> None:
    if name not in there:
        rest = [word for word in there if word not in ("positions", "normals")]
        raise InputError(
            f"channels={name!r}: the mesh has no such vertex attribute; it has {', '.join(rest) or 'none'}"
        )
