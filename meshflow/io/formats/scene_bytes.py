"""Converts a scene of trimesh to the bytes of one file."""

import trimesh

from meshflow.errors import need

__all__ = ["need_3mf", "written"]


def need_3mf() -> None:
    """Require the packages that 3MF needs in addition to trimesh.

    :raises MissingPackage: with the command that installs it.
    """
    need("lxml", "3mf")
    need("networkx", "3mf")


def written(scene: trimesh.Scene, suffix: str) -> bytes:
    """The bytes of a scene in the format of an extension; a glTF embeds its buffers and images.

    :raises MissingPackage: if a package for 3MF is missing.
    """
    if suffix == ".gltf":
        from trimesh.exchange.gltf import export_gltf

        (content,) = export_gltf(scene, embed_buffers=True).values()
    else:
        if suffix == ".3mf":
            need_3mf()
        content = scene.export(file_type=suffix[1:])
    return content if isinstance(content, bytes) else str(content).encode()
