"""Colours smoothed in L*u*v*, L*a*b* and linear light (section 4.3 of the paper): domain="luv"."""

import json

import numpy as np
import pytest
from PIL import Image as Picture
from skimage import color
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import InputError
from meshflow.surfaces.colour_space import COLOUR_SPACES
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

WORDS = tuple(COLOUR_SPACES)
THEIRS = {"luv": color.rgb2luv, "lab": color.rgb2lab}


def colours(size=32, sigma=0.06, word=None, seed=0):
    """Two halves of one lightness and other hues, and noise: truth and noisy, shares of white.

    :param word: the space in which the noise is the same everywhere; it is sigma times the greatest value of white there.
    """
    truth = np.empty((size, size, 3))
    truth[:, : size // 2], truth[:, size // 2 :] = (0.7, 0.4, 0.3), (0.3, 0.55, 0.6)
    noise = sigma * np.random.default_rng(seed).normal(size=truth.shape)
    if word is None:
        return truth, truth + noise
    space = COLOUR_SPACES[word]
    return truth, space.back(space.of(truth) + space.of(np.ones(3)).max() * noise)


@pytest.mark.parametrize("word", THEIRS)
def test_colours_are_those_of_scikit_image(word):
    rgb = np.random.default_rng(0).random((40, 50, 3))
    rgb[0, :5] = [(0, 0, 0), (1, 1, 1), (1, 0, 0), (0, 0, 1), (1e-3, 2e-3, 1e-3)]
    assert np.abs(COLOUR_SPACES[word].of(rgb) - THEIRS[word](rgb)).max() < 2e-3  # they round the constants of the CIE


@pytest.mark.parametrize("word", WORDS)
def test_there_and_back_is_the_same_to_rounding(word):
    rgb = np.random.default_rng(1).random((60, 70, 3)) ** 3
    rgb[0, :4] = [(0, 0, 0), (1, 1, 1), (0, 0, 1), (0, 1e-9, 0)]
    if not COLOUR_SPACES[word].positive:
        rgb -= 0.1
    space = COLOUR_SPACES[word]
    assert np.abs(space.back(space.of(rgb)) - rgb).max() < 1e-13


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("white", [1.0, 255.0, 65535.0])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_data_that_does_not_change_keeps_its_bits_and_its_type(word, white, dtype):
    values = (white * np.random.default_rng(2).random((8, 9, 3))).astype(dtype)
    values[2, 3] = np.nan
    found = meshflow.smooth(values, time=0.0, domain=word)
    assert found.dtype == dtype
    assert np.array_equal(found, values, equal_nan=True)
    every = np.ones((8, 9), bool)
    held = meshflow.smooth(values, time=2.0, method="beltrami", domain=word, constraints=meshflow.Fixed(every))
    assert np.array_equal(held, values, equal_nan=True)


@pytest.mark.long
@pytest.mark.parametrize("word", WORDS)
def test_noise_goes_and_the_result_does_not_depend_on_the_value_of_white(word):
    truth, noisy = colours(32, 0.05, word)
    found, scaled = (meshflow.smooth(white * noisy, domain=word, result=True) for white in (1.0, 255.0))
    assert np.std(found.data - truth) < 0.35 * np.std(noisy - truth)
    assert np.abs(scaled.data / 255.0 - found.data).max() < 1e-9
    for result, white in ((found, 1.0), (scaled, 255.0)):
        assert result.parameters["white"].value == white
        assert result.parameters["domain"].value == word


@pytest.mark.long
@pytest.mark.parametrize("word", WORDS)
def test_the_noise_of_each_channel_is_told_in_the_space(word):
    truth, noisy = colours(96, 0.01, word)
    space = COLOUR_SPACES[word]
    found = meshflow.smooth(noisy, domain=word, result=True)
    real = np.std(space.of(noisy) - space.of(truth), axis=(0, 1))
    for name, sigma in zip(space.channels, real, strict=True):
        assert float(found.parameters[f"noise {name}"]) == pytest.approx(sigma, rel=0.15), name


@pytest.mark.long
@pytest.mark.parametrize("word", WORDS)
def test_a_given_noise_is_that_of_the_values_and_told_as_that_of_the_space(word):
    space, truth = COLOUR_SPACES[word], np.full((64, 64, 3), (0.7, 0.4, 0.3))
    noisy = truth + 0.01 * np.random.default_rng(0).normal(size=truth.shape)
    found = meshflow.smooth(noisy, domain=word, noise=0.01, result=True)
    real = np.sqrt(np.mean(np.square(space.of(noisy) - space.of(truth))))
    assert float(found.parameters["noise"]) == pytest.approx(real, rel=0.02)
    assert found.noise.sigma == 0.01


@pytest.mark.parametrize("word", WORDS)
def test_alpha_is_kept_to_the_bit(word):
    _, noisy = colours()
    alpha = np.random.default_rng(3).random(noisy.shape[:2])
    found = meshflow.smooth(np.dstack([noisy, alpha]), domain=word)
    assert np.array_equal(found[..., 3], alpha)
    assert np.array_equal(found[..., :3], meshflow.smooth(noisy, domain=word))


@pytest.mark.parametrize("word", WORDS)
def test_colours_on_a_mesh_are_smoothed_likewise(word):
    grid = meshflow.to_mesh(meshflow.HeightField(np.zeros((24, 24))))
    left = []
    for seed in range(3):  # of one draw alone the chosen contrast is a matter of chance
        truth, noisy = colours(24, seed=seed)
        mesh = Mesh(grid.vertices, grid.faces, noisy.reshape(-1, 3))
        found = meshflow.smooth(mesh, domain=word, method="beltrami", time=3.0)
        assert np.array_equal(found.points, mesh.points)
        left.append(np.std(found.channels - truth.reshape(-1, 3)) / np.std(noisy - truth))
    assert np.mean(left) < 0.6


def test_black_and_values_below_zero_are_told_and_stay_finite():
    _, noisy = colours(24)
    noisy[:8] = 0.02 * np.random.default_rng(5).normal(size=noisy[:8].shape)
    found = meshflow.smooth(noisy, domain="luv", result=True)
    assert np.isfinite(found.data).all()
    assert np.abs(found.data).max() < 1.5
    assert any("below zero" in said for said in found.warnings)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.zeros((9, 9)), "of three colours"),
        (np.zeros((9, 9, 2)), "of three colours"),
        (1e6 * np.ones((9, 9, 3)), "up to 1, 255 or 65535"),
    ],
)
def test_what_has_no_colours_is_refused(data, words):
    with pytest.raises(InputError, match=words):
        meshflow.smooth(data, domain="luv", kind="image" if data.ndim == 3 else None, time=1.0)


def test_words_in_any_spelling_and_the_named_way_out():
    _, noisy = colours(16)
    one = meshflow.smooth(Image(noisy), time=1.0, domain="Linear RGB")  # type: ignore[arg-type]
    assert np.array_equal(one.values, meshflow.smooth(Image(noisy), time=1.0, domain="linear-rgb").values)
    with pytest.raises(InputError, match="did you mean luv"):
        meshflow.smooth(noisy, domain="lux")  # type: ignore[arg-type]


def test_a_picture_with_alpha_by_the_command(tmp_path):
    truth, noisy = colours(48)
    alpha = np.full((48, 48, 1), 200, np.uint8)
    Picture.fromarray(np.dstack([np.clip(255 * noisy, 0, 255).astype(np.uint8), alpha])).save(tmp_path / "in.png")
    words = ["smooth", str(tmp_path / "in.png"), str(tmp_path / "out.png"), "--domain", "luv", "--json"]
    told = json.loads(CliRunner().invoke(app, words).stdout)["parameters"]
    assert told["domain"]["value"] == "luv"
    assert told["white"]["value"] == 255
    back = np.asarray(Picture.open(tmp_path / "out.png"))
    assert back.dtype == np.uint8
    assert (back[..., 3] == 200).all()
    assert np.std(back[..., :3] / 255.0 - truth) < 0.55 * np.std(noisy - truth)
