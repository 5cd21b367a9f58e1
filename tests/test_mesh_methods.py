"""How the points of a mesh move, at the front door."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.parts import parts
from helpers.shapes import along_normals, sphere, square

from meshflow.errors import InputError
from meshflow.estimate.constraints import Fixed, PreserveArea, PreserveVolume
from meshflow.evaluate.metrics import area, volume
from meshflow.flow.blend import euler
from meshflow.flow.compute import Compute
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.methods import ConformalFlow, CurvatureFlow, Fairing, NormalFilter
from meshflow.geometry.connectivity import connect
from meshflow.geometry.normals import normals_at
from meshflow.io.files import read
from meshflow.smoothing import smooth
from meshflow.surfaces.surface import Surface

BALL, FACES, *_ = sphere(600)
NOISY = along_normals(BALL, FACES, 0.2)
MESHES = Path(__file__).parents[2] / "shared" / "data" / "meshes"
WAYS = [
    {"method": "curvature"},
    {"method": "curvature", "stepper": "semi-implicit", "time": 0.05},
    {"method": "conformal", "time": 0.05},
    {"method": "fairing"},
    {"method": "fairing", "order": 10, "weights": "uniform"},
    {"method": "normal-filter"},
    {},
]
NAMES = [" ".join(map(str, way.values())) or "default" for way in WAYS]
FLAT = [way for way in WAYS if way.get("weights") != "uniform"]
MESSY = [*sorted((MESHES / "messy").glob("*.*")), MESHES / "irregular" / "horse.vtp"]
BRIEF = [{}, {"method": "fairing", "order": 4}, {"method": "curvature"}]


@pytest.mark.parametrize("way", WAYS, ids=NAMES)
def test_volume_is_kept_to_rounding_where_promised(way):
    found = smooth((NOISY, FACES), **parts(preserve="volume", **way))[0]
    assert volume(found, FACES) == pytest.approx(volume(NOISY, FACES), rel=1e-10)
    assert np.abs(found - NOISY).max() > 1e-3


@pytest.mark.parametrize(("keep", "measure"), [(PreserveVolume(by="scaling"), volume), (PreserveArea(), area)])
def test_scaling_keeps_what_it_says(keep, measure):
    found = smooth((NOISY, FACES), method="curvature", time=0.05, constraints=keep)[0]
    assert measure(found, FACES) == pytest.approx(measure(NOISY, FACES), rel=1e-10)


@pytest.mark.parametrize("way", WAYS[:6], ids=NAMES[:6])
def test_motion_along_normals_slides_nowhere(way):
    far = NOISY + 100.0
    words = {
        "method": way["method"],
        "steps": 1,
        **({} if way["method"] in ("curvature", "normal-filter") else {"dt": 0.01}),
    }
    found = smooth((far, FACES), **parts(along="normals", **words))[0]
    normals = normals_at(far, FACES)
    moved = found - far
    across = moved - np.einsum("ij,ij->i", moved, normals)[:, None] * normals
    assert np.abs(moved).max() > 1e-4
    assert np.abs(across).max() < 1e-12 * 100


def test_the_conformalised_flow_of_what_is_like_a_sphere_ends_at_one():
    points = BALL * [1.0, 0.8, 0.6]
    found = smooth((points, FACES), method="conformal", time=3.0, compute=Compute(dt=0.05))[0]
    # The sphere of least squares: |x|^2 = 2 c . x + (r^2 - c^2).
    middle = np.linalg.lstsq(np.column_stack([2 * found, np.ones(len(found))]), (found**2).sum(axis=1))[0][:3]
    radii = np.linalg.norm(found - middle, axis=1)
    assert radii.std() / radii.mean() < 0.01
    assert np.linalg.norm(points, axis=1).std() / np.linalg.norm(points, axis=1).mean() > 0.1
    assert volume(found, FACES) == pytest.approx(volume(points, FACES), rel=1e-9)


@pytest.mark.parametrize("way", FLAT, ids=lambda way: " ".join(map(str, way.values())) or "default")
def test_flat_irregular_meshes_rest_in_every_flow(way):
    points, faces, _ = square(300)
    found = smooth((points, faces), **parts(**{"time": 0.01, **way} if way else way))[0]
    assert np.abs(found - points).max() < 1e-12


@pytest.mark.long
@pytest.mark.shared
@pytest.mark.skipif(not MESHES.exists(), reason="no ../shared/data/meshes")
def test_what_would_only_lose_by_it_is_left_alone_and_says_so():
    horse = read(MESHES / "irregular" / "horse.vtp").data
    result = smooth(horse, result=True)
    assert np.array_equal(result.after.points, horse.points)
    assert "estimated to increase the error" in result.stopped_because


def test_thin_triangles_ask_for_others_and_the_result_says_so():
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-7, 0], [0.5, 1, 0.3], [0.5, -1, 0.3]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 4]])
    result = smooth((points, faces), method="curvature", time=0.01, result=True)
    assert result.parameters["triangles"].value == "delaunay"
    assert np.isfinite(result.data[0]).all()
    assert smooth((NOISY, FACES), method="curvature", time=0.01, result=True).parameters["triangles"].value == "given"


def test_an_open_mesh_has_no_volume_to_keep():
    points, faces, _ = square(50)
    with pytest.raises(InputError, match="the mesh is open"):
        smooth((points, faces), method="curvature", constraints=PreserveVolume())
    with pytest.raises(InputError, match="are fixed or slowed; leave it out, or take PreserveVolume"):
        smooth(
            (NOISY, FACES),
            method="curvature",
            constraints=[Fixed(np.arange(len(NOISY)) == 0), PreserveVolume(by="scaling")],
        )


BAD = [
    ({"order": 0}, "order: a whole number"),
    ({"triangles": "clamped", "method": "normal-filter"}, "the normal filter uses no cotangents"),
    ({"weights": "round"}, "weights: cotangent or uniform"),
    ({"regularize": -1.0}, "regularize: a squared length"),
    ({"along": "edges"}, "along: all or normals"),
    ({"method": "normal-filter", "data_weights": 1.0}, "data weights work"),
    ({"method": "fairing", "stepper": "explicit"}, "stepper: method fairing has its own"),
    ({"method": "normal-filter", "crease_contrast": -1.0}, "crease_contrast: a positive"),
]


@pytest.mark.parametrize(("words", "said"), BAD, ids=[said for _, said in BAD])
def test_words_that_make_no_sense_are_refused(words, said):
    with pytest.raises(InputError, match=said):
        smooth((NOISY, FACES), **parts(**words))


def test_a_method_has_no_options_of_another_and_a_constraint_no_other_words():
    for made in (NormalFilter, CurvatureFlow, ConformalFlow):
        for option in ({"order": 2}, {"weights": "uniform"}):
            with pytest.raises(InputError, match=next(iter(option))):
                made(**option)
    for made in (Fairing, CurvatureFlow, ConformalFlow):
        with pytest.raises(InputError, match="regularize"):
            made(regularize=1.0)
    with pytest.raises(InputError, match="by: normals or scaling expected, got 'length'"):
        PreserveVolume(by="length")


def test_methods_of_points_are_refused_where_no_points_move():
    z = np.random.default_rng(0).normal(size=(20, 20))
    for words in ({"method": "normal-filter"}, {"order": 2}, {"preserve": "volume"}, {"along": "normals"}):
        with pytest.raises(InputError, match="only for a mesh whose points move"):
            smooth(z, **parts(**words))
        with pytest.raises(InputError, match="only for a mesh whose points move"):
            smooth((BALL, FACES), **parts(channels=BALL[:, 2], **words))


@pytest.mark.long
@pytest.mark.shared
@pytest.mark.skipif(not MESHES.exists(), reason="no ../shared/data/meshes")
@pytest.mark.parametrize("path", MESSY, ids=lambda path: path.name)
@pytest.mark.parametrize("way", BRIEF, ids=["default", "fairing", "curvature"])
def test_messy_meshes_stay_finite_in_the_order_they_came(path, way):
    data = read(path).data
    found = smooth(data, **parts(**way))
    assert np.isfinite(found.points).all()
    assert np.array_equal(found.faces, data.faces)
    assert found.points.shape == data.points.shape


@pytest.mark.parametrize("boundary", ["plane-preserving", "neumann", "fixed"])
@pytest.mark.parametrize("mass", ["barycentric", "voronoi"])
def test_the_step_in_one_loop_is_the_rate_times_dt(boundary, mass):
    points, faces, _ = square(200)
    points = points + 0.05 * np.random.default_rng(2).normal(size=points.shape)
    points = np.vstack([points, [[9.0, 9.0, 9.0]]])
    fixed = np.arange(len(points)) % 11 == 0
    flow = MeshFlow(Surface(points, (faces,), fixed=fixed, boundary=boundary), Variant(mass=mass))
    dt = 1.0 / flow.bound(points)
    assert np.abs(flow.rate(points, 0, euler(dt)) - (points + dt * flow.rate(points))).max() < 1e-13


def test_what_is_conformalised_keeps_its_volume_though_noise_is_area():
    after = smooth((NOISY, FACES), method="conformal", time=0.05)[0]
    assert volume(after, FACES) == pytest.approx(volume(NOISY, FACES), rel=1e-9)


def test_a_border_that_is_fixed_stays_whatever_is_kept():
    flat, faces, *_ = square(300)
    points = np.column_stack([flat[:, :2], 0.02 * np.random.default_rng(2).normal(size=len(flat))])
    rim = connect((faces,), len(points)).rim
    after = smooth((points, faces), method="conformal", time=0.01, boundary="fixed")[0]
    assert np.array_equal(after[rim], points[rim])
    assert not np.array_equal(after[~rim], points[~rim])
    with pytest.raises(InputError, match="PreserveArea: all points are scaled"):
        smooth((points, faces), method="fairing", boundary="fixed", constraints=PreserveArea())


def test_noise_that_was_found_from_very_few_vertices_is_warned_of():
    coarse, fine = trimesh.creation.icosphere(subdivisions=1), trimesh.creation.icosphere(3)
    coarse.vertices = along_normals(np.array(coarse.vertices), np.array(coarse.faces), 0.15)
    assert "from 42 vertices" in smooth(coarse, result=True).warnings[0]
    assert smooth(coarse, method="normal-filter", time=0.01, result=True).warnings == ()
    assert not any("vertices, whose shape" in warning for warning in smooth(fine, result=True).warnings)
