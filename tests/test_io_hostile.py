"""Files that lie: whatever is in them, one line says what is wrong, before anything is allocated or read elsewhere."""

import json
import re
import struct
import zipfile
from contextlib import suppress

import numpy as np
import pytest
import rasterio
import trimesh
from rasterio.control import GroundControlPoint

import meshflow
from meshflow.errors import InputError
from meshflow.io.files import read, write
from meshflow.io.formats.cameras import read_camera
from meshflow.io.formats.raster_drivers import allowed_drivers

ASC = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9999\n"
VRT = (
    '<VRTDataset rasterXSize="4" rasterYSize="3"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
    '<SourceFilename relativeToVRT="{relative}">{name}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand>'
    "</VRTDataset>"
)


def refused(call, *words):
    with pytest.raises(InputError) as caught:
        call()
    said = str(caught.value)
    assert "\n" not in said
    for word in words:
        assert re.search(word, said), said


def tiff(path, **profile):
    z = np.arange(12, dtype=np.float32).reshape(3, 4)
    with rasterio.open(path, "w", driver="GTiff", width=4, height=3, count=1, dtype="float32", **profile) as target:
        target.write(z, 1)
    return z


# --- who reads what


@pytest.mark.parametrize(
    "suffix", [".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".asc", ".dem", ".hgt", ""]
)
def test_content_that_names_other_files_or_a_network_is_not_read_by_any_other_name(tmp_path, suffix):
    tiff(tmp_path / "secret.tif")
    path = tmp_path / f"a{suffix}"
    path.write_text(VRT.format(relative=0, name=tmp_path / "secret.tif"))
    refused(lambda: read(path, kind="terrain"))
    path.write_text('<GDAL_WMS><Service name="TMS"><ServerUrl>http://127.0.0.1:9/${z}</ServerUrl></Service></GDAL_WMS>')
    refused(lambda: read(path, kind="terrain"))
    assert not {"VRT", "WMS", "WCS", "WMTS", "HTTP"} & set(allowed_drivers(path))


def test_a_vrt_reads_its_own_folder_and_no_other(tmp_path):
    home = tmp_path / "home"
    (home / "tiles").mkdir(parents=True)
    z = tiff(home / "tiles" / "a.tif")
    tiff(tmp_path / "outside.tif")
    (home / "a.vrt").write_text(VRT.format(relative=1, name="tiles/a.tif"))
    assert np.array_equal(read(home / "a.vrt").data.z, z)
    for name in (
        "../outside.tif",
        str(tmp_path / "outside.tif"),
        "/vsicurl/http://127.0.0.1:9/a.tif",
        "http://127.0.0.1:9/a.tif",
    ):
        (home / "a.vrt").write_text(VRT.format(relative=1, name=name))
        refused(lambda: read(home / "a.vrt"), "a VRT reads files of its own folder alone, this one names")
    (home / "a.vrt").write_text(VRT.format(relative=1, name="../outside.tif"))
    assert np.array_equal(read(home / "a.vrt", allow_remote=True).data.z, z)


@pytest.mark.parametrize(
    "name",
    [
        "<![CDATA[../outside.tif]]>",
        "&#46;./outside.tif",
        "&lt;VRTDataset/&gt;",
        "inner.tif",
        "inner.vrt",
        "wms.tif",
        "{0}",
    ],
)
def test_a_vrt_does_not_get_out_by_another_way(tmp_path, name):
    home = tmp_path / "home"
    home.mkdir()
    tiff(tmp_path / "outside.tif")
    for inner in ("inner.tif", "inner.vrt"):
        (home / inner).write_text(VRT.format(relative=1, name="../outside.tif"))
    (home / "wms.tif").write_text('<GDAL_WMS><Service name="TMS"/></GDAL_WMS>')
    (home / "a.vrt").write_text(VRT.format(relative=1, name=name.format(tmp_path / "outside.tif")))
    refused(lambda: read(home / "a.vrt"), "a VRT reads files of its own folder alone|its source .* describes one")


@pytest.mark.parametrize(
    "uri", ["../outside.bin", "%2e%2e/outside.bin", "/etc/passwd", "http://127.0.0.1:9/gltf_buffer_0.bin"]
)
def test_a_gltf_reads_its_own_folder_and_no_other(tmp_path, uri):
    (tmp_path / "home").mkdir()
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.icosphere(1))).items():
        (tmp_path / "home" / name).write_bytes(content)
    path = tmp_path / "home" / "model.gltf"
    assert len(read(path).data.faces) == 80
    told = json.loads(path.read_text())
    told["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(told))
    refused(lambda: read(path), "a GLTF reads files of its own folder alone, this one names")


def test_heights_in_a_zip_are_read_and_no_broken_zip_ends_the_process(tmp_path):
    heights = (np.arange(1201 * 1201) % 500).reshape(1201, 1201)
    path = tmp_path / "N46E008.hgt.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("N46E008.hgt", heights.astype(">i2").tobytes())
    document = read(path)
    assert np.array_equal(document.data.z, heights)
    assert document.source.frame.transform.f == pytest.approx(47, abs=1e-3)
    whole, rng = path.read_bytes(), np.random.default_rng(5)
    for trial in range(40):
        content = bytearray(whole)
        for at in [*rng.integers(0, len(content), 2), -rng.integers(1, 100)]:
            content[at] = rng.integers(0, 256)
        path.write_bytes(content if trial % 4 else content[: rng.integers(1, len(content))])
        with suppress(InputError):
            read(path)


def test_a_picture_that_is_called_by_another_name_is_still_read(tmp_path):
    z = tiff(tmp_path / "a.tif")
    (tmp_path / "a.tif").rename(tmp_path / "a.png")
    assert np.array_equal(read(tmp_path / "a.png").data.values, z)


# --- sizes, before memory


def test_a_raster_larger_than_the_machine_is_refused_with_size_and_limit(tmp_path):
    with rasterio.open(
        tmp_path / "big.tif",
        "w",
        driver="GTiff",
        width=400_000,
        height=400_000,
        count=1,
        dtype="uint8",
        SPARSE_OK=True,
        tiled=True,
    ):
        pass
    refused(
        lambda: read(tmp_path / "big.tif"),
        r"1 x 400000 x 400000 samples are 640\.0 GB",
        "is the limit",
        "gdal_translate -srcwin",
    )


def test_a_picture_that_promises_what_no_compression_reaches_is_refused(tmp_path):
    profile = {"driver": "GTiff", "count": 1, "dtype": "uint8", "SPARSE_OK": True, "tiled": True}
    blocks = {"blockxsize": 16384, "blockysize": 16384}
    with rasterio.open(tmp_path / "a.tif", "w", width=32768, height=32768, **profile, **blocks):
        pass
    refused(lambda: read(tmp_path / "a.tif"), r"1 x 32768 x 32768 samples, 4\.3 GB .* promised in \d+ bytes")


def test_an_ascii_grid_that_promises_more_than_the_file_holds_is_refused(tmp_path):
    (tmp_path / "a.asc").write_text(ASC.replace("ncols 3", "ncols 50000").replace("nrows 2", "nrows 50000") + "1 2 3\n")
    refused(lambda: read(tmp_path / "a.asc"), "cut off, 50000 x 50000 numbers expected in 6 bytes")


def test_an_array_that_promises_more_than_the_file_holds_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((4, 4)))
    content = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(content.replace(b"(4, 4), }      ", b"(999999999999,)"))
    refused(lambda: read(tmp_path / "a.npy"), "a.npy cannot be read")


@pytest.mark.parametrize("count", ["4000000000", "16000000000000000000", "-1", "many"])
@pytest.mark.parametrize("element", ["vertex", "face", "range_grid"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_ply_that_promises_more_than_it_holds_is_refused_before_anything_is_made(tmp_path, count, element, form):
    counts = {"vertex": "3", "face": "1", "range_grid": "3"} | {element: count}
    text = f"ply\nformat {form} 1.0\nobj_info num_cols 3\nobj_info num_rows 1\nelement vertex {counts['vertex']}\n"
    text += "".join(f"property float {axis}\n" for axis in "xyz")
    for name in ("face", "range_grid"):
        if name != "range_grid" or element == name:
            text += f"element {name} {counts[name]}\nproperty list uchar int vertex_indices\n"
    body = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n1 0\n1 1\n1 2\n"
    if form != "ascii":
        body = np.eye(3, dtype="<f4").tobytes() + b"\x03" + np.arange(3, dtype="<i4").tobytes()
    (tmp_path / "a.ply").write_bytes((text + "end_header\n").encode() + body)
    refused(
        lambda: read(tmp_path / "a.ply"), f"{count} of element {element} promised in {len(body) + 1} bytes|promised in"
    )


def test_a_raster_of_more_bands_than_any_instrument_has_is_refused_and_one_of_them_is_read(tmp_path):
    with rasterio.open(
        tmp_path / "a.tif", "w", driver="GTiff", width=2, height=2, count=2000, dtype="uint8", interleave="pixel"
    ):
        pass
    refused(lambda: read(tmp_path / "a.tif"), "2000 bands, and 1024 smoothed as one image is the limit; choose one")
    assert read(tmp_path / "a.tif", band=1999).data.z.shape == (2, 2)


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply"])
def test_a_polygon_of_very_many_corners_is_refused_with_the_limit(tmp_path, suffix):
    for corners, fits in ((4096, True), (20_000, False)):
        angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
        rows = [f"{x!r} {y!r} 0" for x, y in np.c_[np.cos(angles), np.sin(angles)].tolist()]
        face = " ".join(map(str, range(corners)))
        text = {
            ".obj": "\n".join([f"v {row}" for row in rows] + ["f " + " ".join(map(str, range(1, corners + 1)))]) + "\n",
            ".off": "\n".join([f"OFF\n{corners} 1 0", *rows, f"{corners} {face}"]) + "\n",
            ".ply": "\n".join(
                [f"ply\nformat ascii 1.0\nelement vertex {corners}", *(f"property double {axis}" for axis in "xyz"),
                 "element face 1\nproperty list int int vertex_indices\nend_header", *rows, f"{corners} {face}"]) + "\n",
        }[suffix]  # fmt: skip
        (tmp_path / f"a{suffix}").write_text(text)
        if fits:
            assert len(read(tmp_path / f"a{suffix}").data.faces) == corners - 2
        else:
            refused(lambda: read(tmp_path / f"a{suffix}"), "a polygon of 20000 corners, and 4096 is the limit")


# --- words that are no numbers


@pytest.mark.parametrize("word", ["foo", "1,5x", "--", "e", "0x10", "<b>", "12_3", "inf", "-nan", "null"])
def test_a_word_in_an_ascii_grid_is_refused_with_its_line(tmp_path, word):
    (tmp_path / "a.asc").write_text(f"{ASC}1 2 3\n4 {word} 6\n")
    refused(lambda: read(tmp_path / "a.asc"), r"a\.asc, line 8: a number expected, got '" + re.escape(word))


@pytest.mark.parametrize(
    "numbers",
    [
        "1 2 3\n4 5 6\n",
        "1.5 -2e3 +3.\n.5 1E-4 -9999\n",
        "1 nan 3\r\n4 NaN 6\r\n",
        "1.5 nan 3\n4 5 6",
        "1\n2\n3\n4\n5\n6",
    ],
)
def test_numbers_in_an_ascii_grid_are_read(tmp_path, numbers):
    (tmp_path / "a.asc").write_text(ASC + numbers)
    expected = np.array(numbers.split(), dtype=np.float64).reshape(2, 3)
    data = read(tmp_path / "a.asc").data
    there = np.isfinite(expected) & (expected != -9999)
    np.testing.assert_allclose(data.z[there], expected[there], rtol=1e-6)
    assert np.array_equal(data.missing, ~there)


# --- broken inside


def test_no_byte_of_an_array_file_that_is_changed_or_cut_off_gives_another_error(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(12.0).reshape(3, 4))
    np.savez_compressed(tmp_path / "a.npz", z=np.arange(12.0).reshape(3, 4))
    rng = np.random.default_rng(3)
    for name in ("a.npy", "a.npz"):
        whole = (tmp_path / name).read_bytes()
        for trial in range(300):
            content = bytearray(whole)
            for at in rng.integers(0, len(content), 1 + trial % 3):
                content[at] = rng.integers(0, 256)
            (tmp_path / name).write_bytes(content if trial % 2 else content[: rng.integers(1, len(content))])
            with suppress(InputError):
                read(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    ['{"intrinsic": 5}', "[" * 100_000, '{"fx": 1e400}', '{"width": 1e999, "fx": 1, "fy": 1, "cx": 1, "cy": 1}', '"camera"', "5",
     '{"intrinsic_matrix": "a"}', '{"model": [], "fx": 1}', '{"depth_scale": "x", "fx": 1, "fy": 1, "cx": 1, "cy": 1}'],
)  # fmt: skip
def test_a_camera_file_that_is_none_is_refused_in_a_line(tmp_path, text):
    (tmp_path / "camera.json").write_text(text)
    refused(lambda: read_camera(tmp_path / "camera.json"), "camera")


def test_a_byte_order_mark_before_a_camera_is_no_part_of_it(tmp_path):
    words = {"fx": 525, "fy": 525, "cx": 3.5, "cy": 2.5}
    (tmp_path / "camera.json").write_text(json.dumps(words), encoding="utf-8-sig")
    assert read_camera(tmp_path / "camera.json") == meshflow.Pinhole(525, 525, 3.5, 2.5)


def test_an_archive_that_is_broken_inside_is_no_camera(tmp_path):
    with zipfile.ZipFile(tmp_path / "camera.npz", "w") as archive:
        archive.writestr("directions.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", 20) + b"{'descr': '<f8', 'fo")
    refused(lambda: read_camera(tmp_path / "camera.npz"), "camera")


def test_ground_control_points_without_a_crs_come_back(tmp_path):
    points = [GroundControlPoint(row, col, col * 2.0, row * 3.0) for row, col in ((0, 0), (0, 4), (3, 0), (3, 4))]
    tiff(tmp_path / "a.tif", gcps=points, crs=rasterio.crs.CRS())
    document = read(tmp_path / "a.tif")
    write(document, tmp_path / "b.tif")
    assert np.array_equal(read(tmp_path / "b.tif").data.z, document.data.z)


def test_a_crs_that_is_neither_projected_nor_geographic_has_no_unit_to_disagree_with(tmp_path):
    local = 'ENGCRS["grid",EDATUM["mine"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    geocentric = "EPSG:4978"
    for crs in (local, geocentric):
        tiff(tmp_path / "a.tif", crs=crs, transform=rasterio.Affine(2, 0, 0, 0, -2, 6))
        assert read(tmp_path / "a.tif").data.spacing == (2.0, 2.0)


def test_a_material_library_without_a_name_is_left_alone(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib \nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "elsewhere").mkdir()
    write(read(tmp_path / "a.obj"), tmp_path / "elsewhere" / "b.obj")
    assert "mtllib" in (tmp_path / "elsewhere" / "b.obj").read_text()


@pytest.mark.parametrize("size", [1e100, 1e155, 1e300])
def test_numbers_whose_squares_do_not_fit_are_refused(size):
    z = np.random.default_rng(0).normal(size=(24, 24)) * size
    refused(lambda: meshflow.smooth(z), r"up to 1e\+75 expected.*scale the data")
    ball = trimesh.creation.icosphere(1)
    refused(lambda: meshflow.smooth((ball.vertices * size, ball.faces)), r"up to 1e\+75 expected.*scale the data")
    marked = np.random.default_rng(0).normal(size=(24, 24))
    marked[3, 4] = size
    assert np.isfinite(meshflow.smooth(marked)).all()


def test_an_open_dataset_is_its_file_and_lists_are_told_apart(tmp_path):
    z = tiff(tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif") as source:
        assert np.array_equal(meshflow.smooth(source, time=0).data.z, z)
    with rasterio.MemoryFile((tmp_path / "a.tif").read_bytes()) as memory, memory.open() as source:
        refused(lambda: meshflow.smooth(source), r"dataset.read\(1, masked=True\)")
    refused(lambda: meshflow.smooth([z, z]), "one array expected, got a list of 2; smooth them one by one")


def test_a_ply_that_ends_within_a_line_is_no_smaller_mesh(tmp_path):
    trimesh.creation.icosphere(1).export(tmp_path / "a.ply", encoding="ascii")
    whole = (tmp_path / "a.ply").read_bytes().rstrip()
    assert len(read(tmp_path / "a.ply").data.faces) == 80
    for cut in range(whole.rindex(b"\n") + 2, len(whole) - 2):
        (tmp_path / "a.ply").write_bytes(whole[:cut])
        with suppress(InputError):
            assert len(read(tmp_path / "a.ply").data.faces) == 80
    square = whole.replace(b"element face 80", b"element face 81")
    (tmp_path / "a.ply").write_bytes(square + b"\n4 0 1 2\n")
    refused(lambda: read(tmp_path / "a.ply"), "cut off, 5 numbers expected in its last line, got 4")
