"""What the methods say of themselves holds: what they conserve, their names, their papers and options."""

import json
from dataclasses import fields

import numpy as np
import pytest
from helpers.shapes import sphere
from typer.testing import CliRunner

import meshflow
from meshflow.cli.commands import app
from meshflow.errors import InputError
from meshflow.flow.compute import Compute
from meshflow.flow.methods import HEIGHT_METHODS, METHODS, POINT_METHODS, method_of, papers_of, word_of
from meshflow.flow.methods.beltrami import MEAN
from meshflow.geometry.operator import mass
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.image import Image

# Every system that the paper cites: the method that is meant.
CITED = {
    "PM90": "perona-malik", "ROF92": "rof", "ABBFC97": "half-quadratic", "ALM92": "selective", "KDA97": "shock",
    "FEF98": "mean-curvature",
    "KMS97": "beltrami", "SKM98": "beltrami", "Sha96": "shared-edges", "TT99": "low-curvature", "DMSB99": "implicit-fairing",
    "Tau95": "taubin",
}  # fmt: skip


def drift(method, channels, **compute):
    """By how much the mean changed, relative to the largest change: by area, and of the samples."""
    draw = np.random.default_rng(0)
    z = draw.normal(size=(15, 18, channels)) + 4.0 * (np.arange(18) > 8)[:, None]
    z[4:7, 9:12] = np.nan
    there = ~np.isnan(z[..., 0])
    found = meshflow.smooth(
        Image(z), method=method, time=2.0, noise=1.0, boundary="neumann", compute=Compute(**compute), outliers="include"
    ).values
    surface = Image(z, missing=~there).lifted(Lift(diagonals="both", boundary="neumann"))
    flat = surface.points[:, :2]
    area = sum(mass(flat, faces) for faces in surface.triangulations).reshape(there.shape)
    change = (found - z)[there]
    return tuple(
        float(np.abs(weights[there] @ change).max() / weights[there].sum() / np.abs(change).max())
        for weights in (area, np.ones_like(area))
    )


@pytest.mark.parametrize("kind", HEIGHT_METHODS, ids=lambda kind: kind.word)
@pytest.mark.parametrize("channels", [1, 2])
def test_the_mean_that_a_method_says_it_conserves_is_conserved_to_rounding(kind, channels):
    by_area, of_samples = drift(kind(), channels, diagonals="both")
    if kind.conserves == MEAN:
        assert by_area < 1e-10
    elif kind.conserves.startswith("the mean of the samples"):
        assert of_samples < 1e-10
    else:
        assert min(by_area, of_samples) > 1e-6


@pytest.mark.parametrize(
    "kind", [kind for kind in HEIGHT_METHODS if kind.conserves == MEAN], ids=lambda kind: kind.word
)
@pytest.mark.parametrize("channels", [1, 2])
def test_alternating_diagonals_conserve_what_both_together_do(kind, channels):
    by_area, _ = drift(kind(), channels, diagonals="alternate")
    assert by_area < 1e-10


@pytest.mark.parametrize("word", ["paper", "min-max"])
def test_no_value_leaves_the_range_where_a_method_says_so(word):
    assert "the range" in METHODS[word].conserves
    z = np.random.default_rng(1).normal(size=(30, 31))
    found = meshflow.smooth(z, method=word, time=20.0, noise=1.0, boundary="neumann")
    assert z.min() <= found.min() <= found.max() <= z.max()


@pytest.mark.parametrize("kind", POINT_METHODS, ids=lambda kind: kind.word)
def test_the_centre_of_a_closed_mesh_rests_where_a_method_says_so(kind):
    points, faces = sphere(500)
    draw = np.random.default_rng(2)
    points = points * [1.0, 1.3, 0.8] + 0.05 * draw.normal(size=points.shape) + 0.1 * np.abs(points)
    method = kind(order=2, weights="cotangent") if kind.word == "fairing" else kind()
    found = meshflow.smooth((points, faces), method=method, time=0.02)[0]
    weights = mass(points, faces)
    moved = np.abs(weights @ (found - points)).max() / weights.sum() / np.abs(found - points).max()
    if kind.conserves.startswith("of a closed mesh the centre"):
        assert moved < 1e-9
    else:
        assert moved > 1e-9


def test_every_cited_system_is_known_by_its_paper_and_in_any_spelling():
    for paper, word in CITED.items():
        assert word_of(paper) == word
        assert paper in papers_of(METHODS[word])
    for given, word in (
        ("lcis", "low-curvature"),
        ("Taubin", "taubin"),
        ("LambdaMu", "taubin"),
        ("lambda_mu", "taubin"),
    ):
        assert method_of(given).word == word
    for kind in (*HEIGHT_METHODS, *POINT_METHODS):
        assert word_of(kind.__name__) == kind.word
        assert word_of(kind.word.upper().replace("-", " ")) == kind.word
    for several, named in (("MS96", "graph.*min-max"), ("PR99", "field_picture")):
        with pytest.raises(InputError, match=named):
            method_of(several)


def test_no_two_methods_share_a_name():
    names = [name for kind in (*HEIGHT_METHODS, *POINT_METHODS) for name in (kind.word, *kind.aliases)]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("word", METHODS)
def test_the_options_of_one_method_are_listed_with_units_and_defaults(word):
    told = CliRunner().invoke(app, ["options", word.upper(), "--json"])
    rows = json.loads(told.output)
    declared = [field.name for field in fields(METHODS[word])]
    assert [row["in Python"] for row in rows] == [
        name for name in declared if name not in getattr(METHODS[word], "unused", ())
    ]
    assert all(row["meaning"] and row["default"] for row in rows)
    text = CliRunner().invoke(app, ["options", word], env={"COLUMNS": "200"}).output
    assert "It moves:" in text
    assert "It conserves:" in text


def test_an_unknown_method_has_no_options():
    told = CliRunner().invoke(app, ["options", "beltramy"])
    assert told.exit_code != 0
    assert "did you mean beltrami" in str(told.exception)


@pytest.mark.parametrize("word", ["shock", "min-max", "low-curvature"])
def test_a_scheme_whose_time_nobody_gave_changes_rough_data_by_no_more_than_the_noise_and_says_so(word):
    draw = np.random.default_rng(3)
    rough = 30.0 * np.cumsum(np.cumsum(draw.normal(size=(64, 64)), axis=0), axis=1) / 64
    noisy = rough + draw.normal(size=rough.shape)
    found = meshflow.smooth(noisy, method=word, noise=1.0, result=True)
    assert np.sqrt(np.mean(np.square(found.data - noisy))) < 1.1
    assert any("here it changes other things than noise" in said for said in found.warnings)
    longer = meshflow.smooth(noisy, method=word, noise=1.0, time=float(found.parameters["time"]), result=True)
    assert np.sqrt(np.mean(np.square(longer.data - noisy))) > 1.5
    flat = meshflow.smooth(draw.normal(size=(64, 64)), method=word, result=True)
    assert not any("other things than noise" in said for said in flat.warnings)
