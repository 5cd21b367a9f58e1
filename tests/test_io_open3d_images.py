"""Depth images of open3d in, new ones out. meshflow.io.adapters.open3d_images."""

import subprocess
import sys

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.io.objects import from_object
from meshflow.smoothing import smooth
from meshflow.surfaces.camera import Pinhole

open3d = pytest.importorskip("open3d")

H, W = 24, 32
CAMERA = Pinhole(40, 40, 15.5, 11.5)
RNG = np.random.default_rng(4)
COUNTS = np.rint(2000 + 20 * RNG.normal(size=(H, W))).astype(np.uint16)
COUNTS[3:6, 4:8], COUNTS[0, 0] = 0, 65535
COLOURS = RNG.integers(0, 256, (H, W, 3), dtype=np.uint8)
LEGACY, TENSOR = open3d.geometry, open3d.t.geometry


def tensor(values):
    return TENSOR.Image(open3d.core.Tensor(np.ascontiguousarray(values)))


def rgbd(depth):
    made = LEGACY.RGBDImage()
    made.color, made.depth = LEGACY.Image(COLOURS), LEGACY.Image(depth)
    return made


MAKERS = {
    "Image": LEGACY.Image,
    "t.Image": tensor,
    "RGBDImage": rgbd,
    "t.RGBDImage": lambda depth: TENSOR.RGBDImage(tensor(COLOURS), tensor(depth), True),
}
EVERY = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)


def depth_of(data):
    found = getattr(data, "depth", data)
    values = found.as_tensor().numpy() if hasattr(found, "as_tensor") else np.asarray(found)
    return values.reshape(H, W)


@EVERY
def test_the_same_class_comes_back_in_the_same_units_as_float32(make):
    data = make(COUNTS.copy())
    found = smooth(data, camera=CAMERA, time=3.0)
    assert type(found) is type(data)
    before, after = depth_of(data), depth_of(found)
    assert np.array_equal(before, COUNTS)
    assert after.dtype == np.float32
    gone = (COUNTS == 0) | (COUNTS == 65535)
    assert np.array_equal(after[gone], COUNTS[gone])
    assert after[~gone].mean() == pytest.approx(2000, abs=20)
    assert after[~gone].std() < 0.6 * COUNTS[~gone].std()


@EVERY
def test_what_did_not_move_has_the_numbers_that_it_had(make):
    found = smooth(make(COUNTS.copy()), camera=CAMERA, time=0.0)
    assert np.array_equal(depth_of(found), COUNTS)


def test_colours_of_an_rgbd_image_are_copied():
    for make in (MAKERS["RGBDImage"], MAKERS["t.RGBDImage"]):
        data = make(COUNTS)
        found = smooth(data, camera=CAMERA, time=1.0)
        colour = found.color
        colour = colour.as_tensor().numpy() if hasattr(colour, "as_tensor") else np.asarray(colour)
        assert np.array_equal(colour, COLOURS)
        assert found.color is not data.color
    assert found.are_aligned()


def test_an_rgbd_image_that_open3d_made_is_in_metres():
    made = LEGACY.RGBDImage.create_from_color_and_depth(LEGACY.Image(COLOURS), LEGACY.Image(COUNTS), depth_trunc=70.0)
    data = from_object(made, {"camera": CAMERA}).data
    assert data.depth[10, 10] == pytest.approx(COUNTS[10, 10] / 1000)


def test_units_come_from_the_hint_or_the_convention():
    assert from_object(LEGACY.Image(COUNTS), {"camera": CAMERA, "depth_scale": 5000}).data.depth[9, 9] == pytest.approx(
        COUNTS[9, 9] / 5000
    )
    result = smooth(LEGACY.Image(COUNTS), time=1.0, camera=CAMERA, result=True)
    assert "depths of 1000 units per metre are converted to" in " ".join(result.warnings)
    big = LEGACY.Image(np.full((480, 640), 5000, np.uint16))
    assert from_object(big, {"camera": "tum"}).data.depth[0, 0] == 1.0


def test_open3ds_own_intrinsics_are_a_camera():
    theirs = open3d.camera.PinholeCameraIntrinsic(W, H, 40, 41, 15.5, 11.5)
    assert from_object(LEGACY.Image(COUNTS), {"camera": theirs}).data.camera == Pinhole(40, 41, 15.5, 11.5)


def test_other_hints_reach_the_range_image():
    data = from_object(
        LEGACY.Image(COUNTS),
        {
            "camera": CAMERA,
            "missing": np.eye(H, W) > 0,
            "jump": 0.2,
            "measure": "range",
            "time_unit": "length",
        },
    ).data
    assert data.missing[7, 7]
    assert (data.jump, data.measure, data.time_unit) == (0.2, "range", "length")


# Made in the test: open3d ends a process with 1 where a tensor outlives it.
BAD = [
    (lambda: LEGACY.Image(COUNTS), {}, "open3d Image: a depth image needs its camera"),
    (
        lambda: LEGACY.Image(COLOURS),
        {"camera": CAMERA},
        r"depths \(h, w\) in uint16 or float32 expected, got shape \(24, 32, 3\)",
    ),
    (lambda: tensor(COUNTS.astype(np.int32)), {"camera": CAMERA}, "expected, got shape .* in int32"),
    (lambda: LEGACY.Image(COUNTS), {"camera": CAMERA, "channels": "colors"}, "channels: no option of an open3d Image"),
    (
        lambda: LEGACY.Image(COUNTS),
        {"camera": CAMERA, "kind": "image"},
        "kind='image': an open3d Image is taken as depths",
    ),
    (
        lambda: LEGACY.Image(COUNTS),
        {"camera": open3d.camera.PinholeCameraIntrinsic(640, 480, 40, 41, 15.5, 11.5)},
        "camera saw 640 x 480 pixels, open3d Image has 32 x 24",
    ),
    (
        lambda: LEGACY.Image(COUNTS),
        {"camera": LEGACY.PointCloud()},
        "a PinholeCameraIntrinsic of open3d expected, got PointCloud",
    ),
    (lambda: rgbd(COUNTS), {"camera": "tum"}, "camera tum saw 640 x 480 pixels, open3d RGBDImage has 32 x 24"),
]


@pytest.mark.parametrize(("make", "hints", "words"), BAD, ids=[words[:40] for _, _, words in BAD])
def test_images_that_are_no_depths_with_a_camera_are_refused(make, hints, words):
    with pytest.raises(InputError, match=words):
        from_object(make(), hints)


def test_a_process_that_smoothed_tensors_ends_well():
    script = (
        "import numpy as np, open3d, meshflow\n"
        "o = open3d.t.geometry\n"
        "image = o.Image(open3d.core.Tensor(np.full((24, 32), 2.0, np.float32)))\n"
        "meshflow.smooth(image, camera=meshflow.Pinhole(40, 40, 15.5, 11.5), time=1.0)\n"
        "ball = o.TriangleMesh.create_sphere(1.0, 8)\n"
        "meshflow.smooth(ball, stop=meshflow.Steps(2))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "leak" not in done.stdout + done.stderr
