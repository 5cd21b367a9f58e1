"""The plane-preserving border of meshes: planes rest, nothing grows, whatever the triangles; noise of the border decays."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

import meshflow
from meshflow.estimate.constraints import Fixed
from meshflow.flow.blend import euler
from meshflow.flow.compute import Compute
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.steppers import SemiImplicit
from meshflow.geometry.border import border_operator
from meshflow.geometry.connectivity import connect
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh


def planar(seed, least, most):
    """A random planar Delaunay mesh, whose border has slivers."""
    draw = np.random.default_rng(seed)
    flat = draw.random((int(draw.integers(least, most)), 2))
    return flat, Delaunay(flat).simplices


def terrain(seed, noise=0.005):
    """The smallest case of issue 19: sixty points of the unit square and its corners, on a plane with noise."""
    draw = np.random.default_rng(seed)
    flat = np.concatenate([draw.random((60, 2)), [[0, 0], [1, 0], [0, 1], [1, 1]]])
    plane = 0.3 * flat[:, 0] - 0.1 * flat[:, 1]
    z = plane + noise * draw.normal(size=64)
    return flat, Delaunay(flat).simplices, plane, z


def flow_of(flat, faces):
    return MeshFlow(Mesh(np.column_stack([flat, 0 * flat[:, 0]]), faces).lifted(Lift()))


@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.hour) for part in range(1, 8))])
def test_on_ten_thousand_planar_meshes_planes_rest_and_nothing_grows(part):
    for seed in range(1250 * part, 1250 * (part + 1)):
        flat, faces = planar(seed, 4, 17)
        flow = flow_of(flat, faces)
        generator = flow.generator(flow.start(), "cotangent").toarray()
        fastest = np.abs(generator).max()
        decay = np.linalg.eigvals(generator)
        assert decay.real.min() >= -1e-9 * fastest, f"seed {seed}: {decay.real.min():.3g} of {fastest:.3g}"
        assert np.abs(decay.imag).max() <= 1e-6 * fastest, f"seed {seed}"
        assert np.abs(generator @ flow.start()).max() <= 1e-10 * fastest, f"seed {seed}"
        assert np.abs(decay).max() <= flow.bound(flow.start()) * (1 + 1e-9), f"seed {seed}"


def test_the_system_of_an_implicit_step_is_symmetric_with_vertices_held_or_not():
    flat, faces = planar(3, 30, 40)
    points = np.column_stack([flat, np.random.default_rng(0).normal(size=len(flat)) * 0.1])
    for held in (np.zeros(len(flat), bool), np.arange(len(flat)) % 7 == 0):
        flow = MeshFlow(Mesh(points, faces, fixed=held).lifted(Lift()))
        system = flow.system(flow.start())
        matrix = system.matrix(0.01).toarray()
        assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
        assert np.linalg.eigvalsh(matrix).min() > 0
        moved = SemiImplicit().step(flow, flow.start(), 0.01)
        assert np.array_equal(moved[held], points[held])
        change = np.linalg.solve(matrix, 0.01 * system.mass[:, None] * flow.rate(flow.start()))
        assert np.allclose(moved - points, change, atol=1e-9)


@pytest.mark.parametrize("seed", range(40))
def test_every_step_leaves_a_planar_mesh_where_it_is(seed):
    flat, faces = planar(seed, 4, 40)
    flow = flow_of(flat, faces)
    u = flow.start()
    dt = 2.0 / flow.bound(u)
    for _ in range(20):
        u = flow.rate(u, 0, euler(dt))
    assert np.abs(u - flow.start()).max() < 1e-9
    far = SemiImplicit().step(flow, flow.start(), 1.0)
    assert np.abs(far - flow.start()).max() < 1e-7


def written_out(flat, faces, held):
    """The operator as its docstring has it, by loops."""
    edges, mass = {}, np.zeros(len(flat))
    for i, j, k in faces:
        u, v = flat[j] - flat[i], flat[k] - flat[i]
        mass[[i, j, k]] += abs(u[0] * v[1] - u[1] * v[0]) / 6.0
        for a, b in ((i, j), (j, k), (k, i)):
            edges[frozenset((a, b))] = edges.get(frozenset((a, b)), 0) + 1
    beside = {}
    for edge in (tuple(e) for e, count in edges.items() if count == 1):
        for a, b in (edge, edge[::-1]):
            beside.setdefault(a, []).append(b)
    whole = np.zeros((len(flat), len(flat)))
    for middle, two in beside.items():
        window = [middle]
        for side, first in ((0, two[0]), (1, two[1])):
            before, here = middle, first
            for _ in range(2):
                window.insert(0 if side == 0 else len(window), here)
                before, here = here, next(b for b in beside[here] if b != before)
        if len(set(window)) < 5:
            continue
        linear = np.column_stack([np.ones(5), flat[window]])
        away = np.eye(5) - linear @ np.linalg.pinv(linear)
        whole[np.ix_(window, window)] += away / mass[window].mean()
    whole[held] = 0.0
    return whole


@pytest.mark.parametrize("seed", range(8))
def test_the_border_operator_is_what_is_written(seed):
    flat, faces = planar(seed, 12, 40)
    held = np.random.default_rng(seed).random(len(flat)) < 0.1
    found = border_operator(connect((faces,), len(flat)), flat, held).toarray()
    literal = written_out(flat, faces, held)
    assert np.abs(found - literal).max() < 1e-9 * np.abs(literal).max()
    turned = (
        np.column_stack([flat, np.zeros(len(flat))]) @ np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    )
    assert np.abs(border_operator(connect((faces,), len(flat)), turned, held).toarray() - literal).max() < (
        1e-8 * np.abs(literal).max()
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_a_surveyed_terrain_is_never_thrown_about(seed):
    flat, faces, plane, z = terrain(seed)
    points = np.column_stack([flat, z])
    off = np.abs(z - plane).max()
    for words in (
        {"method": "fairing", "time": 0.01, "compute": Compute(search=False)},
        {"method": "curvature", "time": 0.01},
        {"method": "curvature", "time": 0.01, "compute": Compute(stepper="semi-implicit")},
    ):
        found = meshflow.smooth((points, faces), boundary="plane-preserving", **words)[0]
        # Noise of 0.005, on slivers of 0.001 and less, tilts triangles at will: points go as far as their neighbours are.
        assert np.abs(found - points).max() < 0.1, words
    found = meshflow.smooth((np.column_stack([flat, 0 * z]), faces), channels=z, method="beltrami", time=1.0)[2]
    assert np.abs(found - plane).max() <= off * (1 + 1e-9)


def test_two_flat_triangles_stay_and_a_border_loses_its_noise():
    for seed in range(20):
        flat, faces = planar(seed, 4, 5)
        found = meshflow.smooth((np.column_stack([flat, 0 * flat[:, 0]]), faces), method="curvature", time=5.0)[0]
        assert np.abs(found[:, :2] - flat).max() < 1e-12
    draw = np.random.default_rng(0)
    y, x = np.mgrid[0:20, 0:20].astype(float)
    flat = np.stack([x.ravel(), y.ravel()], axis=1) + draw.uniform(-0.3, 0.3, (400, 2))
    faces = Delaunay(flat).simplices
    plane, noise = flat @ [0.4, -0.2], 0.1 * draw.normal(size=400)
    rim = connect((faces,), 400).rim
    found = meshflow.smooth(
        (np.column_stack([flat, 0 * plane]), faces), channels=plane + noise, method="beltrami", time=4.0
    )[2]
    left = (found - plane)[rim].std() / noise[rim].std()
    assert left < 0.65, f"{left:.2f} of the noise of the border is left"
    held = meshflow.smooth(
        (np.column_stack([flat, 0 * plane]), faces),
        channels=plane + noise,
        method="beltrami",
        time=4.0,
        constraints=Fixed(rim),
    )[2]
    assert np.array_equal(held[rim], (plane + noise)[rim])
