"""Windows of a grid, of any shape and in any order, equal the whole bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.windows import H, W, by_windows, same, terrain
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow import Beltrami, Compute, Fixed, Heat, Mask, MaxChange, Mobility
from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.large.census import census_of, counted_in, joined
from meshflow.large.source import Held, tiled
from meshflow.results.run import run
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

METHODS = {
    "beltrami": Beltrami(contrast=2.0),
    "sharp": Beltrami(gamma=-1.0, sharpness=2.0, contrast=1.5),
    "patches": Beltrami(patch=0.7, contrast=2.0),
    "projection": Beltrami(gamma=1.0, indicator="projection", contrast=1.0),
    "ring": Beltrami(mass="ring", contrast=1.0),
    "heat": Heat(),
    "twicing": Beltrami(contrast=2.0, twicing=0.5),
}


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(
    method=st.sampled_from(sorted(METHODS)),
    time=st.sampled_from([0.4, 2.0, 14.0]),
    boundary=st.sampled_from(["plane-preserving", "neumann", "fixed"]),
    sides=st.tuples(st.integers(1, H), st.integers(1, W)).filter(lambda s: s[0] * s[1] > 40),
    kind=st.sampled_from(["float32", "float64", "rows", "far", "whole", "two"]),
    held=st.sampled_from(["none", "mask", "fixed", "limit", "limits", "mobility", "all"]),
    diagonals=st.sampled_from(["alternate", "both", "forward"]),
    seed=st.integers(0, 3),
    legs=st.sampled_from([1, 1, 3, 100]),
)
def test_windows_of_any_shape_equal_the_whole_bit_for_bit(
    method, time, boundary, sides, kind, held, diagonals, seed, legs
):  # each is a part of the law
    if kind == "two" and method in ("sharp", "projection"):
        method = "patches"
    options = {
        "float64": {"dtype": np.float64},
        "rows": {"rows": True},
        "far": {"level": 3000.0},
        "whole": {"holes": 0},
    }
    data = terrain(seed=seed, **({"k": 2} if kind == "two" else options.get(kind, {})))
    rng = np.random.default_rng(seed + 9)
    constraints = {
        "mask": [Mask(rng.random((H, W)) < 0.8)],
        "fixed": [Fixed(rng.random((H, W)) < 0.1)],
        "limit": [MaxChange(0.5)],
        "limits": [MaxChange(rng.random((H, W)))],
        "mobility": [Mobility(rng.random((H, W)))],
    }
    constraints["none"], constraints["all"] = [], [constraints[name][0] for name in ("mask", "limits", "mobility")]
    request = Request.of(
        METHODS[method], (), constraints[held], time=time, noise=1.0, boundary=boundary, outliers="include",
        compute=Compute(diagonals=diagonals),
    )  # fmt: skip
    done, _ = by_windows(data, request, sides, legs=legs)
    same(done, array_of(run(data, request, record=None).after))


@pytest.mark.long
@settings(max_examples=10, deadline=None)
@given(
    kind=st.sampled_from(["terrain", "image", "colours"]),
    hurt=st.sampled_from(["hot", "salt", "many", "marks", "strays", "levels", "lakes"]),
    outliers=st.sampled_from([None, "keep", "repair"]),
    method=st.sampled_from([Beltrami(contrast=2.0), "quick"]),
    sides=st.tuples(st.integers(7, H), st.integers(7, W)),
    seed=st.integers(0, 5),
)
def test_outliers_are_found_by_windows_as_in_the_whole(kind, hurt, outliers, method, sides, seed):
    data, rng = terrain(seed=seed, k=3 if kind == "colours" else 0), np.random.default_rng(seed)
    values = array_of(data).copy()
    at = rng.random((H, W)) < {"hot": 0.004, "salt": 0.08, "many": 0.25}.get(hurt, 0.002)
    if hurt == "marks":
        at[5:14, 20:31] = True
    values[at] = {"marks": -9999.0, "salt": values.max() + 3, "many": values.min() - 2}.get(hurt, 60.0)
    if hurt == "strays":
        values[at] = 1e5 * (1 + rng.random(int(at.sum()))).reshape(-1, *(1,) * (values.ndim - 2))
    if hurt == "levels":
        values = np.rint(values)
    if hurt == "lakes":
        values[30:44, 3:17] = 0.0
    values = values.astype(np.float32)
    data = HeightField(values, data.spacing, data.missing) if kind == "terrain" else Image(values, missing=data.missing)
    constraints = [Mask(rng.random((H, W)) < 0.9)] if seed == 5 else []
    given = {} if method == "quick" else {"time": 2.0, "noise": 1.0}
    request = Request.of(method, (), constraints, outliers=outliers, **given)
    done, _ = by_windows(data, request, sides)
    same(done, array_of(run(data, request, record=None).after))


@pytest.mark.parametrize("stop", [meshflow.Residual(0.8), meshflow.AreaLoss(0.05), meshflow.Residual(1.0)])
@pytest.mark.parametrize("stepper", ["auto", "explicit"])
def test_a_stop_is_met_by_windows_where_the_whole_meets_it(stop, stepper):
    data = terrain()
    request = Request.of(
        Beltrami(contrast=2.0), stop, noise=1.0, time=30.0 if stop == meshflow.Residual(1.0) else None,
        outliers="include", compute=Compute(stepper=stepper),
    )  # fmt: skip
    whole = run(data, request, record=None)
    done, found = by_windows(data, request, (17, 23))
    same(done, array_of(whole.after))
    assert found.found.time == whole.end.time


@pytest.mark.parametrize("weights", ["one", "each", "none free"])
def test_weights_of_samples_hold_by_windows_as_they_do_in_the_whole(weights):
    data, rng = terrain(rows=True), np.random.default_rng(2)
    each = {"one": 0.3, "each": 3 * rng.random((H, W)), "none free": np.full((H, W), 4.0)}[weights]
    request = Request.of(
        Beltrami(contrast=2.0), (), [meshflow.DataWeights(each)], time=3.0, noise=1.0, outliers="include"
    )
    whole = array_of(run(data, request, record=None).after)
    done, found = by_windows(data, request, (17, 23))
    same(done, whole)
    free = replace(request, constraints=replace(request.constraints, data_weights=None))
    assert not np.array_equal(whole, array_of(run(data, free, record=None).after), equal_nan=True)
    assert found.local.plan.most_pull == pytest.approx(np.max(each) / 4)


@pytest.mark.long
@pytest.mark.parametrize("method", [None, "quick", "search", Beltrami(second_stage=True)])
@pytest.mark.parametrize("k", [0, 3])
def test_what_is_chosen_by_default_runs_by_windows_as_it_does_on_the_whole(method, k):
    data = terrain(k=k, rows=not k)
    request = Request.of(method, outliers="include")
    if k and not isinstance(
        method, Beltrami
    ):  # methods with steps of all samples are left out of the choice of colours
        whole, _ = by_windows(data, request, (H, W))
    else:
        whole = array_of(run(data, request, record=None).after)
    for legs in (1, 5):
        done, found = by_windows(data, request, (17, 23), legs=legs)
        same(done, whole)
    assert (found.local.plan.groups is not None) == isinstance(method, Beltrami)
    assert found.found.idle is None
    assert not np.array_equal(done, array_of(data))


@pytest.mark.long
def test_a_plan_found_on_spread_tiles_is_that_of_the_whole_to_the_error_of_its_estimates():
    data = terrain(400, 500, holes=0.01)
    request = Request.of(outliers="include")
    small, found = by_windows(data, request, (150, 500), enough=240 * 240, side=40)
    one, _ = by_windows(data, request, (400, 500), enough=240 * 240, side=40)
    same(small, one)
    chosen = run(data, replace(request, method=meshflow.Search(second_stage=False)), record=None)
    assert found.found.noise.sigma == pytest.approx(chosen.noise.sigma, rel=0.1)
    assert any("tiles spread over the whole" in word for word in found.warnings)
    y, x = np.mgrid[0:400, 0:500]
    clean = (4 * np.sin(y / 7) * np.cos(x / 5) + 6 * (x > 250))[~data.missing]
    errors = [float(np.sqrt(np.mean(np.square(z[~data.missing] - clean)))) for z in (small, array_of(chosen.after))]
    assert errors[0] < 1.1 * errors[1], errors


def test_the_order_of_windows_and_of_their_counts_does_not_matter():
    data = terrain(rows=True)
    source, shape = Held(data), (H, W)
    windows = list(tiled(shape, (9, 11)))
    counts = [counted_in(window, *source.read(window), source.form) for window in windows]
    one, two = joined(counts, source.form), joined(counts[::-1], source.form)
    same(one.some, two.some)
    assert one.whole.ends == two.whole.ends == census_of(source).whole.ends
    assert one.orientation(Compute()) == two.orientation(Compute())


def test_noise_free_data_comes_back_as_it_is():
    data = replace(terrain(), z=np.ones((H, W), np.float32))
    done, found = by_windows(data, Request.of(), (20, 20))
    same(done, array_of(data))
    assert found.found.idle is not None


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"stop": meshflow.Displacement(0.9)}, "stop: not in windows, any single sample may meet it"),
        ({"level": "rows"}, "level: not in windows"),
        ({"time": 1.0, "compute": Compute(stepper="semi-implicit")}, "stepper='semi-implicit': an implicit step"),
        ({"constraints": MaxChange("step")}, "max_change='step': not in windows"),
        ({"constraints": Mask(np.ones((3, 3), bool))}, "mask: one number per sample, shape"),
    ],
)
def test_what_no_window_can_know_is_refused_in_one_line_that_says_why(options, why):
    with pytest.raises(InputError, match=why) as refusal:
        by_windows(terrain(), Request.of(options.pop("method", None), **options), (20, 20))
    assert "\n" not in str(refusal.value)


def test_a_grid_without_a_present_sample_is_refused():
    data = terrain()
    values, missing = array_of(data), np.ones((H, W), bool)
    with pytest.raises(InputError, match="all .* samples are missing"):
        joined([counted_in((slice(0, H), slice(0, W)), values, missing, Held(data).form)], Held(data).form)
