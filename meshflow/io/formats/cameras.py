"""The camera of a depth image: an object, a file, or the name of a convention."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

import numpy as np

from meshflow.errors import FormatError, InputError, said_by
from meshflow.geometry.options import must_be_object, refused
from meshflow.io.atomic_write import beside
from meshflow.io.formats.camera_info import said_in, words_for
from meshflow.io.metadata import CameraLike, Intrinsics
from meshflow.surfaces.camera import Camera, Orthographic, Pinhole
from meshflow.surfaces.scanner import Scanner, Spherical

__all__ = ["CONVENTIONS", "Calibration", "calibration_for", "read_camera", "write_camera"]


# What numpy and zlib raise for a damaged .npz.
_ZIPPED = (EOFError, MemoryError, SyntaxError, TokenError, zlib.error)


@dataclass(frozen=True)
class Calibration:
    """A camera, and further facts from its file or convention.

    :param shape: (h, w) of its images, if known.
    :param units: of whole numbers in its depth images, per metre, if known.
    """

    camera: Camera
    shape: tuple[int, int] | None = None
    units: float | None = None


def _of_vga(fx: float, fy: float, cx: float, cy: float, units: float, *lens: float) -> Calibration:
    return Calibration(Pinhole(fx, fy, cx, cy, lens), (480, 640), units)


# As published: cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats (colour cameras, which the depth images
# are registered to; they recommend plain ``tum``), and 7-Scenes of Microsoft Research. In all of them 0 is missing, in 7-Scenes
# 65535.
CONVENTIONS: Mapping[str, Calibration] = {
    "tum": _of_vga(525, 525, 319.5, 239.5, 5000),
    "tum-freiburg1": _of_vga(517.3, 516.5, 318.6, 255.3, 5000, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "tum-freiburg2": _of_vga(520.9, 521.0, 325.1, 249.7, 5000, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "tum-freiburg3": _of_vga(535.4, 539.2, 320.1, 247.6, 5000),
    "7scenes": _of_vga(585, 585, 320, 240, 1000),
    "kinect": _of_vga(525, 525, 319.5, 239.5, 1000),
    "primesense": _of_vga(525, 525, 319.5, 239.5, 1000),
}


def calibration_for(camera: CameraLike | None, shape: tuple[int, int], name: str) -> Calibration:
    """The camera and further facts for an image of h x w pixels.

    :param camera: a camera, or anything that :func:`read_camera` reads.
    :param name: of the image, for the messages.
    :raises InputError: without a camera, or for a camera of an image of another size.
    :raises FormatError: when the file cannot be read or is incomplete.
    """
    must_be_object(camera, "camera: a camera")
    if isinstance(camera, Camera):
        return Calibration(camera)
    if camera is None:
        raise InputError(
            f"{name}: a depth image needs its camera; give camera=: a Pinhole, a name ({', '.join(CONVENTIONS)}) or a JSON file "
            f"such as {_example(shape)}"
        )
    found = _calibration(camera, shape)
    if found.shape is not None and found.shape != tuple(shape):
        called = f"camera {Path(camera).name}" if isinstance(camera, (str, PathLike)) else "camera"
        what = f"{called} saw {found.shape[1]} x {found.shape[0]} pixels"
        raise InputError(
            f"{what}, {name} has {shape[1]} x {shape[0]}; give the camera of this image, or scale fx, fy, cx, cy with its size"
        )
    return found


def read_camera(source: str | Path) -> Camera:
    """Read a camera: the name of a convention, or a file.

    * JSON: ``{"fx", "fy", "cx", "cy"}``, with ``width`` and ``height`` if known, and ``distortion`` [k1, k2, p1, p2, ...] or
      these by name; as Open3D writes it: ``{"width", "height", "intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1]}``, column by
      column, with ``depth_scale`` if a recorder wrote it; or ``{"model": "orthographic", "dx", "dy"}``, ``{"model":
      "spherical", "azimuth", "elevation"}``.
    * YAML: the camera_info of ROS, K and D (of images that are not rectified; of those that are, give P as JSON).
    * ``.npz``: ``directions`` and ``origins`` of a :class:`Scanner`.

    Example:

        >>> read_camera("tum").fx
        525.0
        >>> read_camera("data/scene_camera.json").cx
        159.5

    :param source: a name (``tum``, ``7scenes``, ``kinect``, ``primesense``, ``tum-freiburg1`` to ``3``) or a path.
    :raises InputError: for an argument that is no name and no path.
    :raises FormatError: when the file cannot be read or is incomplete.
    """
    return _calibration(source, (480, 640)).camera


def write_camera(
    camera: Camera, path: str | Path, shape: tuple[int, int] | None = None, *, overwrite: bool = False
) -> None:
    """Write a camera: ``.json`` (a pinhole of known shape so that Open3D reads it, too), ``.yaml`` (ROS), ``.npz`` (a scanner).

    Example:

        >>> from meshflow import Pinhole
        >>> write_camera(Pinhole(fx=525, fy=525, cx=319.5, cy=239.5), "camera.json", (480, 640))
        >>> read_camera("camera.json").fx
        525.0

    :param camera: a pinhole, orthographic or spherical camera, or a scanner.
    :param path: of the file.
    :param shape: (h, w) of its images; ROS needs it.
    :param overwrite: replace an existing file.
    :raises FormatError: when the format does not hold the camera, or the file exists and ``overwrite`` is false.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.exists() and not overwrite:
        raise FormatError(f"{path} exists; name another file, or overwrite it on purpose (overwrite=True)")
    if isinstance(camera, Scanner):
        if suffix != ".npz":
            raise FormatError(
                f"{path.name}: the rays of a scanner do not fit into {suffix or 'a file without extension'}; use .npz"
            )
        with beside(path) as temporary:
            np.savez_compressed(
                temporary, allow_pickle=False, directions=camera.directions, origins=np.asarray(camera.origins)
            )
        return
    if suffix in (".yaml", ".yml"):
        if not isinstance(camera, Pinhole) or shape is None:
            got = type(camera).__name__ if not isinstance(camera, Pinhole) else "no shape"
            raise FormatError(
                f"{path.name}: a Pinhole and the shape (h, w) of its images expected for ROS, got {got}; use .json"
            )
        words = words_for(camera, shape)
    elif suffix == ".json":
        words = json.dumps(_said(camera, shape), indent=1) + "\n"
    else:
        raise FormatError(
            f"{path.name}: a camera does not fit into {suffix or 'a file without extension'}; use .json or .yaml"
        )
    with beside(path) as temporary:
        temporary.write_text(words)


def _calibration(source: object, shape: tuple[int, int]) -> Calibration:
    """The calibration of a name, a file, or a camera of open3d."""
    if isinstance(source, Intrinsics):
        k = np.asarray(source.intrinsic_matrix)
        return Calibration(Pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2]), (source.height, source.width))
    if isinstance(source, Mapping):
        return _told(source, Path("of a dictionary"), shape)
    if isinstance(source, np.ndarray):
        return _told({"intrinsic_matrix": source.tolist()}, Path("of a matrix"), shape)
    if not isinstance(source, (str, PathLike)):
        raise InputError(
            "camera: a Pinhole or another camera, a name or the path of a file, a dictionary (fx, fy, cx, cy), a matrix (3, 3), "
            f"or a PinholeCameraIntrinsic of open3d expected, got {type(source).__name__}"
        )
    if str(source).lower() in CONVENTIONS:
        return CONVENTIONS[str(source).lower()]
    path = Path(source)
    if not path.suffix and path.name == str(source) and not path.exists():
        raise FormatError(f"camera: {refused(str(source), tuple(CONVENTIONS), 'camera')}, or give the path of a file")
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                return Calibration(Scanner(arrays["directions"], arrays["origins"]))
        text = path.read_text("utf-8-sig")
        said = said_in(text, path.name) if path.suffix.lower() in (".yaml", ".yml") else json.loads(text)
    except InputError:
        raise
    except (
        OSError,
        ValueError,
        KeyError,
        BadZipFile,
        RecursionError,
        *_ZIPPED,
    ) as cause:  # ValueError: no JSON, or no text
        raise FormatError(
            f"camera {path} cannot be read ({said_by(cause)}); a name ({', '.join(CONVENTIONS)}), a camera_info YAML, or a JSON "
            f"file such as {_example(shape)} is expected"
        ) from cause
    return _told(said, path, shape)


def _told(said: object, path: Path, shape: tuple[int, int]) -> Calibration:
    """The calibration in the words of a file, or of a dictionary of the caller.

    :raises FormatError: for what is no camera.
    """
    said = said.get("intrinsic", said) if isinstance(said, Mapping) else {}
    said = said if isinstance(said, Mapping) else {}
    try:
        camera = _camera(said, path)
        size = tuple(int(said[key]) if key in said else None for key in ("height", "width"))
        units = float(said["depth_scale"]) if said.get("depth_scale") else None
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as cause:
        raise FormatError(
            f"camera {path.name}: no camera ({type(cause).__name__}: {cause}); expected {_example(shape)}"
        ) from cause
    height, width = (given if given is not None else own for given, own in zip(size, shape, strict=True))
    return Calibration(camera, None if size == (None, None) else (height, width), units)


def _camera(said: Mapping[str, Any], path: Path) -> Camera:
    model = said.get("model", "pinhole")
    if model == "orthographic":
        return Orthographic(float(said["dx"]), float(said["dy"]))
    if model == "spherical":
        return Spherical(said["azimuth"], said["elevation"])
    if model != "pinhole":
        raise FormatError(
            f"camera {path.name}: model pinhole, orthographic or spherical expected, got {model!r}; rays of any kind go "
            "into an .npz of directions (h, w, 3) and origins"
        )
    lens = tuple(said.get("distortion", _named(said)))
    if "intrinsic_matrix" not in said:
        fx, fy, cx, cy = (float(said[key]) for key in ("fx", "fy", "cx", "cy"))
        return Pinhole(fx, fy, cx, cy, lens)
    return Pinhole(*_focal(said["intrinsic_matrix"], path), lens)


def _focal(matrix: object, path: Path) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy from nine numbers column by column, as Open3D writes them, or from three rows of three."""
    nested = isinstance(matrix, list) and len(matrix) == 3 and all(isinstance(row, list) for row in matrix)
    numbers = np.array(matrix, dtype=np.float64)
    if numbers.shape == ((3, 3) if nested else (9,)):
        # Three lists are rows if the last one is 0, 0, 1. Columns look so only where cx and cy are 0, which no camera has.
        k = numbers if nested else numbers.reshape(3, 3).T
        if (k[2] == (0, 0, 1)).all() and k[0, 1] == 0 and k[1, 0] == 0:
            return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])
    raise FormatError(
        f"camera {path.name}: an intrinsic_matrix without skew expected, column by column, [fx, 0, 0, 0, fy, 0, cx, cy, 1], or "
        f"as three rows, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {str(matrix)[:120]}; transpose it if it is the other way"
    )


def _named(said: Mapping[str, Any]) -> tuple[float, ...]:
    """Distortion coefficients given by their names."""
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    lens = [float(said.get(name, 0.0)) for name in names]
    return tuple(lens[: 8 if any(lens[5:]) else 5]) if any(lens) else ()


def _said(camera: Camera, shape: tuple[int, int] | None) -> dict[str, Any]:
    """A camera as JSON."""
    size: dict[str, Any] = {} if shape is None else {"width": int(shape[1]), "height": int(shape[0])}
    match camera:
        case Orthographic():
            return {"model": "orthographic", **size, "dx": camera.dx, "dy": camera.dy}
        case Spherical():
            return {"model": "spherical", **size, "azimuth": camera.azimuth, "elevation": camera.elevation}
        case Pinhole():
            if shape is not None:
                size["intrinsic_matrix"] = [camera.fx, 0, 0, 0, camera.fy, 0, camera.cx, camera.cy, 1]
            lens = {"distortion": list(camera.distortion)} if camera.distortion else {}
            return {**size, "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, **lens}
    raise FormatError(f"a camera of the class {type(camera).__name__} has no JSON; write the depths' points instead")


def _example(shape: tuple[int, int]) -> str:
    height, width = shape
    return json.dumps(
        {"width": width, "height": height, "fx": 525.0, "fy": 525.0, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    )
