"""Depths in OpenEXR. meshflow.io.formats.exr."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from meshflow import Pinhole, RangeImage
from meshflow.errors import FormatError, InputError, MissingPackage, NothingThere
from meshflow.io.document import Document
from meshflow.io.files import read, write
from meshflow.io.formats.exr import Layers

CAMERA = Pinhole(30.0, 30.0, 7.5, 5.5)
DEPTH = (1 + np.random.default_rng(1).random((12, 16))).astype(np.float32)
DEPTH[0, :4] = 0, np.nan, np.inf, 1e10


def made(path, channels, **header):
    exr = pytest.importorskip("OpenEXR")
    with exr.File({"type": exr.scanlineimage, **header}, channels) as file:
        file.write(str(path))
    return path


def stored(path):
    with pytest.importorskip("OpenEXR").File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: np.array(c.pixels) for name, c in file.channels().items()}


@pytest.mark.parametrize("name", ["Z", "Y", "depth", "View.Depth.Z"])
def test_depths_are_those_of_z_of_y_or_of_the_only_channel(tmp_path, name):
    more = {"A": np.zeros_like(DEPTH)} if name != "depth" else {}
    document = read(made(tmp_path / "a.exr", {name: DEPTH, **more}), camera=CAMERA)
    assert (document.kind, type(document.source), document.data.unit) == ("depth", Layers, "m")
    assert np.argwhere(document.data.missing).tolist() == [[0, i] for i in range(4)]
    there = ~document.data.missing
    assert np.array_equal(document.data.depth[there], DEPTH[there])


def test_an_exr_comes_out_as_it_came_in_with_its_other_channels_and_attributes(tmp_path):
    colours = {name: np.random.default_rng(2).random(DEPTH.shape).astype(np.float16) for name in "RGB"}
    path = made(tmp_path / "a.exr", {**colours, "Z": DEPTH}, comments="of a renderer")
    document = read(path, camera=CAMERA)
    assert write(document, tmp_path / "b.exr", tags={"meshflow:time": "5"}) == ()
    header, channels = stored(tmp_path / "b.exr")
    assert (header["comments"], header["meshflow:time"]) == ("of a renderer", "5")
    assert channels["Z"].tobytes() == DEPTH.tobytes()
    assert all(np.array_equal(channels[name], plane) for name, plane in colours.items())
    data = document.data
    depth, gone = data.depth.copy(), data.missing.copy()
    depth[5, 5], gone[5, 5] = 0, True  # dropped on the way
    write(document.holding(replace(data, depth=depth, missing=gone)), tmp_path / "c.exr")
    assert stored(tmp_path / "c.exr")[1]["Z"][5, 5] == 0


def test_any_depths_are_written_and_read_again(tmp_path):
    pytest.importorskip("OpenEXR")
    data = RangeImage(DEPTH, CAMERA, missing=DEPTH > 1e9)
    document = Document(data, tmp_path / "a.npy")
    write(document, tmp_path / "a.exr", depth_scale=1000)
    again = read(tmp_path / "a.exr", camera=CAMERA, depth_scale=1000).data
    assert np.array_equal(again.missing, data.missing)
    assert np.allclose(again.depth[~again.missing], data.depth[~data.missing], rtol=1e-6)


def test_half_precision_is_told(tmp_path):
    document = read(made(tmp_path / "a.exr", {"Z": DEPTH.astype(np.float16)}), camera=CAMERA)
    assert document.notes == ("its depths are of half precision: steps of 0.977 mm in the middle of the scene",)


def test_what_is_no_depth_image_is_refused(tmp_path):
    path = made(tmp_path / "a.exr", {"RGB": np.zeros((12, 16, 3), np.float32)})
    with pytest.raises(
        FormatError, match="depths in a channel Z, Y, or the only one, expected, got B, G, R; take one out"
    ):
        read(path, camera=CAMERA)
    path = made(tmp_path / "b.exr", {"Z": DEPTH})
    with pytest.raises(InputError, match="needs its camera"):
        read(path)
    with pytest.raises(InputError, match="got kind='image'"):
        read(path, kind="image", camera=CAMERA)
    with pytest.raises(NothingThere, match=r"c.exr: all its 192 depths are missing"):
        read(made(tmp_path / "c.exr", {"Z": np.full_like(DEPTH, 1e10)}), camera=CAMERA)
    (tmp_path / "d.exr").write_bytes(path.read_bytes()[:200])
    with pytest.raises(FormatError, match=r"d.exr cannot be read .* whole"):
        read(tmp_path / "d.exr", camera=CAMERA)


def test_without_the_package_the_line_that_installs_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    (tmp_path / "a.exr").write_bytes(b"v/1\x01")
    with pytest.raises(MissingPackage, match=r"pip install 'meshflow\[exr\]'"):
        read(tmp_path / "a.exr", camera=CAMERA)
