"""Textures of meshes; they need numpy only, except for reading them from trimesh."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["Texture", "Textured", "image_of", "of_open3d", "texture_of"]

_BLANK = (2, 2)  # the size of the placeholder of trimesh for a missing picture
_NEAR = 1e-5  # as a share of the size of a mesh, since formats keep six digits


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture, and the position in it of each corner of each triangle, so that seams need no split vertices.

    :param picture: (h, w, 3) in uint8, the top row first.
    :param corners: (m, 3, 2), right and up from the lower left, in units of the picture; outside 0 to 1 it repeats.
    """

    picture: Array
    corners: Array

    def of(self, triangles: Array) -> "Texture":
        """The texture of some of the triangles, in their order."""
        return Texture(self.picture, self.corners[triangles])


@dataclass(frozen=True, eq=False, repr=False)
class Textured(Mesh):
    """A mesh that keeps its texture when its points or channels change.

    :param texture: of its triangles; None: there is none.
    """

    texture: Texture | None = None


def image_of(visual: Any) -> Any:
    """The picture (PIL) of the material of a trimesh visual, or None."""
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    return None if image is None or image.size == _BLANK else image


def texture_of(mesh: Any, data: Mesh) -> Texture | None:
    """The texture of a ``trimesh.Trimesh`` on the triangles of the corresponding mesh.

    None where there is none, or where the triangles of the two do not correspond.
    """
    image, uv = image_of(mesh.visual), getattr(mesh.visual, "uv", None)
    faces = np.asarray(mesh.faces)
    if image is None or uv is None or len(uv) != len(mesh.vertices) or faces.shape != data.faces.shape:
        return None
    places, there = np.asarray(mesh.vertices)[faces], data.points[data.faces][..., :3]
    if np.abs(places - there).max() > _NEAR * float(np.ptp(there, axis=(0, 1)).max()):
        return None
    return Texture(np.asarray(image.convert("RGB")), np.asarray(uv, dtype=np.float64)[faces])


def of_open3d(mesh: Any) -> Any:
    """A ``TriangleMesh`` of open3d whose triangles have one texture, as a ``trimesh.Trimesh`` of separate corners; else None."""
    uv, pictures = getattr(mesh, "triangle_uvs", ()), getattr(mesh, "textures", ())
    used = np.unique(np.asarray(getattr(mesh, "triangle_material_ids", ()), dtype=np.int64))
    if len(uv) == 0 or len(pictures) == 0 or len(used) > 1 or len(uv) != 3 * len(mesh.triangles):
        return None
    import PIL.Image
    import trimesh
    from trimesh.visual import TextureVisuals

    picture = np.asarray(pictures[int(used[0]) if len(used) else 0])
    if picture.size == 0:
        return None
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles).ravel()]
    image = PIL.Image.fromarray(np.flipud(picture))  # open3d stores the lowest row first
    visual = TextureVisuals(uv=np.asarray(uv), image=image)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)
