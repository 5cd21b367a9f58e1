"""The flow tunes itself: the risk that is estimated is the error that is made, and what is chosen is near the best."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers import shapes
from helpers.parts import parts

import meshflow
from meshflow.estimate import search_rounds
from meshflow.estimate.constraints import Fixed, Mask, MaxChange
from meshflow.estimate.families import FAMILY, configurations
from meshflow.estimate.grid_risk import probed
from meshflow.estimate.grid_search import searched_on_grid
from meshflow.estimate.pieces import pieces_of, spread, whole
from meshflow.estimate.probes import probes
from meshflow.estimate.reported import risk_of
from meshflow.estimate.request import Request
from meshflow.estimate.risk import PROBE, TWICE, Candidate, Configuration
from meshflow.estimate.search_rounds import GridSearch
from meshflow.estimate.sure import risks_on
from meshflow.flow.compute import Compute
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.family import Variant
from meshflow.flow.methods import HEIGHT_METHODS, METHODS, POINT_METHODS, Beltrami, PeronaMalik, Search
from meshflow.flow.steppers import SuperTime
from meshflow.flow.stops import Residual, Steps
from meshflow.results.run import states
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.synthetic.scenes import mesas, ramps


def noisy(make=ramps, n=128, sigma=2.0, seed=0):
    truth = make(n)
    return truth, truth + sigma * np.random.default_rng(seed).normal(size=truth.shape)


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


@pytest.mark.parametrize("variant", [Variant(patch=0.7), Variant(-1.0, 2.0)], ids=["patches", "perona-malik"])
def test_the_estimated_risk_is_the_error_that_is_made(variant):
    truth, z = noisy()
    part = whole(HeightField(z).gridded(Lift()), np.full((1, 1, 1), 2.0))
    times = (0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    curve = risks_on(probed(part, probes((1, *z.shape))), Configuration(variant, 0.8), times, (0.0, 1.0), len(times))
    for time in times[::2]:
        smoothed = meshflow.smooth(
            z,
            method=Beltrami(gamma=variant.gamma, sharpness=variant.sharpness, patch=variant.patch, contrast=0.8),
            time=time,
        )
        assert curve.mean(0.0, time) == pytest.approx(rms(smoothed - truth) ** 2, abs=0.25)
    again = meshflow.smooth(
        z,
        method=Beltrami(
            gamma=variant.gamma, sharpness=variant.sharpness, patch=variant.patch, contrast=0.8, twicing=1.0
        ),
        time=2.0,
    )
    assert curve.mean(1.0, 2.0) == pytest.approx(rms(again - truth) ** 2, abs=0.25)


@pytest.mark.long
@pytest.mark.parametrize("make", [ramps, mesas])
@pytest.mark.parametrize("sigma", [0.7, 4.0])
def test_what_is_chosen_is_near_the_best_that_there_is(make, sigma):
    truth, z = noisy(make, 96, sigma)
    ours = rms(meshflow.smooth(z) - truth)
    best = min(
        rms(state.z - truth)
        for kind in ({"gamma": 0, "patch": 1.0}, {"gamma": -1, "sharpness": 1.5}, {"gamma": -1, "sharpness": 2})
        for a in (1.0, 2.0, 4.0)
        for _, state in states(HeightField(z), Request.of(**parts(contrast=a / sigma, time=16.0, **kind)), 6)
    )
    assert ours < 1.15 * best, f"{ours:.3f}, and {best:.3f} with the truth in hand"
    assert ours < 0.45 * sigma


def test_an_error_estimated_below_zero_is_told_as_what_it_is():
    plain = Candidate(Configuration(Variant(), 1.0), (0.0, 1.0), (4.0, 1.0))
    assert risk_of(plain, "m").why == "root mean square error to be expected"
    below = risk_of(replace(plain, squares=(4.0, -0.1)), "m")
    assert below.value == 0.0
    assert below.why.startswith("below what can be measured; root mean square error")


def test_the_least_risk_is_one_that_was_evaluated():
    times = (0.0, 0.35, 0.5, 0.7, 1.0)
    diverging = Candidate(Configuration(Variant(), 1.0), times, (1.005, 0.331, 16.3, 6608.0, 3.4e8))
    assert diverging.least == (0.35, 0.331)


@pytest.mark.long
def test_a_search_on_tiles_chooses_what_a_search_on_all_would(monkeypatch):
    truth, z = noisy(lambda n: np.tile(ramps(96), (2, 3)), 0)
    all_of_it = rms(meshflow.smooth(z) - truth)
    monkeypatch.setattr("meshflow.estimate.grid_search.WHOLE", 6_000)
    monkeypatch.setattr("meshflow.estimate.grid_search.WHOLE_FINE", 6_000)
    assert rms(meshflow.smooth(z) - truth) < 1.15 * all_of_it


def test_tiles_keep_the_samples_their_spacing_and_their_holes():
    z = np.random.default_rng(0).normal(size=(300, 400))
    missing = z > 2
    grid = HeightField(z, (np.linspace(1, 2, 300), 1.5), missing).gridded(Lift())
    windows = spread(grid, 16)
    found = pieces_of(grid, windows, np.ones((1, 1, 1)), np.abs(z)[None])
    assert 12 <= len(windows) <= 20
    for piece in found:
        flat, most = piece.grid.planes[0].ravel()[piece.counted], piece.limit[0].ravel()[piece.counted]
        assert not piece.grid.missing.ravel()[piece.counted].any()
        assert np.isin(flat, z[~missing]).all()
        assert np.array_equal(np.abs(flat), most)
        assert len(flat) == len(np.unique(flat))
        rows = piece.counted // piece.grid.shape[1]
        whence = np.array([np.argwhere(z == value)[0][0] for value in flat[::97]])
        assert np.allclose(piece.grid.spacing[0][rows[::97]], np.linspace(1, 2, 300)[whence])


@pytest.mark.parametrize("at", [0.1, 0.25, 0.5, 0.62])
def test_a_front_is_in_as_large_a_share_of_the_tiles_as_of_the_grid_wherever_it_lies(at):
    y = np.indices((400, 400))[0]
    z = 12.0 * (y > at * 400) + np.random.default_rng(0).normal(size=y.shape)
    for lying in (z, z.T):
        grid, front = HeightField(lying).gridded(Lift()), (y > at * 400) if lying is z else (y > at * 400).T
        crossed = [front[window].any() and not front[window].all() for window in spread(grid, 16)]
        assert 0.05 <= np.mean(crossed) <= 0.3


def test_risks_of_copies_side_by_side_are_those_of_copies_run_alone():
    _, z = noisy(n=64)
    variant, times, h = Variant(-1.0, 2.0), (0.25, 0.5, 1.0), PROBE * 2.0
    probe = probes((1, *z.shape), 2)
    part = whole(HeightField(z).gridded(Lift()), np.full((1, 1, 1), 2.0))
    curve = risks_on(probed(part, probe), Configuration(variant, 0.5), times, (0.0, 1.0), len(times))
    runs = []
    for start in (z, *(z + h * one[0] for one in probe)):
        flow, states = GridFlow(HeightField(start).gridded(Lift(0.5)), variant), [start]
        u, since = flow.start(), 0.0
        for count, time in enumerate(times):
            u, since = SuperTime().step(flow, u, time - since, count), time
            states.append(u.reshape(z.shape).copy())
        runs.append(states)
    left = [
        np.mean([np.mean(b[0] * (run[i] - runs[0][i])) / h for b, run in zip(probe, runs[1:], strict=True)])
        for i in range(4)
    ]
    for i, time in enumerate(times, 1):
        expected = rms(runs[0][i] - z) ** 2 + 4.0 * (2.0 * left[i] - 1.0)
        assert curve.mean(0.0, time) == pytest.approx(expected, abs=1e-4)
    twiced = rms(2.0 * runs[0][2] - runs[0][3] - z) ** 2 + 4.0 * (2.0 * (2.0 * left[2] - left[3]) - 1.0)
    assert curve.mean(1.0, 0.5) == pytest.approx(twiced, abs=1e-4)


@pytest.mark.parametrize("between", [None, np.array([[1.0, 0.6], [0.6, 1.0]])])
def test_probes_correlate_as_the_noise_does(between):
    lags = np.arange(-4, 5)
    bell = np.exp(-(lags**2) / 4.0)
    correlation = np.outer(bell, bell)
    found = probes((2, 256, 256), 2, correlation, between).astype(float)
    assert found.std() == pytest.approx(1.0, abs=0.03)
    for r, c in ((0, 1), (1, 0), (1, 1), (2, 0)):
        lagged = np.mean(found[..., r:, c:] * found[..., : 256 - r, : 256 - c])
        assert lagged == pytest.approx(correlation[4 + r, 4 + c], abs=0.03)
    assert np.mean(found[:, 0] * found[:, 1]) == pytest.approx(0.0 if between is None else 0.6, abs=0.05)
    signs = probes((1, 8, 8))
    assert set(np.unique(signs)) == {-1.0, 1.0}


def test_where_nothing_is_surely_better_the_data_stays_to_the_bit(monkeypatch):
    _, z = noisy(n=48)
    assert meshflow.smooth(z, result=True).end.step > 0
    monkeypatch.setattr("meshflow.estimate.search_rounds._error", lambda differences, sizes: np.inf)
    result = meshflow.smooth(z, result=True)
    assert "data left unchanged" in result.stopped_because
    assert result.candidates
    np.testing.assert_array_equal(result.data, z)


def test_what_is_given_is_held_and_what_is_not_is_found():
    _, z = noisy(n=64)
    result = meshflow.smooth(z, method=Beltrami(gamma=0), result=True)
    p = result.parameters
    assert (p["gamma"].value, p["gamma"].origin) == (0, "given")
    assert (p["sharpness"].value, p["patch"].value) == (1, 0)
    assert p["time"].origin == p["contrast"].origin == "estimated"
    result = meshflow.smooth(z, time=3.0, result=True)
    assert (result.end.time, result.parameters["time"].origin) == (3.0, "given")
    assert result.parameters["gamma"].origin == "estimated"
    assert {candidate.times for candidate in result.candidates} == {(3.0,)}
    result = meshflow.smooth(z, method=PeronaMalik(contrast=0.7), result=True)
    assert result.parameters["sharpness"].value == 2
    assert {candidate.configuration.contrast for candidate in result.candidates} == {0.7}
    result = meshflow.smooth(z, compute=Compute(search=False), result=True)
    assert not result.candidates
    assert (result.end.time, result.parameters["time"].why) == (7.5, "7.5 h²")
    assert meshflow.smooth(z, stop=Steps(2), result=True).end.step == 2


@pytest.mark.long
def test_every_name_of_a_variant_is_one_and_runs():
    _, z = noisy(n=32)
    names = [kind.word for kind in HEIGHT_METHODS]
    assert [*METHODS] == ["search", "quick", *names, *(kind.word for kind in POINT_METHODS)]
    for options in ({"time": 2.0}, {"search": False}, {"steps": 3}):
        smoothed = [meshflow.smooth(z, **parts(method=name, **options)) for name in names]
        assert all(0.2 < rms(one - z) < 6.0 for one in smoothed)
        assert len({one.tobytes() for one in smoothed}) == len(names)


def test_more_strength_smooths_more():
    _, z = noisy(n=96)
    removed = [rms(meshflow.smooth(z, strength=strength) - z) for strength in (0.5, 1.0, 2.0)]
    assert removed[0] < removed[1] < removed[2]


def test_a_search_does_not_depend_on_the_units():
    _, z = noisy(n=96)
    near = meshflow.smooth(z, boundary="plane-preserving")
    far = meshflow.smooth(1000 * z, boundary="plane-preserving", spacing=30.0)
    assert rms(far / 1000 - near) < 1e-6 * rms(z - near)


def test_twicing_gives_back_what_the_flow_would_still_take():
    _, z = noisy(n=48)
    options = {"gamma": 0, "contrast": 0.5, "stepper": "explicit"}
    once, later = (meshflow.smooth(z, **parts(time=time, **options)) for time in (2.0, 4.0))
    twice = meshflow.smooth(z, **parts(time=2.0, twicing=0.5, **options))
    assert np.allclose(twice, once + 0.5 * (once - later), atol=2e-3)
    assert set(TWICE) >= {0.0, 1.0}


def test_without_noise_nothing_changes_and_it_says_so():
    blocks = np.random.default_rng(0).integers(0, 9, (6, 6)) * 12.0
    for z in (np.full((40, 40), 3.5), np.kron(blocks, np.ones((16, 16))), np.array([[1.0, 2.0], [3.0, 5.0]])):
        result = meshflow.smooth(z, result=True)
        assert np.array_equal(result.data, z)
        assert "nothing was changed" in result.stopped_because
        assert result.end.step == 0
        assert not result.removed.any()
        assert "nothing was changed" in str(result)
    result = meshflow.smooth(np.full((40, 40), 3.5), time=1.0, result=True)
    assert any("no noise was found" in warning for warning in result.warnings)


def test_data_that_is_all_noise_becomes_flat():
    z = np.random.default_rng(0).normal(size=(128, 128))
    result = meshflow.smooth(z, result=True)
    assert result.data.std() < 0.1
    assert result.correlation < 0.03


def test_channels_of_a_mesh_tune_themselves():
    points, faces = shapes.sphere(1000, shake=0.1)
    truth = np.sign(points[:, 2:]) * 5.0
    noisy_channels = truth + np.random.default_rng(1).normal(size=truth.shape)
    result = meshflow.smooth((points, faces), channels=noisy_channels, result=True)
    smoothed = result.data[2]
    assert result.candidates
    assert rms(smoothed - truth) < 0.4


def test_a_result_tells_every_parameter_with_unit_and_origin():
    _, z = noisy(n=64)
    z[3:9, 10:20] = np.nan
    result = meshflow.smooth(z, result=True)
    reported = json.loads(result.to_json())
    assert set(reported["parameters"]) >= {
        "noise",
        "gamma",
        "sharpness",
        "patch",
        "contrast",
        "time",
        "boundary",
        "diagonals",
    }
    assert {entry["origin"] for entry in reported["parameters"].values()} <= {"given", "estimated", "default"}
    assert reported["noise"]["sigma"] == pytest.approx(2.0, rel=0.1)
    assert reported["history"][0]["change"] == 0
    areas = [moment["area"] for moment in reported["history"]]
    assert areas[1] < areas[0]
    assert reported["candidates"][0]["risk"] == min(entry["risk"] for entry in reported["candidates"])
    assert reported["removed"]["rms"] == pytest.approx(np.sqrt(np.nanmean((z - result.data) ** 2)))
    text = str(result)
    for word in ("noise", "contrast", "estimated", "removed", "candidates"):
        assert word in text
    assert np.array_equal(np.isnan(result.data), np.isnan(z))


def test_the_correlation_of_what_was_removed_tells_structure_from_noise():
    truth, z = noisy(n=128)
    assert meshflow.smooth(z, boundary="plane-preserving", result=True).correlation < 0.1
    blurred = meshflow.smooth(z, method="heat", time=40.0, result=True)
    assert blurred.correlation > 0.3


def test_every_number_has_the_unit_of_the_data_and_what_was_given_is_listed():
    z = np.add.outer(np.arange(32.0), np.zeros(32)) + np.random.default_rng(0).normal(size=(32, 32))
    still = np.zeros(z.shape, bool)
    still[0, :3] = True
    reported = meshflow.smooth(
        meshflow.HeightField(z, 10.0, unit="m", fixed=still),
        method="perona-malik",
        stop=Residual(0.9),
        constraints=[Mask(~still), MaxChange(3.0)],
        result=True,
    ).parameters
    assert {name: reported[name].unit for name in ("noise", "quantum", "max_change", "time")} == {
        "noise": "m", "quantum": "m", "max_change": "m", "time": "m²",
    }  # fmt: skip
    assert (reported["method"].value, reported["method"].origin) == ("perona-malik", "given")
    assert (reported["residual"].value, reported["residual"].unit) == (0.9, "of sigma")
    assert reported["fixed"].value == "3 of 1024 samples stay"
    assert reported["mask"].value == "1021 of 1024 samples may move"


def test_where_nothing_may_move_the_reason_says_so():
    z = np.random.default_rng(0).normal(size=(16, 16))
    found = meshflow.smooth(z, constraints=Mask(np.zeros(z.shape, bool)), result=True)
    assert "no sample may move" in found.stopped_because
    np.testing.assert_array_equal(found.data, z)


def test_a_stiff_run_of_several_channels_ends():
    z = np.random.default_rng(0).normal(size=(40, 40, 3))
    z[20, 20] = 1e3
    for method in ("perona-malik", "quick", None):
        result = meshflow.smooth(z, kind="image", method=method, noise=1.0, outliers="include", result=True)
        assert result.end.step < 100
        assert result.data[:15].std() < 0.25
        assert np.abs(result.data[20, 20] - 1e3).max() < 10.0


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.5, 1.0, 2.0, 5.0])
def test_a_slope_is_no_edge(slope):
    y, x = np.mgrid[0:96, 0:96] * 10.0
    truth = slope * (0.8 * x + 0.6 * y)
    z = truth + np.random.default_rng(3).normal(size=truth.shape)
    # At the steepest the risk of the heat flow and of a sharper one differ by less than their estimates err.
    for method, share in (("quick", 0.15), (None, 0.08 if slope <= 2 else 0.12)):
        left = meshflow.smooth(z, spacing=10.0, method=method) - truth
        assert rms(left[8:-8, 8:-8]) < share, f"{rms(left[8:-8, 8:-8]):.3f} of the noise is left by {method}"


def test_what_is_fixed_stays_to_the_bit_above_a_base():
    _, z = noisy(n=48)
    still = np.random.default_rng(1).random(z.shape) < 0.1
    z[5:9, 20:30] = np.nan
    result = meshflow.smooth(z.astype(np.float32), method="quick", constraints=Fixed(still), result=True)
    assert "base" in result.parameters
    np.testing.assert_array_equal(result.data[still], z.astype(np.float32)[still])
    assert np.array_equal(np.isnan(result.data), np.isnan(z))


def test_a_steep_plane_is_given_to_the_heat_equation():
    y, x = np.mgrid[:96, :96] * 10.0
    truth = 5 * (0.8 * x + 0.6 * y)
    found = meshflow.smooth(
        truth + np.random.default_rng(1).normal(size=truth.shape),
        spacing=10.0,
        method=Search(second_stage=False),
        result=True,
    )
    assert found.parameters["method"].value == "heat"
    assert np.sqrt(np.mean(np.square(found.data - truth))) < 0.12


def test_a_second_round_without_a_credible_estimate_keeps_what_the_first_found(monkeypatch):
    z = ramps(512) + 2.0 * np.random.default_rng(3).normal(size=(512, 512))
    grid = HeightField(z, 1.0).gridded(Lift())
    best, rounds = search_rounds.Runs.best, []

    def fails_once(self, times, patience, until_slow=False):
        rounds.append(len(self.parts))
        return [] if len(rounds) == 2 else best(self, times, patience, until_slow)

    monkeypatch.setattr(search_rounds.Runs, "best", fails_once)
    like = Variant(indicator=Beltrami().indicator, mass=Beltrami().mass)
    made = configurations(FAMILY, 0.5, like, None)
    found = searched_on_grid(grid, GridSearch(made, True, np.full((1, 1, 1), 2.0), None, (0.0,), threads=1))
    assert len(rounds) > 1
    assert found.candidates
