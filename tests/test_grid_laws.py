"""What holds for the grid engine alone: tiles, threads, precision, memory of others, odd grids, and being stopped."""

import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import meshflow
from meshflow.errors import InputError
from meshflow.flow.controls import FixedStep, Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.flow.methods import Search
from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
from meshflow.flow.stops import Steps
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

CAMERA = Pinhole(120, 120, 70.3, 55.1)
RNG = np.random.default_rng(0)


def surfaces(h=90, w=140, dtype=np.float64, seed=0):
    """One channel, three, and depth, with ragged holes."""
    rng = np.random.default_rng(seed)
    missing = rng.random((h, w)) < 0.02
    missing[h // 3 : h // 2, w // 4 : w // 2] |= rng.random((h // 2 - h // 3, w // 2 - w // 4)) < 0.8
    x, y = np.moveaxis(CAMERA.rays((h, w)), 2, 0)[:2]
    depth = 2 / (1 + 0.3 * x - 0.2 * y) + 0.004 * rng.normal(size=(h, w))
    waves = 5 * np.sin(np.arange(h) / 9)[:, None] * np.cos(np.arange(w) / 7)
    return {
        "one": HeightField((waves + rng.normal(size=(h, w))).astype(dtype), (1.3, 0.8), missing),
        "rows": HeightField((waves + rng.normal(size=(h, w))).astype(dtype), (np.linspace(1, 1.4, h), 0.8), missing),
        "three": Image((waves[..., None] + rng.normal(size=(h, w, 3))).astype(dtype), missing=missing),
        "range": RangeImage(depth.astype(dtype), CAMERA, missing),
    }


KINDS = ("one", "rows", "three", "range")


def run(data, steps=6, dt=0.02, threads=None, variant=None, stepper=None):
    flow = GridFlow(data.gridded(Lift()), variant or Variant(), threads)
    *_, last = march(flow, Until(steps=steps), stepper or Explicit(), FixedStep(dt))
    return last.u.T.reshape(flow.shape)


# --- one grid, many ways to walk it ----------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kind", ["one", "rows", "three"])
@pytest.mark.parametrize("gamma", [0.0, -1.0, 1.0])
def test_tiles_with_a_halo_of_n_equal_the_whole_bit_for_bit_after_n_steps(kind, dtype, gamma):
    data, steps, variant = surfaces(dtype=dtype)[kind], 6, Variant(gamma=gamma, sharpness=1.5 if gamma == -1 else 1.0)
    dt = 0.001 if kind == "three" else 0.02
    whole = run(data, steps, dt, variant=variant)
    for top, left, height, width in ((0, 0, 40, 60), (33, 41, 40, 60), (51, 80, 39, 60), (20, 7, 1, 1)):
        rows = slice(max(top - steps, 0), min(top + height + steps, 90))
        columns = slice(max(left - steps, 0), min(left + width + steps, 140))
        values = data.values if kind == "three" else data.z
        spacing = (data.spacing[0][rows], data.spacing[1]) if kind == "rows" else data.spacing
        part = type(data)(values[rows, columns], spacing, data.missing[rows, columns])
        tile = run(part, steps, dt, variant=variant)
        inside = tile[
            :,
            top - rows.start : top - rows.start + height,
            left - columns.start : left - columns.start + width,
        ]
        assert inside.tobytes() == whole[:, top : top + height, left : left + width].tobytes()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stepper", [Explicit(), SuperTime(), SuperTime(2), SemiImplicit("cg")], ids=lambda s: s.name)
def test_results_do_not_depend_on_the_number_of_threads(kind, stepper):
    data = surfaces(h=240, w=300)[kind]  # several bands
    results = [run(data, 2, 0.02, threads, stepper=stepper).tobytes() for threads in (1, 2, 5)]
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("diagonals", ["both", "alternate"])
def test_a_run_on_the_grid_is_the_run_on_its_triangles(kind, diagonals):
    data = surfaces(20, 24)[kind]
    lift = Lift(diagonals=diagonals)
    grid, mesh = GridFlow(data.gridded(lift), Variant(gamma=1.0)), MeshFlow(data.lifted(lift), Variant(gamma=1.0))
    mesh.pace = grid.pace  # the same stages, also beside holes
    for stepper, dt in (
        (Explicit(), 0.05),
        (SuperTime(), 0.3 * grid.pace),
        (SuperTime(2), 0.3 * grid.pace),
        (SemiImplicit("direct"), 0.5),
    ):
        ends = [list(march(flow, Until(steps=5), stepper, FixedStep(dt)))[-1] for flow in (grid, mesh)]
        way = np.abs(ends[1].u - mesh.start()).max()
        assert np.abs(ends[0].u - ends[1].u).max() < 1e-11 * max(way, 1.0)
        assert ends[0].area == pytest.approx(ends[1].area, rel=1e-12)
        assert ends[0].largest == pytest.approx(ends[1].largest, rel=1e-8)


# Stated in README: single precision keeps six digits of the way that a sample goes, of its value what float32 holds.
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gamma", [0.0, -1.0, 1.0])
def test_single_precision_is_within_its_bound_of_double_precision(kind, gamma):
    single, double = surfaces(dtype=np.float32)[kind], surfaces(dtype=np.float64)[kind]
    values = {"three": "values", "range": "depth"}.get(kind, "z")
    exact = type(double)(
        getattr(single, values).astype(np.float64), *([CAMERA] if kind == "range" else [double.spacing]), double.missing
    )
    variant = Variant(gamma=gamma)
    dt = 0.001 if kind == "three" else 0.02
    ours, truth = run(single, 20, dt, variant=variant), run(exact, 20, dt, variant=variant)
    start = np.where(exact.missing, 0, np.moveaxis(np.atleast_3d(getattr(exact, values)), 2, 0))
    assert ours.dtype == np.float32
    bound = 3e-6 * np.abs(truth - start).max() + 20 * np.finfo(np.float32).eps * np.abs(start).max()
    worst = np.abs(ours - truth).max()
    assert worst < bound, f"{worst:.2e} against {bound:.2e}"


def test_slopes_too_steep_for_single_precision_are_measured_in_double():
    z = (1e25 * RNG.normal(size=(12, 12))).astype(np.float32)
    flow = GridFlow(HeightField(z).gridded(Lift()))
    assert flow.dtype == np.float64
    smoothed = meshflow.smooth(z, method=Search(contrast=1e-25))
    assert smoothed.dtype == np.float32
    assert np.isfinite(smoothed).all()
    assert np.ptp(smoothed) < np.ptp(z)
    assert GridFlow(HeightField(np.float32(1e25) * np.ones((3, 3), np.float32)).gridded(Lift())).dtype == np.float64


def test_slopes_whose_powers_no_number_holds_are_refused():
    z = 1e160 * RNG.normal(size=(5, 5))
    with pytest.raises(InputError, match="numbers up to .* expected, got .* scale the data"):
        GridFlow(HeightField(z).gridded(Lift()))
    with pytest.raises(InputError, match="a length from 1e-75 to .* expected, got 1e-200"):
        GridFlow(HeightField(RNG.normal(size=(5, 5)), 1e-200).gridded(Lift()))


# --- what rests and what is kept --------------------------------------------------------------------------------------


@pytest.mark.parametrize("stepper", [Explicit(), SuperTime(), SuperTime(2), SemiImplicit("cg")], ids=lambda s: s.name)
@pytest.mark.parametrize("variant", [Variant(), Variant(1.0), Variant(-1.0, 1.5), Variant(-2.0)], ids=str)
def test_tilted_planes_with_ragged_holes_rest_and_what_is_held_keeps_its_bits(stepper, variant):
    rows, columns = np.mgrid[0:40, 0:50]
    plane = 3.0 + 0.7 * columns - 0.4 * rows
    data = surfaces(40, 50)["one"]
    moved = run(HeightField(plane, (1.3, 0.8), data.missing), 5, 0.02, variant=variant, stepper=stepper)[0]
    assert np.abs(moved - plane)[~data.missing].max() < 1e-12 * np.abs(plane).max()
    fixed = RNG.random(data.missing.shape) < 0.2
    data = HeightField(data.z, data.spacing, data.missing, fixed)
    moved = run(data, 5, 0.02, variant=variant, stepper=stepper)[0]
    assert (moved[fixed & ~data.missing] == data.z[fixed & ~data.missing]).all()
    assert (moved[~fixed & ~data.missing] != data.z[~fixed & ~data.missing]).mean() > 0.9


def test_planes_seen_by_a_camera_rest_in_single_precision_too():
    x, y = np.moveaxis(CAMERA.rays((40, 50)), 2, 0)[:2]
    depth = (2 / (1 + 0.5 * x - 0.3 * y)).astype(np.float32)
    moved = run(RangeImage(depth, CAMERA), 20, 0.1)[0]
    assert np.abs(moved - depth).max() < 1e-5 * depth.max()


def test_a_single_island_stays():
    z = np.full((7, 9), np.nan)
    z[3, 4] = 5.0
    z[0:2, 0:2] = [[0.0, 1.0], [2.0, 4.0]]
    smoothed = meshflow.smooth(z, method=Search(contrast=1.0))
    assert smoothed[3, 4] == 5.0
    assert (np.isnan(smoothed) == np.isnan(z)).all()


@pytest.mark.parametrize("shape", [(2, 2), (2, 9), (9, 2), (3, 3), (2, 700), (700, 2), (4, 1030)])
@pytest.mark.parametrize("diagonals", ["forward", "alternate", "both"])
def test_the_smallest_grids_are_smoothed_as_their_triangles_are(shape, diagonals):
    data = HeightField(RNG.normal(size=shape))
    for boundary in ("neumann", "plane-preserving", "fixed"):
        lift = Lift(1.0, diagonals, boundary)
        grid, mesh = GridFlow(data.gridded(lift)), MeshFlow(data.lifted(lift))
        for turn in (0, 1):
            assert np.allclose(grid.rate(grid.start(), turn), mesh.rate(mesh.start(), turn), rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: np.zeros((1, 9)), "at least 2 x 2 samples"),
        (lambda: np.zeros((9, 1)), "at least 2 x 2 samples"),
        (lambda: np.full((4, 4), np.nan), "all 16 samples are missing"),
        (lambda: np.zeros((4, 4, 0)), "empty|at least one channel"),
    ],
)
def test_grids_without_a_triangle_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        meshflow.smooth(make())


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_order_of_the_callers_memory_changes_nothing_and_it_keeps_its_bytes(dtype):
    z = RNG.normal(size=(30, 41)).astype(dtype)
    truth = meshflow.smooth(z, method=Search(contrast=0.7))
    wide = np.zeros((60, 123), dtype)
    wide[::2, ::3] = z
    frozen = z.copy()
    frozen.flags.writeable = False
    for same in (np.asfortranarray(z), wide[::2, ::3], frozen, z.astype(z.dtype.newbyteorder()), z[::-1][::-1]):
        before = same.tobytes()
        assert meshflow.smooth(same, method=Search(contrast=0.7)).tobytes() == truth.tobytes()
        assert same.tobytes() == before
    still = meshflow.smooth(z, stop=Steps(0))
    assert still.tobytes() == z.tobytes()
    assert not np.shares_memory(still, z)
    still[:] = 0  # and may be written to


def test_states_of_a_run_stay_as_they_were_unless_their_memory_is_recycled():
    flow = GridFlow(surfaces()["one"].gridded(Lift()))
    kept = list(march(flow, Until(time=3.0), SuperTime(), FixedStep(0.5)))
    copies = [state.u.copy() for state in march(flow, Until(time=3.0), SuperTime(), FixedStep(0.5), recycle=True)]
    assert all((state.u == copy).all() for state, copy in zip(kept, copies, strict=True))


@pytest.mark.long
def test_the_memory_of_a_run_is_at_most_seven_more_of_the_array():
    # The run itself needs four, the grid in its standard orientation and masks the others.
    code = """
        import resource, sys
        import numpy as np, meshflow
        meshflow.smooth(np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32))  # compiled, imported
        n = int(sys.argv[1])
        z = np.random.default_rng(0).standard_normal((n, n), np.float32)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        smoothed = meshflow.smooth(z)
        print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 / z.nbytes)
    """
    found = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), "3000"], capture_output=True, text=True, check=True
    )
    assert float(found.stdout) <= 7.5, f"{found.stdout} of the array's size"


# --- beside the machine -----------------------------------------------------------------------------------------------


LONG_RUNS = {
    "flow": "time=1e5, method=meshflow.Beltrami(gamma=0), compute=meshflow.Compute(stepper='explicit')",
    "groups of patches": "time=0.2, method=meshflow.Beltrami(second_stage=True), noise=1.0, outliers='include'",
}


@pytest.mark.long
@pytest.mark.parametrize("run", LONG_RUNS.values(), ids=LONG_RUNS)
def test_ctrl_c_stops_a_long_run_within_a_second_and_leaves_the_array_as_it_was(run):
    code = """
        import signal, sys, time
        import numpy as np, meshflow
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background of a shell ignores it
        small = np.random.default_rng(0).normal(size=(64, 64))
        meshflow.smooth(small, time=1.0, method=meshflow.Beltrami(second_stage=True))  # imports what is used
        z = np.random.default_rng(0).normal(size=(3000, 3000))
        copy = z.copy()
        print("begun", flush=True)
        try:
            meshflow.smooth(z, RUN)
        except KeyboardInterrupt:
            print("stopped", (z == copy).all(), flush=True)
    """.replace("RUN", run)
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline().strip() == "begun"
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        asked = time.monotonic()
        assert process.stdout.readline().strip() == "stopped True"
        heard = time.monotonic() - asked
        process.wait(30)
    finally:
        process.kill()
    assert heard < 10, f"{heard:.1f} s"  # a second on a quiet machine; the wait is for a busy one


def test_the_graph_flow_of_high_cliffs_ends():
    z = np.where(np.random.default_rng(8).random((16, 18)) < 0.1, 1e6, np.round(RNG.random((16, 18))))
    found = meshflow.smooth(z, method="graph", outliers="include", noise=1.0)  # explicit steps would be 1e-12 long
    assert z.min() - 1.0 <= found.min() <= found.max() <= z.max() + 1.0


@pytest.mark.parametrize("share", [0.02, 0.11, 0.3])
@pytest.mark.parametrize("missing", ["at random", "in pieces"])
def test_the_heat_equation_leaves_no_range_however_ragged_the_holes(share, missing):
    draw = np.random.default_rng(3)
    z, field = draw.uniform(0.0, 11.0, (60, 70)), draw.normal(size=(60, 70))
    field = field if missing == "at random" else gaussian_filter(field, 1.5)
    z[field > np.quantile(field, 1.0 - share)] = np.nan
    for end in (8.0, 30.0, 100.0):
        done = meshflow.smooth(z, kind="image", method="heat", time=end)
        assert np.nanmax(done) <= 11.0 + 1e-9
        assert np.nanmin(done) >= -1e-9
    assert np.nanmax(np.abs(meshflow.smooth(z, kind="image", method="quick"))) < 13.0
