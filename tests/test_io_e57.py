"""Organised scans in E57. meshflow.io.formats.e57."""

import sys

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, InputError, MissingPackage
from meshflow.io.files import read, write
from meshflow.surfaces.range_image import RangeImage

H, W = 24, 30
RNG = np.random.default_rng(4)
ROW, COLUMN = np.mgrid[:H, :W]
THERE = ~((ROW > 4) & (ROW < 8) & (COLUMN > 2) & (COLUMN < 9))


def points(noise=0.0):
    a, e = np.radians(40 - 2 * COLUMN), np.radians(20 - 1.5 * ROW)
    r = 5 + 0.3 * np.cos(3 * a) + noise * RNG.normal(size=(H, W))
    return np.stack([r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e)], axis=-1)


def e57(path, *clouds, rows=True):
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(path), mode="w") as file:
        for cloud in clouds:
            fields = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), cloud[THERE].T.copy(), strict=True))
            if rows:
                fields |= {"rowIndex": ROW[THERE].astype("u2"), "columnIndex": COLUMN[THERE].astype("u2")}
            fields["intensity"] = np.linspace(0, 1, THERE.sum()).astype("f4")
            pose = {"rotation": np.array([np.cos(0.2), 0, 0, np.sin(0.2)]), "translation": np.array([10.0, 20.0, 3.0])}
            file.write_scan_raw(fields, name="one", **pose)
    return path


def test_an_organised_scan_is_a_range_image_and_comes_back(tmp_path):
    path = e57(tmp_path / "a.e57", points(0.02))
    document = read(path)
    assert isinstance(document.data, RangeImage)
    assert np.array_equal(document.data.missing, ~THERE)
    result = meshflow.smooth(document, result=True)
    truth = points()
    before, after = (
        np.linalg.norm((cloud - truth)[THERE], axis=1) for cloud in (document.data.cloud, result.after.cloud)
    )
    assert np.sqrt(np.mean(after**2)) < 0.75 * np.sqrt(np.mean(before**2))
    write(result.data, tmp_path / "b.e57")
    assert np.abs(read(tmp_path / "b.e57").data.cloud - result.after.cloud)[THERE].max() < 1e-5
    import pye57

    with pye57.E57(str(tmp_path / "b.e57")) as file:
        assert np.allclose(file.get_header(0).translation, [10, 20, 3])
        assert np.allclose(file.read_scan_raw(0)["intensity"], np.linspace(0, 1, THERE.sum()), atol=1e-6)
    write(result.data, tmp_path / "b.ply")
    assert np.allclose(read(tmp_path / "b.ply").data.cloud[THERE], result.after.cloud[THERE], atol=1e-5)


def test_of_several_scans_one_is_chosen_and_the_others_stay(tmp_path):
    path = e57(tmp_path / "a.e57", points(0.02), points() + 0.5)
    with pytest.raises(InputError, match="it has 2; choose one: band=1"):
        read(path)
    with pytest.raises(InputError, match="band: 1 to 2 expected"):
        read(path, band=3)
    done = meshflow.smooth(read(path, band=1))
    write(done, tmp_path / "b.e57")
    assert np.abs(read(tmp_path / "b.e57", band=2).data.cloud - points() - 0.5)[THERE].max() < 1e-5
    assert np.abs(read(tmp_path / "b.e57", band=1).data.cloud - done.data.cloud)[THERE].max() < 1e-5


def test_points_without_rows_and_broken_files_are_refused(tmp_path):
    with pytest.raises(FormatError, match="without rows and columns.*reconstruct"):
        read(e57(tmp_path / "a.e57", points(), rows=False))
    content = e57(tmp_path / "b.e57", points()).read_bytes()
    for share in (0.3, 0.8, 0.99):
        (tmp_path / "c.e57").write_bytes(content[: int(share * len(content))])
        with pytest.raises(FormatError, match="cannot be read") as refused:
            read(tmp_path / "c.e57")
        assert "\n" not in str(refused.value)
        assert (tmp_path / "c.e57").exists()
    with pytest.raises(InputError, match="depth image"):
        read(tmp_path / "b.e57", kind="mesh")


def test_what_e57_takes_is_named_where_it_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pye57", None)
    (tmp_path / "a.e57").write_bytes(b"ASTM-E57")
    with pytest.raises(MissingPackage, match=r"pip install 'meshflow\[e57\]'"):
        read(tmp_path / "a.e57")
