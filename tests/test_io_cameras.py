"""Files of cameras and conventions by name. meshflow.io.formats.cameras, camera_info."""

import json

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.io.formats.cameras import CONVENTIONS, calibration_for, read_camera, write_camera
from meshflow.surfaces.camera import Orthographic, Pinhole
from meshflow.surfaces.scanner import Scanner, Spherical

LENS = Pinhole(525, 520, 319.5, 239.5, (0.1, -0.2, 0.001, 0.002, 0.05))
RATIONAL = Pinhole(525, 520, 319.5, 239.5, (0.1, -0.2, 0.001, 0.002, 0.05, 0.01, 0.02, 0.03))
CALIBRATED = """\
image_width: 640
image_height: 480
camera_name: head_camera   # of a robot
camera_matrix:
  rows: 3
  cols: 3
  data: [525.0, 0.000000, 319.5,
         0.0, 520.0, 239.5, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.05]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
ECHOED = """\
header:
  stamp:
    sec: 1
    nanosec: 2
  frame_id: camera
height: 480
width: 640
distortion_model: rational_polynomial
d:
- 0.1
- -0.2
- 0.001
- 0.002
- 0.05
- 0.01
- 0.02
- 0.03
k:
- 525.0
- 0.0
- 319.5
- 0.0
- 520.0
- 239.5
- 0.0
- 0.0
- 1.0
binning_x: 0
roi:
  x_offset: 0
  do_rectify: false
---
"""
ROS1 = 'height: 480\nwidth: 640\ndistortion_model: "plumb_bob"\nD: []\nK: [525, 0, 319.5, 0, 520, 239.5, 0, 0, 1]\n'


def put(tmp_path, words, name="camera.yaml"):
    path = tmp_path / name
    path.write_text(words if isinstance(words, str) else json.dumps(words))
    return path


@pytest.mark.parametrize(
    ("words", "camera"), [(CALIBRATED, LENS), (ECHOED, RATIONAL), (ROS1, Pinhole(525, 520, 319.5, 239.5))]
)
def test_every_camera_info_of_ros_is_read(tmp_path, words, camera):
    found = calibration_for(put(tmp_path, words), (480, 640), "a.png")
    assert found.camera == camera
    assert found.shape == (480, 640)


def test_a_camera_info_says_the_same_to_a_yaml_library(tmp_path):
    yaml = pytest.importorskip("yaml")
    write_camera(LENS, tmp_path / "a.yaml", (480, 640))
    said = yaml.safe_load((tmp_path / "a.yaml").read_text())
    assert said["camera_matrix"]["data"] == [525, 0, 319.5, 0, 520, 239.5, 0, 0, 1]
    assert said["distortion_coefficients"]["data"] == list(LENS.distortion)
    assert said["projection_matrix"]["data"] == [525, 0, 319.5, 0, 0, 520, 239.5, 0, 0, 0, 1, 0]
    assert (said["image_width"], said["distortion_model"]) == (640, "plumb_bob")


@pytest.mark.parametrize("shape", [None, (480, 640)])
@pytest.mark.parametrize(
    "camera",
    [Pinhole(525, 520, 319.5, 239.5), LENS, RATIONAL, Orthographic(0.1, 0.2), Spherical((180, -179), (3, 2, -7))],
    ids=lambda camera: camera.summary,
)
def test_what_is_written_is_read_again(tmp_path, camera, shape):
    write_camera(camera, tmp_path / "a.json", shape)
    assert read_camera(tmp_path / "a.json") == camera
    if isinstance(camera, Pinhole) and shape:
        write_camera(camera, tmp_path / "a.yaml", shape)
        assert meshflow.read_camera(str(tmp_path / "a.yaml")) == camera


def test_a_scanner_is_written_as_arrays_and_read_again(tmp_path):
    rng = np.random.default_rng(0)
    for origins in ((1.0, 2.0, 3.0), rng.random((4, 5, 3))):
        camera = Scanner(rng.random((4, 5, 3)), origins)
        meshflow.write_camera(camera, tmp_path / "a.npz", overwrite=True)
        assert read_camera(tmp_path / "a.npz") == camera


def test_open3d_reads_the_json_that_is_written(tmp_path):
    open3d = pytest.importorskip("open3d")
    write_camera(Pinhole(525, 520, 319.5, 239.5), tmp_path / "a.json", (480, 640))
    theirs = open3d.io.read_pinhole_camera_intrinsic(str(tmp_path / "a.json"))
    assert (theirs.width, theirs.height) == (640, 480)
    assert np.array_equal(theirs.intrinsic_matrix, [[525, 0, 319.5], [0, 520, 239.5], [0, 0, 1]])


def test_units_of_depth_are_taken_from_open3ds_recorder(tmp_path):
    said = {"width": 8, "height": 6, "intrinsic_matrix": [525, 0, 0, 0, 520, 0, 3.5, 2.5, 1], "depth_scale": 4000.0}
    assert calibration_for(put(tmp_path, said, "a.json"), (6, 8), "a.png").units == 4000


def test_coefficients_may_stand_under_their_names(tmp_path):
    said = {"fx": 525, "fy": 520, "cx": 319.5, "cy": 239.5, "k1": 0.1, "k2": -0.2, "p1": 0.001, "p2": 0.002, "k3": 0.05}
    assert read_camera(put(tmp_path, said, "a.json")) == LENS
    assert read_camera(put(tmp_path, said | {"k4": 0.01, "k5": 0.02, "k6": 0.03}, "b.json")) == RATIONAL


@pytest.mark.parametrize("name", CONVENTIONS)
def test_every_convention_has_a_ray_for_each_of_its_pixels(name):
    found = calibration_for(name.upper(), (480, 640), "a.png")
    assert isinstance(found.camera, Pinhole)
    rays = found.camera.rays((480, 640))
    assert np.abs(found.camera.project(rays.reshape(-1, 3))[-1] - (639, 479)).max() < 1e-9
    assert found.units == (5000 if name.startswith("tum") else 1000)
    with pytest.raises(InputError, match=f"camera {name} saw 640 x 480 pixels, a.png has 320 x 240"):
        calibration_for(name, (240, 320), "a.png")


BAD = [
    ("a.yaml", CALIBRATED.replace("plumb_bob", "equidistant"), "got 'equidistant'; undistort the image first"),
    ("a.yaml", CALIBRATED.replace("525.0, 0.0", "0.0, 0.0"), "never calibrated"),
    ("a.yaml", CALIBRATED.replace("525.0, 0.000000", "525.0, 2.0"), "row by row without skew"),
    ("a.yaml", "height: 480\nwidth: 640\n", r"camera_matrix \(K\) of 9 numbers expected, got None"),
    ("a.yaml", ROS1.replace("D: []", "D: broad"), r"\(D\) of numbers expected, got 'broad'"),
    ("a.yaml", CALIBRATED[:160], "the list of camera_matrix does not end"),
    ("a.yaml", "Bonjour à tous", "line 1 is no camera_info of ROS: 'Bonjour"),
    ("a.yaml", ROS1.replace("D: []", "D: [1, 2, 3]"), "distortion: 0, 4, 5 or 8 numbers .* got 3"),
    ("a.json", {"model": "fisheye"}, "model pinhole, orthographic or spherical expected, got 'fisheye'"),
    ("a.json", {"model": "orthographic", "dx": 1}, "no camera .KeyError: 'dy'"),
    ("a.json", {"fx": 1, "fy": 1, "cx": 1, "cy": 1, "distortion": [1]}, "0, 4, 5 or 8 numbers .* got 1"),
    ("a.npz", "no archive", "cannot be read"),
    ("kinnect", None, r"kinnect cannot be read .* a name \(tum, .* is expected"),
]


@pytest.mark.parametrize(("name", "words", "expected"), BAD, ids=[words[:40] for _, _, words in BAD])
def test_files_that_hold_no_camera_are_refused_with_the_way_out(tmp_path, name, words, expected):
    path = tmp_path / name if words is None else put(tmp_path, words, name)
    with pytest.raises(InputError, match=expected):
        read_camera(path)


def test_formats_without_room_for_a_camera_are_refused(tmp_path):
    rays = Scanner(np.ones((2, 2, 3)))
    for camera, name, shape, words in [
        (rays, "a.json", None, "the rays of a scanner do not fit into .json; use .npz"),
        (LENS, "a.yaml", None, "expected for ROS, got no shape; use .json"),
        (Orthographic(1, 1), "a.yaml", (4, 4), "expected for ROS, got Orthographic"),
        (LENS, "a.txt", None, "a camera does not fit into .txt; use .json or .yaml"),
    ]:
        with pytest.raises(FormatError, match=words):
            write_camera(camera, tmp_path / name, shape)
        assert not (tmp_path / name).exists()
    write_camera(LENS, tmp_path / "a.json")
    with pytest.raises(FormatError, match="exists; name another file"):
        write_camera(LENS, tmp_path / "a.json")


def test_a_dictionary_and_a_matrix_say_what_a_file_of_them_says():
    depth = 2.0 + 0.01 * np.random.default_rng(0).normal(size=(40, 50))
    same = meshflow.smooth(depth, camera=Pinhole(60.0, 61.0, 24.5, 19.5))
    for camera in (
        {"fx": 60, "fy": 61, "cx": 24.5, "cy": 19.5},
        {"intrinsic": {"width": 50, "height": 40, "intrinsic_matrix": [60, 0, 0, 0, 61, 0, 24.5, 19.5, 1]}},
        np.array([[60, 0, 24.5], [0, 61, 19.5], [0, 0, 1.0]]),
    ):
        np.testing.assert_array_equal(meshflow.smooth(depth, camera=camera), same)
    for camera, word in (({"fx": 60}, "of a dictionary: no camera"), (np.eye(4), "of a matrix"), (3.0, "got float")):
        with pytest.raises(InputError, match=word):
            meshflow.smooth(depth, camera=camera)
    with pytest.raises(InputError, match="saw 51 x 40 pixels"):
        meshflow.smooth(depth, camera={"fx": 60, "fy": 60, "cx": 25, "cy": 20, "width": 51, "height": 40})
