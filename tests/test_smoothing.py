"""The front door: the same kind of thing out, nothing of the caller's changed, options to the part that they steer."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import shapes

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.mesh_noise import noise_on
from meshflow.estimate.noise import noise_of
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Beltrami, Search
from meshflow.flow.stops import Steps
from meshflow.geometry.border import border_operator
from meshflow.geometry.connectivity import connect
from meshflow.results.run import run

SHARED = Path(__file__).parents[2] / "shared" / "data"
shared = pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")


def noisy_plane(n=40, sigma=1.0, seed=0):
    rows, columns = np.mgrid[0:n, 0:n]
    plane = 0.3 * rows - 0.2 * columns
    return plane, plane + sigma * np.random.default_rng(seed).normal(size=plane.shape)


def test_with_no_parameter_at_all_noise_goes_and_a_cliff_stays():
    rng = np.random.default_rng(0)
    truth = np.where(np.arange(60) < 30, 0.0, 50.0)[None] * np.ones((60, 1))
    noisy = truth + rng.normal(size=truth.shape)
    smoothed = meshflow.smooth(noisy)
    assert np.sqrt(np.mean((smoothed - truth) ** 2)) < 0.45
    assert abs((smoothed[:, 30] - smoothed[:, 29]).mean() - 50) < 1.0


def test_scale_is_the_standard_deviation_of_the_equal_gaussian():
    bump = np.zeros((61, 61))
    bump[30, 30] = 1.0
    smoothed = meshflow.smooth(
        bump, method=Search(contrast=1e-6), scale=3.0, boundary="neumann", compute=Compute(diagonals="both")
    )
    x = np.arange(61) - 30
    for axis in (0, 1):
        assert np.sqrt((smoothed.sum(axis=1 - axis) * x**2).sum()) == pytest.approx(3.0, rel=0.01)
    assert smoothed.sum() == pytest.approx(1.0)


def test_time_is_in_units_of_the_spacing_and_the_result_knows_no_other():
    _, z = noisy_plane()
    near = meshflow.smooth(z, time=2.0)
    far = meshflow.smooth(z, spacing=10.0, time=200.0)
    # dt is cut to end at the time asked for: the last bits of the two runs differ, and nothing else.
    assert np.allclose(near, far, atol=1e-9)


def test_the_callers_array_keeps_its_bytes_and_the_result_is_a_new_one():
    _, z = noisy_plane()
    before = z.tobytes()
    smoothed = meshflow.smooth(z)
    assert z.tobytes() == before
    assert not np.shares_memory(smoothed, z)
    assert smoothed.dtype == z.dtype


def test_a_mesh_of_arrays_and_a_trimesh_come_out_alike_and_less_rough():
    points, faces = shapes.sphere(800, shake=0.1)
    points = points * (1 + 0.03 * np.random.default_rng(1).normal(size=(len(points), 1)))
    smoothed, same = meshflow.smooth((points, faces))
    assert np.array_equal(same, faces)
    mesh = meshflow.smooth(trimesh.Trimesh(points, faces, process=False))
    assert isinstance(mesh, trimesh.Trimesh)
    assert np.allclose(mesh.vertices, smoothed)
    assert np.linalg.norm(smoothed, axis=1).std() < 0.5 * np.linalg.norm(points, axis=1).std()


def test_channels_of_a_mesh_are_smoothed_on_a_surface_that_stays():
    points, faces = shapes.sphere(800, shake=0.1)
    heat = points[:, 2] + 0.2 * np.random.default_rng(2).normal(size=len(points))
    assert noise_on(heat[:, None], faces).sigma == pytest.approx(0.2, rel=0.1)
    stays, _, smoothed = meshflow.smooth((points, faces), channels=heat)
    assert np.array_equal(stays, points)
    assert np.std(smoothed.ravel() - points[:, 2]) < 0.5 * np.std(heat - points[:, 2])


def test_options_go_to_the_part_that_they_steer():
    _, z = noisy_plane()
    data = meshflow.HeightField(z)
    outcome = run(
        data,
        Request.of(
            method=Beltrami(gamma=1.0, contrast=2.0),
            time=1.0,
            compute=Compute(stepper=meshflow.SemiImplicit("cg"), dt=0.25),
        ),
    )
    assert outcome.end.step == 4
    assert outcome.tags["stepper"] == "semi-implicit"
    assert outcome.tags["gamma"] == "1"
    assert outcome.tags["contrast"] == "2"
    assert outcome.tags["stopped_because"] == "reached time 1 in 4 steps"
    assert outcome.end.area < outcome.start.area


def test_a_constant_field_has_no_noise_and_stays_as_it_is():
    z = np.full((9, 9), 7.25)
    assert noise_of(z, np.zeros(z.shape, bool)).sigma == 0
    assert np.array_equal(meshflow.smooth(z), z)


@pytest.mark.parametrize("sigma", [0.5, 2.0, 10.0])
def test_noise_on_smooth_data_is_estimated_within_five_percent(sigma):
    rows, columns = np.mgrid[0:200, 0:200]
    z = 30 * np.sin(rows / 20) * np.cos(columns / 25) + sigma * np.random.default_rng(3).normal(size=rows.shape)
    missing = np.random.default_rng(4).random(z.shape) < 0.02
    found = noise_of(z, missing)
    assert found.sigma == pytest.approx(sigma, rel=0.05)
    assert found.quantum == 0


def test_the_quantum_of_quantised_data_is_found_and_its_rounding_counts_as_noise():
    rows, columns = np.mgrid[0:100, 0:100]
    z = np.round((rows + 2 * columns) / 7.3) * 4.0
    found = noise_of(z, np.zeros(z.shape, bool))
    assert found.quantum == 4.0
    assert found.sigma >= 4.0 / np.sqrt(12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda z: meshflow.smooth(z, sharpen=3), "sharpen"),
        (lambda z: meshflow.smooth(z, time=-1), "time: a finite number, zero or more"),
        (lambda z: meshflow.smooth(z, scale=-1), "scale: a finite number, zero or more"),
        (lambda z: meshflow.smooth(z, time=1, scale=1), "give one of them"),
        (lambda z: meshflow.smooth(z, compute=Compute(dt=-0.1)), "dt: a positive"),
        (lambda z: meshflow.smooth(z, compute=Compute(stepper="explicit", dt=9.0)), "the largest stable step is"),
        (lambda z: meshflow.smooth(z, method=Search(contrast=0)), "contrast: a positive"),
        (lambda z: meshflow.smooth(z, method=Beltrami(gamma=np.inf)), "gamma: a finite number"),
        (
            lambda z: meshflow.smooth(z, compute=Compute(threads=0)),
            "threads: a whole number, 1 or more, expected, got 0",
        ),
        (lambda z: meshflow.smooth(z, compute=Compute(threads=1.5)), "threads: a whole number"),
        (
            lambda z: meshflow.smooth(z, compute=Compute(stepper="leapfrog")),
            "auto, explicit, semi-implicit or super-time expected",
        ),
        (lambda z: meshflow.smooth(z, compute=Compute(dt=0.1, control=meshflow.AreaChange())), "one of them expected"),
        (lambda z: meshflow.smooth(z[0]), "2 or 3 dimensions|2 dimensions"),
        (lambda z: meshflow.smooth(z * 1j), "real numbers expected"),
        (lambda z: meshflow.smooth(object()), "expected a numpy array"),
        (lambda z: meshflow.smooth("terrain.tif"), "terrain.tif: no such file"),
        (lambda z: meshflow.smooth(meshflow.HeightField(z), spacing=3), "already says spacing"),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(call, words):
    with pytest.raises(InputError, match=words):
        call(noisy_plane(8)[1])


@pytest.mark.shared
@shared
@pytest.mark.parametrize("path", sorted((SHARED / "meshes/messy").glob("*")), ids=lambda p: p.name)
def test_every_messy_mesh_gives_a_finite_result(path):
    data = meshflow.read(path).data
    for stepper in ("explicit", "semi-implicit"):
        outcome = run(
            data,
            Request.of(
                stop=Steps(3), compute=Compute(stepper=stepper, dt=None if stepper == "explicit" else data.step**2)
            ),
        )
        assert np.isfinite(outcome.after.points).all()
        assert np.array_equal(outcome.after.faces, data.faces)
        around = connect((data.faces,), len(data.points))
        # Single triangles, and borders of fewer than five vertices, rest.
        rests = around.rim.all() and border_operator(around, data.points, data.fixed).nnz == 0
        assert (outcome.end.largest > 0) != (outcome.start.area == 0 or rests)


@pytest.mark.long
@pytest.mark.shared
@shared
def test_the_horse_with_its_slivers_is_smoothed_in_one_call():
    data = meshflow.read(SHARED / "meshes/irregular/horse.vtp").data
    outcome = run(data, Request.of(method="curvature"))
    assert np.isfinite(outcome.after.points).all()
    assert outcome.end.area < outcome.start.area
    assert np.abs(outcome.after.points - data.points).max() < 20 * data.step


@pytest.mark.shared
@shared
def test_quantisation_of_a_real_terrain_is_reduced_against_the_truth():
    coarse = meshflow.read(SHARED / "dem/mola_olympus_crop_q200m_derived.tif").data
    truth = meshflow.read(SHARED / "dem/mola_olympus_crop_derived.tif").data.z
    smoothed = run(coarse, Request.of(method=Search(contrast=coarse.step / 115), time=coarse.step**2)).after.z
    before, after = (np.sqrt(np.mean((z.astype(float) - truth) ** 2)) for z in (coarse.z, smoothed))
    assert before == pytest.approx(57.3, abs=0.1)
    assert after < 40, f"rms to the unquantised truth {before:.1f} m before, {after:.1f} m after"


@pytest.mark.shared
@shared
def test_a_ragged_mask_of_missing_samples_is_the_same_afterwards():
    before = meshflow.read(SHARED / "dem/SainteHelens.dem").data
    after = run(before, Request.of(stop=Steps(5))).after
    assert before.missing.sum() == 4151
    assert np.array_equal(after.missing, before.missing)
    assert np.isfinite(after.z[~before.missing]).all()
