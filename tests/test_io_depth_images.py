"""Depth images: metres in between, the numbers of the camera at both ends. meshflow.io.formats.depth_images, cameras."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.depth_files import CAMERA, SHARED, counts, make, stored

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.io.files import Document, read, write
from meshflow.io.formats import depth_images as depths
from meshflow.io.formats.cameras import calibration_for
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.range_image import RangeImage

ICL = SHARED / "range" / "icl_livingroom_pairs"
PLAIN = {"fx": 525, "fy": 520, "cx": 3.5, "cy": 2.5}
ROWS = {"width": 8, "height": 6, "intrinsic_matrix": [[525, 0, 3.5], [0, 520, 2.5], [0, 0, 1]]}
OPEN3D = {"width": 8, "height": 6, "intrinsic_matrix": [525, 0, 0, 0, 520, 0, 3.5, 2.5, 1]}


def said(tmp_path, words):
    path = tmp_path / "camera.json"
    path.write_text(words if isinstance(words, str) else json.dumps(words))
    return path


# --- depths


def test_depths_are_metres_and_the_missing_ones_are_known(tmp_path):
    document = read(make(tmp_path / "a.png", counts()), camera=CAMERA)
    assert isinstance(document.data, RangeImage)
    assert document.kind == "depth"
    assert document.data.depth[0, 1] == np.float32(1.007)
    assert np.argwhere(document.data.missing).tolist() == [[0, 0], [1, 1]]
    assert document.data.jump == "noise"
    assert read(tmp_path / "a.png", camera=CAMERA, jump=None).data.jump is None


@pytest.mark.parametrize("scale", [1000, 5000, 10000])
def test_whole_numbers_come_out_as_they_came_in(tmp_path, scale):
    document = read(make(tmp_path / "a.png", counts()), camera=CAMERA, depth_scale=scale)
    assert document.data.depth[0, 1] == pytest.approx(1007 / scale)
    notes = write(document, tmp_path / "b.png")
    assert np.array_equal(stored(tmp_path / "b.png")[0], counts())
    assert [("rounded to 1 mm, up to 0.5 mm off" in note) for note in notes] == ([True] if scale == 1000 else [])


def test_every_number_of_sixteen_bit_survives_metres(tmp_path):
    raw = np.arange(65536, dtype="uint16").reshape(256, 256)
    for scale in (1000.0, 5000.0):
        document = read(make(tmp_path / "a.png", raw), camera=CAMERA, depth_scale=scale)
        write(document, tmp_path / "b.png", overwrite=True)
        assert np.array_equal(stored(tmp_path / "b.png")[0], raw)


def test_a_tiff_holds_metres_exactly(tmp_path):
    document = read(make(tmp_path / "a.png", counts()), camera=CAMERA)
    smoothed = replace(document.data, depth=document.data.depth * np.float32(1.0001))
    assert write(document.holding(smoothed), tmp_path / "b.tif", tags={"meshflow:q": "1"}) == ()
    out, nodata = stored(tmp_path / "b.tif")
    there = ~document.data.missing
    assert out.dtype == np.float32
    assert np.array_equal(out[there], smoothed.depth[there])
    assert (out[~there] == 0).all()
    assert nodata == 0
    again = read(tmp_path / "b.tif", camera=CAMERA)
    assert np.array_equal(again.data.missing, document.data.missing)


def test_a_float_tiff_comes_out_as_it_came_in(tmp_path):
    raw = (counts() / 1000).astype("float32")
    raw[0, 0], raw[1, 1] = 0, np.nan
    document = read(make(tmp_path / "a.tif", raw), camera=CAMERA)
    assert np.argwhere(document.data.missing).tolist() == [[0, 0], [1, 1]]
    write(document, tmp_path / "b.tif")
    assert stored(tmp_path / "b.tif")[0].tobytes() == raw.tobytes()


def test_depths_that_do_not_fit_are_clipped_and_said_not_lost(tmp_path):
    depth = np.full((6, 8), 1.0, "float32")
    depth[0, :3] = 70.0, 0.0001, np.nan
    document = Document(RangeImage(depth, CAMERA), tmp_path / "a.npy")
    notes = write(document, tmp_path / "a.png")
    assert stored(tmp_path / "a.png")[0][0, :4].tolist() == [65534, 1, 0, 1000]
    assert "2 depths do not fit into 16 bit at 1000 units per metre" in notes[1]
    write(document, tmp_path / "b.png", depth_scale=5000)
    assert stored(tmp_path / "b.png")[0][0, 3] == 5000


def test_other_kinds_of_pictures_are_refused(tmp_path):
    path = make(tmp_path / "a.png", counts().astype("uint8"))
    with pytest.raises(FormatError, match="got 1 of uint8; a picture in 8 bit or colour shows depths"):
        read(path, camera=CAMERA)
    path = make(tmp_path / "b.png", np.stack([counts()] * 3))
    with pytest.raises(FormatError, match="one band of 16 bit .* got 3 of uint16"):
        read(path, camera=CAMERA)
    with pytest.raises(InputError, match="a depth image expected, got kind='terrain'"):
        depths.read(path, ReadOptions(kind="terrain", camera=CAMERA))
    with pytest.raises(InputError, match="depth_scale: a positive finite number of units per metre expected, got 0"):
        read(make(tmp_path / "c.png", counts()), camera=CAMERA, depth_scale=0)


def test_rounding_is_told_where_it_is_not_small_beside_the_noise_that_is_left(tmp_path):
    document = read(make(tmp_path / "a.png", counts()), camera=CAMERA)
    moved = document.holding(replace(document.data, depth=document.data.depth + np.float32(0.003)))
    note = write(moved, tmp_path / "b.png", left=0.0002)[0]
    assert "rounding to 1 mm errs by 0.29 mm (rms): the 0.2 mm of noise that are left become 0.35 mm" in note
    assert ".tif, .npy or .exr, which hold float32 or a depth_scale of 10000" in note
    assert not any("left" in note for note in write(moved, tmp_path / "c.png", left=0.002))
    assert write(moved, tmp_path / "d.tif", left=0.0002) == ()


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_a_frame_of_a_depth_camera_comes_out_as_it_came_in(tmp_path):
    document = read(ICL / "noisy_00000.png", camera=ICL / "camera_primesense.json")
    assert document.data.camera == Pinhole(525, 525, 319.5, 239.5)
    write(document, tmp_path / "out.png")
    assert np.array_equal(stored(tmp_path / "out.png")[0], stored(ICL / "noisy_00000.png")[0])


# --- cameras


@pytest.mark.parametrize(
    "words", [PLAIN, PLAIN | {"width": 8, "height": 6}, OPEN3D, ROWS, {"intrinsic": OPEN3D, "extrinsic": []}]
)
def test_a_camera_is_read_from_every_json_that_is_in_use(tmp_path, words):
    assert calibration_for(said(tmp_path, words), (6, 8), "a.png").camera == CAMERA
    assert calibration_for(str(said(tmp_path, words)), (6, 8), "a.png").camera == CAMERA


def test_a_depth_image_without_a_camera_shows_the_json_to_write(tmp_path):
    path = make(tmp_path / "a.png", counts())
    with pytest.raises(InputError, match="needs its camera") as refusal:
        read(path, kind="depth")
    example = json.loads(str(refusal.value)[str(refusal.value).index("{") :])
    assert calibration_for(said(tmp_path, example), (6, 8), "a.png").camera == Pinhole(525, 525, 3.5, 2.5)


def test_a_camera_of_another_size_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"saw 8 x 6 pixels, a\.png has 16 x 12"):
        calibration_for(said(tmp_path, OPEN3D), (12, 16), "a.png")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("not json", "cannot be read"),
        ("[1, 2]", "no camera .KeyError: 'fx'"),
        ({"fx": 1, "fy": 1, "cx": 1}, "no camera .KeyError: 'cy'"),
        ({"fx": "wide", "fy": 1, "cx": 1, "cy": 1}, "no camera .ValueError"),
        ({"intrinsic_matrix": [1, 2, 3]}, "an intrinsic_matrix without skew expected"),
        ({"intrinsic_matrix": [[525, 0, 0], [0, 520, 0], [3.5, 2.5, 1]]}, "as three rows, .*transpose"),
        ({"intrinsic_matrix": [[525, 1, 3.5], [0, 520, 2.5], [0, 0, 1]]}, "without skew"),
        ({"intrinsic_matrix": [[525, 0], [0, 520, 2.5], [0, 0, 1]]}, "no camera .ValueError"),
        ({"intrinsic_matrix": [525, 0, 3.5, 0, 520, 2.5, 0, 0, 1]}, "column by column, .*transpose"),
        (PLAIN | {"fx": -1}, "camera fx: a positive finite number of pixels expected, got -1"),
    ],
)
def test_a_json_that_is_no_camera_is_refused_with_an_example(tmp_path, words, expected):
    with pytest.raises(InputError, match=expected):
        calibration_for(said(tmp_path, words), (6, 8), "a.png")


def test_a_camera_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"nowhere\.json cannot be read .*No such file"):
        calibration_for(tmp_path / "nowhere.json", (6, 8), "a.png")
    with pytest.raises(InputError, match="or a PinholeCameraIntrinsic of open3d expected, got tuple"):
        calibration_for((60, 60, 4, 3), (6, 8), "a.png")


def circle():
    """The round field of view of an Azure Kinect in its wide mode."""
    v, u = np.mgrid[:120, :120]
    return np.hypot(u - 60, v - 60) < 56


def speckled():
    """The blind band of a stereo camera as the RealSense, and its speckle."""
    seen = np.random.default_rng(3).random((120, 120)) > 0.03
    seen[:, :14] = False
    return seen


@pytest.mark.parametrize("made", [circle, speckled])
def test_the_holes_of_a_camera_stay_and_their_rim_is_as_good_as_the_middle(made):
    seen, rng = made(), np.random.default_rng(1)
    truth = 2.0 / (1 - 0.3 * (np.mgrid[:120, :120][1] - 60) / 60)
    counts = np.where(seen, np.rint(1000 * (truth + 0.008 * rng.normal(size=truth.shape))), 0).astype(np.uint16)
    done = meshflow.smooth(counts, kind="depth", camera=meshflow.Pinhole(60, 60, 60, 60))
    error = np.abs(done / 1000 - truth)
    assert not done[~seen].any()
    rim = seen & ~np.all([np.roll(seen, shift, axis) for axis in (0, 1) for shift in (-1, 1)], axis=0)
    inside = seen & ~rim
    assert error[inside].mean() < 0.35 * 0.0064, "mean of |noise| is 0.8 sigma"
    assert error[rim].mean() < 2.5 * error[inside].mean()
