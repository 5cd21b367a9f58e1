"""Range images by default: the noise of each depth, the time that follows from it, jumps, components, frames, inverse depth."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.parts import parts

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.constraints import DataWeights, MaxChange, MinComponent
from meshflow.estimate.frames import averaged
from meshflow.estimate.quantization import steps_of
from meshflow.evaluate.range_images import range_quality
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Search
from meshflow.flow.stops import Steps
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.discontinuities import cuts_by_noise, small_components
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Spherical
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import CAMERA, depth_scene
from meshflow.synthetic.samples import SCENE as SHAPES
from meshflow.synthetic.sensors import StructuredLight, TimeOfFlight, observe

SMALL = Pinhole(150.0, 150.0, 79.5, 59.5)
SCENE = depth_scene(SMALL, (120, 160), seed=3, noise=0.002)


def rms(depth):
    there = np.isfinite(SCENE.truth)
    return float(np.sqrt(np.mean((depth - SCENE.truth)[there] ** 2)))


def wall(sigma, seed=0, shape=(60, 80)):
    """A slanted wall with noise, and its camera."""
    camera = Pinhole(100.0, 100.0, 39.5, 29.5)
    rays = camera.rays(shape)
    truth = 2.0 / (rays @ (0.3, 0.1, 1.0))
    return truth, truth + sigma * np.random.default_rng(seed).normal(size=shape), camera


@pytest.mark.parametrize("part", [0.05, 0.3, 1.0])
def test_time_is_ten_times_the_noise_in_footprints(part):
    truth, noisy, camera = wall(part * 2.0 / 100.0)
    found = meshflow.smooth(RangeImage(noisy, camera), domain="length", result=True).parameters
    assert found["time"].value == pytest.approx(10 * part * 2.0 / np.median(truth), rel=0.2)
    assert (found["time"].origin, found["time"].unit) == ("estimated", "pixel footprints²")
    assert found["noise"].value == pytest.approx(part * 2.0 / 100.0, rel=0.2)


def test_a_clean_range_image_is_left_alone():
    truth, _, camera = wall(0.0)
    flat = np.full_like(truth, 2.0)
    found = meshflow.smooth(RangeImage(flat, camera), result=True)
    assert "no noise was found" in found.stopped_because
    np.testing.assert_array_equal(found.data.depth, flat)


def test_strength_multiplies_the_time():
    _, noisy, camera = wall(0.01)
    one, two = (
        meshflow.smooth(RangeImage(noisy, camera), strength=s, domain="length", result=True).parameters["time"].value
        for s in (1.0, 2.0)
    )
    assert two == pytest.approx(2 * one)


def test_a_search_of_least_risk_smooths_the_scene_and_tells_its_curve():
    image = RangeImage(SCENE.noisy, SMALL)
    found = meshflow.smooth(image, compute=Compute(search=True), result=True)
    assert len(found.candidates) == 3
    assert found.parameters["gamma"].origin == "estimated"
    assert rms(found.data.depth) < 0.5 * rms(SCENE.noisy)
    # The risk is told in the root mean square of the noise, and is near what the truth says, jumps and all.
    assert found.candidates[0].risk == pytest.approx(rms(found.data.depth), rel=0.5)


def test_noise_of_each_sample_sets_its_time():
    rng = np.random.default_rng(0)
    truth, _, camera = wall(0.0)
    sigma = 0.01 * rng.choice([0.25, 1.0, 4.0], size=truth.shape)
    noisy = truth + sigma * rng.normal(size=truth.shape)
    known = meshflow.smooth(RangeImage(noisy, camera, sigma=sigma), result=True)
    alike = meshflow.smooth(RangeImage(noisy, camera), time=known.parameters["time"].value)
    assert known.parameters["time_unit"].value == "noise"
    assert np.std(known.data.depth - truth) < 0.8 * np.std(alike.depth - truth)


def test_inverse_depth_of_a_wall_rests_and_keeps_the_units_of_the_depth():
    truth, noisy, camera = wall(0.01)
    still = meshflow.smooth(RangeImage(truth, camera), method=Search(contrast=100.0), time=20.0, domain="disparity")
    np.testing.assert_allclose(still.depth, truth, rtol=1e-12)
    found = meshflow.smooth(RangeImage(noisy, camera), domain="disparity", result=True)
    assert np.std(found.data.depth - truth) < 0.3 * np.std(noisy - truth)
    assert found.parameters["noise"].value == pytest.approx(0.01, rel=0.15)
    assert found.parameters["domain"].value == "disparity"


def test_inverse_depth_suits_the_noise_of_structured_light():
    image = RangeImage(SCENE.noisy, SMALL)
    assert rms(meshflow.smooth(image, domain="disparity").depth) < rms(meshflow.smooth(image, domain="length").depth)


def test_inverse_depth_is_of_pinholes():
    camera = Spherical((-20.0, 20.0), (10.0, -10.0))
    image = RangeImage(np.full((8, 9), 2.0), camera)
    with pytest.raises(InputError, match="pinhole without distortion"):
        meshflow.smooth(image, time=1.0, domain="disparity")


@pytest.mark.parametrize(("word", "value"), [("domain", "disparity"), ("min_component", 5)])
def test_what_is_of_range_images_is_refused_elsewhere(word, value):
    with pytest.raises(InputError, match="only for range images"):
        meshflow.smooth(np.random.default_rng(0).normal(size=(8, 8)), **parts(**{word: value}))


def test_jumps_are_cut_and_slopes_are_not():
    truth, noisy, camera = wall(0.005)
    nearer = noisy.copy()
    nearer[20:40, 30:50] -= 0.5
    image = RangeImage(nearer, camera, sigma=0.005)
    cuts = image.cuts
    rim_right, rim_down = np.zeros((60, 79), bool), np.zeros((59, 80), bool)
    rim_right[20:40, [29, 49]], rim_down[[19, 39], 30:50] = True, True
    np.testing.assert_array_equal(cuts.right, rim_right)
    np.testing.assert_array_equal(cuts.down, rim_down)


def test_a_surface_that_turns_away_from_its_ray_is_cut():
    depth = np.tile(2.0 + 0.4 * np.arange(12.0), (10, 1))  # 20 footprints for each pixel
    footprint = np.full(depth.shape, 0.02)
    assert cuts_by_noise(depth, np.zeros(depth.shape, bool), 1e-4, footprint).right.all()
    assert not cuts_by_noise(depth, np.zeros(depth.shape, bool), 0.1, footprint).right.any(), "noise explains it"


def test_no_triangle_joins_what_a_jump_separates():
    _, noisy, camera = wall(0.002)
    noisy[:, 40:] += 1.0
    smoothed = meshflow.smooth(RangeImage(noisy, camera), time=50.0).depth
    assert np.abs(np.diff(smoothed, axis=1)[:, 39]).min() > 0.9


def test_small_components_are_dropped_on_request_only():
    _, noisy, camera = wall(0.002)
    missing = np.zeros(noisy.shape, bool)
    missing[10:20, 10:20] = True
    missing[13:15, 13:15] = False
    image = RangeImage(noisy, camera, missing)
    np.testing.assert_array_equal(meshflow.smooth(image).missing, missing)
    found = meshflow.smooth(image, constraints=MinComponent(5), result=True)
    assert found.data.missing[10:20, 10:20].all()
    assert (found.data.depth[13:15, 13:15] == 0).all()
    assert found.removed[13:15, 13:15].max() == 0
    assert int(found.data.missing.sum()) == 100
    with pytest.raises(InputError, match="fewer than 100000"):
        meshflow.smooth(image, constraints=MinComponent(100_000))


def test_components_hang_together_by_edges_that_are_not_cut():
    missing = np.zeros((4, 6), bool)
    cut = cuts_by_noise(np.where(np.arange(6) < 2, 1.0, 3.0) * np.ones((4, 1)), missing, 1e-3, np.full((4, 6), 0.01))
    assert small_components(missing, cut, 10).sum() == 8
    assert not small_components(missing, None, 10).any()


def test_the_steps_of_a_disparity_grow_with_the_square_of_the_depth():
    disparity = np.rint(8 * np.linspace(10.0, 40.0, 40_000)) / 8
    steps = steps_of(40.0 / disparity)
    for depth in (1.2, 2.0, 3.0):
        assert 0.8 < steps.at(np.array([depth]))[0] / (depth**2 / 40.0 / 8) < 1.05, "the least step nearby"
    assert steps_of(np.random.default_rng(0).normal(size=5000)) is None


def test_a_limit_of_half_the_step_holds_at_each_depth():
    truth, _, camera = wall(0.0)
    depth = 100.0 / np.rint(100.0 / truth * 8) * 8
    smoothed = meshflow.smooth(RangeImage(depth, camera), time=20.0, constraints=MaxChange("step")).depth
    half = steps_of(depth.ravel()).at(depth) / 2
    assert np.abs(smoothed - depth).max() > 0
    assert (np.abs(smoothed - depth) <= half * (1 + 1e-9)).all()
    with pytest.raises(InputError, match="not quantized"):
        meshflow.smooth(RangeImage(wall(0.01)[1], camera), constraints=MaxChange("step"))


@pytest.mark.long
@pytest.mark.parametrize("words", [{}, {"domain": "disparity"}, {"domain": "length"}])
@pytest.mark.parametrize("most", [0.003, "one per pixel", "step", np.inf])
def test_no_depth_moves_by_more_than_the_limit_whatever_the_domain(words, most):
    truth, noisy, camera = wall(0.01)
    noisy[10:14, 20:24] = 0.0  # missing
    depth = np.where(noisy > 0, 100.0 / np.rint(100.0 / np.where(noisy > 0, truth, 1.0) * 8) * 8, 0.0)
    depth = depth if most == "step" else noisy
    limits = {"one per pixel": np.where(np.arange(80) < 40, 0.001, 0.5) * np.ones((60, 1))}
    if most == "step":
        limits[most] = steps_of(depth[depth > 0]).at(depth) / 2
    held = MaxChange(limits[most] if most == "one per pixel" else most)
    found = meshflow.smooth(RangeImage(depth, camera), constraints=held, result=True, **words)
    assert ("domain" in found.parameters) == (words != {"domain": "length"})
    moved = np.abs(found.data.depth - depth)
    assert (moved <= np.broadcast_to(limits.get(most, most), depth.shape) * (1 + 1e-9)).all()
    assert moved.max() > 0
    assert (moved[10:14, 20:24] == 0).all()


@pytest.mark.long
@pytest.mark.parametrize("words", [{}, {"domain": "disparity"}])
def test_a_limit_in_depths_is_reached_and_an_infinite_one_is_none(words):
    _, noisy, camera = wall(0.01)
    image = RangeImage(noisy, camera)
    held = meshflow.smooth(image, constraints=MaxChange(0.002), **words).depth
    assert np.quantile(np.abs(held - noisy), 0.5) > 0.99 * 0.002
    free = meshflow.smooth(image, constraints=MaxChange(np.inf), **words).depth
    np.testing.assert_array_equal(free, meshflow.smooth(image, **words).depth)
    still = meshflow.smooth(image, constraints=MaxChange(0.0), **words).depth
    np.testing.assert_array_equal(still, noisy)
    with pytest.raises(InputError, match="not quantized"):
        meshflow.smooth(image, constraints=MaxChange("step"), **words)


def test_frames_are_one_weighted_problem():
    truth, _, camera = wall(0.0, shape=(60, 80))
    rng = np.random.default_rng(0)
    frames = truth + 0.01 * rng.normal(size=(12, *truth.shape))
    gone = rng.random(frames.shape) < rng.choice([0.1, 0.9], size=truth.shape)
    frames[gone] = 0.0
    one = averaged(frames)
    several = one.count > 0
    np.testing.assert_array_equal(one.count, (~gone).sum(axis=0))
    np.testing.assert_allclose(one.mean[several], (frames.sum(axis=0) / np.maximum(one.count, 1))[several], rtol=1e-12)
    expected = 0.01 / np.sqrt(one.count[several])
    assert np.median(one.sigma[several] / expected) == pytest.approx(1.0, abs=0.15)
    assert (one.weights[~several] == 0).all()
    fused = meshflow.fuse(frames, camera=camera)
    alone = meshflow.smooth(np.where(several, one.mean, 0.0), camera=camera)
    np.testing.assert_array_equal(fused == 0, ~several)
    assert np.std((fused - truth)[several]) < np.std((alone - truth)[several])


@pytest.mark.parametrize(
    ("frames", "words"),
    [([], "two or more"), ([np.ones((4, 5))], "two or more"), ([np.ones((4, 5)), np.ones((5, 5))], "one size")],
)
def test_frames_that_are_no_sequence_are_refused(frames, words):
    with pytest.raises(InputError, match=words):
        meshflow.fuse(frames, camera=Pinhole(5.0, 5.0, 2.0, 2.0))


def test_data_weights_hold_pixels_where_they_are():
    _, noisy, camera = wall(0.01)
    confidence = np.zeros(noisy.shape)
    confidence[20:40] = 1e6
    smoothed = meshflow.smooth(RangeImage(noisy, camera), time=10.0, constraints=DataWeights(confidence)).depth
    assert np.abs(smoothed - noisy)[20:40].max() < 1e-3 < np.abs(smoothed - noisy)[:20].max()


@pytest.mark.long
def test_the_scene_by_default_is_near_the_best_time():
    scene = depth_scene(CAMERA, seed=1, noise=0.0015)
    there = np.isfinite(scene.truth)

    def error(**options):
        smoothed = meshflow.smooth(RangeImage(scene.noisy, CAMERA), **parts(**options)).depth
        return float(np.sqrt(np.mean((smoothed - scene.truth)[there] ** 2)))

    best = min(error(time=t) for t in (2.0, 5.0, 10.0, 20.0))
    assert error() < 1.05 * best


@pytest.mark.long
@pytest.mark.parametrize("sensor", [StructuredLight(seed=1), StructuredLight(seed=2, step=None), TimeOfFlight(seed=3)])
def test_a_pinhole_is_smoothed_in_inverse_depths_by_default_and_is_better_for_it(sensor):
    frame = observe(SHAPES, Sight.through(CAMERA, (120, 160)), sensor)
    image = RangeImage(frame.depth, CAMERA)
    found = meshflow.smooth(image, result=True)
    domain = found.parameters["domain"]
    assert (domain.value, domain.origin) == ("disparity", "default")
    chosen, along = (
        range_quality(one.depth, np.where(np.isfinite(frame.depth), frame.truth, np.nan), CAMERA)
        for one in (found.data, meshflow.smooth(image, domain="length"))
    )
    assert chosen.normal_error < along.normal_error
    assert chosen.rms < along.rms


@pytest.mark.long
@pytest.mark.parametrize(
    "given",
    [
        {"time": 2.0}, {"method": "beltrami"}, {"stop": Steps(3)}, {"constraints": DataWeights(1.0)},
        {"compute": Compute(search=True)}, {"boundary": "neumann"},
    ],
)  # fmt: skip
def test_what_refers_to_lengths_keeps_the_flow_along_the_rays(given):
    _, noisy, camera = wall(0.01, shape=(40, 48))
    image = RangeImage(noisy, camera)
    np.testing.assert_array_equal(
        meshflow.smooth(image, **given).depth, meshflow.smooth(image, **given, domain="length").depth
    )


def test_other_cameras_and_a_noise_that_differs_from_pixel_to_pixel_keep_the_flow_along_the_rays():
    _, noisy, camera = wall(0.01)
    images = (
        RangeImage(noisy, replace(camera, distortion=(0.1, 0.0, 0.0, 0.0))),
        RangeImage(noisy, camera, sigma=0.01 * 4.0 ** (np.arange(noisy.size) % 2).reshape(noisy.shape)),
        RangeImage(noisy, camera, measure="range"),
    )
    for image in images:
        assert "domain" not in meshflow.smooth(image, result=True).parameters
    even = RangeImage(noisy, camera, sigma=np.full(noisy.shape, 0.01))
    assert meshflow.smooth(even, result=True).parameters["domain"].value == "disparity"


@pytest.mark.parametrize("words", [{}, {"domain": "disparity"}])
def test_a_given_noise_is_one_of_depths(words):
    truth, noisy, camera = wall(0.01)
    found = meshflow.smooth(RangeImage(noisy, camera), noise=0.01, result=True, **words)
    assert found.parameters["noise"].value == pytest.approx(0.01, rel=0.05)
    assert np.std(found.data.depth - truth) < 0.4 * np.std(noisy - truth)


def test_a_height_field_takes_the_noise_of_each_sample_and_is_better_for_it():
    rng = np.random.default_rng(4)
    truth = np.sin(np.arange(96.0) / 12)[:, None] * 8.0 + np.cos(np.arange(128.0) / 9) * 6.0
    sigma = np.where(np.arange(128) < 64, 0.3, 3.0) * np.ones((96, 1))
    z = truth + sigma * rng.normal(size=truth.shape)
    field = HeightField(z, 5.0, sigma=sigma)
    found = meshflow.smooth(field, result=True)
    assert found.parameters["noise"].value == pytest.approx(np.sqrt(np.mean(sigma**2)), rel=0.01)
    relative = (found.data.z - truth) / sigma
    # The risk is that of errors in units of the noise of each sample, as it is counted.
    expected = found.parameters["risk"].value / np.sqrt(np.mean(sigma**2))
    assert expected == pytest.approx(np.sqrt(np.mean(relative**2)), rel=0.25)
    turned = HeightField(np.rot90(z), 5.0, sigma=np.rot90(sigma))
    np.testing.assert_array_equal(meshflow.smooth(turned).z, np.rot90(found.data.z))
    with pytest.raises(InputError, match="sigma: a positive number or one for each of 128 x 96 heights"):
        HeightField(z, 5.0, sigma=sigma[:-1])
