"""Laws of the cotangent operator, in every dimension, against finite differences, libigl and known curvatures."""

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from helpers import shapes

from meshflow.errors import InputError
from meshflow.geometry import operator
from meshflow.geometry.connectivity import boundary_edges
from meshflow.surfaces.triangles import grid_triangulations, triangles_there

SHARED = Path(__file__).parents[2] / "shared" / "data"
IGL_MASS = {"barycentric": igl.MASSMATRIX_TYPE_BARYCENTRIC, "voronoi": igl.MASSMATRIX_TYPE_VORONOI}


@pytest.mark.parametrize("d", [2, 3, 4, 5, 6, 7])
def test_l_x_is_the_finite_difference_gradient_of_area(d):
    points, faces = shapes.soup(12, 20, d)
    gradient, eps = operator.stiffness(points, faces) @ points, 1e-6
    for i in range(len(points)):
        for q in range(d):
            there, back = points.copy(), points.copy()
            there[i, q] += eps
            back[i, q] -= eps
            slope = (operator.total_area(there, faces) - operator.total_area(back, faces)) / (2 * eps)
            assert gradient[i, q] == pytest.approx(slope, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("d", [3, 4, 5, 7])
def test_stiffness_is_symmetric_semidefinite_and_its_rows_sum_to_zero(d):
    points, faces = shapes.soup(30, 60, d)
    dense = operator.stiffness(points, faces).toarray()
    scale = np.abs(dense).max()
    assert np.abs(dense - dense.T).max() <= 1e-14 * scale
    assert np.abs(dense.sum(axis=1)).max() <= 1e-13 * scale
    assert np.linalg.eigvalsh(dense).min() >= -1e-12 * scale


@pytest.mark.parametrize(("kind", "total"), [("barycentric", 1.0), ("voronoi", 1.0), ("ring", 3.0)])
def test_masses_sum_to_the_area(kind, total):
    points, faces = shapes.soup(30, 60, 4)
    assert operator.mass(points, faces, kind).sum() == pytest.approx(
        total * operator.total_area(points, faces), rel=1e-13
    )


def _differences(points, faces):
    """Largest differences from libigl, relative to the largest entry: stiffness and two masses."""
    found = [
        abs(operator.stiffness(points, faces) + igl.cotmatrix(points, faces)).max()
        / abs(igl.cotmatrix(points, faces)).max()
    ]
    for kind, word in IGL_MASS.items():
        theirs = igl.massmatrix(points, faces, word).diagonal()
        found.append(np.abs(operator.mass(points, faces, kind) - theirs).max() / theirs.max())
    return found


@pytest.mark.parametrize("d", [3, 4, 5])
def test_operator_equals_libigl_on_soups_and_grids(d):
    rng = np.random.default_rng(d)
    grid = np.mgrid[0:9, 0:11].reshape(2, -1).T
    heights = np.column_stack([grid, rng.normal(size=(99, d - 2))])
    worst = max(max(_differences(*shapes.soup(60, 100, d, seed))) for seed in range(5))
    worst = max(
        worst, *_differences(heights, grid_triangulations(triangles_there(np.zeros((9, 11), bool)), "forward")[0])
    )
    print(f"largest relative difference from libigl in R^{d}: {worst:.1e}")
    assert worst <= 1e-12


def _real_meshes():
    names = sorted((SHARED / "meshes").glob("*/*")) if SHARED.exists() else []
    return [p for p in names if p.suffix.lower() in {".off", ".obj", ".ply", ".stl", ".vtp"}]


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
@pytest.mark.parametrize("path", _real_meshes(), ids=lambda p: p.name)
def test_operator_equals_libigl_on_real_meshes(path):
    import pyvista

    if path.suffix == ".vtp":
        mesh = pyvista.read(path)
        points, faces = np.asarray(mesh.points, float), mesh.regular_faces
    else:
        loaded = trimesh.load(path, process=False, force="mesh")
        points, faces = np.asarray(loaded.vertices, float), np.asarray(loaded.faces)
    edges = points[faces] - np.roll(points[faces], 1, axis=1)
    longest = np.square(edges).sum(axis=2).max(axis=1)
    doubled = 2 * operator.cotangents(points, faces)[1]
    # The horse has six triangles without area; everything else counts, its slivers of 1 : 10^4 too.
    sound = faces[doubled > 1e-10 * longest]
    assert len(sound) > 0
    worst = max(_differences(points, sound.astype(np.int64)))
    print(f"{path.name}: {len(sound)} of {len(faces)} triangles, largest relative difference from libigl {worst:.1e}")
    assert worst <= 1e-12


def test_unit_sphere_sampled_irregularly_has_mean_curvature_one():
    errors = {n: np.abs(operator.mean_curvature(*shapes.sphere(n, shake=0.05)) - 1) for n in (500, 2000, 8000)}
    rms = {n: float(np.sqrt(np.mean(e**2))) for n, e in errors.items()}
    order = np.log(rms[500] / rms[8000]) / np.log(4)
    share = float((errors[2000] < 0.02).mean())
    assert share > 0.99, f"{share:.1%} of vertices within 2 % (Figure 6); rms {rms}, observed order {order:.2f}"
    assert order > 0.2, f"rms {rms}, observed order {order:.2f}"


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")
def test_every_inner_vertex_of_the_sampled_hemisphere_has_mean_curvature_one_within_two_percent():
    mesh = trimesh.load(SHARED / "meshes/irregular/hemisphere.off", process=False)
    faces = np.asarray(mesh.faces)
    corners = boundary_edges(faces)
    rim = np.unique([faces[corners // 3, (corners + turn) % 3] for turn in (1, 2)])
    inner = np.setdiff1d(np.arange(len(mesh.vertices)), rim)
    error = np.abs(operator.mean_curvature(np.asarray(mesh.vertices), faces) - 1)[inner]
    assert error.max() < 0.02, f"largest error {error.max():.2%} (Figure 6)"


@pytest.mark.parametrize(
    ("profile", "length", "expected", "order"),
    [(np.ones_like, np.pi, 0.5, 1.7), (np.cosh, 2.0, 0.0, 0.8)],
    ids=["cylinder", "catenoid"],
)
def test_mean_curvature_of_a_surface_of_revolution_converges(profile, length, expected, order):
    errors = []
    for rings, around in ((20, 40), (40, 80), (80, 160)):
        points, faces, inside = shapes.tube(profile, rings, around, length, shake=0.0)
        errors.append(np.sqrt(np.mean((operator.mean_curvature(points, faces) - expected)[inside] ** 2)))
    observed = np.log2(errors[0] / errors[2]) / 2
    assert observed > order, f"rms errors {errors}, observed order {observed:.2f}, expected above {order}"
    assert errors[-1] < 0.02


def test_a_flat_irregular_mesh_has_no_curvature_inside_nor_on_its_border():
    points, faces, inside = shapes.square()
    assert operator.mean_curvature(points, faces).max() < 1e-10
    natural = operator.area_gradient(points, faces)
    assert np.abs(natural[inside]).max() < 1e-13
    assert np.abs(natural[~inside]).max() > 1e-3  # the variational boundary does pull


@pytest.mark.parametrize("kind", ["barycentric", "voronoi", "ring"])
@pytest.mark.parametrize("d", [3, 5])
def test_no_eigenvalue_exceeds_the_bound_of_the_triangles(d, kind):
    points, faces = shapes.soup(40, 70, d)
    used = np.unique(faces)
    dense = operator.stiffness(points, faces).toarray()[np.ix_(used, used)]
    half = 1 / np.sqrt(operator.mass(points, faces, kind)[used])
    largest = np.linalg.eigvalsh(half[:, None] * dense * half).max()
    bound = operator.rate_bound(*operator.cotangents(points, faces), kind).max()
    assert largest <= bound * (1 + 1e-12)


def test_the_bound_of_one_triangle_is_its_eigenvalue():
    points, faces = np.random.default_rng(3).normal(size=(3, 4)), np.array([[0, 1, 2]])
    third = operator.total_area(points, faces) / 3
    largest = np.linalg.eigvalsh(operator.stiffness(points, faces).toarray()).max() / third
    assert operator.rate_bound(*operator.cotangents(points, faces))[0] == pytest.approx(largest, rel=1e-12)


@pytest.mark.parametrize("amplitude", [0.0, 0.3, 1.0, 2.0, 30.0, 1e5])
def test_twelve_over_h_squared_bounds_every_height_field(amplitude):
    rng, h = np.random.default_rng(1), 0.7
    grid = np.mgrid[0:40, 0:40].reshape(2, -1).T * h
    for channels in (1, 3):
        points = np.column_stack([grid, amplitude * rng.normal(size=(1600, channels))])
        faces = grid_triangulations(triangles_there(np.zeros((40, 40), bool)), "forward")[0]
        assert operator.rate_bound(*operator.cotangents(points, faces)).max() <= 12 / h**2 * (1 + 1e-9)


def test_steep_cliffs_keep_their_digits():
    # 2T of a cell lifted by 1e9: the difference of products |u|^2 |v|^2 - (u.v)^2 would have none left.
    points = np.array([[0.0, 0, 0], [1, 0, 1e9], [0, 1, 1e9]])
    assert operator.total_area(points, np.array([[0, 1, 2]])) == pytest.approx(0.5 * np.sqrt(1 + 2e18), rel=1e-14)


def test_triangles_without_area_contribute_nothing():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [0.5, 0, 0]])
    good, bad = np.array([[0, 1, 2]]), np.array([[0, 1, 2], [0, 1, 3], [0, 4, 1], [1, 1, 2], [2, 2, 2]])
    assert np.array_equal(operator.stiffness(points, bad).toarray(), operator.stiffness(points, good).toarray())
    assert np.array_equal(operator.mass(points, bad), operator.mass(points, good))


def test_an_edge_of_one_triangle_is_boundary_and_one_of_three_is_not():
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 5, 6]])
    corners = boundary_edges(faces)
    edges = {frozenset((int(faces[c // 3, (c + 1) % 3]), int(faces[c // 3, (c + 2) % 3]))) for c in corners}
    assert edges == {frozenset(e) for e in ((1, 2), (0, 2), (0, 3), (1, 3), (1, 4), (0, 4))}


def test_an_unknown_mass_is_refused():
    with pytest.raises(InputError, match="barycentric, voronoi, ring expected, got 'lumped'"):
        operator.mass(*shapes.soup(), "lumped")
