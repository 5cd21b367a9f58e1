"""Methods whose steps are as long as the data allows: windows find the lengths on all samples, and equal the whole to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.windows import by_windows, same, terrain
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow import Beltrami, Compute
from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.engines.grid import GridFlow
from meshflow.large.chunks import smooth_chunked
from meshflow.results.run import run
from meshflow.surfaces.data import array_of

# Each with a number of channels: cliffs are slow, channels couple, masses depend on the data, gradients are those of patches.
METHODS = {
    "cliffs": (Beltrami(gamma=-2.0, contrast=1.0), 0),
    "channels": (Beltrami(gamma=-1.0, contrast=1.0), 3),
    "masses": (Beltrami(gamma=0.0, contrast=1.0, mass="voronoi"), 0),
    "patches": (Beltrami(gamma=-0.5, contrast=1.0, patch=0.7, mass="voronoi"), 2),
}
EXPLICIT = Compute(stepper="explicit")


def asked(name, compute=EXPLICIT, **options):
    return Request.of(METHODS[name][0], noise=1.0, outliers="include", compute=compute, **options)


@settings(max_examples=12, deadline=None)
@given(
    name=st.sampled_from(sorted(METHODS)),
    sides=st.sampled_from([(20, 23), (61, 16), (33, 47)]),
    rows=st.booleans(),
    holes=st.sampled_from([0.0, 0.05]),
    end=st.sampled_from([{"time": 0.2}, {"stop": meshflow.Steps(7)}, {"scale": 1.0}]),
    seed=st.integers(0, 5),
)
def test_windows_equal_the_whole_where_steps_depend_on_all_samples(name, sides, rows, holes, end, seed):
    data, request = terrain(seed=seed, holes=holes, rows=rows, k=METHODS[name][1]), asked(name, **end)
    same(by_windows(data, request, sides, enough=400)[0], array_of(run(data, request).data))


@pytest.mark.parametrize(
    "options",
    [
        {"compute": Compute(stepper="explicit", dt=7e-4), "stop": meshflow.Steps(40)},
        {"constraints": [meshflow.MaxChange(0.5), meshflow.Mask(terrain(holes=0).missing)], "time": 0.2},
        {"constraints": meshflow.DataWeights(np.random.default_rng(0).random((61, 47))), "time": 0.2},
    ],
    ids=["dt", "limit", "weights"],
)
def test_windows_equal_the_whole_with_all_that_changes_steps(options):
    data, request = terrain(), asked("cliffs", **options)
    same(by_windows(data, request, (20, 23), enough=400, legs=3)[0], array_of(run(data, request).data))


def test_twicing_goes_on_after_the_time_in_the_steps_of_the_whole():
    data = terrain()
    request = Request.of(
        replace(METHODS["cliffs"][0], twicing=0.7), noise=1.0, outliers="include", time=0.1, compute=EXPLICIT
    )
    same(by_windows(data, request, (20, 23), enough=400)[0], array_of(run(data, request).data))


@pytest.mark.parametrize("name", METHODS)
def test_the_bound_of_windows_is_that_of_the_grid(name):
    method, k = METHODS[name]
    data = terrain(k=k)
    flow = GridFlow(data.gridded(meshflow.Lift(contrast=1.0)), method.variant)
    u, cuts = flow.start() + 0.25, ((0, 17, 40, 61), (0, 5, 47))
    parts = [
        flow.bound_within(u, (slice(*rows), slice(*columns)))
        for rows in zip(cuts[0], cuts[0][1:], strict=False)
        for columns in zip(cuts[1], cuts[1][1:], strict=False)
    ]
    assert max(parts) == flow.bound(u)
    assert min(parts) < max(parts)
    for wrong in (slice(0, 62), slice(5, 5), slice(-1, 4)):
        with pytest.raises(ValueError, match="do not belong together"):
            flow.bound_within(u, (wrong, slice(0, 47)))


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"time": 50.0, "compute": Compute()}, "take stepper='explicit'"),
        ({"time": 1.0, "stop": meshflow.Residual(0.9)}, "and so does where it stops; give a time"),
        ({"time": 1.0, "compute": Compute(stepper="explicit", dt=9.0)}, "dt: 9 is not stable with the explicit"),
    ],
)
def test_steps_that_are_not_found_on_all_samples_are_refused(options, why):
    with pytest.raises(InputError, match=why):
        by_windows(terrain(), asked("cliffs", **options), (20, 20), enough=400)


def test_chunks_that_are_computed_later_refuse_steps_that_depend_on_all_of_them():
    da = pytest.importorskip("dask.array")
    lazy = da.zeros((9000, 9000), chunks=3000) + 1.0
    with pytest.raises(InputError, match="follow from all samples, and so does their number; compute"):
        smooth_chunked(lazy, asked("cliffs", time=0.1), meshflow.io.metadata.ReadOptions())
