"""Where a run stops, and what holds it: found to within a step, said as a sentence, never passed."""

import numpy as np
import pytest
from helpers import shapes
from helpers.parts import parts

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.constraints import DataWeights, Fixed, Mask, MaxChange
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Beltrami, GraphFlow
from meshflow.flow.stops import AreaLoss, Displacement, Residual


def noisy(n=64, sigma=2.0, seed=0):
    r, c = np.mgrid[0:n, 0:n] / n
    truth = 30 * np.sin(5 * r) * np.cos(4 * c) + 20 * ((r > 0.3) & (c > 0.4))
    return truth, truth + sigma * np.random.default_rng(seed).normal(size=(n, n))


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


@pytest.mark.parametrize("share", [0.3, 0.7, 0.9])
@pytest.mark.parametrize("stepper", ["explicit", "super-time"])
def test_a_residual_is_a_share_of_the_noise_and_no_more(share, stepper):
    _, z = noisy()
    result = meshflow.smooth(
        z,
        method=Beltrami(gamma=0, contrast=0.7),
        noise=2.0,
        stop=Residual(share),
        compute=Compute(stepper=stepper),
        result=True,
    )
    assert rms(result.data - z) == pytest.approx(share * 2.0, rel=1e-3)
    assert f"came to a residual of {share:.3g} sigma" in result.stopped_because
    assert result.end.time < 100


def test_a_residual_counts_the_samples_that_are_there():
    _, z = noisy()
    z[20:40, 10:60] = np.nan
    smoothed = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), noise=2.0, stop=Residual(0.8))
    assert np.sqrt(np.nanmean((smoothed - z) ** 2)) == pytest.approx(1.6, rel=1e-3)


def test_a_residual_counts_the_samples_that_may_move():
    _, z = noisy()
    region = np.zeros(z.shape, bool)
    region[20:50, 10:60] = True
    flow = Beltrami(gamma=0, contrast=0.7)
    smoothed = meshflow.smooth(z, method=flow, noise=2.0, stop=Residual(0.8), constraints=Mask(region))
    assert rms((smoothed - z)[region]) == pytest.approx(1.6, rel=1e-3)
    assert np.array_equal(smoothed[~region], z[~region])


def test_a_residual_of_several_channels_counts_them_alike():
    rng = np.random.default_rng(1)
    z = np.zeros((40, 40, 3)) + 2 * rng.normal(size=(40, 40, 3))
    smoothed = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), noise=2.0, stop=Residual(0.8))
    assert rms(smoothed - z) == pytest.approx(1.6, rel=1e-3)


def test_the_largest_displacement_and_the_area_stop_where_they_were_asked_to():
    _, z = noisy()
    moved = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), stop=Displacement(3.0))
    assert np.abs(moved - z).max() == pytest.approx(3.0, rel=1e-3)
    result = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), stop=AreaLoss(0.2), result=True)
    areas = result.history.area
    assert areas[-1] / areas[0] == pytest.approx(0.8, rel=1e-3)


def test_the_first_of_several_stops_counts():
    _, z = noisy()
    result = meshflow.smooth(
        z,
        method=Beltrami(gamma=0, contrast=0.7),
        time=50,
        noise=2.0,
        stop=[Residual(0.9), Displacement(1.0)],
        result=True,
    )
    assert "displacement of 1 " in result.stopped_because
    assert rms(result.data - z) < 0.9 * 2.0


def test_a_callable_sees_the_values_and_stops_the_run():
    _, z = noisy()
    smoothed = meshflow.smooth(
        z, method=Beltrami(gamma=0, contrast=0.7), stop=lambda values, time: z.std() - 0.1 - values.std()
    )
    assert smoothed.std() == pytest.approx(z.std() - 0.1, abs=1e-4)
    seen = []

    def enough(values, time):
        seen.append((values.shape, time))
        return bool(time > 1.0)

    result = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), stop=enough, result=True)
    assert result.end.time == pytest.approx(1.0, abs=0.01)
    assert {shape for shape, _ in seen} == {z.shape}
    with pytest.raises(InputError, match="true, false or a finite number expected"):
        meshflow.smooth(z, stop=lambda values, time: None)


def test_a_stop_that_is_never_met_ends_at_the_time_with_the_reason():
    _, z = noisy()
    result = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), time=2.0, stop=Displacement(1e6), result=True)
    assert result.end.time == pytest.approx(2.0)
    assert "before a displacement of" in result.stopped_because
    assert "(1e+06 asked for)" in result.stopped_because


@pytest.mark.parametrize("stepper", ["explicit", "super-time", "semi-implicit"])
def test_no_sample_leaves_its_limit(stepper):
    _, z = noisy()
    most = np.where(np.arange(64) < 32, 0.5, 2.0) * np.ones_like(z)
    result = meshflow.smooth(
        z,
        method=Beltrami(gamma=0, contrast=0.7),
        time=8.0,
        constraints=MaxChange(most),
        compute=Compute(stepper=stepper),
        result=True,
    )
    away = np.abs(result.data - z) - most
    assert away.max() <= 1e-12
    assert (away > -1e-12).any(), "the limit was never reached: the test proves nothing"
    assert np.array_equal(
        meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), time=8.0, constraints=MaxChange(0.0)), z
    )
    free = meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), time=8.0, compute=Compute(stepper=stepper))
    assert np.array_equal(
        meshflow.smooth(
            z,
            method=Beltrami(gamma=0, contrast=0.7),
            time=8.0,
            constraints=MaxChange(np.inf),
            compute=Compute(stepper=stepper),
        ),
        free,
    )


@pytest.mark.parametrize("moves", ["points", "channels", "all"])
def test_what_moves_of_a_mesh_is_held_and_stopped_alike(moves):
    points, faces = shapes.sphere(600, shake=0.1)
    heat = 3 * points[:, :2] + np.random.default_rng(1).normal(size=(len(points), 2))
    options = {"channels": heat, "moves": moves, "time": 0.5, "gamma": 0, "contrast": 1.0}
    most = np.where(np.arange(len(points)) % 2, 0.01, np.inf)
    after, _, warm = meshflow.smooth((points, faces), **parts(max_change=most, **options))
    change = np.concatenate([after - points, warm - heat], axis=1)[np.isfinite(most)]
    assert 0.005 < np.abs(change).max() <= 0.0101
    result = meshflow.smooth((points, faces), **parts(displacement=0.004, **options), result=True)
    assert result.history.largest[-1] == pytest.approx(0.004, rel=1e-3)
    seen = []
    meshflow.smooth((points, faces), **parts(stop=lambda values, time: bool(seen.append(values.shape)), **options))
    assert set(seen) == {(len(points), {"points": 3, "channels": 2, "all": 5}[moves])}
    trusted = meshflow.smooth((points, faces), **parts(data_weights=1e6, **options), result=True)
    assert trusted.history.largest[-1] < 1e-2


def test_rounded_data_stay_consistent_with_what_was_recorded():
    truth, _ = noisy(sigma=0)
    z = np.round(truth / 4) * 4
    result = meshflow.smooth(z, result=True)
    assert np.abs(result.data - z).max() <= 2.0
    assert result.parameters["max_change"].value == 2.0
    assert result.parameters["max_change"].origin == "estimated"
    assert rms(result.data - truth) < 0.7 * rms(z - truth)


def test_a_fidelity_comes_to_rest_and_trusted_samples_stay_nearer():
    _, z = noisy()
    long = meshflow.smooth(z, method=Beltrami(gamma=-1, contrast=0.7), time=400.0, constraints=DataWeights(0.25))
    longer = meshflow.smooth(z, method=Beltrami(gamma=-1, contrast=0.7), time=800.0, constraints=DataWeights(0.25))
    assert rms(longer - long) < 5e-3 * rms(long - z), "it has not come to rest"
    weights = np.where(np.arange(64) < 32, 4.0, 0.01) * np.ones_like(z)
    result = meshflow.smooth(z, method=Beltrami(gamma=-1, contrast=0.7), constraints=DataWeights(weights), result=True)
    change = np.abs(result.data - z)
    assert change[:, :28].mean() < 0.4 * change[:, 36:].mean()
    assert np.array_equal(meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), time=3.0, constraints=DataWeights(0.0)),
                          meshflow.smooth(z, method=Beltrami(gamma=0, contrast=0.7), time=3.0))  # fmt: skip


def test_the_rest_is_where_smoothness_and_data_pull_alike():
    from meshflow.flow.blend import euler
    from meshflow.flow.constraints import Faithful, trust_of
    from meshflow.flow.engines.grid import GridFlow
    from meshflow.flow.family import Variant
    from meshflow.surfaces.grid import Lift
    from meshflow.surfaces.height_field import HeightField

    _, z = noisy(24)
    flow = GridFlow(HeightField(z).gridded(Lift(0.7, "both")), Variant(-1.0))
    held = Faithful(flow, trust_of(0.25, z.shape, z.size, 0.7))
    u = held.start()
    for _ in range(6000):
        u = held.rate(u, 0, euler(2 / held.bound(u)))
    assert np.abs(held.rate(u)).max() < 1e-6 * np.abs(flow.rate(u)).max()


def test_what_lies_outside_of_only_and_inside_of_fixed_keeps_its_bits():
    _, z = noisy()
    only = np.zeros(z.shape, bool)
    only[10:30, 20:50] = True
    smoothed = meshflow.smooth(z, time=2.0, constraints=Mask(only))
    assert np.array_equal(smoothed[~only], z[~only])
    assert rms((smoothed - z)[only]) > 0.5
    fixed = meshflow.smooth(z, time=2.0, constraints=Fixed(only))
    assert np.array_equal(fixed[only], z[only])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"noise": 0}, "noise: a positive finite number expected, got 0"),
        ({"noise": -2}, "noise: a positive"),
        ({"strength": 0}, "strength: a positive"),
        ({"contrast": np.inf}, "contrast: a positive finite number"),
        ({"max_change": -1}, "max_change: a number, zero or more, or an array expected, got -1"),
        (
            {"max_change": np.ones((3, 3))},
            r"max_change: a number or an array of shape \(64, 64\) expected, got \(3, 3\)",
        ),
        ({"data_weights": np.nan}, "data_weights: a number, zero or more, or an array expected, got nan"),
        ({"data_weights": -np.ones((64, 64))}, "data_weights: finite numbers, zero or more, expected, got -1"),
        ({"data_weights": "much"}, "data_weights: a number or an array"),
        ({"mask": np.ones((3, 3), bool)}, r"mask: a mask of shape \(64, 64\) expected"),
        ({"mask": np.ones((64, 64), complex)}, "mask: a mask of booleans, or of numbers, expected, got dtype complex"),
        ({"fixed": np.ones((3, 3), bool)}, "fixed: a mask of shape"),
        ({"residual": 0}, "residual: a positive"),
        ({"area_loss": 1.5}, "area_loss: a share of the area between 0 and 1"),
        ({"displacement": -1}, "displacement: a positive"),
        ({"stop": 5}, "stop: Steps, Residual, AreaLoss, Displacement, or a callable .* expected, got 5"),
        ({"method": "magic"}, "magic: no such method; there are search, quick, beltrami, graph"),
        ({"twicing": 2}, "twicing: 0 to 1 expected, got 2"),
        ({"twicing": 1, "residual": 0.5}, "twicing 1: a time is doubled"),
        ({"patch": -1}, "patch: 0 to 6 samples expected, got -1"),
        (
            {"boundary": "Linear"},
            "boundary: neumann, .*expected, got 'Linear'; did you mean plane-preserving",
        ),
        ({"control": "x"}, "control: FixedStep, AreaChange or Embedded expected"),
        ({"time": "5"}, "time: a finite number expected, got the text '5'"),
        ({"gamma": "a"}, "gamma: a finite number expected, got the text 'a'"),
        ({"threads": "2"}, "threads: a whole number"),
        ({"search": 3}, "search: True, False or None"),
        ({"stepper": 3}, "stepper: auto, explicit"),
        ({"foo": 1}, "foo: no such keyword; there are method, time"),
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused_by_name(options, words):
    _, z = noisy()
    with pytest.raises(InputError, match=words):
        meshflow.smooth(z, **parts(**options))


def test_an_option_of_another_method_is_refused_by_name():
    _, z = noisy(8)
    with pytest.raises(InputError, match="gamma: no such option of GraphFlow"):
        GraphFlow(gamma=1)
    with pytest.raises(InputError, match=r"gamma: no keyword of smooth; give method=Beltrami\(gamma=...\)"):
        meshflow.smooth(z, method="graph", gamma=1)


def test_the_limit_of_points_is_of_their_way_whichever_the_axes():
    points, faces = shapes.sphere(600, shake=0.1)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    straight = meshflow.smooth((points, faces), time=0.05, constraints=MaxChange(0.01))[0]
    turned = meshflow.smooth((points @ turn.T, faces), time=0.05, constraints=MaxChange(0.01))[0] @ turn
    way = np.linalg.norm(straight - points, axis=1)
    assert way.max() == pytest.approx(0.01, rel=1e-9)
    assert np.abs(straight - turned).max() < 1e-9
    box = meshflow.smooth((points, faces), time=0.05, constraints=MaxChange(np.full(points.shape, 0.01)))[0]
    assert np.abs(box - points).max() <= 0.01 + 1e-12
    assert np.linalg.norm(box - points, axis=1).max() > 0.0101


def test_a_surface_that_vanishes_is_told():
    points, faces = shapes.sphere(300)
    result = meshflow.smooth(
        (points, faces), method="curvature", time=2.0, compute=Compute(stepper="semi-implicit", dt=0.02), result=True
    )
    assert any("the surface has vanished" in warning for warning in result.warnings)
