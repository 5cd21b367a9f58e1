"""The camera of a depth image: a Pinhole, or the JSON that holds one."""

import json
from pathlib import Path
from typing import Any

from meshflow.errors import FormatError, InputError
from meshflow.geometry.camera import Pinhole

__all__ = ["camera_for"]


def camera_for(camera: Pinhole | str | Path | None, shape: tuple[int, int], name: str) -> Pinhole:
    """The camera of an image of h x w pixels.

    JSON comes as ``{"fx", "fy", "cx", "cy"}``, with ``width`` and ``height`` if known, or as Open3D writes it:
    ``{"width", "height", "intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1]}``, column by column.

    :param name: of the image, for the messages.
    :raises InputError: without a camera, or for a camera of an image of another size.
    :raises FormatError: when the JSON cannot be read or lacks something.
    """
    height, width = shape
    if isinstance(camera, Pinhole):
        return camera
    if camera is None:
        raise InputError(
            f"{name}: a depth image needs its camera; give a Pinhole or a JSON file such as {_example(shape)}"
        )
    if not isinstance(camera, (str, Path)):
        raise InputError(f"camera: a Pinhole or the path of a JSON file expected, got {type(camera).__name__}")
    path = Path(camera)
    try:
        said = json.loads(path.read_text())
    except (OSError, ValueError) as cause:  # ValueError: no JSON, or no text at all
        raise FormatError(
            f"camera {path} cannot be read ({cause}); a JSON file such as {_example(shape)} is expected"
        ) from cause
    said = said.get("intrinsic", said) if isinstance(said, dict) else {}
    size = (said.get("width", width), said.get("height", height))
    if size != (width, height):
        raise InputError(
            f"camera {path.name} saw {size[0]} x {size[1]} pixels, {name} has {width} x {height}; "
            "give the camera of this image, or scale fx, fy, cx, cy with its size"
        )
    return _pinhole(said, path, shape)


def _pinhole(said: dict[str, Any], path: Path, shape: tuple[int, int]) -> Pinhole:
    try:
        if "intrinsic_matrix" not in said:
            return Pinhole(*(float(said[key]) for key in ("fx", "fy", "cx", "cy")))
        fx, a, b, skew, fy, c, cx, cy, one = map(float, said["intrinsic_matrix"])
    except (KeyError, TypeError, ValueError) as cause:
        if isinstance(cause, InputError):
            raise
        raise FormatError(
            f"camera {path.name}: no camera ({type(cause).__name__}: {cause}); expected {_example(shape)}"
        ) from cause
    if (a, b, c, skew, one) != (0, 0, 0, 0, 1):
        raise FormatError(
            f"camera {path.name}: an intrinsic_matrix column by column without skew expected, "
            f"[fx, 0, 0, 0, fy, 0, cx, cy, 1], got {said['intrinsic_matrix']}; transpose it if it is row by row"
        )
    return Pinhole(fx, fy, cx, cy)


def _example(shape: tuple[int, int]) -> str:
    height, width = shape
    return json.dumps(
        {"width": width, "height": height, "fx": 525.0, "fy": 525.0, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    )
