"""Metrics of what is known, and samples whose truth holds to rounding."""

import numpy as np
import pytest
import trimesh
from helpers import shapes
from scipy.spatial import cKDTree

from meshflow.errors import InputError
from meshflow.evaluate import facts as module
from meshflow.evaluate import metrics
from meshflow.evaluate.facts import describe
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.synthetic import samples

RNG = np.random.default_rng(0)


def test_a_surface_compared_with_itself_differs_by_nothing():
    z = RNG.normal(size=(8, 9)) + 5
    points, faces = shapes.sphere(200)
    for data in (HeightField(z), Image(np.stack([z, z], -1)), RangeImage(z, Pinhole(9, 9, 4, 4)), Mesh(points, faces)):
        same = metrics.compare(data, data)
        assert (same.rms, same.median, same.largest) == (0, 0, 0)
        assert same.normal_angle in (0, None)
        assert same.area_before == same.area_after > 0


def test_differences_are_those_of_the_samples_that_both_have():
    one, other = np.zeros((4, 5)), np.full((4, 5), 3.0)
    one[0, 0], other[1, 1], other[2, 2] = np.nan, np.nan, 7.0
    found = metrics.compare(HeightField(one), HeightField(other))
    assert found.samples == 18
    assert (found.missing_before, found.missing_after) == (1, 1)
    assert found.largest == 7.0
    assert found.median == 3.0
    assert found.rms == pytest.approx(np.sqrt((17 * 9 + 49) / 18))


def test_the_angle_between_two_tilted_planes_is_exact():
    rows, columns = np.mgrid[0:6, 0:7]
    for angle in (1e-6, 1.0, 30.0):
        found = metrics.compare(HeightField(0.0 * columns), HeightField(np.tan(np.radians(angle)) * columns))
        assert found.normal_angle == pytest.approx(angle, rel=1e-9)


def test_volume_and_area_of_a_cube_are_exact_wherever_it_stands():
    cube = trimesh.creation.box((2, 3, 4))
    assert metrics.volume(cube.vertices + 1e6, np.asarray(cube.faces)) == pytest.approx(24, rel=1e-9)
    assert metrics.area(cube.vertices, np.asarray(cube.faces)) == pytest.approx(52)
    assert metrics.volume(cube.vertices, np.asarray(cube.faces)[:, ::-1]) == pytest.approx(-24)
    found = metrics.compare(Mesh(cube.vertices, cube.faces), Mesh(2 * cube.vertices, cube.faces))
    assert found.volume_after == pytest.approx(8 * found.volume_before)
    with pytest.raises(InputError, match="a closed mesh expected"):
        metrics.volume(cube.vertices, np.asarray(cube.faces)[1:])


@pytest.mark.parametrize(
    ("one", "other", "words"),
    [
        (HeightField(np.ones((3, 3))), Image(np.ones((3, 3))), "one kind expected, got height field and image"),
        (HeightField(np.ones((3, 3))), HeightField(np.ones((3, 4))), r"got shapes \(3, 3\) and \(3, 4\)"),
        (HeightField(np.ones((3, 3)), 1.0), HeightField(np.ones((3, 3)), 2.0), "same spacing dx expected"),
        (
            HeightField(np.ones((3, 3)), unit="m"),
            HeightField(np.ones((3, 3)), unit="ft"),
            "in one unit expected, got ft and m",
        ),
        (Mesh(np.eye(3), [[0, 1, 2]]), Mesh(np.eye(3), [[0, 2, 1]]), "the same triangles expected"),
        (Mesh(np.eye(3), [[0, 1, 2]]), Mesh(np.eye(4)[:, :3], [[0, 1, 2]]), "the same points expected"),
    ],
)
def test_what_cannot_be_compared_is_refused(one, other, words):
    with pytest.raises(InputError, match=words):
        metrics.compare(one, other)


def test_samples_of_one_seed_are_equal_and_of_another_differ():
    for make in (samples.terrain, samples.depth_scene, samples.irregular_mesh, samples.picture):
        one, same, other = make(seed=3), make(seed=3), make(seed=4)
        assert np.array_equal(one.noisy, same.noisy, equal_nan=True)
        assert not np.array_equal(one.noisy, other.noisy, equal_nan=True)


def test_noise_has_the_deviation_that_was_asked_for():
    sample = samples.terrain(noise=3.0)
    assert (sample.noisy - sample.truth).std() == pytest.approx(3.0, rel=0.02)
    scene = samples.depth_scene(noise=0.004)
    seen = np.isfinite(scene.truth)
    assert ((scene.noisy - scene.truth) / scene.truth**2)[seen].std() == pytest.approx(0.004, rel=0.02)
    mesh = samples.irregular_mesh(noise=0.02)
    moved = np.linalg.norm(mesh.noisy - mesh.truth, axis=1)
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(0.02, rel=0.03)
    smooth = np.ones(len(moved), bool)  # away from the rims: there a normal leads straight away from the surface
    for axis, height in zip(mesh.body.axes, mesh.body.heights, strict=True):
        smooth &= np.abs(np.arccos(mesh.truth @ axis / np.linalg.norm(mesh.truth, axis=1)) - np.arccos(height)) > 0.1
    assert np.allclose(mesh.body.distance(mesh.noisy)[smooth], moved[smooth], atol=1e-12)


def test_cast_depths_lie_on_the_analytic_surfaces_and_the_nearest_hides_the_others():
    scene = samples.depth_scene()
    rays = samples.CAMERA.rays(scene.truth.shape)
    points = rays * scene.truth[..., None]
    for index, solid in enumerate(scene.solids):
        seen = scene.seen == index
        assert seen.sum() > 1000
        assert np.abs(solid.distance(points[seen])).max() < 1e-12
        assert (solid.cast(rays)[~np.isnan(scene.truth)] >= scene.truth[~np.isnan(scene.truth)]).all()
    panel, other, ball, block = scene.solids
    assert np.abs(points[scene.seen == 0] @ panel.normal - panel.offset).max() < 1e-12
    assert (points[scene.seen == 1][:, 0] > other.low).all()
    from_ball = np.linalg.norm(points[scene.seen == 2] - ball.centre, axis=1)
    assert np.abs(from_ball - ball.radius).max() < 1e-12
    from_block = np.linalg.norm(points[scene.seen == 3] - block.centre, axis=1)
    assert block.half <= from_block.min() < 1.01 * block.half
    assert from_block.max() <= np.sqrt(3) * block.half
    assert np.array_equal(np.isnan(scene.truth), scene.seen == -1)
    assert 0.01 < np.isnan(scene.truth).mean() < 0.2


def test_true_vertices_lie_on_the_capped_ball_and_close_it():
    mesh = samples.irregular_mesh(800)
    assert np.abs(mesh.body.distance(mesh.truth)).max() < 1e-12
    assert metrics.is_closed(mesh.faces)
    caps = sum(np.pi * (1 - h) ** 2 * (2 + h) / 3 for h in mesh.body.heights)
    assert metrics.volume(mesh.truth, mesh.faces) == pytest.approx(4 * np.pi / 3 - caps, rel=0.02)


def test_the_distance_from_the_capped_ball_is_that_of_its_nearest_point():
    dense = samples.irregular_mesh(20_000, density=1.0)
    points = RNG.uniform(-1.3, 1.3, (2000, 3))
    exact, sampled = dense.body.distance(points), cKDTree(dense.truth).query(points)[0]
    gap = 0.04  # no point of the surface is farther from a vertex
    assert (exact <= sampled + 1e-12).all()
    assert (sampled <= exact + gap).all()
    far = exact > 0.2
    assert (sampled[far] <= np.hypot(exact[far], 0.15)).all()


def test_a_spacing_per_row_measures_each_triangle_in_its_own_chart():
    rows, columns = np.mgrid[0:5, 0:6]
    dx = np.linspace(1.0, 2.0, 5)
    found = metrics.compare(HeightField(0.0 * rows, (dx, 3.0)), HeightField(4.0 * rows, (dx, 3.0)))
    # Each triangle has one leg in a row: rows 1 to 3 bear triangles on both sides, the first and the last on one.
    base = 5 * 3.0 * 0.5 * (dx[:-1] + dx[1:]).sum()
    assert found.area_before == pytest.approx(base, rel=1e-12)
    assert found.area_after == pytest.approx(base * 5 / 3, rel=1e-12)
    assert found.normal_angle == pytest.approx(np.degrees(np.arctan(4 / 3)), rel=1e-12)


def test_triangles_across_a_jump_of_depth_in_either_count_in_neither():
    camera, flat = Pinhole(9, 9, 4, 4), np.full((6, 8), 2.0)
    stepped = np.where(np.arange(8) < 4, 2.0, 3.0)[None] * np.ones((6, 1))
    one = metrics.compare(RangeImage(flat, camera), RangeImage(stepped, camera))
    other = metrics.compare(RangeImage(stepped, camera), RangeImage(flat, camera))
    whole = metrics.compare(RangeImage(flat, camera), RangeImage(flat, camera))
    assert one.area_before == other.area_after == pytest.approx(whole.area_before * 6 / 7)
    assert one.normal_angle == pytest.approx(0, abs=1e-9)


def test_words_leave_out_what_does_not_apply_and_name_the_unit():
    z = np.ones((4, 5))
    words = metrics.compare(HeightField(z, unit="m"), HeightField(z + 1, unit="m")).words()
    assert (words["unit"], words["rms difference"], words["samples compared"]) == ("m", 1.0, 20)
    assert "volume before" not in words
    image = metrics.compare(Image(np.ones((4, 5, 3))), Image(np.ones((4, 5, 3)))).words()
    assert not {"unit", "mean angle of normals (degrees)"} & set(image)


def test_nothing_in_common_is_refused():
    one, other = np.ones((4, 4)), np.ones((4, 4))
    one[:2], other[2:] = np.nan, np.nan
    with pytest.raises(InputError, match="no sample is present in both"):
        metrics.compare(HeightField(one), HeightField(other))
    with pytest.raises(InputError, match="finite in both"):
        metrics.rms_difference(one, other)
    with pytest.raises(InputError, match=r"one shape expected, got \(4, 4\) and \(4,\)"):
        metrics.largest_difference(one, one[0])
    with pytest.raises(InputError, match="one camera expected"):
        metrics.compare(RangeImage(one, Pinhole(9, 9, 4, 4)), RangeImage(one, Pinhole(9, 9, 4, 5)))


def test_a_sampling_is_as_irregular_as_it_says():
    mesh = samples.irregular_mesh(4000, density=5.0)
    dense, sparse = (np.mean(sign * mesh.truth[:, 0] > 0.6) for sign in (1, -1))
    assert 3.0 < dense / sparse < 6.0


@pytest.mark.parametrize(
    "make",
    [lambda: samples.terrain(8), lambda: samples.irregular_mesh(50), lambda: samples.irregular_mesh(density=0.5)],
)
def test_samples_too_small_to_mean_anything_are_refused(make):
    with pytest.raises(InputError, match="expected, got"):
        make()


def test_facts_name_what_is_wrong_with_a_mesh():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [9, 9, 9], [0, 0, 1], [0, 0, -1]])
    facts = describe(Mesh(points, [[0, 1, 2], [0, 1, 3], [0, 1, 5], [0, 1, 6]]))
    assert facts["isolated points"] == 1
    assert facts["triangles without area"] == 1
    assert facts["non-manifold edges"] == 1
    assert facts["boundary edges"] == 8
    assert facts["area"] == pytest.approx(1.5)


def test_facts_of_grids_name_size_spacing_and_what_is_missing():
    z = np.ones((4, 5))
    z[0, 0] = np.nan
    facts = describe(HeightField(z, (np.linspace(1, 2, 4), 3.0)))
    assert facts["rows x columns"] == "4 x 5"
    assert facts["spacing"] == "1 to 2 (per row) x 3"
    assert facts["missing"] == "1 of 20 samples (5.0%)"
    assert describe(RangeImage(np.ones((4, 5)), Pinhole(9, 9, 4, 4)))["kind"] == "range image"
    assert describe(Image(np.ones((4, 5, 3))))["channels"] == 3


@pytest.mark.parametrize("k", [0, 2], ids=["heights", "image"])
@pytest.mark.parametrize("at_once", [1, 40, 100])
def test_the_facts_of_bands_of_rows_are_those_of_the_whole(k, at_once, monkeypatch):
    rng = np.random.default_rng(0)
    values, missing = rng.normal(size=(23, 11, k) if k else (23, 11)), rng.random((23, 11)) < 0.2
    missing[9:14] = True
    spacing = (np.linspace(1.0, 2.0, 23), 1.5)
    data = Image(values, spacing, missing) if k else HeightField(values, spacing, missing)
    whole = describe(data)
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    parts = describe(data)
    assert parts.pop("area") == pytest.approx(whole.pop("area"), rel=1e-12)
    assert parts == whole
