"""Series of DICOM: read as volumes in their place, written as NIfTI and as new series. The files are made here, by pydicom."""

import numpy as np
import pytest
from helpers.command import run

import meshflow
from meshflow import FormatError, InputError, Volume

pydicom = pytest.importorskip("pydicom")
nibabel = pytest.importorskip("nibabel")
TURN = [0.8, 0.6, 0.0, -0.6, 0.8, 0.0]  # of rows and columns; slices go up


def stored(shape=(5, 6, 7)):
    return np.random.default_rng(0).integers(900, 1300, shape).astype(np.int16)


def made(folder, values=None, change=None, series="1.2.3.4"):
    """A series of slices of 2.5 mm, pixels of 0.5 x 0.75 mm, in an order that says nothing."""
    from pydicom.dataset import FileDataset, FileMetaDataset

    values = stored() if values is None else values
    folder.mkdir(exist_ok=True)
    for k in np.random.default_rng(1).permutation(len(values)):
        meta = FileMetaDataset()
        meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
        meta.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
        meta.MediaStorageSOPInstanceUID = f"{series}.{k + 1}"
        one = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
        one.SOPClassUID, one.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
        one.SeriesInstanceUID, one.Modality, one.PatientName, one.SeriesDescription = series, "CT", "Nobody", "head"
        one.Rows, one.Columns = values.shape[1:]
        one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
        one.BitsAllocated, one.BitsStored, one.HighBit, one.PixelRepresentation = 16, 16, 15, 1
        one.PixelSpacing, one.RescaleSlope, one.RescaleIntercept = [0.5, 0.75], 2, -1024
        one.ImageOrientationPatient, one.ImagePositionPatient = TURN, [10.0, 20.0, 2.5 * float(k)]
        one.PixelData = values[k].tobytes()
        if change is not None:
            change(one, k)
        one.save_as(folder / f"{series}-{97 * (k + 1) % 31}.dcm", enforce_file_format=True)
    return folder


def test_a_folder_of_slices_is_a_volume_in_its_place(tmp_path):
    folder = made(tmp_path / "scan")
    (folder / "notes.txt").write_text("no slice")
    document = meshflow.read(folder)
    assert isinstance(document.data, Volume)
    assert document.data.spacing == (2.5, 0.5, 0.75)
    assert document.data.unit == "mm"
    assert np.array_equal(document.data.values, 2.0 * stored() - 1024)
    assert "1 files in the folder are no slices" in document.notes[0]
    meshflow.write(document, tmp_path / "scan.nii.gz")
    image = nibabel.load(tmp_path / "scan.nii.gz")
    assert np.array_equal(image.get_fdata(), document.data.values)
    place = image.affine @ [2, 3, 4, 1]  # the second slice, row 3, column 4
    patient = np.array([10, 20, 5.0]) + 0.5 * 3 * np.array(TURN[3:]) + 0.75 * 4 * np.array(TURN[:3])
    assert np.allclose(place[:3], patient * [-1, -1, 1])
    again = meshflow.read(tmp_path / "scan.nii.gz").data
    assert np.allclose(again.spacing, document.data.spacing)


def test_the_command_writes_a_new_series_that_keeps_everything_but_the_values(tmp_path):
    folder = made(tmp_path / "scan")
    done = run("smooth", folder, tmp_path / "calm", "--method", "heat", "--time", "2")
    assert done.returncode == 0, done.stderr
    assert "a new series of 5 slices" in done.stdout + done.stderr
    back = meshflow.read(tmp_path / "calm").data
    expected = meshflow.smooth(meshflow.read(folder), method="heat", time=2.0).data.values
    assert np.abs(back.values - expected).max() <= 1.0 + 1e-3  # half a step of 2
    assert back.spacing == (2.5, 0.5, 0.75)
    one = pydicom.dcmread(tmp_path / "calm" / "00001.dcm")
    assert one.SeriesInstanceUID != "1.2.3.4"
    assert one.PatientName == "Nobody"
    assert one.ImageType[0] == "DERIVED"
    assert "method heat" in one.DerivationDescription
    assert run("smooth", folder, tmp_path / "calm", "--method", "quick").returncode != 0  # it is there
    assert run("smooth", folder, tmp_path / "calm", "--method", "quick", "--overwrite").returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["calm", "scan"]


def test_a_folder_with_other_things_is_never_replaced_and_after_a_fault_the_old_series_is_whole(tmp_path, monkeypatch):
    document = meshflow.read(made(tmp_path / "scan"))
    target = made(tmp_path / "calm")
    before = {path.name: path.read_bytes() for path in target.iterdir()}

    def full(*given):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("meshflow.io.formats.dicom._derived", full)
        with pytest.raises(FormatError, match="No space left on device.*existing folder is unchanged"):
            meshflow.write(document, target, overwrite=True)
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before
    (target / "report.txt").write_text("mine")
    with pytest.raises(FormatError, match="the folder holds report.txt"):
        meshflow.write(document, target, overwrite=True)
    assert (target / "report.txt").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["calm", "scan"]


def shifted(one, k):
    one.ImagePositionPatient = [10.0, 20.0 + 3.0 * k, 2.5 * float(k)]


def missing(one, k):
    one.ImagePositionPatient = [10.0, 20.0, 2.5 * float(k + (k > 2))]


def turned(one, k):
    if k == 2:
        one.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]


def nowhere(one, k):
    del one.ImagePositionPatient


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (shifted, "tilted gantry.*dcm2niix"),
        (missing, "even distances.*2.5 to 5 mm"),
        (turned, "one size and one direction"),
        (nowhere, "do not say ImagePositionPatient"),
    ],
)
def test_slices_that_make_no_volume_are_refused(tmp_path, change, words):
    with pytest.raises(InputError, match=words):
        meshflow.read(made(tmp_path / "scan", change=change))


def test_single_files_several_series_and_other_folders_are_refused_with_the_way_out(tmp_path):
    folder = made(tmp_path / "scan")
    with pytest.raises(InputError, match="give the folder"):
        meshflow.read(next(folder.glob("*.dcm")))
    made(folder, series="1.2.3.5")
    with pytest.raises(InputError, match=r"5 slices of head; 5 slices of head; give each a folder"):
        meshflow.read(folder)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FormatError, match="a folder with a series of DICOM"):
        meshflow.read(tmp_path / "empty")
    with pytest.raises(InputError, match="one slice"):
        meshflow.read(made(tmp_path / "one", values=stored((1, 6, 7))))
    with pytest.raises(InputError, match="is a volume, got kind='image'"):
        meshflow.read(made(tmp_path / "two"), kind="image")
