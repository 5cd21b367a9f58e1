"""Windows of a volume, of any shape and in any order, equal the whole bit for bit; so do chunks of dask."""

import numpy as np
import pytest
from helpers.windows import SHAPE, by_windows, same, volume
from hypothesis import given, settings
from hypothesis import strategies as st

from meshflow import (
    Beltrami,
    Compute,
    DataWeights,
    Fixed,
    Heat,
    Mask,
    MaxChange,
    Mobility,
    PeronaMalik,
    Residual,
    Search,
)
from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.results.run import run

METHODS = {
    "beltrami": Beltrami(contrast=2.0),
    "sharp": PeronaMalik(contrast=1.5),
    "heat": Heat(),
    "twicing": Beltrami(contrast=2.0, twicing=0.5),
}


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(
    method=st.sampled_from(sorted(METHODS)),
    time=st.sampled_from([0.2, 0.6, 8.0]),
    boundary=st.sampled_from(["neumann", "fixed"]),
    sides=st.tuples(*(st.integers(3, size) for size in SHAPE)).filter(lambda sides: np.prod(sides) > 300),
    kind=st.sampled_from(["float32", "float64", "far", "whole", "two"]),
    held=st.sampled_from(["none", "mask", "fixed", "limits", "mobility"]),
    diagonals=st.sampled_from(["alternate", "both", "backward"]),
    seed=st.integers(0, 3),
    legs=st.sampled_from([1, 2, 100]),
)
def test_windows_of_any_shape_equal_the_whole_bit_for_bit(
    method, time, boundary, sides, kind, held, diagonals, seed, legs
):  # each is a part of the law
    if kind == "two" and method == "sharp":
        method = "beltrami"
    options = {"float64": {"dtype": np.float64}, "far": {"level": 3000.0}, "whole": {"holes": 0}, "two": {"k": 2}}
    data = volume(seed=seed, **options.get(kind, {}))
    numbers = np.random.default_rng(seed + 9).random(SHAPE)
    constraints = {
        "none": [], "mask": [Mask(numbers < 0.8)], "fixed": [Fixed(numbers < 0.1)], "limits": [MaxChange(numbers)],
        "mobility": [Mobility(numbers)],
    }[held]  # fmt: skip
    request = Request.of(
        METHODS[method], (), constraints, time=time, noise=1.0, boundary=boundary, compute=Compute(diagonals=diagonals)
    )
    done, _ = by_windows(data, request, sides, legs=legs)
    same(done, run(data, request, record=None).after.values)


@pytest.mark.long
@pytest.mark.parametrize("method", [Search(second_stage=True), None, "quick"])
@pytest.mark.parametrize("k", [0, 2])
def test_what_is_chosen_runs_by_windows_as_it_does_on_the_whole(method, k):
    data = volume((14, 29, 17), k=k)
    request = Request.of(method)
    done, found = by_windows(data, request, (14, 10, 17), legs=8)
    same(done, run(data, request, record=None).after.values)
    assert found.local.plan.groups is not None or not isinstance(method, Search)
    assert found.found.idle is None
    assert not np.array_equal(done, data.values, equal_nan=True)


def test_a_plan_is_found_on_cubes_spread_over_the_whole():
    data = volume((40, 50, 36), holes=0.0)
    request = Request.of("quick")
    done, found = by_windows(data, request, (40, 30, 36), enough=36_000, side=16)
    same(done, by_windows(data, request, (20, 50, 36), enough=36_000, side=16)[0])
    assert found.found.data.missing.size < 0.7 * data.missing.size
    assert found.found.noise.sigma == pytest.approx(run(data, request, record=None).noise.sigma, rel=0.1)
    assert any("tiles spread over the whole" in word for word in found.warnings)


@pytest.mark.parametrize("constraint", [DataWeights(np.linspace(0, 2, np.prod(SHAPE)).reshape(SHAPE)), MaxChange(0.4)])
def test_stops_and_weights_of_samples_hold_by_windows_as_they_do_in_the_whole(constraint):
    request = Request.of(Beltrami(contrast=2.0), Residual(0.6), constraint, noise=1.0)
    whole = run(volume(), request, record=None)
    done, found = by_windows(volume(), request, (9, 12, 14))
    same(done, whole.after.values)
    assert found.found.time == whole.end.time


def test_what_no_window_can_know_is_refused():
    for options, why in (
        ({"method": Beltrami(gamma=-2.0, contrast=1.0), "time": 1.0}, "the length of its steps"),
        ({"time": 1.0, "compute": Compute(stepper="semi-implicit")}, "an implicit step needs all samples"),
        ({"constraints": Mask(np.ones((3, 3, 3), bool))}, "mask: one number per sample, shape"),
    ):
        with pytest.raises(InputError, match=why):
            by_windows(volume(), Request.of(options.pop("method", None), **options), (9, 9, 9), enough=500)
