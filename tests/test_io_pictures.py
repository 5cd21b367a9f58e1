"""Pictures come out in the type, the colours and the transparency that they came in with. meshflow.io.formats.pictures."""

import base64
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image as Pixels
from rasterio.enums import ColorInterp

from meshflow.errors import FormatError, InputError
from meshflow.io.files import Document, read, write
from meshflow.io.formats import pictures
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

SHARED = Path(__file__).parents[2] / "shared" / "data"
DRIVERS = {".png": "PNG", ".tif": "GTiff", ".bmp": "BMP", ".webp": "WEBP", ".jpg": "JPEG"}


def samples(count, dtype="uint8", h=12, w=16):
    largest = np.iinfo(dtype).max
    return np.random.default_rng(count).integers(1, largest, (count, h, w), endpoint=True).astype(dtype)


def make(path, picture, *, palette=None, colours=None, icc=None, **profile):
    with warnings.catch_warnings(), rasterio.Env(GDAL_PAM_ENABLED=False):
        warnings.simplefilter("ignore")
        count, height, width = picture.shape
        size = {"count": count, "height": height, "width": width, "dtype": picture.dtype}
        with rasterio.open(path, "w", driver=DRIVERS[path.suffix], **size, **profile) as target:
            if palette:
                target.write_colormap(1, palette)
            if colours:
                target.colorinterp = colours
            if icc:
                target.update_tags(ns="COLOR_PROFILE", SOURCE_ICC_PROFILE=icc)
            target.write(picture)
    return path


def stored(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path) as source:
            return source.read()


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_picture_comes_out_as_it_came_in(tmp_path, suffix, dtype, count):
    picture = samples(count, dtype)
    rgb = [ColorInterp.red, ColorInterp.green, ColorInterp.blue]
    colours = [*([ColorInterp.gray] if count < 3 else rgb), *([ColorInterp.alpha] if count % 2 == 0 else [])]
    path = make(tmp_path / f"a{suffix}", picture, colours=colours)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        document = read(path, kind="image")
        notes = write(document, tmp_path / f"b{suffix}")
    plain = count - (count % 2 == 0)
    assert document.data.values.shape == ((12, 16) if plain == 1 else (12, 16, 3))
    assert document.data.values.max() <= np.iinfo(dtype).max
    assert stored(tmp_path / f"b{suffix}").dtype == dtype
    assert np.array_equal(stored(tmp_path / f"b{suffix}"), picture)
    assert notes == ()
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"a{suffix}", f"b{suffix}"]


def test_a_picture_of_sixteen_bit_in_colour_survives(tmp_path):
    """The trap of Pillow, imageio and scikit-image: 16-bit colour becomes 8-bit without a word."""
    picture = samples(3, "uint16")
    document = read(make(tmp_path / "a.png", picture))
    assert np.array_equal(np.moveaxis(document.data.values, 2, 0), picture)
    write(document, tmp_path / "b.png")
    assert np.array_equal(stored(tmp_path / "b.png"), picture)


@pytest.mark.parametrize(("suffix", "count"), [(".bmp", 1), (".bmp", 3), (".webp", 3), (".webp", 4)])
def test_other_formats_without_loss_are_exact(tmp_path, suffix, count):
    picture = samples(count)
    if count == 4:
        picture[3, :2] = 0
    source = tmp_path / f"a{suffix}"
    make(source, picture, **({"lossless": True, "exact": True} if suffix == ".webp" else {}))
    document = read(source)
    assert document.data.values.ndim == (2 if count == 1 else 3)
    write(document, tmp_path / f"b{suffix}")
    again = read(tmp_path / f"b{suffix}")
    assert np.array_equal(again.data.values, document.data.values)
    assert np.array_equal(again.data.missing, document.data.missing)


def test_jpeg_is_near(tmp_path):
    x = np.linspace(0, 200, 32)
    document = read(make(tmp_path / "a.png", np.stack([np.add.outer(x, x) / 2] * 3).astype("uint8")))
    assert write(document, tmp_path / "b.jpg") == ()
    off = np.abs(read(tmp_path / "b.jpg").data.values - document.data.values)
    assert off.max() <= 4, f"largest change {off.max()}"


def test_alpha_is_not_smoothed_and_what_is_transparent_is_missing_and_kept(tmp_path):
    picture = samples(4)
    picture[3, 2:5, 3] = 0
    document = read(make(tmp_path / "a.png", picture))
    assert np.argwhere(document.data.missing).tolist() == [[2, 3], [3, 3], [4, 3]]
    smoothed = np.where(document.data.missing[..., None], document.data.values, np.float32(100))
    write(document.holding(replace(document.data, values=smoothed)), tmp_path / "b.png")
    out = stored(tmp_path / "b.png")
    assert np.array_equal(out[3], picture[3])
    assert np.array_equal(out[:, 2:5, 3], picture[:, 2:5, 3])
    assert (out[:3, picture[3] > 0] == 100).all()


def test_what_was_opaque_stays_opaque_in_another_type(tmp_path):
    picture = samples(4)
    picture[3] = 255
    write(read(make(tmp_path / "a.png", picture)), tmp_path / "b.png", dtype="uint16")
    out = stored(tmp_path / "b.png")
    assert (out[3] == 65535).all()
    assert np.array_equal(out[:3], picture[:3])


def test_a_palette_is_expanded(tmp_path):
    palette = {0: (255, 0, 0, 255), 1: (0, 128, 0, 255), 2: (1, 2, 3, 255)}
    picture = samples(1) % 3
    document = read(make(tmp_path / "a.png", picture, palette=palette))
    expected = np.array([palette[i][:3] for i in picture.ravel()]).reshape(12, 16, 3)
    assert np.array_equal(document.data.values, expected)
    assert "palette" in document.notes[0]
    write(document, tmp_path / "b.png")
    assert np.array_equal(stored(tmp_path / "b.png"), np.moveaxis(expected, 2, 0))


def test_a_transparent_entry_of_a_palette_is_missing(tmp_path):
    palette = {0: (255, 0, 0, 0), 1: (0, 128, 0, 255)}
    picture = samples(1) % 2
    document = read(make(tmp_path / "a.tif", picture, palette=palette), kind="image")
    if document.source.frame.alpha is None:  # TIFF has no room for alpha in its colour table
        assert not document.data.missing.any()
    path = make(tmp_path / "a.png", picture, palette=palette)
    document = read(path)
    assert np.array_equal(document.data.missing, picture[0] == 0)
    write(document, tmp_path / "b.png")
    assert np.array_equal(stored(tmp_path / "b.png")[3], np.where(picture[0] == 0, 0, 255))


def test_the_colour_profile_is_kept(tmp_path):
    cms = pytest.importorskip("PIL.ImageCms")
    icc = base64.b64encode(cms.ImageCmsProfile(cms.createProfile("sRGB")).tobytes()).decode()
    path = make(tmp_path / "a.png", samples(3), icc=icc)
    write(read(path), tmp_path / "b.png")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path) as source, rasterio.open(tmp_path / "b.png") as target:
            kept = target.tags(ns="COLOR_PROFILE")["SOURCE_ICC_PROFILE"]
            assert kept == source.tags(ns="COLOR_PROFILE")["SOURCE_ICC_PROFILE"]


def test_values_are_rounded_and_clipped_and_clipping_is_said(tmp_path):
    document = read(make(tmp_path / "a.png", samples(1)))
    values = np.full((12, 16), 10.6, "float32")
    values[0, :3] = -3, 255.4, 300
    notes = write(document.holding(replace(document.data, values=values)), tmp_path / "b.png")
    assert stored(tmp_path / "b.png")[0, 0, :4].tolist() == [0, 255, 255, 11]
    assert notes == ("2 samples were clipped to 0 to 255, the range of uint8",)


def test_a_float_tiff_keeps_every_bit(tmp_path):
    document = read(make(tmp_path / "a.png", samples(3)))
    values = document.data.values + np.float32(0.3)
    write(
        document.holding(replace(document.data, values=values)),
        tmp_path / "b.tif",
        dtype="float32",
        tags={"meshflow:q": "2"},
    )
    assert np.array_equal(np.moveaxis(stored(tmp_path / "b.tif"), 0, 2), values)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(tmp_path / "b.tif") as target:
            assert target.colorinterp[0] == ColorInterp.red
            assert target.tags(ns="meshflow") == {"q": "2"}


def test_an_image_of_arrays_is_written_where_its_type_is_said(tmp_path):
    values = np.full((4, 5, 3), 7.4, "float32")
    values[1, 1] = np.nan
    document = Document(Image(values), tmp_path / "a.npy")
    with pytest.raises(FormatError, match="uint8 or uint16 fits into .png, got float32; give it as dtype="):
        write(document, tmp_path / "a.png")
    notes = write(document, tmp_path / "a.png", dtype="uint8")
    assert stored(tmp_path / "a.png")[:, 1, 1].tolist() == [0, 0, 0]
    assert (stored(tmp_path / "a.png")[:, 0] == 7).all()
    assert notes == ("3 missing samples (NaN) became 0",)


@pytest.mark.parametrize(
    ("name", "count", "dtype", "expected"),
    [
        ("a.jpg", 3, "uint16", "uint8 fits into .jpg, got uint16"),
        ("a.bmp", 3, "uint16", "uint8 fits into .bmp, got uint16"),
        ("a.webp", 1, "uint8", "3 colours fit into .webp, got 1"),
        ("a.png", 2, "uint8", "1 or 3 colours fit into .png, got 2"),
    ],
)
def test_a_format_that_does_not_hold_the_picture_is_refused(tmp_path, name, count, dtype, expected):
    values = np.moveaxis(samples(count, dtype), 0, 2)
    data = Image(values if count > 1 else values[..., 0])
    document = Document(data, tmp_path / "a.npy")
    with pytest.raises(FormatError, match=expected):
        write(document, tmp_path / name, dtype=dtype)
    assert list(tmp_path.iterdir()) == []


def test_alpha_that_does_not_fit_is_lost_with_a_note(tmp_path):
    document = read(make(tmp_path / "a.png", samples(4)))
    assert write(document, tmp_path / "b.jpg") == (".jpg has no room for alpha: it is lost",)


def test_a_grey_picture_can_be_a_terrain_and_one_in_colour_cannot(tmp_path):
    grey = samples(1, "uint16")
    document = read(make(tmp_path / "a.png", grey), kind="terrain")
    assert isinstance(document.data, HeightField)
    assert np.array_equal(document.data.z, grey[0])
    assert isinstance(pictures.read(tmp_path / "a.png", ReadOptions(kind="terrain")).data, HeightField)
    make(tmp_path / "c.png", samples(3))
    with pytest.raises(InputError, match="grey picture expected as a terrain, got 3 colours"):
        pictures.read(tmp_path / "c.png", ReadOptions(kind="terrain"))
    with pytest.raises(InputError, match="an image or a terrain, got kind='mesh'"):
        pictures.read(tmp_path / "a.png", ReadOptions(kind="mesh"))


def test_a_broken_picture_is_refused(tmp_path):
    for count in (1, 3):
        path = make(tmp_path / "a.png", samples(count, h=200, w=200))
        short = tmp_path / "short.png"
        short.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(FormatError, match="short.png cannot be read"):
            read(short)
    text = tmp_path / "text.jpg"
    text.write_text("words")
    with pytest.raises(FormatError, match="text.jpg cannot be read"):
        read(text)


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_a_photograph_comes_out_as_it_came_in(tmp_path):
    path = SHARED / "images" / "moonlanding.png"
    document = read(path)
    assert document.data.values.shape == (474, 630)
    write(document, tmp_path / "out.png")
    assert np.array_equal(stored(tmp_path / "out.png"), stored(path))


def test_grey_of_16_bit_with_holes_is_asked_for_its_camera_before_any_work(tmp_path):
    rng = np.random.default_rng(2)
    depth = (1500 + 5 * np.arange(64) + rng.normal(0, 9, (48, 64))).astype(np.uint16)
    depth[10:20, 5:30] = 0
    Pixels.fromarray(depth).save(tmp_path / "depth.png")
    with pytest.raises(InputError, match=r"250 holes .*camera='tum'.*kind='image'"):
        read(tmp_path / "depth.png")
    assert read(tmp_path / "depth.png", kind="image").kind == "image"
    camera = Pinhole(60, 60, 31.5, 23.5)
    assert read(tmp_path / "depth.png", camera=camera).kind == "depth"
    grey = (np.arange(64) * 900 + rng.normal(0, 300, (48, 64))).clip(0, 65535).astype(np.uint16)
    Pixels.fromarray(grey).save(tmp_path / "grey.png")
    assert (grey == 0).mean() > 0.005
    assert read(tmp_path / "grey.png").kind == "image", "black is no hole"
