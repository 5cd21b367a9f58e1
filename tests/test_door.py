"""The door: what the signature shows is what there is, each part refuses its own nonsense, each option is declared once."""

import dataclasses
import inspect
import json
import operator
import typing
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import meshflow
from meshflow import (
    AreaLoss,
    Beltrami,
    Compute,
    CurvatureFlow,
    DataWeights,
    Displacement,
    Fairing,
    Fixed,
    MaxChange,
    MinComponent,
    NormalChannels,
    NormalFilter,
    PeronaMalik,
    PreserveVolume,
    PrincipalFlow,
    Residual,
    Search,
    Steps,
)
from meshflow.cli.commands import app
from meshflow.cli.flags import FLOW
from meshflow.errors import InputError
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.parameters import Parameter
from meshflow.estimate.request import Request
from meshflow.flow.methods import HEIGHT_METHODS, METHODS, POINT_METHODS, method_of
from meshflow.geometry.options import options_of
from meshflow.smoothing import Metadata, smooth

Z = np.random.default_rng(3).normal(size=(24, 24)) + np.arange(24) * 0.3


def test_the_signature_shows_all_that_there_is():
    shown = inspect.signature(smooth).parameters
    assert {
        "method",
        "time",
        "scale",
        "strength",
        "noise",
        "stop",
        "constraints",
        "boundary",
        "domain",
        "compute",
    } <= set(shown)
    assert all(p.annotation is not inspect.Parameter.empty for p in shown.values())
    assert shown["metadata"].annotation == typing.Unpack[Metadata]


def test_the_type_checker_knows_what_comes_back():
    kinds = [typing.get_type_hints(f)["return"] for f in typing.get_overloads(smooth)]
    assert meshflow.Result in kinds
    assert len(kinds) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"sharpnes": 2}, r"did you mean method=Beltrami\(sharpness"),
        ({"gamma": 1.0}, r"method=Beltrami\(gamma=\.\.\.\)"),
        ({"order": 3}, r"method=Fairing\(order=\.\.\.\)"),
        ({"max_change": 3}, r"constraints=MaxChange"),
        ({"steper": "auto"}, r"compute=Compute\(stepper"),
        ({"tim": 2.0}, "did you mean time"),
        ({"constraint": ()}, "did you mean constraints"),
        ({"spaceing": 2.0}, "did you mean spacing"),
    ],
)
def test_an_unknown_word_is_refused_with_what_was_meant(words, message):
    with pytest.raises(InputError, match=message):
        smooth(Z, **words)


@pytest.mark.parametrize(
    ("word", "meant"), [("peronna", "perona-malik"), ("normal_filtr", "normal-filter"), ("Fairin", "fairing")]
)
def test_an_unknown_method_is_refused_with_the_nearest_one(word, meant):
    with pytest.raises(InputError, match=f"did you mean {meant}"):
        method_of(word)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Beltrami(gamma="a"), "gamma: a finite number"),  # type: ignore[arg-type]
        (lambda: Beltrami(sharpness=0), "sharpness: a positive"),
        (lambda: Beltrami(patch=99), "patch: 0 to 6 samples"),
        (lambda: Beltrami(contrast=-1), "contrast: a positive"),
        (lambda: Beltrami(twicing=2), "twicing: 0 to 1 expected"),
        (lambda: PeronaMalik(mass="fat"), "mass: barycentric"),  # type: ignore[arg-type]
        (lambda: Fairing(order=0), "order: a whole number"),
        (lambda: Fairing(weights="heavy"), "weights: cotangent or uniform"),  # type: ignore[arg-type]
        (lambda: NormalFilter(crease_contrast=0), "crease_contrast: a positive"),
        (lambda: NormalFilter(regularize=-1), "regularize: a squared length"),
        (lambda: PrincipalFlow(feature_length=0), "feature_length: a positive"),
        (lambda: NormalChannels(normal_weight=-2), "normal_weight: a positive"),
        (lambda: CurvatureFlow(along="up"), "along: all or normals"),  # type: ignore[arg-type]
        (lambda: Residual(1.5), "residual: a share"),
        (lambda: AreaLoss(1.0), "area_loss: a share"),
        (lambda: Displacement(0), "displacement: a positive"),
        (lambda: Steps(-1), "steps: a whole number"),
        (lambda: MinComponent(0), "min_component: a whole number"),
        (lambda: PreserveVolume(by="magic"), "by: normals or scaling"),  # type: ignore[arg-type]
        (lambda: Compute(dt=0), "dt: a positive"),
        (lambda: Compute(threads=0), "threads: a whole number"),
        (lambda: Compute(triangles="round"), "triangles: auto"),  # type: ignore[arg-type]
        (lambda: Compute(search="yes"), "search: True, False or None"),  # type: ignore[arg-type]
        (lambda: Request(time=True), "time: a finite number"),
        (lambda: Request(time=1.0, scale=2.0), "give one of them"),
        (
            lambda: Request(domain="moon"),
            "domain: auto, length, disparity, luv, lab, linear-rgb, stabilized or magnitudes",
        ),  # type: ignore[arg-type]
        (lambda: Request(compute="fast"), "compute: a Compute"),  # type: ignore[arg-type]
        (lambda: Request.of(stop=[Steps(2), Steps(3)]), "Steps is given twice"),
        (lambda: Request.of(stop=[Residual(0.9), Residual(0.5)]), "Residual is given twice"),
        (lambda: Request.of(stop=5), "stop: Steps, Residual"),  # type: ignore[arg-type]
        (lambda: Request.of(stop=Residual), r"got the class Residual; give Residual\(\)"),  # type: ignore[arg-type]
        (lambda: Request.of(constraints=[MaxChange(1), MaxChange(2)]), "MaxChange is given twice"),
        (lambda: Request.of(constraints=["fixed"]), "constraints: one of Fixed"),  # type: ignore[list-item]
        (lambda: Request.of(constraints=Fixed()), "Fixed: a value expected"),
        (lambda: Request.of(method=PeronaMalik), r"give PeronaMalik\(\)"),  # type: ignore[arg-type]
        (lambda: Request.of(constraints=PreserveVolume), r"give PreserveVolume"),  # type: ignore[arg-type]
        (lambda: Request.of(constraints="volume"), "got the text 'volume'"),  # type: ignore[arg-type]
        (
            lambda: Request.of(constraints=[PreserveVolume(), meshflow.PreserveArea()]),
            "one of PreserveVolume and PreserveArea",
        ),
        (lambda: Request.of(method=3), "method: a name or a method"),  # type: ignore[arg-type]
        (lambda: Request.of(method=Search(twicing=1.0), stop=Residual(0.5)), "a time is doubled"),
    ],
)
def test_each_part_refuses_its_own_nonsense_when_it_is_made(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("kind", [*METHODS.values(), Compute, Request, Constraints])
def test_parts_are_frozen_and_hashable_where_they_hold_no_arrays(kind):
    part = kind()
    with pytest.raises(dataclasses.FrozenInstanceError):
        part.time = 1  # type: ignore[attr-defined]


def test_a_word_stands_for_the_class_with_its_defaults():
    for word, kind in METHODS.items():
        assert method_of(word) == kind()
        assert method_of(kind()) == kind()


def test_each_option_is_declared_once_and_is_a_flag_with_its_meaning():
    flags = {flag.name: flag for flag in FLOW}
    assert len(flags) == len(FLOW)
    for kind in (*HEIGHT_METHODS, *POINT_METHODS, Request, Compute):
        for option in options_of(kind):
            if option.has_flag:
                assert option.meaning.split(".")[0] in flags[option.flag.replace("-", "_")].help, option.name


def test_an_option_of_one_name_means_one_thing():
    meanings = {}
    for kind in (*HEIGHT_METHODS, *POINT_METHODS):
        for option in options_of(kind):
            assert meanings.setdefault(option.name, option.meaning) == option.meaning, option.name


def test_a_parameter_that_is_a_number_behaves_as_one():
    p = Parameter(3.0, "m²", "given", "asked for")
    assert p == 3.0
    assert float(p) == 3.0
    assert [f(p, 2.0) for f in (operator.add, operator.sub, operator.mul, operator.truediv)] == [5.0, 1.0, 6.0, 1.5]
    assert [f(6.0, p) for f in (operator.add, operator.sub, operator.mul, operator.truediv)] == [9.0, 3.0, 18.0, 2.0]
    assert p > 2
    assert p < 4
    assert f"{p:.2f}" == "3.00"
    assert str(p) == "3 m² (given, asked for)"
    assert np.sqrt(float(p)) == np.sqrt(3.0)
    assert Parameter("metric") == "metric"


def test_parameters_are_made_from_the_plan():
    found = smooth(Z, method=Beltrami(gamma=-1.0, contrast=2.0), time=1.5, result=True)
    reported = {name: (p.value, p.origin) for name, p in found.parameters.items()}
    assert reported["gamma"] == (-1.0, "given")
    assert reported["contrast"] == (2.0, "given")
    assert reported["time"] == (1.5, "given")
    assert reported["noise"][1] == "estimated"
    assert found.history.time[-1] == pytest.approx(1.5)
    assert json.loads(found.to_json())["parameters"]["time"]["value"] == 1.5


def test_what_is_fully_named_is_not_searched_for(monkeypatch):
    def refused(*_):
        raise AssertionError("searched")

    monkeypatch.setattr("meshflow.estimate.heights.searched_on_grid", refused)
    monkeypatch.setattr("meshflow.estimate.points.searched", refused)
    smooth(Z, method=Beltrami(gamma=0.0, contrast=2.0), time=1.0)
    smooth(Z, method="quick")
    ball = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], float)
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    smooth((ball, faces), method=Fairing(order=2, weights="uniform"), time=0.01)
    smooth((ball, faces), method="quick")
    with pytest.raises(AssertionError, match="searched"):
        smooth(Z)


def test_one_constraint_or_stop_needs_no_list():
    one = smooth(Z, time=1.0, constraints=MaxChange(0.1), stop=Steps(3), method=Beltrami())
    many = smooth(Z, time=1.0, constraints=[MaxChange(0.1)], stop=[Steps(3)], method=Beltrami())
    assert (one == many).all()
    assert np.abs(one - Z).max() <= 0.1 + 1e-12
    assert not np.array_equal(one, smooth(Z, time=1.0, constraints=DataWeights(2.0), method=Beltrami()))


def test_the_noise_of_any_data_can_be_asked_for():
    z = np.random.default_rng(0).normal(scale=2.0, size=(96, 96))
    assert meshflow.estimate_noise(z).sigma == pytest.approx(2.0, rel=0.1)
    with pytest.raises(InputError, match="did you mean spacing"):
        meshflow.estimate_noise(z, spacin=2.0)


def test_the_version_is_said_in_python_and_by_the_command():
    reported = CliRunner().invoke(app, ["--version"])
    assert reported.exit_code == 0
    assert reported.output.strip() == meshflow.__version__


def test_the_environment_is_said_for_reports_of_faults():
    reported = CliRunner().invoke(app, ["info", "--environment", "--json"])
    found = json.loads(reported.output)
    assert {"meshflow", "python", "numpy", "threads", "instruction set"} <= set(found)
    assert found["meshflow"] == meshflow.__version__


def test_methods_and_options_are_listed_from_their_declarations():
    methods = json.loads(CliRunner().invoke(app, ["methods", "--json"]).output)
    assert [row["method"] for row in methods] == list(METHODS)
    options = json.loads(CliRunner().invoke(app, ["options", "--json"]).output)
    assert [row["option"] for row in options] == [f"--{flag.name.replace('_', '-')}" for flag in FLOW]


def test_the_help_shows_first_what_most_need():
    text = CliRunner().invoke(app, ["smooth", "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output
    first = text[text.index("Most used") : text.index("Heights, channels")]
    assert sum(line.lstrip("│| ").startswith("--") for line in first.splitlines()) == 10


@pytest.mark.parametrize(("command", "extra"), [("film", "meshflow[film]"), ("view", "meshflow[web]")])
def test_the_help_names_what_to_install_in_full(command, extra):
    assert extra in CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output


def test_an_option_of_another_method_is_refused_with_those_that_have_it(tmp_path):
    np.save(tmp_path / "z.npy", Z)
    words = ["smooth", str(tmp_path / "z.npy"), str(tmp_path / "o.npy"), "--method", "graph", "--order", "3"]
    told = CliRunner().invoke(app, words)
    assert told.exit_code != 0
    assert "--order: no option of method graph; it belongs to fairing" in str(told.exception)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ({"sigma": 2.0}, "give noise="),
        ({"iterations": 3}, r"give stop=Steps\(count=...\)"),
        ({"sharpness": 2.0, "method": "perona-malik"}, r"method=PeronaMalik\(sharpness"),
    ],
)
def test_the_words_of_other_tools_are_pointed_to_what_is_here(words, hint):
    with pytest.raises(InputError, match=hint):
        meshflow.smooth(Z, **words)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ({"result": "yes"}, "result: True or False expected"),
        ({"unit": 3}, "unit: the name of a unit"),
        ({"method": "heat", "time": 1e12}, "wide as the data"),
        ({"method": "heat", "scale": 1e200}, "whose square is a number"),
        ({"constraints": meshflow.Mask("mask.tif")}, r"of a file, give its samples: meshflow.read"),
    ],
)
def test_nonsense_is_refused_before_the_work(words, expected):
    with pytest.raises(InputError, match=expected):
        meshflow.smooth(Z, **words)


def test_a_path_is_read_and_nothing_else():
    with pytest.raises(InputError, match="a path expected, got int"):
        meshflow.read(3)


def test_diagonals_of_a_mesh_are_refused():
    with pytest.raises(InputError, match="which has its own triangles"):
        meshflow.smooth((np.eye(3), np.array([[0, 1, 2]])), compute=meshflow.Compute(diagonals="both"))


@pytest.mark.parametrize(
    ("words", "expected"),
    [(["--dtype", "foo"], "dtype: source or one of"), (["--order", "3"], "--order: belongs to fairing; methods for")],
)
def test_what_does_not_suit_the_data_or_its_file_is_refused_before_the_work(words, expected, tmp_path, monkeypatch):
    source, target = Path(__file__).parents[1] / "data" / "terrain.tif", tmp_path / "o.tif"
    worked = []
    monkeypatch.setattr("meshflow.cli.commands.smooth_object", lambda *a, **k: worked.append(1))
    told = CliRunner().invoke(app, ["smooth", str(source), str(target), *words])
    assert expected in str(told.exception)
    assert not worked


def test_the_table_of_methods_has_plain_words():
    told = CliRunner().invoke(app, ["methods", "--json"]).output
    assert "``" not in told
    assert ":class:" not in told
