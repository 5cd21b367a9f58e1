"""Laws of the compiled loops over meshes: one for each thing that is compiled apart."""

import hashlib
import multiprocessing
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import scipy.sparse as sparse
from helpers import shapes

from meshflow.flow.conjugate_gradients import conjugate_gradients, packed_matrix, rows_of
from meshflow.geometry import blocks, curvature, delaunay, normals, operator
from meshflow.geometry.connectivity import connect, shared_sides
from meshflow.geometry.crossings import crossing_pairs
from meshflow.kernels import conjugate_gradients as cg_kernels
from meshflow.kernels import mesh_blocks, mesh_connectivity, mesh_crossings, mesh_delaunay, mesh_normals, mesh_operator
from meshflow.kernels.library import environment, using_threads
from meshflow.kernels.polynomials import chebyshev_degree
from meshflow.synthetic.shapes import sphere

SHARPNESS = (1.0, 1.5, 2.0, 3.0)


def everything(seed=0):
    """Numbers of every loop, of meshes of several blocks, by name."""
    rng, ball = np.random.default_rng(seed), sphere(6)
    points, faces = ball.noisy("iso", 0.2, 3), ball.faces[40:]
    n, m, found = len(points), len(faces), {}
    c = connect((faces,), n)
    pattern = c.pattern
    found |= {"border": c.border, "indices": pattern.indices, "slots": pattern.slots}
    for d in (1, 2, 3, 4, 5, 6):
        wide = np.ascontiguousarray(np.concatenate([points, points], axis=1)[:, :d] + 0.01 * rng.normal(size=(n, d)))
        charts = rng.normal(size=(m, 3, d))
        if d > 1:
            forms = operator.forms(charts)
            for q in SHARPNESS:
                found[f"sharpened {d} {q}"], _ = operator.cotangents(wide, faces, forms, q)
            found[f"cot {d}"], _ = operator.cotangents(wide, faces)
        cot, area = operator.cotangents(points, faces)
        found[f"gradient {d}"] = operator.gather_gradient(c, cot, wide, True)
        found[f"charts {d}"] = operator.gather_chart_gradient(c, cot, charts, True)
    held = rng.random(n) < 0.1
    for kind, word in enumerate(operator.MASSES):
        of_blocks = blocks.blocked(points, faces, kind, held)
        assert of_blocks is not None
        found[f"mass {word}"] = operator.gather_mass(c, cot, area, word)
        found[f"bound {word}"] = operator.rate_bound(cot, area, word)
        out, inverse = np.empty_like(points), np.empty(n)
        blocks.march_blocks(of_blocks, points, 1.0, 1e-4, out, inverse)
        found |= {f"step {word}": out, f"inverse {word}": inverse}
    rays = rng.normal(size=(n, 3))
    found |= {"L": operator.fill_stiffness(c, cot).data, "along rays": operator.fill_stiffness(c, cot, rays).data}
    found["seen"] = operator.gather_seen(c, points, rays)
    across, (at, areas) = normals.beyond(faces), normals.measured(points, faces)
    weights = normals.conductances(points, faces, across)
    for q in (2.0, 4.0, 8.0, 3.0):
        found[f"spread {q}"] = normals.spread(at, normals.NormalDiffusion(areas, weights, across, 2.0, q), 1e-4, 3)
    found["followed"] = normals.followed(points, c, at, held, 3)
    found["shared"] = shared_sides(faces)[0]
    diffusion = normals.NormalDiffusion(areas, weights, across, 8.0, 4.0)
    found["offsets"] = normals.shifted(c, at, areas, normals.crease_weights(at, diffusion).sum(axis=1), 0.01)
    found["averaged"] = normals.averaged(np.stack([area, areas], axis=1), 0.1 * weights, across, 50.0, 20)
    found["vertex normals"] = normals.normals_at(points, faces)
    found["crossings"] = crossing_pairs(ball.noisy("iso", 0.5, 3), faces)
    found["directed"] = curvature.directed(points, faces, 2.0)
    found["flipped"], lengths = delaunay.delaunay(faces, normals.side_lengths(points, faces))
    found["of lengths"], _ = delaunay.length_cotangents(lengths)
    matrix = operator.stiffness(points, faces) + sparse.identity(n)
    for k in range(1, 9):
        found[f"solved {k}"], _ = conjugate_gradients(
            sparse.csr_matrix(matrix), rng.normal(size=(n, k)), None, 1e-9, 60
        )
    return found


def digests():
    """What :func:`everything` finds, to the bit, in a line for each."""
    return {
        name: hashlib.sha256(np.ascontiguousarray(a).tobytes()).hexdigest()[:16] for name, a in everything().items()
    }


@pytest.fixture(scope="module")
def by_two_threads():
    with using_threads(2):
        return digests()


@pytest.mark.long
def test_no_loop_over_a_mesh_depends_on_the_number_of_threads(by_two_threads):
    for threads in (1, 5):
        with using_threads(threads):
            assert digests() == by_two_threads


@pytest.mark.long
def test_loops_over_a_mesh_give_the_same_bits_with_every_instruction_set(by_two_threads):
    others = [level for level in ("v2", "v3") if level != environment().instruction_set]
    if environment().instruction_set == "baseline" or not others:
        pytest.skip("one instruction set on this kind of machine")
    script = "import test_mesh_kernels as t; print(t.digests())"
    env = {**os.environ, "MESHFLOW_ISA": others[0], "PYTHONPATH": os.pathsep.join(sys.path)}
    reported = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True)
    if "cannot run the kernels" in reported.stderr:
        pytest.skip(reported.stderr.splitlines()[-1])
    assert reported.stdout.splitlines()[-1] == str(by_two_threads), reported.stderr


@pytest.mark.parametrize("sharpness", SHARPNESS)
@pytest.mark.parametrize("d", [2, 3, 4, 5, 6])
def test_triangles_measure_the_same_in_a_space_of_more_dimensions(d, sharpness):
    rng = np.random.default_rng(d)
    points, faces = shapes.soup(40, 70, d)
    forms = operator.forms(rng.normal(size=(70, 3, 3)))
    turned, _ = np.linalg.qr(rng.normal(size=(9, d)))
    for base, q in ((None, 1.0), (forms, sharpness)):
        here, there = (
            operator.cotangents(points, faces, base, q),
            operator.cotangents(points @ turned.T, faces, base, q),
        )
        for one, other in zip(here, there, strict=True):
            assert np.abs(one - other).max() <= 1e-11 * np.abs(one).max()


@pytest.mark.parametrize("d", [1, 2, 3, 4, 5])
def test_coordinates_are_gathered_each_by_itself_and_by_charts_as_by_points(d):
    points, faces = shapes.soup(40, 70, 3)
    wide = np.random.default_rng(d).normal(size=(40, d))
    c, (cot, _) = connect((faces,), 40), operator.cotangents(points, faces)
    for linear in (False, True):
        whole = operator.gather_gradient(c, cot, wide, linear)
        for q in range(d):
            assert np.array_equal(whole[:, q], operator.gather_gradient(c, cot, wide[:, q : q + 1], linear)[:, 0])
        assert np.array_equal(whole, operator.gather_chart_gradient(c, cot, wide[c.faces], linear))


def test_directions_that_are_all_one_unit_vector_leave_the_stiffness_as_it_is():
    points, faces = shapes.soup(40, 70, 3)
    c, (cot, _) = connect((faces,), 40), operator.cotangents(points, faces)
    plain, along = operator.fill_stiffness(c, cot), operator.fill_stiffness(c, cot, np.tile([0.0, 0.0, 1.0], (40, 1)))
    assert np.array_equal(plain.data, along.data)


def test_the_pattern_of_a_mesh_is_that_of_vertices_that_share_a_triangle_however_wide_a_fan_is():
    rng = np.random.default_rng(1)
    ring = 5 + rng.permutation(400)
    faces = np.concatenate(
        [shapes.soup(60, 100, 3)[1], [[3, i, j] for i, j in zip(ring, np.roll(ring, 1), strict=True)]]
    )
    faces = np.concatenate([faces, [[7, 7, 9], [8, 8, 8]]])
    c = connect((faces,), 500)
    ones = sparse.coo_matrix((np.ones(3 * len(faces)), (faces.ravel(), np.repeat(np.arange(len(faces)), 3))))
    ones.resize(500, len(faces))
    wanted = sparse.csr_matrix(ones @ ones.T + sparse.identity(500))
    wanted.sort_indices()
    pattern = c.pattern
    assert np.array_equal(pattern.indptr, wanted.indptr)
    assert np.array_equal(pattern.indices, wanted.indices)
    assert np.array_equal(pattern.indices[pattern.diagonal], np.arange(500))
    rows, corner = np.repeat(np.arange(500), np.diff(c.first)), c.corners
    for side, turn in enumerate((1, 2)):
        beside, slots = c.faces[corner // 3, (corner + turn) % 3], pattern.slots[:, side].astype(int)
        reported = slots < 255
        assert np.array_equal(pattern.indices[pattern.indptr[rows] + slots][reported], beside[reported])
        assert set(rows[~reported]) == {3}
        assert (np.searchsorted(pattern.indices[pattern.indptr[3] : pattern.indptr[4]], beside[~reported]) >= 255).all()
    cot = np.random.default_rng(2).normal(size=(len(faces), 3))
    entries = [(c.faces[:, a], c.faces[:, b], -0.5 * cot[:, 3 - a - b]) for a in range(3) for b in range(3) if a != b]
    i, j, w = (np.concatenate(part) for part in zip(*entries, strict=True))
    off = sparse.csr_matrix(sparse.coo_matrix((w, (i, j)), shape=(500, 500)))
    whole = off - sparse.diags(np.asarray(off.sum(axis=1)).ravel())
    assert abs(operator.fill_stiffness(c, cot) - whole).max() < 1e-13


def test_columns_of_a_system_are_solved_each_by_itself():
    ball, rng = sphere(4), np.random.default_rng(2)
    matrix = sparse.csr_matrix(operator.stiffness(ball.points, ball.faces) + sparse.identity(len(ball.points)))
    right = rng.normal(size=(len(ball.points), 9))
    for k in range(1, 10):
        whole, _ = conjugate_gradients(matrix, right[:, :k], None, 0.0, 15)
        for q in range(k):
            alone, _ = conjugate_gradients(matrix, np.ascontiguousarray(right[:, q : q + 1]), None, 0.0, 15)
            assert np.abs(whole[:, q] - alone[:, 0]).max() < 1e-13


def test_the_order_of_the_rows_of_a_system_does_not_change_what_solves_it():
    ball, rng = sphere(5), np.random.default_rng(3)
    n = len(ball.points)
    matrix = sparse.csr_matrix(operator.stiffness(ball.points, ball.faces) + sparse.identity(n))
    truth = rng.normal(size=(n, 3))
    for order in (None, np.arange(n, dtype=np.int32), rng.permutation(n).astype(np.int32)):
        x, iterations = conjugate_gradients(matrix, matrix @ truth, None, 1e-13, 300, order)
        assert iterations < 300
        assert np.abs(x - truth).max() < 1e-11


@pytest.mark.parametrize("columns", [1, 3, 4, 6])
def test_a_degree_of_polynomials_is_its_formula_to_the_bit_for_any_number_of_threads(columns):
    ball, rng = sphere(4), np.random.default_rng(5)
    n, matrix = len(ball.points), sparse.csr_matrix(operator.stiffness(ball.points, ball.faces))
    now, before, sums = rng.normal(size=(n, columns)), rng.normal(size=(n, columns)), rng.normal(size=(3, n, columns))
    terms = np.array([[0.3, -0.7], [0.0, 0.0], [1.5, 0.0]])
    after = 0.1 * (matrix @ now) - 2.0 * now - before
    summed = sums + terms[:, :1, None] * now + terms[:, 1:, None] * after
    for threads in (1, 2, 3):
        found, of_all = before.copy(), sums.copy()
        chebyshev_degree(*rows_of(matrix), 0.1, 2.0, terms, now, found, of_all, threads)
        assert np.array_equal(found, after)
        assert np.array_equal(of_all, summed)


@pytest.mark.parametrize("sharpness", [2.0, 4.0, 8.0])
def test_sharpnesses_by_products_are_limits_of_those_by_powers(sharpness):
    ball = sphere(4)
    points = ball.noisy("iso", 0.2, 1)
    at, areas = normals.measured(points, ball.faces)
    across = normals.beyond(ball.faces)
    weights = normals.conductances(points, ball.faces, across)
    one, other = (
        normals.spread(at, normals.NormalDiffusion(areas, weights, across, 2.0, q), 1e-2, 2)
        for q in (sharpness, sharpness + 1e-12)
    )
    assert np.abs(one - other).max() < 1e-11


def sound_calls():
    """A call of each kernel that reads indices: the kernel, its arguments, and which of them are indices."""
    ball = sphere(4)
    points, faces, n = ball.points, ball.faces.astype(np.int32), len(ball.points)
    m, c = len(faces), connect((faces,), n)
    p, (cot, area) = c.pattern, operator.cotangents(points, faces)
    across = normals.beyond(faces)
    b = blocks.blocked(points, faces, 0, np.zeros(len(points), bool))
    assert b is not None
    held, threes = np.zeros(n, bool), np.empty((m, 3))
    around = (c.first, c.corners)
    matrix = operator.fill_stiffness(c, cot)
    rows, line = (matrix.indptr, matrix.indices, matrix.data), np.arange(n, dtype=np.int32)
    begins = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32)
    packed, _, _ = packed_matrix(rows, None)
    order, block = np.arange(n, dtype=np.int32), (np.arange(n) // 60).astype(np.int32)
    many = int(block.max()) + 1
    first = np.empty(many + 1, np.int64)
    held_by = mesh_blocks.count_blocks(faces, block, first)
    to, vertices = np.empty((n, 3)), np.empty(3 * held_by + n, np.int32)
    numbered = (vertices, np.empty(many + 1, np.int64), np.empty((held_by, 3), np.uint16))
    sums, start = [np.ones(3) for _ in range(3)], np.empty(n + 1, np.int64)
    one = np.empty(mesh_connectivity.count_shared(*around, faces, start), np.int64)
    other = np.empty_like(one)
    mesh_connectivity.list_shared(*around, faces, start, one, other)
    return [
        (mesh_operator.triangle_angles, [points, faces, None, 1.0, threes, np.empty(m)], [1]),
        (mesh_operator.vertex_mass, [*around, cot, area, 0, np.empty(n)], [0, 1]),
        (mesh_operator.area_gradient, [*around, faces, cot, points, to], [0, 1, 2]),
        (mesh_operator.chart_gradient, [*around, cot, np.zeros((m, 3, 3)), to], [0, 1]),
        (mesh_operator.border_conormals, [np.arange(3), faces, cot, points[faces[:3]], to], [0, 1]),
        (mesh_operator.area_seen, [*around, faces, points, points, np.empty(n)], [0, 1, 2]),
        (
            mesh_operator.fill_stiffness,
            [*around, faces, p.indptr, p.indices, p.slots, p.diagonal, cot, points, np.empty(len(p.indices))],
            [0, 1, 2, 3, 6],
        ),
        (mesh_connectivity.corners_around, [n, faces, np.empty(n + 1, np.int64), np.empty(3 * m, np.int32)], [1]),
        (mesh_connectivity.mark_border, [*around, faces, np.empty(3 * m, bool)], [0, 1, 2]),
        (mesh_connectivity.count_shared, [*around, faces, start.copy()], [0, 1, 2]),
        (mesh_connectivity.list_shared, [*around, faces, start, one.copy(), other.copy()], [0, 1, 2, 3]),
        (mesh_connectivity.pattern_rows, [*around, faces, np.empty(n + 1, np.int32)], [0, 1, 2]),
        (
            mesh_connectivity.pattern_entries,
            [*around, faces, p.indptr, p.indices.copy(), p.slots.copy(), p.diagonal.copy()],
            [0, 1, 2, 3],
        ),
        (mesh_blocks.count_blocks, [faces, block, first.copy()], [0, 1]),
        (mesh_blocks.number_blocks, [faces, order, block, 60, first, *numbered], [0, 1, 2, 4]),
        (
            mesh_blocks.march_blocks,
            [
                b.vertices,
                b.start,
                b.owned,
                b.triangles,
                b.first,
                points,
                0,
                held,
                1.0,
                0.1,
                to,
                None,
                np.empty(len(b.owned)),
            ],
            [0, 1, 2, 3, 4],
        ),
        (mesh_normals.triangle_normals, [points, faces, threes, np.empty(m)], [1]),
        (mesh_normals.edge_conductances, [points, faces, across, threes], [1, 2]),
        (mesh_normals.spread_normals, [cot, area, cot, across, 0.1, 1.0, -1.0, 0.0, 1.0, threes], [3]),
        (mesh_normals.average_pairs, [cot, across, 0.1, 1.0, np.empty((m, 2)), np.empty((m, 2))], [1]),
        (mesh_normals.vertex_normals, [*around, cot, area, to], [0, 1]),
        (mesh_normals.follow_normals, [points, *around, faces, cot, held, 0.0, 1.0, threes, to], [1, 2, 3]),
        (mesh_normals.side_lengths, [points, faces, threes], [1]),
        (mesh_normals.crease_weights, [cot, cot, across, 1.0, -1.0, threes], [2]),
        (mesh_normals.shift_along_normals, [*around, cot, area, area, 0.1, to], [0, 1]),
        (mesh_normals.directed_weights, [points, faces, points, 1.0, threes], [1]),
        (mesh_crossings.folded_pairs, [cot, np.stack([one, other], axis=1) // 3, 0.5, np.empty(len(one), bool)], [1]),
        (mesh_delaunay.flip_edges, [faces.copy(), cot.copy(), np.full(3 * m, -1, np.int32)], [2]),
        (cg_kernels.matrix_product, [*rows, points, to], [0, 1]),
        (chebyshev_degree, [*rows, 1.0, 2.0, np.ones((2, 2)), points, to, np.zeros((2, n, 3))], [0, 1]),
        (cg_kernels.pack_rows, [*rows, line, line, *begins, np.empty(n)], [0, 1, 3, 4]),
        (cg_kernels.pack_entries, [*rows, line, line, np.ones(n), *packed], [0, 1, 3, 4, 6, 7]),
        (cg_kernels.pack_vectors, [line, np.ones(n), points, to, 0], [0]),
        (
            cg_kernels.conjugate_gradients,
            [*packed, np.ones(n), np.zeros(3), to, to + 1, to + 2, to + 3, *sums[:2], 1],
            [0, 1, 2, 4, 5],
        ),
    ]


CALLS = [call[0].name for call in sound_calls()]


@pytest.mark.parametrize("which", range(len(CALLS)), ids=CALLS)
def test_an_index_out_of_range_is_refused_wherever_it_stands(which):
    kernel, sound, indices = sound_calls()[which]
    kernel(*sound)
    for at in indices:
        top = np.iinfo(sound[at].dtype).max
        for place in (0, sound[at].size // 2, sound[at].size - 1):
            for wrong in (top, top - 3):
                arguments = list(sound)
                arguments[at] = sound[at].copy()
                arguments[at].flat[place] = wrong
                with pytest.raises(ValueError, match="indices|index"):
                    kernel(*arguments)


@pytest.mark.parametrize("which", range(len(CALLS)), ids=CALLS)
def test_an_array_that_is_one_too_short_is_refused(which):
    kernel, sound, _ = sound_calls()[which]
    for at, array in enumerate(sound):
        if isinstance(array, np.ndarray) and (kernel.name, at) != (
            "count_blocks",
            0,
        ):  # it alone says how many there are
            arguments = list(sound)
            arguments[at] = array[:-1].copy()
            with pytest.raises((TypeError, ValueError)):
                kernel(*arguments)


def _smoothed(seed):
    ball = sphere(6)
    points, faces = ball.noisy("nrm", 0.2, seed), ball.faces
    return float(operator.area_gradient(points, faces).sum() + operator.stiffness(points, faces).data.sum())


@pytest.mark.long
def test_a_child_that_is_forked_after_a_mesh_was_smoothed_smooths_another_one():
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    script = """
        import multiprocessing
        from test_mesh_kernels import _smoothed
        here = _smoothed(1)
        with multiprocessing.get_context("fork").Pool(2) as pool:
            assert pool.map(_smoothed, [1, 1, 1]) == [here] * 3
        assert _smoothed(1) == here
        print("well")
    """
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "MESHFLOW_NUM_THREADS": "2"}
    command = [sys.executable, "-c", textwrap.dedent(script)]
    reported = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    assert reported.stdout.strip() == "well", reported.stderr
