"""The loops of the grid in C++: the same bits whatever the machine and the cut, and each template beside the slow way."""

import hashlib
import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

from meshflow.flow.blend import Blend
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.grid_layout import Layout
from meshflow.flow.family import Variant
from meshflow.kernels import grid as kernels
from meshflow.kernels.compiler import Target
from meshflow.surfaces.camera import Orthographic, Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.range_image import RangeImage

CAMERAS = {
    "pinhole": lambda h, w: Pinhole(1.2 * w, 1.1 * w, 0.45 * w, 0.5 * h),
    "lines": lambda h, w: Orthographic(0.07, 0.06),
}
VARIANTS = [
    Variant(),
    Variant(-1.0),
    Variant(-1.0, 1.5),
    Variant(-2.0, 2.0, mass="ring"),
    Variant(0.3, 3.0),
    Variant(1.0, 4.0),
    Variant(-0.5, 0.7),
    Variant(0.5, mass="voronoi"),
    Variant(-1.0, indicator="projection"),
    Variant(patch=0.7),
    Variant(-1.0, 1.5, patch=1.5),
    Variant(0.3, 1.2, patch=2.5),
]


def scene(kind, shape=(37, 83), dtype=np.float64, holes=True, seed=0):
    """A data object with holes, long runs of whole rows and of nothing, and samples that stay."""
    rng = np.random.default_rng(seed)
    missing, fixed = rng.random(shape) < 0.04 * holes, rng.random(shape) < 0.03 * holes
    missing[:, : shape[1] // 2] &= np.arange(shape[0])[:, None] % 7 == 0
    if holes:
        missing[shape[0] // 2 :, shape[1] // 3 : shape[1] // 3 + 35] = True
    if kind in CAMERAS:
        rows, columns = np.mgrid[: shape[0], : shape[1]] / shape[1]
        depth = 2 / (1 + 0.3 * columns - 0.2 * rows) + 0.01 * rng.normal(size=shape)
        return RangeImage(depth.astype(dtype), CAMERAS[kind](*shape), missing, fixed)
    if kind in ("one", "rows"):
        spacing = (1.3, 0.8) if kind == "one" else (np.linspace(1, 2, shape[0]), 0.8)
        return HeightField((1.5 * rng.normal(size=shape)).astype(dtype), spacing, missing, fixed)
    return Image((1.5 * rng.normal(size=(*shape, int(kind)))).astype(dtype), (1.3, 0.8), missing, fixed)


def flows(kind, diagonals="alternate", boundary="plane-preserving", threads=None, variants=None, **how):
    """Flows of all members that have a meaning for a kind of data."""
    for variant in variants or VARIANTS:
        if kind in CAMERAS and (variant.patch > 0 or variant.sharpness != 1):
            continue
        lift = Lift(1.0 if kind in CAMERAS else 1.7, diagonals, boundary)
        yield GridFlow(scene(kind, **how).gridded(lift), variant, threads)


KINDS = ["one", "rows", "2", "3", "5", *CAMERAS]


def digest():
    """What all kernels of the grid compute, in 32 letters: run by another process with another library."""
    found = hashlib.sha256()
    for kind, dtype, boundary in itertools.product(KINDS, (np.float32, np.float64), ("neumann", "plane-preserving")):
        for diagonals in ("alternate", "both"):
            for flow in flows(kind, diagonals, boundary, 1, dtype=dtype):
                u = flow.start()
                for turn in (0, 1):
                    found.update(flow.rate(u, turn).tobytes())
                found.update(
                    np.float64([flow.area(u), flow.bound(u), *flow.size((1.0, u), (-0.3, flow.rate(u)))]).tobytes()
                )
                system = flow.system(u)
                found.update(system.edges.tobytes() + system.inertia.tobytes())
    return found.hexdigest()[:32]


@pytest.mark.long
def test_instruction_sets_give_the_same_bits():
    levels, found = Target.here().instruction_sets, set()
    for level in levels:
        code = "from test_grid_kernels import digest; print(digest())"
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "MESHFLOW_ISA": level, "PYTHONPATH": os.pathsep.join([*sys.path, os.path.dirname(__file__)])},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if "KernelsMissing" in done.stderr:
            continue  # this machine lacks it
        assert done.returncode == 0, done.stderr
        found.add(done.stdout)
    assert len(found) == 1, f"{found}"


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_threads_give_the_same_bits(kind, dtype):
    found = []
    for threads in (1, 2, 5):
        rates = []
        for flow in flows(kind, threads=threads, shape=(200, 700), dtype=dtype, variants=VARIANTS[:4] + VARIANTS[7:10]):
            u = flow.start()
            rates += [flow.rate(u).tobytes(), flow.area(u), flow.bound(u), flow.size((2.0, u))]
        found.append(rates)
    assert found[0] == found[1] == found[2]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["one", "2", "3", "5", "lines"])
@pytest.mark.parametrize("boundary", ["neumann", "plane-preserving"])
def test_a_part_of_a_grid_moves_as_in_the_whole_to_the_bit(kind, boundary):
    """Wherever it is cut: what is asked of blocks, tiles and rows does not show."""
    far, shape = 8, (40, 8300)  # wider than two tiles
    data = scene(kind, shape, np.float32)
    for variant in VARIANTS[:4] + VARIANTS[7:11]:
        if kind in CAMERAS and (variant.patch > 0 or variant.sharpness != 1):
            continue
        lift = Lift(1.0 if kind in CAMERAS else 1.7, "forward", boundary)
        whole = GridFlow(data.gridded(lift), variant)
        rate = whole.rate(whole.start()).T.reshape(whole.shape)
        for rows, columns in (
            (slice(0, 31), slice(0, 8300)),
            (slice(7, 40), slice(5, 8243)),
            (slice(3, 36), slice(4090, 4437)),
        ):
            if kind in CAMERAS:  # the lines of a camera stand where its pixels do
                columns = slice(0, columns.stop)
                rows = slice(0, rows.stop)
            values = {"lines": "depth", "one": "z"}.get(kind, "values")
            rest = (CAMERAS[kind](*shape),) if kind in CAMERAS else (data.spacing,)
            part = type(data)(
                getattr(data, values)[rows, columns], *rest, data.missing[rows, columns], data.fixed[rows, columns]
            )
            cut = GridFlow(part.gridded(lift), variant)
            ours = cut.rate(cut.start()).T.reshape(cut.shape)
            top, left = far * (rows.start > 0), far * (columns.start > 0)
            inner = np.s_[:, top : ours.shape[1] - far, left : ours.shape[2] - far]
            assert np.array_equal(ours[inner], rate[:, rows, columns][inner]), f"{variant} {rows} {columns}"


@pytest.mark.parametrize("kind", ["one", "rows", "2", "3"])
@pytest.mark.parametrize("diagonals", ["forward", "backward", "both"])
@pytest.mark.parametrize("boundary", ["neumann", "plane-preserving"])
@pytest.mark.parametrize("holes", [False, True])
def test_loops_for_few_channels_compute_what_those_for_any_number_do(kind, diagonals, boundary, holes):
    for sharpness, patch in itertools.product((1.0, 1.5, 2.0, 3.0, 4.0, 0.7), (0.0, 0.7)):
        for gamma in (0.0, -1.0):
            variant = Variant(gamma, sharpness, patch=patch)
            (flow,) = flows(kind, diagonals, boundary, variants=[variant], holes=holes)
            ours = flow.rate(flow.start())
            flow._by_forms = True
            theirs = flow.rate(flow.start())
            # The other way takes the difference of products where this one has nothing to cancel: the more, the greater W^q is.
            bound = 2e-11 if sharpness < 3 else 1e-9
            assert np.abs(ours - theirs).max() <= bound * np.abs(theirs).max(), f"{variant}"


@pytest.mark.parametrize("kind", ["one", "3"])
@pytest.mark.parametrize("patch", [0.0, 0.7])
@pytest.mark.parametrize("sharpness", [1.0, 1.5, 2.0, 3.0, 4.0])
def test_roots_and_products_are_the_general_power(kind, patch, sharpness):
    rates = []
    for q in (sharpness, sharpness * (1 + 4e-16)):
        (flow,) = flows(kind, variants=[Variant(-0.5 * (1 + 4e-16 * (q != sharpness)), q, patch=patch)])
        rates.append(flow.rate(flow.start()))
    assert np.abs(rates[0] - rates[1]).max() <= 1e-12 * np.abs(rates[0]).max()


def test_the_general_power_keeps_its_digits_from_flat_to_steep():
    for slope, q in itertools.product((1e-9, 1e-4, 0.1, 3.0, 1e3), (0.3, 1.2, 2.6)):
        z = slope * np.array([[0.0, 1.0, 3.0], [0.5, 0.0, 2.0], [1.0, 4.0, 0.0]])
        flow = GridFlow(HeightField(z).gridded(Lift(1.0, "forward", "neumann")), Variant(sharpness=q))
        faces = [((i, j), (i, j + 1), (i + 1, j)) for i in range(2) for j in range(2)]
        faces += [((i + 1, j + 1), (i + 1, j), (i, j + 1)) for i in range(2) for j in range(2)]
        legs = np.array([[z[q_] - z[p], z[r] - z[p]] for p, q_, r in faces])
        area = 0.5 * np.exp(0.5 * q * np.log1p((legs**2).sum(axis=1))).sum()
        assert flow.area(flow.start()) == pytest.approx(area, rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_a_blend_is_the_rate_and_what_it_asks_for_beside(kind):
    rng = np.random.default_rng(0)
    for flow in flows(kind, variants=[Variant(), Variant(-1.0), Variant(mass="voronoi")]):
        u = flow.start()
        a, b, c = (np.asfortranarray(rng.normal(size=u.shape)) for _ in range(3))
        rate = flow.rate(u)
        for toward, drift in (((), None), (((0.3, a),), None), (((0.3, a), (-0.2, b)), None), (((0.3, a), (-0.2, b)), (0.7, c)),
                              ((), (0.7, c)), (((0.3, a),), (0.7, c))):  # fmt: skip
            found = flow.rate(u, 0, Blend(0.9, 0.1, toward, drift))
            truth = 0.9 * u + 0.1 * rate + sum(f * (x - u) for f, x in toward) + (drift[0] * drift[1] if drift else 0)
            assert np.allclose(found, truth, rtol=1e-13, atol=1e-13)
            for over in [x for _, x in toward] + ([drift[1]] if drift else []):
                kept = over.copy(order="F")
                assert np.array_equal(flow.rate(u, 0, Blend(0.9, 0.1, toward, drift), over), found)
                over[...] = kept


def test_what_does_not_belong_together_is_refused():
    flow = GridFlow(scene("3").gridded(Lift()), Variant(patch=0.7))
    asked, out = list(flow._asked(flow.start(), (0, 1))), np.empty(flow.shape)
    blend = kernels.GridBlend(0.0, 1.0, 0.0, 0.0, 0.0)
    rest = (out, None, None, None, blend, 1)
    wide = np.zeros((len(asked[3]), asked[3].shape[1] + 1), np.uint8)
    for i, wrong in ((3, wide), (9, np.ones(17)), (10, kernels.GridOptions(*([1.0] * 7), 1, 1)),
                     (10, kernels.GridOptions(*([1.0] * 7), 0, 1, 0, 0, kernels.LINES))):  # fmt: skip
        with pytest.raises(ValueError, match="do not belong together"):
            kernels.grid_rate(*asked[:i], wrong, *asked[i + 1 :], *rest)
    rows = asked[4].copy()
    rows[0, 3] = len(asked[2])
    with pytest.raises(ValueError, match="indices"):
        kernels.grid_rate(*asked[:4], rows, *asked[5:], *rest)
    with pytest.raises(ValueError, match="shares memory"):
        kernels.grid_rate(out, *asked[1:], out, None, None, None, blend, 1)
    with pytest.raises(ValueError, match="do not belong together"):
        kernels.grid_measured(*asked, 3, np.array([0, 1, 0, 1]), np.empty(2), 1)


def test_rows_of_codes_that_are_alike_stand_once():
    whole = Layout.of(None, (500, 40), "both", True)
    there = Layout.of(np.full((499, 39), 15, np.uint8), (500, 40), "both", True)
    assert len(whole.codes) == 6
    assert np.array_equal(whole.codes[whole.row_of], there.codes[there.row_of])
    assert np.array_equal(whole.kinds[whole.row_of], there.kinds[there.row_of])
