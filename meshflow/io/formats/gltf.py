"""The header of a GLB or a glTF: the files that it refers to, and contents that trimesh does not keep."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from meshflow.errors import FormatError, InputError

__all__ = ["lost", "named"]

_PACKED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}


def _header(path: Path) -> Any:
    """The JSON of a GLB or a glTF.

    :raises InputError: when it is neither.
    """
    content = path.read_bytes()
    if path.suffix.lower() == ".gltf":
        found = json.loads(content.decode("utf-8-sig"))
    elif content[:4] == b"glTF" and len(content) >= 20:
        found = json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])
    else:
        raise InputError(f"not a GLB: it starts with {content[:4]!r} instead of b'glTF'")
    if not isinstance(found, dict):
        raise InputError(f"not a glTF: an object expected in its JSON, got {type(found).__name__}")
    return found


def named(path: Path) -> Iterator[str]:
    """The names of the files that it refers to, as written and decoded."""
    header = _header(path)
    for kind in ("buffers", "images"):
        for one in header.get(kind, ()):
            name = one.get("uri", "")
            if name and not name.startswith("data:"):
                yield name
                yield unquote(name)


def lost(path: Path) -> Iterator[str]:
    """A note on contents that trimesh does not keep.

    :raises FormatError: for compressed geometry, which trimesh would read as zeros, and for positions that are stored as shares
        of the largest whole number, which it would read as these numbers.
    """
    header = _header(path)
    packed = _PACKED & set(header.get("extensionsRequired", ()))
    if packed:
        raise FormatError(
            f"{path.name}: compressed with {', '.join(packed)}; decompress it first (gltf-transform copy)"
        )
    names = {name for name in ("animations", "cameras", "skins") if header.get(name)} | set(
        header.get("extensionsUsed", ())
    )
    accessors = header.get("accessors", ())
    for mesh in header.get("meshes", ()):
        for primitive in mesh["primitives"]:
            if accessors[primitive["attributes"]["POSITION"]].get("normalized"):
                raise FormatError(
                    f"{path.name}: its positions are quantized (KHR_mesh_quantization); "
                    "make them floating-point numbers first (gltf-transform dequantize)"
                )
            kept = {"POSITION", "NORMAL", "COLOR_0"} | ({"TEXCOORD_0"} if "material" in primitive else set())
            names |= {name for name in primitive["attributes"] if name not in kept and not name.startswith("_")}
            names |= {"morph targets"} if primitive.get("targets") else set()
    if names:
        yield f"not written again: {', '.join(sorted(names))}"
