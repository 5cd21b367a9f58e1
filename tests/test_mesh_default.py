"""What a mesh gets by default: clean parts as they were, noise of any kind away, whatever its numbering and place."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
import trimesh
from scipy.spatial import Delaunay

import meshflow
from meshflow.errors import InputError, NotConverged
from meshflow.estimate.mesh_noise import noise_of_points
from meshflow.estimate.spikes import _put_back_near
from meshflow.estimate.voxels import voxels_of
from meshflow.evaluate.metrics import normal_angle, volume
from meshflow.geometry.folds import moved_without_folds, new_folds
from meshflow.geometry.laplacians import neighbour_means
from meshflow.geometry.normals import mean_edge, measured, normals_at
from meshflow.geometry.orientation import alike
from meshflow.synthetic import shapes

MAKE = trimesh.creation
MESHES = Path(__file__).parents[2] / "shared" / "data" / "meshes"
ROUNDS = [[0, 0], [1, 0], [1, 0.3], [0.4, 0.5], [0.4, 2], [0.7, 2.2], [0.7, 2.6], [0, 2.6]]
CLEAN = {
    "box": MAKE.box((3, 2, 1)),
    "box, subdivided": MAKE.box((3, 2, 1)).subdivide().subdivide(),
    "cylinder": MAKE.cylinder(1, 3, sections=32),
    "fine cylinder": MAKE.cylinder(1, 3, sections=200),
    "cone": MAKE.cone(1, 2, sections=40),
    "capsule": MAKE.capsule(2, 1),
    "annulus": MAKE.annulus(0.5, 1, 1),
    "torus": MAKE.torus(1, 0.3),
    "turned": MAKE.revolve(ROUNDS),
    "ball of triangles": MAKE.icosphere(3),
    "ball of strips": MAKE.uv_sphere(count=[20, 20]),
}
CUBE, BALL, PART = shapes.cube(10), shapes.sphere(3), shapes.part(0.04)


def impulsive(shape, share, level, seed=3):
    """Points of which a share is off along the normals."""
    rng = np.random.default_rng(seed)
    off = (rng.random(len(shape.points)) < share) * rng.normal(size=len(shape.points))
    return shape.points + (level * shape.edge * off)[:, None] * shape.normals()


def ball_of_voxels(cells):
    """The level set of a binary ball as marching cubes leaves it, in voxels, and its radius."""
    import pyvista

    z = np.stack(np.meshgrid(*[np.arange(cells) - (cells - 1) / 2] * 3, indexing="ij"), axis=-1)
    radius = 0.4 * cells
    grid = pyvista.ImageData(dimensions=(cells,) * 3)
    grid.point_data["inside"] = (np.linalg.norm(z, axis=-1) < radius).astype(float).ravel(order="F")
    found = grid.contour([0.5], scalars="inside", method="marching_cubes", compute_normals=False).clean().triangulate()
    return np.asarray(found.points, float) - (cells - 1) / 2, found.faces.reshape(-1, 4)[:, 1:], radius


@pytest.mark.parametrize("name", CLEAN)
def test_what_was_drawn_comes_back_to_the_bit(name):
    points, faces = np.array(CLEAN[name].vertices), np.array(CLEAN[name].faces)
    result = meshflow.smooth((points, faces), result=True)
    assert np.array_equal(result.data[0], points)
    assert "no noise was found" in result.stopped_because


@pytest.mark.parametrize("name", ["antfile", "planefile"])
def test_models_of_few_polygons_stay_to_the_bit(name):
    import pyvista
    from pyvista import examples

    model = pyvista.read(getattr(examples, name)).triangulate()
    points, faces = np.asarray(model.points), model.faces.reshape(-1, 4)[:, 1:]
    assert np.array_equal(meshflow.smooth((points, faces))[0], points)


def test_drawn_parts_are_clean_in_single_precision_wherever_they_lie():
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.6, 0.3]))[:3, :3]
    for name in ("box, subdivided", "fine cylinder", "annulus"):
        points = (np.array(CLEAN[name].vertices) @ turn + 1.7).astype(np.float32)
        assert np.array_equal(meshflow.smooth((points, np.array(CLEAN[name].faces)))[0], points)


@pytest.mark.parametrize("level", [0.1, 0.3, 0.7])
@pytest.mark.parametrize("kind", ["nrm", "iso"])
@pytest.mark.parametrize("shape", [shapes.cube(16), shapes.sphere(4)], ids=["cube", "ball"])
def test_sigma_of_white_noise_has_no_bias_however_strong(shape, kind, level):
    found = noise_of_points(shape.noisy(kind, level), shape.faces)
    assert found.sigma / shape.edge == pytest.approx(level, rel=0.12)
    assert found.is_plain


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_sigma_of_impulses_is_their_root_mean_square_and_they_are_told_from_other_noise(share):
    shape = shapes.sphere(4)
    points = impulsive(shape, share, 0.5)
    true = np.sqrt(np.mean(np.square(shape.distance(points))))
    found = noise_of_points(points, shape.faces)
    assert found.sigma == pytest.approx(true, rel=0.12)
    assert found.kurtosis > 3.8


@pytest.mark.long
@pytest.mark.parametrize("shape", [shapes.sphere(4), shapes.cube(20), shapes.dome(3000)], ids=["ball", "cube", "dome"])
def test_sigma_of_correlated_noise_is_that_of_the_noise_and_not_of_its_differences(shape):
    from meshflow.geometry.laplacians import neighbour_means

    mean = neighbour_means(shape.faces, len(shape.points), "free")
    off = np.random.default_rng(2).normal(size=len(shape.points))
    for _ in range(3):
        off = 0.5 * (off + mean @ off)
    points = shape.points + (0.15 * shape.edge * off / off.std())[:, None] * shape.normals()
    found = noise_of_points(points, shape.faces)
    assert found.spread in (2, 3, 4)
    assert found.sigma / shape.edge == pytest.approx(0.15, rel=0.2)
    after = meshflow.smooth((points, shape.faces))[0]
    assert normal_angle(after, shape.points, shape.faces) < 0.3 * normal_angle(points, shape.points, shape.faces)


@pytest.mark.parametrize("shape", [BALL, shapes.cube(16, True), shapes.dome(2000)], ids=["ball", "cube", "dome"])
def test_white_noise_is_not_taken_for_correlated(shape):
    found = [noise_of_points(shape.noisy("nrm", level, seed), shape.faces) for seed in range(4) for level in (0.1, 0.4)]
    assert [noise.spread for noise in found] == [0] * 8


# Mean angles between normals, degrees, with a tenth to spare beside those that were measured.
ANGLES = [
    (CUBE, "nrm", 0.1, 1.8),
    (CUBE, "nrm", 0.3, 2.0),
    (CUBE, "iso", 0.3, 2.5),
    (BALL, "nrm", 0.3, 2.0),
    (BALL, "iso", 0.3, 2.6),
    (BALL, "nrm", 0.7, 4.5),
    (PART, "iso", 0.3, 6.0),
]


def uneven_sheet(count, seed=3):
    """A bumpy sheet over random points, whose density varies by a thousand, and its border."""
    rng, side = np.random.default_rng(seed), np.linspace(0, 1, 40)
    rims = [np.c_[side, 0 * side], np.c_[side, 0 * side + 1], np.c_[0 * side, side], np.c_[0 * side + 1, side]]
    flat = np.unique(np.concatenate([np.c_[rng.random(count) ** 3, rng.random(count)], *rims]), axis=0)
    return np.c_[flat, 0.1 * np.sin(3 * flat[:, 0]) * np.cos(2 * flat[:, 1])], Delaunay(flat).simplices


STRIPS, DRUM = MAKE.uv_sphere(count=[30, 30]), MAKE.cylinder(1, 3, sections=64).subdivide_to_size(0.25)
# Triangles whose sides differ by ten times and more, noise in all directions, and the mean angle of normals that is left.
UNEVEN = {
    "ball of strips": (STRIPS.vertices, STRIPS.faces, 0.3, 1.2),
    "drum": (DRUM.vertices, DRUM.faces, 0.4, 8.0),
    "sheet": (*uneven_sheet(2500), 0.1, 4.0),
}


@pytest.mark.parametrize("name", UNEVEN)
def test_strongly_uneven_triangles_come_right_however_folded_by_their_noise(name):
    points, faces, level, most = UNEVEN[name]
    points, faces = np.array(points), np.array(faces)
    noisy = points + level * mean_edge(points, faces) * np.random.default_rng(6).normal(size=points.shape)
    angle = normal_angle(meshflow.smooth((noisy, faces))[0], points, faces)
    assert angle < most, f"{angle:.2f} degrees"


@pytest.mark.long
@pytest.mark.parametrize(("kind", "level", "most"), [("iso", 0.1, 0.4), ("iso", 0.3, 0.6), ("nrm", 0.3, 0.45)])
def test_a_smooth_shape_keeps_neither_facets_nor_waves_of_its_noise(kind, level, most):
    shape = shapes.sphere(4)
    after = meshflow.smooth((shape.noisy(kind, level, 12), shape.faces))[0]
    assert normal_angle(after, shape.points, shape.faces) < most
    assert np.sqrt(np.mean(np.square(shape.distance(after)))) < 0.1 * level * shape.edge


# Noise of all directions that folds the surface; it lengthens edges, so that it seems to be less of them than it is.
FOLDING = [
    (shapes.part(0.026), "iso", 0.3, 3),
    (shapes.part(0.026), "iso", 0.5, 4),
    (shapes.cube(14, True), "iso", 0.5, 5),
    (shapes.blob(20), "iso", 0.3, 6),
    (shapes.dome(1200), "iso", 0.4, 7),
]


@pytest.mark.long
@pytest.mark.parametrize("level", [0.4, 0.5])
def test_noise_between_moderate_and_strong_leaves_creases(level):
    shape = shapes.part(0.026)
    after = meshflow.smooth((shape.noisy("iso", level, 3), shape.faces))[0]
    assert normal_angle(after, shape.points, shape.faces) < 4.0


@pytest.mark.parametrize(("shape", "kind", "level", "most"), ANGLES)
def test_normals_come_right_by_default_and_nothing_folds(shape, kind, level, most):
    points = shape.noisy(kind, level)
    after = meshflow.smooth((points, shape.faces))[0]
    angle = normal_angle(after, shape.points, shape.faces)
    assert angle < most, f"{angle:.2f} degrees"
    assert len(new_folds(points, after, shape.faces)) == 0


@pytest.mark.parametrize(("share", "seed"), [(0.1, 3), (0.1, 4), (0.1, 6), (0.5, 3)])
def test_impulses_are_taken_away(share, seed):
    points = impulsive(CUBE, share, 0.5, seed)
    after = meshflow.smooth((points, CUBE.faces))[0]
    angle = normal_angle(after, CUBE.points, CUBE.faces)
    assert angle < 0.35 * normal_angle(points, CUBE.points, CUBE.faces), f"{angle:.2f} degrees"


def test_a_piece_of_which_every_vertex_is_taken_for_a_spike_stays_where_it_is():
    # As on a range map of MeshLab's samples, of which six vertices went 3000 mm away.
    strip = np.array([[0, 0, 0], [0.7, 0, -0.3], [1.5, 0, -0.5], [0, -0.7, 0.8], [0.7, -0.7, 0.3], [1.5, -0.7, 0.3]])
    n, h = len(BALL.points), BALL.edge
    faces = np.vstack([BALL.faces, n + np.array([[0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2]])])
    points, spikes = np.vstack([BALL.points, 3.0 + h * strip]), np.zeros(n + 6, bool)
    spikes[[5, 50, 500, *range(n, n + 6)]] = True
    points[[5, 50, 500]] *= 1.0 + 2.0 * h
    umbrella = sparse.csr_matrix(sparse.identity(n + 6) - neighbour_means(faces, n + 6, "free"))
    found, lost = _put_back_near(umbrella, points, points, normals_at(points, faces), spikes)
    assert np.flatnonzero(lost).tolist() == list(range(n, n + 6))
    assert np.array_equal(found[n:], points[n:])
    assert np.abs(np.linalg.norm(found[:n], axis=1) - 1.0).max() < 0.2 * h


@pytest.mark.parametrize("shape", [CUBE, BALL], ids=["cube", "ball"])
def test_single_spikes_are_put_back_and_told_and_nothing_else_moves(shape):
    rng = np.random.default_rng(5)
    spikes = rng.random(len(shape.points)) < 0.03
    off = spikes * rng.choice([-1.0, 1.0], size=len(spikes))
    points = shape.points + (2.0 * shape.edge * off)[:, None] * shape.normals()
    result = meshflow.smooth((points, shape.faces), result=True)
    after, angle = result.data[0], normal_angle(result.data[0], shape.points, shape.faces)
    assert angle < 0.45 * normal_angle(points, shape.points, shape.faces), f"{angle:.2f} degrees"
    assert any("points are spikes" in said for said in result.warnings)
    assert result.stopped_because.startswith("but for spikes, no noise was found")
    assert np.linalg.norm(after - shape.points, axis=1)[~spikes].max() < 0.3 * shape.edge


@pytest.mark.long
@pytest.mark.parametrize("shape", [CUBE, BALL], ids=["cube", "ball"])
def test_what_comes_back_does_not_depend_on_numbering_turns_of_triangles_place_or_unit(shape):
    points, faces = shape.noisy("nrm", 0.3), shape.faces
    expected = meshflow.smooth((points, faces))[0]
    rng = np.random.default_rng(1)
    order = rng.permutation(len(points))
    number = np.argsort(order)
    mixed = faces.copy()
    mixed[::2] = mixed[::2][:, [0, 2, 1]]
    size = np.abs(points).max()
    np.testing.assert_allclose(meshflow.smooth((points, mixed))[0], expected, atol=1e-10 * size)
    # Several changes at once: what depends on one of them is told by this, too.
    again = meshflow.smooth((points[order], np.roll(number[faces][rng.permutation(len(faces))], 1, axis=1)))[0]
    np.testing.assert_allclose(again, expected[order], atol=1e-10 * size)
    moved = meshflow.smooth(((points + 0.37) * 3.7, faces[:, ::-1]))[0]
    np.testing.assert_allclose(moved / 3.7 - 0.37, expected, atol=1e-10 * size)


@pytest.mark.parametrize("shape", [CUBE, BALL], ids=["cube", "ball"])
def test_what_comes_back_is_the_same_in_any_unit_or_the_unit_is_refused(shape):
    points, faces = shape.noisy("iso", 0.2), shape.faces
    expected = meshflow.smooth((points, faces))[0]
    for unit in (1e-60, 1e60):
        np.testing.assert_allclose(meshflow.smooth((points * unit, faces))[0] / unit, expected, atol=1e-10)
    with pytest.raises(InputError, match="a size of 1e-75 or more expected, got .*e-160; scale the data"):
        meshflow.smooth((points * 1e-160, faces))
    with pytest.raises(
        InputError, match=r"numbers up to 1e\+75 expected, got .*e\+159 as a typical one; scale the data"
    ):
        meshflow.smooth((points * 1e160, faces))


def test_triangles_that_are_turned_against_their_neighbours_are_told():
    points, mixed = BALL.noisy("nrm", 0.3), BALL.faces.copy()
    mixed[:200] = mixed[:200][:, [0, 2, 1]]
    result = meshflow.smooth((points, mixed), result=True)
    assert any("200 of 1280 triangles are oriented against their neighbours" in said for said in result.warnings)
    assert np.array_equal(result.data[1], mixed)
    back, turned = alike(mixed)
    assert turned == 200
    assert np.array_equal(np.sort(back, axis=1), np.sort(BALL.faces, axis=1))
    assert volume(BALL.points, back) == pytest.approx(volume(BALL.points, BALL.faces))


def test_a_strip_with_one_side_stays_as_it_is_turned():
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    faces = np.array([[[2 * i, 2 * i + 1, 2 * i + 2], [2 * i + 2, 2 * i + 1, 2 * i + 3]] for i in range(23)])
    faces = np.concatenate([faces.reshape(-1, 3), [[46, 47, 1], [1, 47, 0]]])
    assert len(around) == 24
    assert np.array_equal(alike(faces)[0], faces)


def test_a_clean_body_beside_a_noisy_one_stays_to_the_bit():
    box = CLEAN["box, subdivided"]
    noisy, far = BALL.noisy("nrm", 0.3), np.array(box.vertices) + 5.0
    points = np.concatenate([noisy, far])
    faces = np.concatenate([BALL.faces, np.array(box.faces) + len(noisy)])
    after = meshflow.smooth((points, faces))[0]
    assert np.array_equal(after[len(noisy) :], far)
    assert normal_angle(after[: len(noisy)], BALL.points, BALL.faces) < 2.0


@pytest.mark.parametrize("cells", [40, 60])
def test_steps_of_voxels_are_smoothed_within_half_a_voxel_and_the_volume_kept(cells):
    points, faces, radius = ball_of_voxels(cells)
    assert voxels_of(points, faces).shortest == pytest.approx(1.0)
    after = meshflow.smooth((points, faces))[0]
    normals, _ = measured(after, faces)
    middle = after[faces].mean(axis=1)
    cosine = np.einsum("ij,ij->i", normals, middle) / np.linalg.norm(middle, axis=1)
    angle = np.degrees(np.arccos(np.clip(np.abs(cosine), -1, 1))).mean()
    assert angle < 1.5, f"{angle:.2f} degrees"
    assert np.sqrt(np.mean((np.linalg.norm(after, axis=1) - radius) ** 2)) < 0.1
    assert np.linalg.norm(after - points, axis=1).max() <= 0.5 + 1e-9
    assert abs(volume(after, faces)) == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.005)


def test_a_box_of_whole_numbers_is_no_volume_of_voxels():
    box = MAKE.box((8, 6, 4)).subdivide().subdivide().subdivide()
    assert voxels_of(np.array(box.vertices), np.array(box.faces)) is None


def test_what_would_fold_moves_otherwise_and_nothing_else_does():
    points, faces = BALL.points, BALL.faces
    after = points.copy()
    after[7] += 2.5 * (points[faces[(faces == 7).any(axis=1)][0]].mean(axis=0) - points[7])  # beyond its neighbours
    assert len(new_folds(points, after, faces)) > 0
    free = np.zeros(len(points), bool)
    found, less = moved_without_folds(points, after, faces, free)
    assert len(new_folds(points, found, faces)) == 0
    assert 0 < less < 40
    near = np.unique(faces[(faces == 7).any(axis=1)])
    for _ in range(2):
        near = np.unique(faces[np.isin(faces, near).any(axis=1)])
    still = np.setdiff1d(np.arange(len(points)), near)
    assert np.array_equal(found[still], points[still])


@pytest.mark.long
@pytest.mark.parametrize(("shape", "kind", "level", "seed"), FOLDING)
def test_no_fold_is_left_of_those_that_noise_made(shape, kind, level, seed):
    points, nowhere = shape.noisy(kind, level, seed), np.zeros_like(shape.points)
    assert len(new_folds(nowhere, points, shape.faces)) > 50  # where all triangles have no area nothing is folded
    result = meshflow.smooth((points, shape.faces), result=True)
    assert len(new_folds(nowhere, result.data[0], shape.faces)) == 0
    assert not any("of its area" in warning for warning in result.warnings)  # noise has area; the shape has lost none


POINTS_OF_A_LINE = np.c_[np.arange(20.0), np.zeros((20, 2))]
ALONG = np.stack([np.arange(18), np.arange(1, 19), np.arange(2, 20)], axis=1)
HALF_A_BALL = np.where(np.arange(len(BALL.points))[:, None] < 300, BALL.points[0], BALL.points)
DEGENERATE = {
    "a point": (np.zeros((6, 3)), np.array([[0, 1, 2], [3, 4, 5]])),
    "a line": (POINTS_OF_A_LINE, ALONG),
    "half a ball in a point": (HALF_A_BALL, BALL.faces),
    "one triangle": (np.eye(3), np.array([[0, 1, 2]])),
    "triangles twice and turned round": (BALL.noisy("iso", 0.2), np.concatenate([BALL.faces, BALL.faces[:40, ::-1]])),
}


@pytest.mark.filterwarnings("error", "ignore::meshflow.errors.MeshflowWarning")
@pytest.mark.parametrize("method", [None, "principal", "conformal", "fairing", "normal-filter", "curvature", "taubin"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_meshes_come_back_finite_and_without_a_word_of_numpy(name, method):
    points, faces = DEGENERATE[name]
    if (name, method) == ("half a ball in a point", "principal"):
        with pytest.raises(NotConverged, match="out of range"):
            meshflow.smooth((points, faces), method=method)
        return
    assert np.isfinite(meshflow.smooth((points, faces), method=method)[0]).all()


def test_strength_means_more_of_the_same_method():
    points = CUBE.noisy("nrm", 0.3)
    one, two = (meshflow.smooth((points, CUBE.faces), strength=s, result=True).parameters for s in (1.0, 2.0))
    assert one["method"].value == two["method"].value
    assert two["time"].value == pytest.approx(4.0 * one["time"].value)


@pytest.mark.skipif(not MESHES.exists(), reason="no ../shared/data/meshes")
def test_where_no_method_helps_the_rim_stays_as_well():
    model = trimesh.load(MESHES / "attributes" / "fuze.obj", process=False)
    points = np.array(model.vertices)
    result = meshflow.smooth((points, np.array(model.faces)), result=True)
    assert "data left unchanged" in result.stopped_because
    assert np.array_equal(result.data[0], points)


@pytest.mark.parametrize(("sides", "size"), [((10, 1, 1), 0.2), ((6, 6, 0.25), 0.2), ((4, 3, 2), 0.3)])
def test_a_box_of_uneven_triangles_has_no_spikes_and_stays_to_the_bit(sides, size):
    box = trimesh.creation.box(sides).subdivide_to_size(size)
    found = meshflow.smooth(box, result=True)
    np.testing.assert_array_equal(found.data.vertices, box.vertices)
    assert not found.warnings
