"""Normals of triangles flow, points follow. meshflow.flow.methods.normal_filter, meshflow.geometry.normals."""

import numpy as np
import pytest
from helpers.shapes import along_normals, sphere, square

from meshflow.errors import InputError
from meshflow.evaluate.metrics import normal_angle, volume
from meshflow.flow.controls import Until
from meshflow.flow.march import march
from meshflow.flow.methods.normal_filter import NormalFilter, NormalFilterFlow
from meshflow.geometry import nearness
from meshflow.geometry import normals as facets
from meshflow.geometry.connectivity import shared_sides
from meshflow.geometry.fewer_sweeps import fewer_sweeps, widest
from meshflow.geometry.normals import mean_edge
from meshflow.smoothing import smooth
from meshflow.surfaces.free import Axes
from meshflow.surfaces.surface import Surface
from meshflow.synthetic.shapes import cube

MADE = cube(12)
CUBE, SIDES = MADE.points, MADE.faces


def test_without_triangles_there_are_no_normals_and_no_edges():
    none = np.zeros((0, 3), int)
    assert np.array_equal(facets.normals_at(np.eye(3), none), np.zeros((3, 3)))
    assert facets.mean_edge(np.eye(3), none) == 0.0


def run(points, faces, rounds=20, how=None, **more):
    engine = NormalFilterFlow(Surface(points, (faces,), **more), how)
    *_, last = march(engine, Until(steps=rounds))
    return last.u


def test_the_triangle_beyond_an_edge_shares_it():
    across = facets.beyond(SIDES)
    assert (across >= 0).all()
    for f in range(0, len(SIDES), 37):
        for c in range(3):
            edge = {SIDES[f, (c + 1) % 3], SIDES[f, (c + 2) % 3]}
            assert edge <= set(SIDES[across[f, c]])
            assert across[f, c] != f


def test_edges_of_two_triangles_are_found_in_the_order_of_their_ends_and_no_others():
    faces = np.random.default_rng(0).integers(0, 24, (80, 3))
    beside = {}
    for f, face in enumerate(faces):
        for c in range(3) if len(set(face)) == 3 else ():
            ends = sorted((face[(c + 1) % 3], face[(c + 2) % 3]))
            beside.setdefault(tuple(ends), []).append(3 * f + c)
    expected = [beside[ends] for ends in sorted(beside) if len(beside[ends]) == 2]
    assert len(expected) > 20
    assert max(map(len, beside.values())) > 2
    assert np.array_equal(np.stack(shared_sides(faces), axis=1), expected)


def test_a_border_and_an_edge_of_three_triangles_have_nothing_beyond():
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    assert (facets.beyond(faces) == -1).all()


@pytest.mark.parametrize("sweeps", [1, 4, 5, 10, 20, 50, 300])
@pytest.mark.parametrize("least", [-1.0, -1.0 / 3.0])
def test_fewer_stages_lead_as_far_as_many_sweeps_and_never_away(sweeps, least):
    means = np.linspace(least, 1.0, 2001)  # -1: the eigenvalues of any mean with positive weights
    before, now, stages = np.ones_like(means), np.ones_like(means), fewer_sweeps(sweeps, least)
    for keep, pull in stages:
        before, now = now, now + keep * (before - now) + pull * (means * now - now)
    assert len(stages) == min(sweeps, np.ceil(1.75 * np.sqrt(0.5 * (1.0 - least) * sweeps)))
    assert np.abs(now).max() <= 1 + 1e-12
    smooth_modes, alternating = sweeps * (1.0 - means) < 0.1, sweeps * (1.0 - means) > 8.0
    np.testing.assert_allclose(now[smooth_modes], means[smooth_modes] ** sweeps, atol=0.003)
    if len(stages) < sweeps:
        assert np.abs(now[alternating]).max(initial=0.0) < 0.1


def test_means_over_triangles_are_those_of_many_sweeps():
    across, sweeps, stages = facets.beyond(cube(3).faces), 40, 24
    m, w0 = len(across), widest(sweeps, stages)
    values, weights = np.random.default_rng(5).normal(size=(m, 2)), np.full(across.shape, 0.3)
    away = 0.9 * np.eye(m)
    np.subtract.at(away, (np.arange(m)[:, None], across), weights)
    chebyshev = np.polynomial.chebyshev.Chebyshev.basis(stages)
    eigenvalues, vectors = np.linalg.eigh(away)
    expected = vectors @ (chebyshev(w0 - 0.5 * (w0 + 1.0) * eigenvalues)[:, None] * (vectors.T @ values))
    found = facets.averaged(values, weights, across, sweeps, stages)
    np.testing.assert_allclose(found, expected, atol=1e-9 * chebyshev(w0))
    many = np.linalg.matrix_power(np.eye(m) - away, sweeps) @ values
    assert np.abs(found / chebyshev(w0) - many).max() < 0.02 * np.abs(values).max()


def test_a_run_passes_through_the_states_of_a_search_and_rounds_are_longer_later():
    noisy, square = along_normals(CUBE, SIDES, 0.2), mean_edge(along_normals(CUBE, SIDES, 0.2), SIDES) ** 2
    how, engine = (
        NormalFilter(crease_contrast=4.0),
        NormalFilterFlow(Surface(noisy, (SIDES,)), NormalFilter(crease_contrast=4.0)),
    )
    times = (10.0 * square, 100.0 * square, 200.0 * square)
    states = list(how.states(engine, noisy, times))
    passed = list(march(engine, Until(time=times[-1]), control=how.control(None, times[-1])))
    assert [round(state.dt / square) for state in passed[1:]] == [10] * 10 + [25] * 4
    for at, state in zip((1, 10, 14), states, strict=True):
        np.testing.assert_allclose(passed[at].u, state, atol=1e-13)


def test_planes_rest_wherever_they_lie():
    points, faces, _ = square(300)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    points = points @ turn + 50.0
    assert (
        np.abs(run(points, faces, how=NormalFilter(crease_contrast=1.0, crease_sharpness=2.0)) - points).max()
        < 1e-12 * 50
    )


def test_a_cube_rests_but_for_its_corners_of_unequal_triangles():
    found = run(CUBE, SIDES, rounds=30)
    assert normal_angle(found, CUBE, SIDES) < 0.1
    assert volume(found, SIDES) == pytest.approx(1.0, abs=1e-3)


def test_noise_goes_and_creases_stay():
    noisy = along_normals(CUBE, SIDES, 0.3)
    assert normal_angle(noisy, CUBE, SIDES) > 25
    found = smooth((noisy, SIDES))[0]
    # 3.6 degrees of MeshLib at its best on a finer cube; the coarser, the more triangles lie at a crease.
    assert normal_angle(found, CUBE, SIDES) < 3.0
    assert volume(found, SIDES) == pytest.approx(1.0, abs=0.02)


def test_a_ball_is_smooth_afterwards_and_keeps_its_volume():
    points, faces, *_ = sphere(1500, shake=0.2)
    noisy = along_normals(points, faces, 0.2)
    found = smooth((noisy, faces))[0]
    assert normal_angle(noisy, points, faces) > 12
    assert normal_angle(found, points, faces) < 2.5
    assert np.abs(np.linalg.norm(found, axis=1) - 1).std() < 0.3 * np.abs(np.linalg.norm(noisy, axis=1) - 1).std()
    assert volume(found, faces) == pytest.approx(volume(points, faces), rel=0.01)


def test_fixed_points_stay_and_a_mesh_turned_or_scaled_gives_the_same():
    noisy = along_normals(CUBE, SIDES, 0.2)
    fixed = CUBE[:, 2] > 0.4
    found = run(noisy, SIDES, 5, fixed=fixed)
    assert np.array_equal(found[fixed], noisy[fixed])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    other = run(7.0 * noisy @ turn, SIDES, 5, fixed=fixed)
    assert np.abs(other / 7.0 - found @ turn).max() < 1e-10


def test_triangles_without_area_do_no_harm():
    faces = np.vstack([SIDES, [[0, 0, 1], [3, 3, 3]]])
    found = run(along_normals(CUBE, SIDES, 0.2), faces, 5)
    assert np.isfinite(found).all()


def test_the_order_in_which_a_large_mesh_is_run_changes_nothing(monkeypatch):
    points, rng = along_normals(CUBE, SIDES, 0.2), np.random.default_rng(3)
    order = rng.permutation(len(points))
    faces = rng.permutation(np.argsort(order)[SIDES])
    held = rng.random(len(points)) < 0.1
    how = NormalFilter(regularize=0.3 * mean_edge(CUBE, SIDES) ** 2)
    expected = run(points[order], faces, 5, how, fixed=held)
    monkeypatch.setattr(nearness, "LARGE", 0)
    found = run(points[order], faces, 5, how, fixed=held)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.array_equal(found[held], points[order][held])


def test_parts_do_not_touch_each_other():
    noisy = along_normals(CUBE, SIDES, 0.2)
    both = np.vstack([noisy, noisy + 3.0])
    found = run(both, np.vstack([SIDES, SIDES + len(CUBE)]), 5)
    assert np.abs(found[: len(CUBE)] + 3.0 - found[len(CUBE) :]).max() < 1e-12


def test_what_the_normal_filter_is_given_is_checked():
    with pytest.raises(InputError, match="crease_contrast"):
        NormalFilter(crease_contrast=0.0)
    with pytest.raises(InputError, match="regularize: a squared length"):
        NormalFilter(regularize=-1.0)
    points, faces, _ = square(30)
    with pytest.raises(InputError, match=r"normal-filter: a mesh in R\^3 whose points move expected"):
        NormalFilterFlow(Surface(points, (faces,), Axes((2,))))
    with pytest.raises(InputError, match="explicit rounds"):
        NormalFilterFlow(Surface(points, (faces,))).system(points)


def test_the_result_names_the_method_and_its_origin():
    result = smooth((along_normals(CUBE, SIDES, 0.3), SIDES), result=True)
    assert result.parameters["method"].value == "normal-filter"
    assert result.parameters["method"].origin == "estimated"
    assert result.noise.sigma == pytest.approx(0.3 * mean_edge(CUBE, SIDES), rel=0.15)
    assert {"risk", "time", "crease_contrast", "crease_sharpness", "regularize"} <= set(result.parameters)
    assert "normal-filter" in str(result)
    assert len(result.to_dict()["candidates"]) == len(result.candidates) >= 5
