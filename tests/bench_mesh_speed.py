"""Meshes, time and memory beside the peers: ``pytest -m bench -s tests/bench_mesh_speed.py``.

Ratios of medians of interleaved runs in one process, on a sphere with noise. From the environment: BENCH_SUBDIVISIONS=6 for a
smaller one (8: 655362 vertices); BENCH_PLOT=growth_meshes.png draws the growth; BENCH_LARGEST=9 is where that ends (2.6 million
vertices); BENCH_SOLVERS=CG,pyamg asks these alone. Quality: tests/bench_meshes.py.
"""

import cProfile
import json
import os
import platform
import pstats
import subprocess
import sys
import textwrap
import time
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest

import meshflow
from meshflow.errors import need
from meshflow.flow.blend import euler
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.steppers import SemiImplicit
from meshflow.flow.workspace import Workspace
from meshflow.geometry import operator
from meshflow.geometry.connectivity import connect
from meshflow.kernels.library import default_threads
from meshflow.surfaces.surface import Surface
from meshflow.synthetic.shapes import part, sphere

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
THREADS = default_threads()
SUBDIVISIONS = int(os.environ.get("BENCH_SUBDIVISIONS", "8"))
NOISE, SEED = 0.2, 7
# Smoothing lengths of the semi-implicit step, mean edges, and its relative residual.
LENGTHS, RESIDUAL = (2, 10), 1e-6


def interleaved(calls, repeats):
    """Seconds of each call, the median of interleaved runs, after one of each that does not count."""
    for call in calls.values():
        call()
    times = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            time.sleep(0.05)  # threads of a peer before it may still be spinning
            begun = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begun)
    return {name: float(np.median(found)) for name, found in times.items()}


@cache
def noisy(subdivisions=SUBDIVISIONS):
    """Points, faces, and mean edge of a sphere with noise along its normals."""
    ball = sphere(subdivisions)
    return np.ascontiguousarray(ball.noisy("nrm", NOISE, SEED)), np.ascontiguousarray(ball.faces), ball.edge


def versions(*names):
    found = []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} absent")
    # Peers with one thread lose less on a machine that others use as well: its load at the begin is part of what was measured.
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    return f"{THREADS} threads of {os.cpu_count()} cores, {load}, {platform.machine()}; " + ", ".join(found)


def flow_of(points, faces):
    return MeshFlow(Surface(points, (faces,)))


def test_refill_of_stiffness_and_mass_beside_igl():
    import igl

    points, faces, _ = noisy()
    connectivity = connect((faces,), len(points))
    connectivity.pattern  # noqa: B018 - made once, not at every step

    def ours():
        cot, area = operator.cotangents(points, connectivity.faces)
        return operator.fill_stiffness(connectivity, cot), operator.gather_mass(connectivity, cot, area, "barycentric")

    def theirs():
        return igl.cotmatrix(points, faces), igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC)

    (stiffness, mass), (cot, diagonal) = ours(), theirs()
    assert abs(stiffness + cot).max() < 1e-9
    assert np.abs(mass - diagonal.diagonal()).max() < 1e-12
    found = interleaved({"ours": ours, "igl": theirs}, 9)
    print(f"\nrefill of stiffness and mass, {len(points)} vertices, {versions('meshflow', 'libigl')}")
    print(f"  ours {1e3 * found['ours']:.1f} ms, igl.cotmatrix + igl.massmatrix {1e3 * found['igl']:.1f} ms: "
          f"{found['igl'] / found['ours']:.1f} x faster")  # fmt: skip
    assert found["igl"] > found["ours"]


def iterations():
    """Calls of the peers by name: how many iterations, to a call that does so many on a mesh that is there already."""
    points, faces, _ = noisy()
    found = {}
    for of in (_meshlib, _vtk, _trimesh, _open3d, _pymeshlab):
        try:
            found |= of(points, faces)
        except ImportError as cause:
            print(f"  left out: {cause}")
    return found


def _meshlib(points, faces):
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(np.int32), points.astype(np.float32))

    def relax(count):
        params = mrmeshpy.MeshRelaxParams()
        params.iterations, params.force = count, 0.3
        return lambda: mrmeshpy.relax(mesh, params)

    return {"MeshLib relax": (relax, 10, 40)}


def _vtk(points, faces):
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    return {
        "VTK windowed sinc": (lambda count: lambda: mesh.smooth_taubin(n_iter=count, pass_band=0.1), 10, 40),
        "VTK smooth": (lambda count: lambda: mesh.smooth(n_iter=count, relaxation_factor=0.3), 5, 15),
    }


def _trimesh(points, faces):
    import trimesh

    mesh = trimesh.Trimesh(points, faces, process=False)
    laplacian = trimesh.smoothing.laplacian_calculation(mesh)
    return {
        "trimesh Taubin": (
            lambda count: lambda: trimesh.smoothing.filter_taubin(mesh, 0.5, 0.53, count, laplacian),
            4,
            16,
        )
    }


def _open3d(points, faces):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    return {"Open3D Laplacian": (lambda count: lambda: mesh.filter_smooth_laplacian(count, 0.3), 2, 8)}


def _pymeshlab(points, faces):
    pymeshlab = need("pymeshlab", "bench")
    session = pymeshlab.MeshSet()
    session.add_mesh(pymeshlab.Mesh(points, faces))

    def smooth(count):
        return lambda: session.apply_coord_laplacian_smoothing(stepsmoothnum=count, cotangentweight=True)

    return {"pymeshlab cotangent": (smooth, 1, 4)}


def test_explicit_step_beside_one_iteration_of_the_peers():
    points, faces, _ = noisy()
    flow = flow_of(points, faces)
    u, out = flow.start(), Workspace(flow).take()
    dt = 1.0 / flow.bound(u)
    peers = iterations()
    calls = {"ours": lambda: flow.rate(u, 0, euler(dt), out)}
    for name, (of, few, many) in peers.items():
        # What a call costs before its first iteration (structure, copies) is not counted: the difference of two.
        calls |= {f"{name} {few}": of(few), f"{name} {many}": of(many)}
    found = interleaved(calls, 5)
    n, mine = len(points), found["ours"]
    print(f"\nexplicit step, cotangents recomputed, {n} vertices, float64, "
          f"{versions('meshflow', 'meshlib', 'vtk', 'trimesh', 'open3d', 'pymeshlab')}")  # fmt: skip
    print(f"  {'ours':24s} {1e9 * mine / n:7.1f} ns per vertex and step")
    behind = []
    for name, (_, few, many) in peers.items():
        took = (found[f"{name} {many}"] - found[f"{name} {few}"]) / (many - few)
        print(f"  {name:24s} {1e9 * took / n:7.1f} ns per vertex and step, theirs / ours {took / mine:5.2f}")
        behind += [name] if took < mine else []
    print(f"  ahead of ours: {', '.join(behind) or 'none'}")


class Assembled:
    """What a user writes today: (M - dt C) x = M u, C and M of igl."""

    def __init__(self, points, faces, dt):
        self.points, self.faces, self.dt = points, faces, dt

    def system(self):
        import igl

        mass = igl.massmatrix(self.points, self.faces, igl.MASSMATRIX_TYPE_BARYCENTRIC)
        return (mass - self.dt * igl.cotmatrix(self.points, self.faces)).tocsr(), mass @ self.points

    def cg(self):
        from scipy.sparse import diags

        a, b = self.system()
        return self._iterated(a, b, diags(1.0 / a.diagonal()))

    def multigrid(self):
        import pyamg

        a, b = self.system()
        return self._iterated(a, b, pyamg.smoothed_aggregation_solver(a, symmetry="symmetric").aspreconditioner())

    def _iterated(self, a, b, preconditioner):
        from scipy.sparse.linalg import cg

        x = [cg(a, b[:, k], self.points[:, k], rtol=RESIDUAL, M=preconditioner)[0] for k in range(3)]
        return np.stack(x, axis=1)

    def pardiso(self):
        import pypardiso

        solver = pypardiso.PyPardisoSolver()
        a, b = self.system()
        x = solver.solve(a, b)
        solver.free_memory(everything=True)
        return x

    def cholesky(self):
        cholespy = need("cholespy", "bench")
        a, b = self.system()
        a = a.tocoo()
        rows, columns = a.row.astype(np.int32), a.col.astype(np.int32)
        solver = cholespy.CholeskySolverD(a.shape[0], rows, columns, a.data, cholespy.MatrixType.COO)
        x = np.empty_like(b)
        solver.solve(np.ascontiguousarray(b), x)
        return x


SOLVERS = {"CG, Jacobi": "cg", "CG, pyamg": "multigrid", "pypardiso": "pardiso", "cholespy": "cholesky"}


@pytest.mark.parametrize("length", LENGTHS)
def test_semi_implicit_step_beside_what_a_user_writes_today(length):
    points, faces, edge = noisy()
    dt = length**2 / 2 * edge**2
    flow, user = flow_of(points, faces), Assembled(points, faces, dt)
    u = flow.start()
    mass = flow.system(u).mass[:, None]
    # Ours solves for the change, to a share of what changes; a user solves for the points, to a share of where they are.
    weaker = RESIDUAL * (np.linalg.norm(mass * u, axis=0) / np.linalg.norm(dt * mass * flow.rate(u), axis=0)).min()
    steppers = {"ours": SemiImplicit(tolerance=weaker), "ours, change": SemiImplicit(tolerance=RESIDUAL)}
    calls = {name: lambda stepper=stepper: stepper.step(flow, u, dt, 0) for name, stepper in steppers.items()}
    wanted = tuple(name for name in os.environ.get("BENCH_SOLVERS", "").split(",") if name) or ("",)
    print(f"\nsemi-implicit step of {length} edges, {len(points)} vertices, residual {RESIDUAL:g}, assembly included, "
          f"{versions('meshflow', 'libigl', 'scipy', 'pyamg', 'pypardiso', 'cholespy')}")  # fmt: skip
    a, b = user.system()
    scale = np.linalg.norm(b, axis=0)
    for name, method in SOLVERS.items():
        if wanted == ("",) or name.endswith(wanted) or name.startswith(wanted):
            try:
                residual = (np.linalg.norm(b - a @ getattr(user, method)(), axis=0) / scale).max()
            except (ImportError, ValueError, RuntimeError, MemoryError) as cause:
                print(f"  {name} is left out: {cause}")
                continue
            print(f"  {name:14s} residual of its own system {residual:.1e}")
            calls[name] = getattr(user, method)
    for name in steppers:
        residual = (np.linalg.norm(b - a @ calls[name](), axis=0) / scale).max()
        print(f"  {name:14s} residual of the same system {residual:.1e}")
    print(
        f"  ours: residual {weaker:.1e} of the change, that is {RESIDUAL:g} of the points; ours, change: {RESIDUAL:g} of it"
    )
    found = interleaved(calls, 3)
    for name, took in found.items():
        print(f"  {name:14s} {took:8.2f} s, theirs / ours {took / found['ours']:6.2f}")
    peers = {name: took for name, took in found.items() if name not in steppers}
    if peers:
        best = min(peers, key=peers.__getitem__)
        print(f"  the best of them, {best}: {peers[best] / found['ours']:.2f} x ours")


# Parts of the default call, by the functions that do them.
PARTS = {
    "spikes": "without_spikes", "noise": "noise_by_parts", "search": "searched", "method": "march", "offsets": "without_offsets",
    "folds and crossings": "moved_without_harm",
}  # fmt: skip


@pytest.mark.parametrize("shape", [sphere(5), part(0.00485), sphere(8)], ids=["10k", "100k", "700k"])
def test_default_call_and_its_parts(shape):
    noisy_points, calls = shape.noisy("nrm", NOISE, SEED), cProfile.Profile()
    meshflow.smooth((sphere(4).noisy("nrm", NOISE, SEED), sphere(4).faces))  # imports
    begun, before = time.perf_counter(), time.process_time()
    calls.runcall(meshflow.smooth, (noisy_points, shape.faces))
    took, cpu = time.perf_counter() - begun, time.process_time() - before
    found = pstats.Stats(calls).get_stats_profile().func_profiles
    shares = ", ".join(f"{part} {found[name].cumtime / took:.0%}" for part, name in PARTS.items() if name in found)
    print(f"\ndefault call, {shape.name} of {len(noisy_points)} vertices, {versions('meshflow')}")
    print(f"  {took:.2f} s, {cpu:.2f} s of the processors; of the time: {shares}")


MEASURED = """
    import json, sys
    import numpy as np
    from meshflow.flow.engines.mesh import MeshFlow
    from meshflow.flow.steppers import SemiImplicit
    from meshflow.surfaces.surface import Surface
    from meshflow.synthetic.shapes import sphere

    def status(name):
        lines = dict(line.split(":", 1) for line in open("/proc/self/status"))
        return 1024 * int(lines[name].split()[0])

    def step(points, faces, dt):
        flow = MeshFlow(Surface(points, (faces,)))
        return SemiImplicit(tolerance=1e-6).step(flow, flow.start(), dt, 0)

    ball = sphere(5)
    step(ball.points, ball.faces, 2 * ball.edge**2)  # imports
    points, faces = np.load(sys.argv[1]), np.load(sys.argv[2])
    points.sum() + faces.sum()
    before = status("VmRSS")
    open("/proc/self/clear_refs", "w").write("5")  # the peak begins anew
    step(points, faces, float(sys.argv[3]))
    print(json.dumps({"before": before, "peak": status("VmHWM")}))
"""


@pytest.mark.parametrize("length", LENGTHS)
def test_memory_of_a_semi_implicit_step(tmp_path, length):
    if not Path("/proc/self/clear_refs").exists():
        pytest.skip("the peak of a process is read from /proc, which is Linux's")
    points, faces, edge = noisy()
    paths = [str(tmp_path / name) for name in ("points.npy", "faces.npy")]
    for path, array in zip(paths, (points, faces), strict=True):
        np.save(path, array)
    command = [sys.executable, "-c", textwrap.dedent(MEASURED), *paths, repr(length**2 / 2 * edge**2)]
    reported = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    found = json.loads(reported)
    more = (found["peak"] - found["before"]) / len(points)
    print(f"\nmemory of a semi-implicit step of {length} edges, {len(points)} vertices, structure included: {more:.0f} bytes"
          " per vertex beyond the mesh")  # fmt: skip


def test_growth_with_the_size_of_the_mesh():
    sizes, rows = range(5, int(os.environ.get("BENCH_LARGEST", "9")) + 1), []
    print(f"\ngrowth, ns per vertex, {versions('meshflow')}")
    print(f"  {'vertices':>10s} {'refill':>8s} {'explicit':>9s} {'implicit, 2 edges':>18s}")
    for subdivisions in sizes:
        points, faces, edge = noisy(subdivisions)
        flow, stepper = flow_of(points, faces), SemiImplicit(tolerance=RESIDUAL)
        u, out = flow.start(), Workspace(flow).take()
        dt, n = 1.0 / flow.bound(u), len(points)
        calls = {
            "refill": lambda flow=flow, u=u: flow.system(u),
            "explicit": lambda flow=flow, u=u, out=out, dt=dt: flow.rate(u, 0, euler(dt), out),
            "implicit": lambda flow=flow, u=u, s=stepper, dt=2 * edge**2: s.step(flow, u, dt, 0),
        }
        found = interleaved(calls, 5)
        rows.append((n, *(1e9 * found[name] / n for name in calls)))
        print("  {:10d} {:8.1f} {:9.1f} {:18.1f}".format(*rows[-1]), flush=True)
    if path := os.environ.get("BENCH_PLOT"):
        _plot(np.array(rows), path)


def _plot(rows, path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 2.8), layout="constrained")
    names = ("refill of the system", "explicit step", "semi-implicit step of 2 edges")
    for column, (name, colour) in enumerate(zip(names, ("#7f7f7f", "#1f4e79", "#b8541a"), strict=True), 1):
        axes.loglog(rows[:, 0], rows[:, column], "o-", color=colour, label=name)
    axes.set_xlabel("vertices")
    axes.set_ylabel("ns per vertex")
    axes.set_title(f"meshes, float64, {THREADS} threads", fontsize=10)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.58))
    figure.savefig(path, dpi=90)
