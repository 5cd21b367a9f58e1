"""Volumes in files by windows: what the command writes is, to the bit, what it writes of the whole, in any format."""

import json
import subprocess
import sys

import numpy as np
import pytest

import meshflow
from meshflow import Beltrami, InputError
from meshflow.errors import FormatError
from meshflow.estimate.request import Request
from meshflow.io.formats.volume_windows import volume_read
from meshflow.io.metadata import ReadOptions
from meshflow.large.memory import LIBRARIES, Budget
from meshflow.large.outputs import Output
from meshflow.large.volumes import form_of_volume, smooth_volume

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
SHAPE = 26, 20, 23
FIXED = {"method": Beltrami(contrast=2.0), "time": 0.25, "noise": 1.0}
AFFINE = np.diag([-1.0, 0.8, 1.3, 1.0])


def values(dtype="float32"):
    rng = np.random.default_rng(3)
    z, y, x = np.mgrid[tuple(slice(size) for size in SHAPE)]
    made = 40 + 8 * np.sin(z / 5) * np.cos(y / 4) + 9 * (x > 9) + 2 * rng.normal(size=SHAPE)
    return (100 * made).round().astype(dtype) if np.dtype(dtype).kind in "iu" else made.astype(dtype)


def stored(path, dtype="float32"):
    """A volume in a file of this name."""
    made = values(dtype)
    if path.name.endswith((".nii", ".nii.gz")):
        image = nibabel.Nifti1Image(made, AFFINE)
        image.header.set_xyzt_units("mm")
        nibabel.save(image, path)
    elif path.suffix == ".nrrd":
        encoding = "raw" if dtype == "float64" else "gzip"
        nrrd.write(str(path), made, {"space directions": AFFINE[:3, :3], "space": "LPS", "encoding": encoding})
    elif path.suffix == ".npy":
        np.save(path, made if dtype != "float64" else np.asfortranarray(made))
    else:
        meshflow.write(meshflow.Volume(made.astype("float32")), path)
    return path


def small(samples=9_000, itemsize=4):
    """A budget in which a block of so many samples fits."""
    return Budget(LIBRARIES + 14.0 * itemsize * samples)


@pytest.mark.parametrize("name", ["v.npy", "v.nii", "v.nii.gz", "v.nrrd", "v.tif"])
@pytest.mark.parametrize("dtype", ["float32", "float64", "int16"])
def test_a_file_by_windows_is_the_file_of_the_whole(name, dtype, tmp_path):
    path, one, other = stored(tmp_path / name, dtype), tmp_path / f"one{name[1:]}", tmp_path / f"other{name[1:]}"
    named = {"kind": "volume"} if path.suffix in (".npy", ".tif") else {}
    document = meshflow.read(path, **named)
    done = meshflow.smooth(document, **FIXED)
    meshflow.write(done, one)
    itemsize = done.data.values.itemsize
    found = smooth_volume(
        path,
        other,
        Request.of(FIXED["method"], time=0.25, noise=1.0),
        ReadOptions.of(named),
        Output(small(itemsize=itemsize)),
    )
    assert found.windows > 1
    assert found.removed is not None
    assert found.removed.rms > 0
    again = [meshflow.read(file, **named).data for file in (one, other)]
    assert again[0].spacing == again[1].spacing
    np.testing.assert_array_equal(again[0].values, again[1].values)
    assert {file.name for file in tmp_path.iterdir()} == {name, one.name, other.name}
    if name == "v.nii":
        headers = [nibabel.load(file).header for file in (one, other)]
        assert headers[0].binaryblock == headers[1].binaryblock or len(headers[1].extensions) > 0


def test_headers_are_kept_and_types_by_request(tmp_path):
    path = stored(tmp_path / "v.nii.gz", "int16")
    request, out = Request.of(FIXED["method"], time=0.25, noise=100.0), tmp_path / "o.nii.gz"
    writing = Output(small(), dtype="source", removed=tmp_path / "r.nii")
    found = smooth_volume(path, out, request, ReadOptions(), writing)
    image = nibabel.load(out)
    assert image.get_data_dtype() == np.int16
    assert any("rounded to int16" in note for note in found.notes)
    np.testing.assert_allclose(image.affine, AFFINE)
    assert image.header.get_xyzt_units()[0] == "mm"
    assert "Beltrami" in str(image.header.extensions[0]) or "beltrami" in str(image.header.extensions[0])
    removed = np.asarray(nibabel.load(tmp_path / "r.nii").dataobj)
    assert np.abs(values("int16") - removed - np.asarray(image.dataobj)).max() <= 0.51


@pytest.mark.long
def test_the_command_takes_windows_where_the_whole_does_not_fit(tmp_path):
    path = tmp_path / "v.npy"
    np.save(path, np.tile(values(), (4, 5, 4)))
    words = ("--kind", "volume", "--method", "quick", "--memory", "285MB", "--json", "-q")
    done = subprocess.run(
        [sys.executable, "-m", "meshflow", "smooth", path, tmp_path / "o.npy", *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["windows"] > 1
    assert np.load(tmp_path / "o.npy").std() < np.load(path).std()


def test_what_is_no_volume_and_what_does_not_fit_is_refused(tmp_path):
    request, path = Request.of(FIXED["method"], time=0.25, noise=1.0), stored(tmp_path / "v.npy")
    labels = np.zeros((30, 30, 30), np.uint8)
    labels[:10] = 3
    np.save(tmp_path / "labels.npy", labels)
    np.save(tmp_path / "flat.npy", np.zeros((5, 6)))
    np.save(tmp_path / "mask.npy", labels > 0)
    (tmp_path / "broken.npy").write_bytes(b"nothing")
    nrrd.write(str(tmp_path / "b.nrrd"), values(), {"encoding": "bzip2"})
    for name, target, writing, why in (
        ("labels.npy", "o.npy", Output(small()), "as labels do"),
        ("flat.npy", "o.npy", Output(small()), "got shape .5, 6."),
        ("mask.npy", "o.npy", Output(small()), "a mask .booleans. has no noise"),
        ("broken.npy", "o.npy", Output(small()), "cannot be read"),
        ("b.nrrd", "o.npy", Output(small()), "raw or compressed by gzip, is read"),
        ("v.npy", "o.xyz", Output(small()), "written by windows as .npy"),
        ("v.npy", "v.npy", Output(small()), "exists"),
        ("v.npy", "gone/o.npy", Output(small()), "is not a folder"),
        ("v.npy", "o.npy", Output(Budget(250.05e6)), "MB is the least"),
        ("v.npy", "o.npy", Output(Budget(50e6)), "MB is the least, and more where the halo is wider"),
        ("v.npy", "o.npy", Output(small(), driver="COG"), "of rasters"),
        ("v.npy", "o.npy", Output(small(), uncertainty=tmp_path / "u.npy"), "only for height fields and images"),
    ):
        with pytest.raises((InputError, FormatError), match=why):
            smooth_volume(tmp_path / name, tmp_path / target, request, ReadOptions(kind="volume"), writing)
    assert not list(tmp_path.glob("o.*"))
    assert not list(tmp_path.glob(".meshflow*"))
    assert form_of_volume(path).shape == SHAPE


def test_blocks_are_those_with_the_fewest_samples_in_all_halos():
    form = form_of_volume_like((512, 512, 512))
    for memory, halo in ((4e9, 32), (1e9, 32), (1e9, 4)):
        sides = Budget(memory).sides(form, halo)
        wide = np.prod([min(side + 2 * halo, 512) for side in sides])
        assert 14 * 4 * wide <= memory - LIBRARIES
        cut = [-(-512 // side) for side in sides]
        assert np.prod(cut) * wide < {(4e9, 32): 1.5, (1e9, 32): 3.0, (1e9, 4): 1.2}[memory, halo] * 512**3


def form_of_volume_like(shape):
    from meshflow.large.source import Form

    return Form(shape, None, np.dtype(np.float32), (1.0, 1.0, 1.0), meshflow.Volume)


def test_nodata_is_missing_in_windows(tmp_path):
    made = values()
    made[4:9, 5:9] = -1.0
    np.save(tmp_path / "v.npy", made)
    with volume_read(tmp_path / "v.npy", ReadOptions(nodata=-1.0), tmp_path) as reader:
        window = slice(2, 12), slice(0, 9), slice(3, 8)
        found, gone = reader.read(window)
        np.testing.assert_array_equal(found, made[window])
        np.testing.assert_array_equal(gone, made[window] == -1.0)
