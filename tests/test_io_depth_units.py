"""Numbers of depth cameras as metres, and what is strange about them. meshflow.io.depth_units, depths, arrays."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.depth_files import CAMERA, SHARED, counts, make, stored
from typer.testing import CliRunner

from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError, NothingThere
from meshflow.io.files import Document, read, write
from meshflow.surfaces.camera import Orthographic, Pinhole
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Scanner, Spherical

NEAR = Pinhole(8, 8, 3.5, 2.5)
REAL = SHARED / "range" / "icl_livingroom_pairs" / "noisy_00000.png"


def vga(scale):
    depth = 2 + 0.5 * np.sin(np.arange(640) / 50) * np.cos(np.arange(480) / 40)[:, None]
    return np.rint(depth * scale).astype("uint16")


def test_a_convention_sets_camera_and_units(tmp_path):
    path = make(tmp_path / "a.png", vga(5000))
    found = read(path, camera="tum").data
    assert found.camera == Pinhole(525, 525, 319.5, 239.5)
    assert found.depth[0, 0] == pytest.approx(2.0)
    assert read(path, camera="tum", depth_scale=1000).data.depth[0, 0] == pytest.approx(10.0)
    with pytest.raises(InputError, match=r"camera tum saw 640 x 480 pixels, b\.png has 8 x 6"):
        read(make(tmp_path / "b.png", counts()), camera="tum")


def test_the_command_takes_a_convention_by_name_and_says_what_depths_are(tmp_path):
    make(tmp_path / "a.png", vga(5000))
    words = ["smooth", str(tmp_path / "a.png"), str(tmp_path / "o.tif"), "--camera", "tum", "--steps", "1", "-q"]
    done = CliRunner().invoke(app, [*words, "--measure", "range", "--time-unit", "length", "--time", "0.0001"])
    assert done.exit_code == 0, done.output
    assert stored(tmp_path / "o.tif")[0].mean() == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("suffix", [".tif", ".npy"])
def test_floating_point_is_metres_whatever_units_the_camera_writes_in_whole_numbers(tmp_path, suffix):
    depth = (vga(5000) / 5000).astype("float32")
    path = tmp_path / f"a{suffix}"
    np.save(path, depth) if suffix == ".npy" else make(path, depth)
    assert np.array_equal(read(path, camera="tum").data.depth, depth)


def test_measure_and_pace_are_handed_on(tmp_path):
    make(tmp_path / "a.png", counts())
    np.save(tmp_path / "a.npy", counts() / 1000)
    for name in ("a.png", "a.npy"):
        data = read(tmp_path / name, camera=NEAR, measure="range", time_unit="length").data
        assert (data.measure, data.time_unit) == ("range", "length")
    assert read(tmp_path / "a.png", camera=Spherical((30, -30), (10, -10))).data.measure == "range"


def test_whole_numbers_of_an_array_are_read_as_those_of_a_png(tmp_path):
    make(tmp_path / "a.png", counts())
    np.save(tmp_path / "a.npy", counts())
    for scale in (None, 5000):
        one, other = (read(tmp_path / name, camera=NEAR, depth_scale=scale) for name in ("a.png", "a.npy"))
        assert np.array_equal(one.data.depth[~one.data.missing], other.data.depth[~other.data.missing])
        assert np.array_equal(one.data.missing, other.data.missing)
        assert one.notes == other.notes
    with pytest.raises(InputError, match=r"depth_scale 1000 belongs to depths \(h, w\) with a camera"):
        read(tmp_path / "a.npy", depth_scale=1000)


def test_turned_bits_are_recognised_and_refused_with_the_way_out(tmp_path):
    raw = vga(1000)
    raw[0, :100] = 9000  # beyond 8 m the upper bits come out below
    turned = (raw << 3) | (raw >> 13)
    path = make(tmp_path / "a.png", turned)
    with pytest.raises(
        FormatError, match=r"are turned, as SUN RGB-D has them\. .*\(x >> 3\) \| \(x << 13\), or give depth_scale 8000"
    ):
        read(path, camera="kinect")
    back = ((turned >> 3) | (turned << 13)).astype("uint16")
    assert np.array_equal(back, raw)
    assert np.allclose(read(path, camera="kinect", depth_scale=8000).data.depth[1:], raw[1:] / 1000)
    read(make(tmp_path / "b.png", raw), camera="kinect")
    read(make(tmp_path / "c.png", (raw // 50) * 160), camera="kinect")  # steps of 16 and more are a coarse sensor


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1, "the scene is 1.01 to 65.5 km away with 1 units"),
        (1e6, "the scene is 1.01 to 65.5 mm away with 1e.06 units"),
    ],
)
def test_a_scene_at_a_kilometre_or_a_millimetre_is_told_with_its_range(tmp_path, scale, words):
    document = read(make(tmp_path / "a.png", counts()), camera=NEAR, depth_scale=scale)
    assert any(re.search(words, note) for note in document.notes), document.notes
    assert not any("the scene is" in note for note in read(tmp_path / "a.png", camera=NEAR).notes)


def test_a_tiny_field_of_view_is_told(tmp_path):
    make(tmp_path / "a.png", counts())
    (note,) = [note for note in read(tmp_path / "a.png", camera=CAMERA).notes if "field of view" in note]
    assert "0.87 x 0.66 degrees" in note
    assert "f_px = f_mm * width_px / sensor_width_mm" in note
    assert not any("field of view" in note for note in read(tmp_path / "a.png", camera=NEAR).notes)
    with pytest.raises(InputError, match=r"fx = 0.5 pixels gives 8 pixels a field of view"):
        read(tmp_path / "a.png", camera=Pinhole(0.5, 0.5, 3.5, 2.5))


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((0, 2.5), "cx = 0 of an image 8 pixels wide"),
        ((3.5, 9), "cy = 9 of an image 6 pixels high"),
        ((3.5, 2.5), None),
    ],
)
def test_a_principal_point_on_the_edge_or_outside_is_told(tmp_path, place, words):
    notes = read(make(tmp_path / "a.png", counts()), camera=Pinhole(9.0, 9.0, *place)).notes
    assert [words in note for note in notes if "principal point" in note] == ([] if words is None else [True])


def test_a_single_depth_is_told_and_none_is_refused(tmp_path):
    raw = np.zeros((6, 8), "uint16")
    with pytest.raises(NothingThere, match=r"a.png: all its 48 depths are missing, 48 are 0;"):
        read(make(tmp_path / "a.png", raw), camera=NEAR)
    raw[0] = 65535
    with pytest.raises(NothingThere, match=r"missing, 40 are 0 and 8 are 65535;"):
        read(make(tmp_path / "a.png", raw), camera=NEAR)
    with pytest.raises(NothingThere, match=r"missing, 48 are NaN or infinite;"):
        read(make(tmp_path / "a.tif", np.full((6, 8), np.nan, "float32")), camera=NEAR)
    raw[0] = 0
    raw[2, 3] = 1000
    document = read(make(tmp_path / "a.png", raw), camera=NEAR)
    assert "only 1 of 48 depths is there: no triangle, so nothing can move" in document.notes[1]
    from meshflow.smoothing import smooth

    assert np.array_equal(smooth(document.data, time=5.0).depth, document.data.depth)


def test_negative_depths_are_refused(tmp_path):
    raw = counts().astype("int16") * np.int16(-1)
    with pytest.raises(InputError, match=r"depths above zero expected, got -1"):
        read(make(tmp_path / "a.tif", raw), camera=NEAR)


def test_rounding_that_takes_the_gain_back_is_told_with_its_size(tmp_path):
    document = read(make(tmp_path / "a.png", counts()), camera=NEAR)
    moved = replace(document.data, depth=document.data.depth + np.float32(0.0004))
    notes = write(document.holding(moved), tmp_path / "b.png")
    assert any("depths changed by 0.4 mm (rms), less than the steps of 1 mm" in note for note in notes)
    moved = replace(document.data, depth=document.data.depth + np.float32(0.004))
    assert not any("less than" in note for note in write(document.holding(moved), tmp_path / "c.png"))
    notes = write(document.holding(moved), tmp_path / "d.png", depth_scale=100)
    assert any("changed by 4 mm (rms), less than the steps of 10 mm" in note for note in notes)


def test_values_that_may_be_zero_do_not_fit_into_a_depth_image(tmp_path):
    rays = Scanner(np.broadcast_to([0.0, 0.0, -1.0], (6, 8, 3)), np.zeros((6, 8, 3)))
    depth = np.zeros((6, 8))
    depth[0, 0] = np.nan
    document = Document(RangeImage(depth, rays), Path("a.ply"))
    with pytest.raises(FormatError, match=r"values .* may be 0.* write \.ply or \.npy"):
        write(document, tmp_path / "a.tif")
    write(document, tmp_path / "a.npy")
    assert np.array_equal(np.load(tmp_path / "a.npy"), depth, equal_nan=True)
    assert np.array_equal(read(tmp_path / "a.npy", camera=rays).data.missing, np.isnan(depth))


def test_an_orthographic_depth_image_is_read(tmp_path):
    data = read(make(tmp_path / "a.png", counts()), camera=Orthographic(0.01, 0.01)).data
    assert data.camera == Orthographic(0.01, 0.01)


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_a_real_frame_needs_no_doubts():
    document = read(REAL, camera="primesense")
    assert document.notes == ("depths of 1000 units per metre are converted to, and reported in, metres",)
    assert 0.5 < np.median(document.data.depth) < 5
