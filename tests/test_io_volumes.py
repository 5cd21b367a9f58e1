"""Volumes in files and objects: what comes in goes out, with its place, its unit and its number type."""

import gzip
import json

import numpy as np
import pytest
import pyvista
from helpers.command import run
from PIL import Image as Picture

import meshflow
from meshflow import FormatError, InputError, Volume
from meshflow.cli.inputs import per_sample, plain_sample
from meshflow.io.files import read
from meshflow.synthetic import head
from meshflow.view.slices import three_slices

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
AFFINE = np.array([[0, -1.5, 0, 4], [1, 0, 0, 5], [0, 0, 2, 6], [0, 0, 0, 1.0]])


def noisy(side=16):
    truth = head(side)
    return (truth + 0.05 * np.random.default_rng(0).normal(size=truth.shape)).astype(np.float32)


def nifti(path, values, affine=AFFINE, unit="mm"):
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return path


def test_nifti_keeps_affine_unit_and_number_type(tmp_path):
    path = nifti(tmp_path / "v.nii.gz", noisy())
    document = meshflow.read(path)
    assert document.kind == "volume"
    assert document.data.spacing == (1.0, 1.5, 2.0)
    assert document.data.unit == "mm"
    np.testing.assert_array_equal(document.data.values, noisy())
    done = meshflow.smooth(document, method="quick")
    notes = meshflow.write(done, tmp_path / "o.nii.gz", tags={"meshflow:method": "quick"})
    back = nibabel.load(tmp_path / "o.nii.gz")
    assert not notes
    assert back.get_data_dtype() == np.float32
    assert back.header.get_xyzt_units()[0] == "mm"
    np.testing.assert_array_equal(back.affine, AFFINE)
    np.testing.assert_array_equal(np.asarray(back.dataobj), done.data.values)
    assert json.loads(back.header.extensions[0].get_content()) == {"meshflow:method": "quick"}
    assert gzip.decompress((tmp_path / "o.nii.gz").read_bytes())[:4] == (348).to_bytes(4, "little")


def test_whole_numbers_become_floating_point_and_go_back_by_name(tmp_path):
    whole = np.round(1000 * noisy()).astype(np.int16)
    done = meshflow.smooth(meshflow.read(nifti(tmp_path / "v.nii", whole)), method="quick")
    notes = meshflow.write(done, tmp_path / "f.nii")
    assert "written as float32" in notes[0]
    assert nibabel.load(tmp_path / "f.nii").get_data_dtype() == np.float32
    notes = meshflow.write(done, tmp_path / "i.nii", dtype="source")
    assert "rounded to int16" in notes[0]
    again = np.asarray(nibabel.load(tmp_path / "i.nii").dataobj)
    assert again.dtype == np.int16
    assert np.abs(again - done.data.values).max() <= 0.5


def test_nrrd_keeps_its_header(tmp_path):
    header = {"space": "left-posterior-superior", "space directions": AFFINE[:3, :3].T, "space origin": [1.0, 2.0, 3.0]}
    nrrd.write(str(tmp_path / "v.nrrd"), noisy(), header)
    document = meshflow.read(tmp_path / "v.nrrd")
    assert document.data.spacing == (1.0, 1.5, 2.0)
    done = meshflow.smooth(document, method="quick")
    meshflow.write(done, tmp_path / "o.nrrd", tags={"meshflow:time": "4"})
    values, found = nrrd.read(str(tmp_path / "o.nrrd"))
    np.testing.assert_array_equal(values, done.data.values)
    np.testing.assert_array_equal(found["space directions"], header["space directions"])
    assert found["space"] == "left-posterior-superior"
    assert found["meshflow_time"] == "4"
    assert "the place of the NRRD in space is not" in meshflow.write(done, tmp_path / "o.nii.gz")[0]
    moved = meshflow.read(nifti(tmp_path / "v.nii", noisy()))
    meshflow.write(moved, tmp_path / "moved.nrrd")
    np.testing.assert_allclose(nrrd.read(str(tmp_path / "moved.nrrd"))[1]["space directions"], AFFINE[:3, :3].T)


def test_arrays_and_stacks_are_volumes_by_name(tmp_path):
    np.save(tmp_path / "v.npy", noisy())
    with pytest.raises(InputError, match="kind='volume'"):
        meshflow.read(tmp_path / "v.npy")
    document = meshflow.read(tmp_path / "v.npy", kind="volume", spacing=(2.0, 1.0, 1.0))
    assert document.data.spacing == (2.0, 1.0, 1.0)
    done = meshflow.smooth(document, method="quick")
    meshflow.write(done, tmp_path / "o.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "o.npy"), done.data.values)
    meshflow.write(done, tmp_path / "o.tif")
    stack = meshflow.read(tmp_path / "o.tif", kind="volume")
    np.testing.assert_array_equal(stack.data.values, done.data.values)
    meshflow.write(Volume(noisy(), (2.0, 1.0, 1.0), unit="mm"), tmp_path / "own.nii.gz")
    assert meshflow.read(tmp_path / "own.nii.gz").data.spacing == (2.0, 1.0, 1.0)


@pytest.mark.parametrize("cells", [False, True])
def test_an_image_data_of_pyvista_comes_back_as_one(cells):
    values = noisy()
    grid = pyvista.ImageData(dimensions=tuple(np.array(values.shape[::-1]) + cells), spacing=(1.0, 1.5, 2.0))
    (grid.cell_data if cells else grid.point_data)["t1"] = values.ravel()
    done = meshflow.smooth(grid, method="quick")
    assert isinstance(done, pyvista.ImageData)
    plain = meshflow.smooth(Volume(values, (2.0, 1.5, 1.0)), method="quick")
    np.testing.assert_array_equal(done["t1"].reshape(values.shape), plain.values)
    np.testing.assert_array_equal(grid["t1"], values.ravel())


def test_what_is_no_volume_in_a_file_is_refused_with_the_way_out(tmp_path):
    sheared = AFFINE.copy()
    sheared[0, 2] = 0.7
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[:4] = 3
    for values, affine, words in (
        (np.zeros((8, 8, 8, 5), np.float32), AFFINE, "Which axis is what"),
        (np.zeros((8, 8), np.float32), AFFINE, "three axes.*single slice"),
        (np.zeros((8, 8, 8), np.complex64), AFFINE, "real numbers expected, got complex ones; smooth the magnitude"),
        (np.zeros((8, 8, 1), np.float32), AFFINE, "single slice is an image"),
        (noisy(), sheared, "sheared affine.*resample"),
        (labels, AFFINE, "labels.*probability"),
    ):
        with pytest.raises(InputError, match=words):
            meshflow.read(nifti(tmp_path / "bad.nii.gz", values, affine))
    (tmp_path / "cut.nii.gz").write_bytes(nifti(tmp_path / "v.nii.gz", noisy()).read_bytes()[:900])
    (tmp_path / "text.nrrd").write_text("no header")
    for name in ("cut.nii.gz", "text.nrrd"):
        with pytest.raises(FormatError, match="cannot be read"):
            meshflow.read(tmp_path / name)
    with pytest.raises(FormatError, match=r"a volume does not fit into .png"):
        meshflow.write(Volume(noisy()), tmp_path / "v.png")


def test_masks_of_a_volume_come_from_files_of_the_same_samples(tmp_path):
    region = np.zeros((9, 10, 11), np.uint8)
    region[2:7, 3:8, 1:10] = 1
    nrrd.write(str(tmp_path / "m.nrrd"), region)
    np.save(tmp_path / "m.npy", region)
    for path in (nifti(tmp_path / "m.nii.gz", region), tmp_path / "m.nrrd", tmp_path / "m.npy"):
        np.testing.assert_array_equal(plain_sample("mask", str(path)), region == 1)
    pages = [Picture.fromarray(page) for page in region]
    pages[0].save(tmp_path / "m.tif", save_all=True, append_images=pages[1:])
    volume = read(nifti(tmp_path / "v.nii.gz", noisy(8)))
    np.testing.assert_array_equal(per_sample(volume, "fixed", str(tmp_path / "m.tif")), region == 1)
    words = (
        "smooth",
        tmp_path / "v.nii.gz",
        tmp_path / "o.nii.gz",
        "--mask",
        tmp_path / "m.nii.gz",
        "--method",
        "quick",
    )
    assert "a mask of shape (8, 8, 8) expected, got (9, 10, 11)" in run(*words).stderr


def test_pictures_show_the_three_slices_through_the_middle(tmp_path):
    volume = Volume(np.arange(4 * 5 * 6.0).reshape(4, 5, 6), (2.0, 1.0, 1.0))
    image = three_slices(volume)
    gap = image.missing.all(axis=0)
    assert image.missing.shape[0] == 8
    assert (~gap).sum() == 6 + 6 + 5
    assert image.values[~image.missing].max() <= volume.values.max()
    before, after = Volume(noisy()), meshflow.smooth(Volume(noisy()), method="quick")
    notes = meshflow.view.compare(before, after, str(tmp_path / "p.png"))
    assert (tmp_path / "p.png").stat().st_size > 10_000 or notes


def test_the_command_smooths_a_volume(tmp_path, monkeypatch):
    nifti(tmp_path / "v.nii.gz", noisy())
    words = ("smooth", "v.nii.gz", "o.nii.gz", "--method", "quick", "--json", "--quiet")
    monkeypatch.chdir(tmp_path)
    done = run(*words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["parameters"]["time"]["unit"] == "mm²"
    assert nibabel.load(tmp_path / "o.nii.gz").shape == (16, 16, 16)
