"""Arrays in memory and in files of numpy. meshflow.io.formats.arrays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.flow.stops import Steps
from meshflow.io.document import WriteOptions
from meshflow.io.files import Document, read, write
from meshflow.io.formats import arrays
from meshflow.io.objects import from_object
from meshflow.smoothing import smooth
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

SHARED = Path(__file__).parents[2] / "shared" / "data"
CAMERA = Pinhole(525, 525, 3.5, 2.5)
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]], dtype="float32")
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def heights(dtype="float32"):
    return (np.arange(48).reshape(6, 8) % 7 * 10).astype(dtype)


def moved(data):
    """The data object, every sample that is there 0.25 higher, as a flow would hand it back."""
    missing = data.missing if data.missing is not None else None
    match data:
        case HeightField():
            return replace(data, z=np.where(missing, data.z, data.z + np.float32(0.25)))
        case Image():
            gone = missing if data.values.ndim == 2 else missing[..., None]
            return replace(data, values=np.where(gone, data.values, data.values + np.float32(0.25)))
        case RangeImage():
            return replace(data, depth=np.where(missing, data.depth, data.depth + np.float32(0.25)))
    raise AssertionError(data)


# --- what is what


def test_the_shape_and_the_camera_say_what_an_array_is():
    assert isinstance(from_object(heights()).data, HeightField)
    assert isinstance(from_object(np.dstack([heights()] * 3)).data, Image)
    assert isinstance(from_object(heights(), {"kind": "image"}).data, Image)
    depth = from_object(heights() + 1, {"camera": CAMERA}).data
    assert isinstance(depth, RangeImage)
    assert depth.jump == "noise"
    assert isinstance(from_object((POINTS, FACES)).data, Mesh)
    assert isinstance(from_object([POINTS, FACES.tolist()]).data, Mesh)


def test_hints_reach_the_data_object():
    mask = np.zeros((6, 8), bool)
    mask[2, 3] = True
    data = from_object(heights(), {"spacing": (2.0, 3.0), "missing": mask}).data
    assert data.spacing == (2, 3)
    assert np.array_equal(data.missing, mask)
    data = from_object((POINTS, FACES), {"channels": np.arange(4.0), "moves": "channels"}).data
    assert data.moves == "channels"
    assert data.channels.shape == (4, 1)


@pytest.mark.parametrize(
    ("data", "hints", "expected"),
    [
        (
            heights(),
            {"channels": 1},
            "channels: no option of an array of heights, which takes kind, spacing, missing, nodata, unit",
        ),
        (heights(), {"kind": "image", "moves": "all"}, "moves: no option of an array of channels"),
        (heights() + 1, {"camera": CAMERA, "spacing": 2}, "spacing: no option of an array of depths"),
        ((POINTS, FACES), {"spacing": 2, "camera": CAMERA}, r"camera, spacing: no option of \(points, faces\)"),
        (
            heights(),
            {"kind": "mesh"},
            "terrain, image, depth, volume, vectors or tensors expected for an array, got 'mesh'",
        ),
        ((POINTS, FACES), {"kind": "terrain"}, "kind='terrain'"),
        (heights(), {"kind": "depth"}, "needs its camera"),
        ("dem.tif", {}, "dem.tif: no such file"),
        (heights(), {"fixed": heights() > 0}, "fixed: a constraint, no option of a reader; give constraints=Fixed"),
        (heights(), {"max_change": 1.0}, "give constraints=MaxChange"),
        (heights(), {"spacng": 2}, "spacng: no such option; did you mean spacing"),
        ([[1, 2], [3, 4]], {}, r"\(points, faces\) of shapes .* make a grid of numbers an array first"),
        ((POINTS, FACES, FACES), {}, "expected of a tuple, got 3 parts"),
        ({"z": 1}, {}, "an array expected, got dict"),
        (np.zeros(5), {}, r"2 dimensions expected, got shape \(5,\)"),
        (np.zeros(()), {"spacing": (np.ones(16), 1.0)}, "spacing"),
        (np.zeros((0, 0)), {"missing": np.nan}, "the array of shape \\(0, 0\\) is empty"),
        (np.full((4, 4), "a"), {"camera": CAMERA}, "real numbers expected, got dtype <U1"),
        (
            np.ma.array(np.zeros((4, 4, 2), "m8[s]"), mask=True),
            {"kind": "vectors"},
            "real numbers expected, got dtype timedelta",
        ),
        (heights() * 1j, {}, "real numbers expected, got dtype complex64"),
        (np.full((3, 3), np.nan), {}, "all 9 samples are missing"),
    ],
)
def test_what_cannot_be_imported_is_refused_with_the_way_out(data, hints, expected):
    with pytest.raises(InputError, match=expected):
        from_object(data, hints)


@pytest.mark.long
def test_numbers_of_numpy_are_numbers():
    points = meshflow.Scattered(np.random.default_rng(0).uniform(0, 9, (40, 2)), np.arange(40.0))
    for word in ("time", "scale", "noise", "strength"):
        one, two = (meshflow.smooth(points, **{word: given}).values for given in (2.0, np.array(2.0)))
        assert np.array_equal(one, two)


def test_a_path_is_read_and_what_comes_back_is_a_document(tmp_path):
    np.save(tmp_path / "z.npy", heights())
    for path in (tmp_path / "z.npy", str(tmp_path / "z.npy")):
        taken = from_object(path, {"spacing": 3.0})
        assert taken.data.spacing == (3.0, 3.0)
        back = taken.to_object(moved(taken.data))
        assert isinstance(back, Document)
        assert np.array_equal(back.data.z, moved(taken.data).z)
        assert np.array_equal(smooth(path, stop=Steps(2)).data.z, smooth(heights(), stop=Steps(2)))
    with pytest.raises(InputError, match="channels: no option of an array of heights"):
        from_object(tmp_path / "z.npy", {"channels": "heat"})


# --- what comes back


@pytest.mark.parametrize(
    ("given", "expected"),
    [("uint8", "f4"), ("int16", "f4"), ("int32", "f8"), ("int64", "f8"), ("float16", "f4"), ("float32", "f4"), ("float64", "f8"),
     (">f4", "f4"), (">i2", "f4"), (">f8", "f8"), ("bool", "f4")],
)  # fmt: skip
def test_numbers_come_back_as_native_floats_wide_enough(given, expected):
    taken = from_object(heights(given))
    back = taken.to_object(moved(taken.data))
    assert back.dtype == np.dtype(expected)
    assert back.dtype.isnative
    assert np.array_equal(back, heights(given).astype(expected) + np.float32(0.25))


def test_what_comes_back_is_never_a_view_and_what_came_in_is_never_changed():
    for data in (heights(), np.dstack([heights()] * 2), np.ma.masked_equal(heights(), 0)):
        before = np.array(data, copy=True)
        taken = from_object(data)
        back = taken.to_object(taken.data)
        assert not np.shares_memory(np.asarray(back), np.asarray(data))
        back[...] = -1
        assert np.array_equal(np.asarray(data), before)
    taken = from_object((POINTS, FACES))
    points, faces = taken.to_object(taken.data)
    assert not np.shares_memory(points, POINTS)
    assert not np.shares_memory(faces, FACES)


@pytest.mark.parametrize("layout", ["strided", "reversed", "fortran", "read-only", "big-endian"])
def test_the_layout_in_memory_does_not_matter(layout):
    z = heights("float64")
    views = {
        "strided": np.repeat(z, 2, axis=1)[:, ::2],
        "reversed": z[::-1].copy()[::-1],
        "fortran": np.asfortranarray(z),
        "read-only": z.copy(),
        "big-endian": z.astype(">f8"),
    }
    data = views[layout]
    data.flags.writeable = layout != "read-only"
    taken = from_object(data)
    back = taken.to_object(moved(taken.data))
    assert np.array_equal(back, z + 0.25)
    assert back.flags.writeable


def test_missing_samples_come_back_bit_for_bit():
    z = heights()
    z.view("uint32")[1, 1] = 0x7FC12345  # a NaN with a message
    z[2, 2] = np.inf
    taken = from_object(z)
    back = taken.to_object(moved(taken.data))
    assert taken.data.missing.sum() == 2
    assert back.view("uint32")[1, 1] == 0x7FC12345
    assert back[2, 2] == np.inf


def test_masked_arrays_come_back_with_their_mask():
    z = np.ma.masked_equal(heights("int16"), 30)
    taken = from_object(z)
    assert np.array_equal(taken.data.missing, z.mask)
    back = taken.to_object(moved(taken.data))
    assert isinstance(back, np.ma.MaskedArray)
    assert np.array_equal(back.mask, z.mask)
    assert not np.shares_memory(back.mask, z.mask)
    assert np.array_equal(back.data, np.where(z.mask, z.data, z.data + np.float32(0.25)))
    assert back.dtype == np.float32
    channels = np.ma.array(np.dstack([heights()] * 2), mask=False)
    channels[1, 1, 0] = np.ma.masked
    back = from_object(channels).to_object(from_object(channels).data)
    assert np.array_equal(back.mask, channels.mask)
    assert np.ma.getmask(from_object(np.ma.array(heights())).to_object(from_object(heights()).data)) is np.ma.nomask


def test_meshes_come_back_as_they_came():
    taken = from_object((POINTS, FACES))
    points, faces = taken.to_object(replace(taken.data, points=POINTS + 1))
    assert np.array_equal(points, POINTS + 1)
    assert points.dtype == np.float32
    assert np.array_equal(faces, FACES)
    for channels in (np.arange(4.0), np.arange(8.0).reshape(4, 2)):
        taken = from_object((POINTS, FACES), {"channels": channels, "moves": "channels"})
        _, _, back = taken.to_object(taken.data)
        assert np.array_equal(back, channels)
        assert not np.shares_memory(back, channels)


# --- files


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_files_of_arrays_come_out_as_they_came_in(tmp_path, suffix):
    for z in (heights(), np.dstack([heights("float64")] * 3)):
        z[1, 1] = np.nan
        save = np.save if suffix == ".npy" else np.savez
        save(tmp_path / f"a{suffix}", z)
        document = read(tmp_path / f"a{suffix}", spacing=2.0)
        assert document.data.spacing == (2, 2)
        assert write(document, tmp_path / f"b{suffix}", overwrite=True) == ()
        back = np.load(tmp_path / f"b{suffix}")
        back = back if suffix == ".npy" else back["arr_0"]
        assert back.dtype == z.dtype
        assert back.tobytes() == z.tobytes()


def test_depths_in_an_array_are_metres_as_given(tmp_path):
    depth = heights() / 10
    np.savez(tmp_path / "a.npz", depth=depth, time=3.0)
    document = read(tmp_path / "a.npz", camera=CAMERA)
    assert document.kind == "depth"
    assert np.array_equal(document.data.missing, depth == 0)
    write(document.holding(moved(document.data)), tmp_path / "b.npz")
    back = np.load(tmp_path / "b.npz")
    assert np.array_equal(back["depth"], np.where(depth == 0, 0, depth + np.float32(0.25)))
    assert back["time"] == 3.0


def test_the_array_of_an_archive_is_found_by_its_name(tmp_path):
    for key in ("z", "values", "depth", "data"):
        np.savez(tmp_path / "a.npz", first=np.zeros(3), **{key: heights()})
        assert np.array_equal(read(tmp_path / "a.npz").data.z, heights())
    np.savez(tmp_path / "b.npz", anything=heights())
    assert np.array_equal(read(tmp_path / "b.npz").data.z, heights())
    np.savez(tmp_path / "c.npz", first=heights(), second=heights())
    with pytest.raises(FormatError, match=r"c\.npz holds the arrays first, second; one named z, values, depth, data"):
        read(tmp_path / "c.npz")


def test_points_and_faces_are_a_mesh_and_stay_one(tmp_path):
    np.savez(tmp_path / "a.npz", points=POINTS, faces=FACES, channels=np.arange(4.0), name="tetra")
    document = read(tmp_path / "a.npz")
    assert document.kind == "mesh"
    write(document.holding(replace(document.data, points=POINTS + 1)), tmp_path / "b.npz")
    back = np.load(tmp_path / "b.npz")
    assert np.array_equal(back["points"], POINTS + 1)
    assert np.array_equal(back["faces"], FACES)
    assert back["name"] == "tetra"
    with pytest.raises(FormatError, match="a mesh does not fit into .npy"):
        write(document, tmp_path / "b.npy")
    with pytest.raises(FormatError, match="a mesh is two arrays, points and faces; write .npz"):
        arrays.write(document, tmp_path / "b.npy", WriteOptions())


def test_nodata_of_the_caller_is_missing_and_kept(tmp_path):
    z = heights("int16")
    np.save(tmp_path / "a.npy", z)
    document = read(tmp_path / "a.npy", nodata=30)
    assert np.array_equal(document.data.missing, z == 30)
    write(document.holding(moved(document.data)), tmp_path / "b.npy")
    assert np.array_equal(np.load(tmp_path / "b.npy")[z == 30], z[z == 30])


def test_what_a_raster_marks_as_missing_is_nan_in_an_array(tmp_path):
    missing = heights() == 30
    terrain = Document(HeightField(heights(), missing=missing), tmp_path / "a.tif")
    write(terrain, tmp_path / "b.npy")
    assert np.array_equal(np.isnan(np.load(tmp_path / "b.npy")), missing)
    depth = Document(RangeImage(heights() + 1, CAMERA, missing), tmp_path / "a.png")
    write(depth, tmp_path / "c.npy")
    assert np.array_equal(np.load(tmp_path / "c.npy") == 0, missing)


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_an_array_says_that_it_has_no_room_for_the_crs(tmp_path):
    document = read(SHARED / "dem" / "SainteHelens.dem")
    assert "no room for CRS" in write(document, tmp_path / "a.npy")[0]
    assert np.array_equal(np.isnan(np.load(tmp_path / "a.npy")), document.data.missing)


def test_files_that_hold_no_numbers_are_refused(tmp_path):
    np.save(tmp_path / "objects.npy", np.array([{}, None]), allow_pickle=True)
    (tmp_path / "text.npy").write_text("words")
    (tmp_path / "text.npz").write_text("words")
    np.save(tmp_path / "whole.npy", heights())
    (tmp_path / "short.npy").write_bytes((tmp_path / "whole.npy").read_bytes()[:200])
    np.savez(tmp_path / "whole.npz", heights())
    (tmp_path / "short.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:200])
    for name in ("objects.npy", "text.npy", "text.npz", "short.npy", "short.npz"):
        with pytest.raises(FormatError, match=rf"{name} cannot be read .*numpy.save"):
            read(tmp_path / name)
    (tmp_path / "empty.npy").touch()
    with pytest.raises(FormatError, match="is empty"):
        read(tmp_path / "empty.npy")


def test_a_full_disk_leaves_the_old_array(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", heights())
    document = read(tmp_path / "a.npy")
    before = (tmp_path / "a.npy").read_bytes()

    whole = Path.write_bytes

    def full(path, _):
        whole(path, b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FormatError, match="No space left on device"):
        write(document, tmp_path / "a.npy", overwrite=True)
    assert (tmp_path / "a.npy").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.npy"]
