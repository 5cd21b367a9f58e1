"""A scene of trimesh as the bytes of one file."""

import trimesh

from meshflow.errors import need

__all__ = ["need_3mf", "written"]


def need_3mf() -> None:
    """Ask for what 3MF takes besides trimesh.

    :raises MissingPackage: with the line that installs it.
    """
    need("lxml", "3mf")
    need("networkx", "3mf")


def written(scene: trimesh.Scene, suffix: str) -> bytes:
    """A scene in the format of an extension; a glTF holds its own buffers and images.

    :raises MissingPackage: where 3MF lacks what it takes.
    """
    if suffix == ".gltf":
        from trimesh.exchange.gltf import export_gltf

        (content,) = export_gltf(scene, embed_buffers=True).values()
    else:
        if suffix == ".3mf":
            need_3mf()
        content = scene.export(file_type=suffix[1:])
    return content if isinstance(content, bytes) else str(content).encode()
