"""Pictures that were compressed are told from others, with their quality and the size of their error."""

import io
import re

import numpy as np
import pytest
from PIL import Image as Picture

import meshflow
from meshflow.estimate.jpeg import jpeg_of, table_of
from meshflow.surfaces.image import Image

data = pytest.importorskip("skimage.data")
NAMES = ("camera", "astronaut", "chelsea", "coffee")


def subject(name, size=160):
    return getattr(data, name)()[100 : 100 + size, 100 : 100 + size]


def compressed(picture, quality):
    kept = io.BytesIO()
    Picture.fromarray(picture).save(kept, "JPEG", quality=quality)
    return np.asarray(Picture.open(kept)).astype(np.float64)


def luminance(picture):
    return picture if picture.ndim == 2 else picture @ [0.299, 0.587, 0.114]


def none(picture):
    return np.zeros(picture.shape[:2], bool)


def decibels(picture, truth):
    return -10 * np.log10(np.mean((picture - truth) ** 2))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("quality", [10, 30, 50, 75])
def test_the_quality_and_the_error_of_a_compressed_picture_are_found(name, quality):
    truth = subject(name)
    picture = compressed(truth, quality)
    found = jpeg_of(picture, none(picture))
    assert abs(found.quality - quality) <= 1
    error = np.sqrt(np.mean((luminance(picture) - luminance(truth.astype(float))) ** 2))
    assert 0.75 < found.sigma / error < 1.55


@pytest.mark.parametrize("cut", [(3, 6), (0, 1), (7, 7)])
def test_the_lattice_of_blocks_is_found_where_a_picture_was_cut_out(cut):
    picture = compressed(subject("chelsea"), 40)[cut[0] :, cut[1] :]
    assert jpeg_of(picture, none(picture)).quality == 40
    turned = np.ascontiguousarray(picture[::-1])
    assert jpeg_of(turned, none(turned)).quality == 40


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_that_was_never_compressed_is_told_from_those_that_were(name):
    truth = subject(name).astype(float)
    noisy = np.clip(np.rint(truth + 8 * np.random.default_rng(0).normal(size=truth.shape)), 0, 255)
    for picture in (truth, noisy, truth / 255.0, 256.0 * truth):
        assert jpeg_of(picture, none(picture)) is None
    drawing = np.kron(np.random.default_rng(1).integers(0, 256, (20, 20)), np.ones((8, 8)))
    assert jpeg_of(drawing, none(drawing)) is None


@pytest.mark.long
@pytest.mark.parametrize(("name", "quality", "gain"), [("camera", 20, 0.4), ("coffee", 50, 0.3)])
def test_a_compressed_picture_becomes_better_by_default_and_the_result_says_why(name, quality, gain):
    truth, picture = subject(name).astype(float), compressed(subject(name), quality)
    found = meshflow.smooth(Image(picture), result=True)
    assert decibels(found.after.values, truth) > decibels(picture, truth) + gain
    said = re.search(r"from the steps of JPEG compression, quality (\d+)", found.parameters["noise"].why)
    assert abs(int(said[1]) - quality) <= 1


def test_the_steps_are_those_that_libraries_write():
    for quality in (5, 35, 50, 80):
        kept = io.BytesIO()
        Picture.fromarray(np.zeros((16, 16), np.uint8)).save(kept, "JPEG", quality=quality)
        written = Picture.open(kept).quantization[0]
        assert sorted(written) == sorted(table_of(quality).ravel())
