"""Reads and writes the camera_info YAML of ROS, as written by camera_calibration and printed by ``ros2 topic echo``.

The parser understands the contents of such files only: mappings of numbers, words and lists. It needs no YAML library.
"""

import re
from collections.abc import Sequence
from typing import Any

from meshflow.errors import FormatError
from meshflow.surfaces.camera import Pinhole

__all__ = ["said_in", "words_for"]

MODELS = ("plumb_bob", "rational_polynomial", "none", "")
_LINE = re.compile(r"^( *)(?:(- *)|([A-Za-z_]\w*) *: *)(.*)$")


def said_in(text: str, name: str) -> dict[str, Any]:
    """A camera_info file as the keys of a plain JSON: fx, fy, cx, cy, distortion, width, height.

    :param name: of the file, for the messages.
    :raises FormatError: for a file that is no camera_info, a camera that is not calibrated, or another lens model.
    """
    said = {key.lower(): value for key, value in _parsed(text, name).items()}
    matrix = _numbers(said.get("camera_matrix", said.get("k")), 9, "camera_matrix (K)", name)
    fx, skew, cx, a, fy, cy, b, c, one = matrix
    if fx == 0:
        raise FormatError(
            f"camera {name}: K is zero, so this camera was never calibrated; calibrate it, or give fx, fy, cx, cy"
        )
    if (skew, a, b, c, one) != (0, 0, 0, 0, 1):
        raise FormatError(
            f"camera {name}: K row by row without skew, [fx, 0, cx, 0, fy, cy, 0, 0, 1], expected, got {matrix}"
        )
    model = str(said.get("distortion_model", "")).strip("'\"")
    lens = _numbers(said.get("distortion_coefficients", said.get("d", [])), None, "distortion_coefficients (D)", name)
    if model not in MODELS:
        raise FormatError(
            f"camera {name}: distortion_model plumb_bob or rational_polynomial expected, got {model!r}; undistort the image "
            "first (cv2.fisheye.initUndistortRectifyMap for equidistant lenses) and give its new K"
        )
    while len(lens) > 8 and lens[-1] == 0:  # thin prism and tilt, not used
        lens = lens[:-1]
    lens = (*lens, *(0.0,) * (8 - len(lens))) if 5 < len(lens) < 8 else lens
    size = {
        key: said[ros] for key in ("width", "height") for ros in (f"image_{key}", key) if isinstance(said.get(ros), int)
    }
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "distortion": lens, **size}


def words_for(camera: Pinhole, shape: tuple[int, int]) -> str:
    """The file of a camera of images (h, w)."""
    lens = camera.distortion
    lens = (*lens, *(0.0,) * (5 - len(lens))) if len(lens) < 5 else lens
    k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    matrices = {
        "camera_matrix": (3, 3, k),
        "distortion_model": "plumb_bob" if len(lens) == 5 else "rational_polynomial",
        "distortion_coefficients": (1, len(lens), lens),
        "rectification_matrix": (3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": (3, 4, [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]),
    }
    lines = [f"image_width: {shape[1]}", f"image_height: {shape[0]}", "camera_name: meshflow"]
    for key, value in matrices.items():
        if isinstance(value, str):
            lines.append(f"{key}: {value}")
        else:
            rows, columns, data = value
            lines += [
                f"{key}:",
                f"  rows: {rows}",
                f"  cols: {columns}",
                f"  data: [{', '.join(map(repr, map(float, data)))}]",
            ]
    return "\n".join(lines) + "\n"


def _parsed(text: str, name: str) -> dict[str, Any]:
    """Keys and values of the first level; a matrix is its ``data``, other nested values are ignored."""
    found: dict[str, Any] = {}
    key, inner, opened = "", "", ""
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.split("#")[0].rstrip() if not opened else line.strip()
        if opened:  # a list in brackets over several lines
            opened += line
        elif not line.strip() or line.startswith(("---", "...", "%")):
            continue
        else:
            match = _LINE.match(line)
            if match is None:
                raise FormatError(f"camera {name}: line {number} is no camera_info of ROS: {line.strip()[:60]!r}")
            indent, dash, word, rest = match.groups()
            if dash:
                if isinstance(found.setdefault(key, []), list):
                    found[key].append(_scalar(rest))
                continue
            key, inner = (word, "") if not indent else (key, word)
            opened = rest
        if opened.startswith("[") and not opened.endswith("]"):
            continue
        value, opened = opened, ""
        if value and (not inner or inner == "data"):
            found[key] = (
                [_scalar(part) for part in value[1:-1].split(",") if part.strip()]
                if value[0] == "["
                else _scalar(value)
            )
    if opened:
        raise FormatError(f"camera {name}: the list of {key} does not end; get the whole file")
    return found


def _scalar(word: str) -> Any:
    """A number if possible, else the word."""
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word.strip()


def _numbers(values: object, count: int | None, what: str, name: str) -> tuple[float, ...]:
    if (
        not isinstance(values, Sequence)
        or any(isinstance(v, str) for v in values)
        or (count is not None and len(values) != count)
    ):
        many = "numbers" if count is None else f"{count} numbers"
        raise FormatError(f"camera {name}: {what} of {many} expected, got {values!r}; is it a camera_info of ROS?")
    return tuple(map(float, values))
