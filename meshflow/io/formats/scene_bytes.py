"""Converts a scene of trimesh to the bytes of one file."""

import numpy as np
import trimesh

from meshflow.errors import need
from meshflow.geometry.validation import Array

__all__ = ["STL_HEAD", "marked_stl", "need_3mf", "written"]

# The number types of glTF.
_OF_GLTF = ("i1", "u1", "i2", "u2", "u4", "f4")
# Bytes of a binary STL before its number of triangles and before its triangles, of a triangle, and of its numbers; two bytes,
# where some programs keep colours, follow these.
STL_HEAD, _TRIANGLES, _TRIANGLE, _NUMBERS = 80, 84, 50, 48


def need_3mf() -> None:
    """Require the packages that 3MF needs in addition to trimesh.

    :raises MissingPackage: with the command that installs it.
    """
    need("lxml", "3mf")
    need("networkx", "3mf")


def written(scene: trimesh.Scene, suffix: str) -> bytes:
    """The bytes of a scene in the format of an extension; a glTF embeds its buffers and images.

    :param scene: nobody else's; attributes that the format cannot hold get another number type in it.
    :raises MissingPackage: if a package for 3MF is missing.
    """
    if suffix in (".glb", ".gltf"):
        _retype(scene)
    if suffix == ".gltf":
        from trimesh.exchange.gltf import export_gltf

        (content,) = export_gltf(scene, embed_buffers=True).values()
    else:
        if suffix == ".3mf":
            need_3mf()
        content = scene.export(file_type=suffix[1:])
    return content if isinstance(content, bytes) else str(content).encode()


def _retype(scene: trimesh.Scene) -> None:
    """Give vertex attributes the number types that glTF has: whole numbers without sign, or single precision."""
    for mesh in scene.geometry.values():
        attributes = getattr(mesh, "vertex_attributes", {})
        for name, values in list(attributes.items()):
            kept = np.asarray(values)
            if kept.dtype.str[1:] in _OF_GLTF:
                continue
            whole = kept.dtype.kind in "iub" and kept.size and kept.min() >= 0 and kept.max() < 2**32
            attributes[name] = kept.astype(np.uint32 if whole else np.float32)


def marked_stl(content: bytes, head: bytes, marks: Array) -> bytes:
    """A binary STL with what trimesh leaves empty.

    :param head: its first 80 bytes: words on the file, or the colour of the whole.
    :param marks: (m,), the two bytes after every triangle.
    """
    written = np.frombuffer(content, np.uint8).copy()
    written[:STL_HEAD] = np.frombuffer(head, np.uint8)
    written[_TRIANGLES:].reshape(-1, _TRIANGLE)[:, _NUMBERS:] = marks.astype("<u2").view(np.uint8).reshape(-1, 2)
    return written.tobytes()
