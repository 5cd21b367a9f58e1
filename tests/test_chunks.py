"""Arrays of dask: lazy in, lazy out, the same chunks, and the same bits as the whole."""

import os
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow import Beltrami, DataWeights, Fixed, Mask, MaxChange, Mobility, Patches, Search
from meshflow.errors import InputError

da = pytest.importorskip("dask.array")
dask = pytest.importorskip("dask")
H, W = 83, 70
FIXED = {"method": Beltrami(contrast=2.0), "time": 0.9, "noise": 1.0, "outliers": "include"}


def heights(k=0, dtype="float32", level=0.0, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:H, 0:W]
    z = level + 4 * np.sin(y / 7) * np.cos(x / 5) + 6 * (x > W // 2) + rng.normal(size=(H, W))
    z[20:30, :25] = np.nan
    if k:
        z = np.stack([z + i for i in range(k)], axis=2) + rng.normal(size=(H, W, k))
    return z.astype(dtype)


def same(one, other):
    assert np.array_equal(one, other, equal_nan=True), f"{np.nanmax(np.abs(one - other)):.3g}"


def counting(values, chunks):
    """An array of dask, and the list of reads of its chunks."""
    reads = []

    def read(block):
        reads.append(block.shape)
        return block

    return da.from_array(values, chunks).map_blocks(read, meta=np.zeros((0,) * values.ndim, values.dtype)), reads


@pytest.mark.long
@settings(max_examples=12, deadline=None)
@given(
    rows=st.lists(st.integers(4, 40), min_size=1, max_size=5).filter(lambda sizes: max(sizes) > 20),
    columns=st.lists(st.integers(4, 40), min_size=1, max_size=5).filter(lambda sizes: max(sizes) > 20),
    kind=st.sampled_from(["plain", "float64", "far", "three"]),
    held=st.sampled_from(["none", "mask", "fixed", "limits", "mobility", "lazy", "weights"]),
    seed=st.integers(0, 2),
)
def test_chunks_of_any_size_equal_the_whole_bit_for_bit(rows, columns, kind, held, seed):
    options = {"float64": {"dtype": "float64"}, "far": {"level": 3000.0}, "three": {"k": 3}}
    z = heights(seed=seed, **options.get(kind, {}))
    rng = np.random.default_rng(seed)
    numbers = rng.random((H, W))
    constraints = {
        "none": [], "mask": [Mask(numbers < 0.8)], "fixed": [Fixed(numbers < 0.1)], "limits": [MaxChange(numbers)],
        "mobility": [Mobility(numbers)], "lazy": [Mobility(da.from_array(numbers, (30, 30)))],
        "weights": [DataWeights(da.from_array(numbers, (30, 30)))],
    }[held]  # fmt: skip
    chunks = [_to(size, parts) for size, parts in ((H, rows), (W, columns))]
    lazy = da.from_array(z, chunks=(*chunks, *z.shape[2:]))
    done = meshflow.smooth(lazy, **FIXED, constraints=constraints)
    assert done.chunks == lazy.chunks
    assert done.dtype == z.dtype
    held_whole = {"lazy": [Mobility(numbers)], "weights": [DataWeights(numbers)]}.get(held, constraints)
    same(done.compute(scheduler="threads"), meshflow.smooth(z, **FIXED, constraints=held_whole))


def _to(size, parts):
    """Chunks of these sizes, as often as they fit."""
    made = []
    while sum(made) < size:
        made.append(min(parts[len(made) % len(parts)], size - sum(made)))
    return tuple(made)


@pytest.mark.parametrize("method", [None, "quick", Patches()])
def test_what_is_found_by_default_is_that_of_the_whole(method):
    z = heights()
    whole = Search(second_stage=False) if method is None else method
    done = meshflow.smooth(da.from_array(z, (30, 40)), method=method, outliers="include")
    same(done.compute(), meshflow.smooth(z, method=whole, outliers="include"))


@pytest.mark.parametrize("outliers", [None, "repair"])
@pytest.mark.parametrize("k", [0, 3])
def test_outliers_are_found_as_in_the_whole(k, outliers):
    z = heights(k)
    z[np.random.default_rng(4).random((H, W)) < 0.01] = 60.0
    z[60:66, 30:36] = -9999.0
    options = {"method": "quick", "outliers": outliers}
    done = meshflow.smooth(da.from_array(z, (13, 40, *z.shape[2:])), **options)
    same(done.compute(), meshflow.smooth(z, **options))
    given = {**FIXED, "outliers": "repair"}
    same(meshflow.smooth(da.from_array(z, (40, 40, *z.shape[2:])), **given).compute(), meshflow.smooth(z, **given))


def test_a_lazy_array_with_the_shape_of_something_else_is_refused_as_one_in_memory_is():
    for shape, likeness in (
        ((12, 60, 50), "a volume"),
        ((3, 60, 50), "3 channels that come first"),
        ((90, 3), "points"),
    ):
        for array in (np.zeros(shape), da.zeros(shape)):
            with pytest.raises(InputError, match=f"looks like {likeness}"):
                meshflow.smooth(array)


def test_a_graph_is_built_without_reading_a_sample_where_all_is_given():
    lazy, reads = counting(heights(), (30, 40))
    done = meshflow.smooth(lazy, **FIXED)
    assert reads == []
    same(done.compute(), meshflow.smooth(heights(), **FIXED))
    assert len(reads) <= 2 * 6  # the ends of all values are found in a pass of its own


def test_long_times_are_given_steps_by_a_sample():
    lazy, reads = counting(heights(), (30, 40))
    options = {**FIXED, "time": 20.0}
    done = meshflow.smooth(lazy, **options)
    assert reads
    same(done.compute(), meshflow.smooth(heights(), **options))


def test_chunks_smaller_than_the_halo_are_joined_and_that_is_said():
    z = heights()
    lazy = da.from_array(z, (5, 70))
    found = meshflow.smooth(lazy, **FIXED, result=True)
    assert found.data.chunks == lazy.chunks
    assert any("smaller than the halo of 6: they are computed in chunks" in word for word in found.warnings)
    same(found.data.compute(), meshflow.smooth(z, **FIXED))


def test_a_result_says_what_is_known_before_the_data_is_computed():
    lazy, _ = counting(heights(), (30, 40))
    found = meshflow.smooth(lazy, outliers="include", result=True)
    assert found.noise.sigma == pytest.approx(1.0, rel=0.3)
    assert found.parameters["time"].origin == "estimated"
    assert found.summary.endswith("; how much is removed is known only when the data is computed")
    assert found.to_dict()["removed"] is None
    assert "what is removed" not in str(found)
    assert "reached time" in str(found)


def test_integers_and_graphs_with_other_chunks_come_back_as_the_whole():
    z = np.nan_to_num(heights() * 10).astype(np.int16)
    lazy = (da.from_array(z, (20, 30)) + np.int16(1)).rechunk((40, 35))
    done = meshflow.smooth(lazy, **FIXED)
    assert done.dtype == np.float32
    same(done.compute(), meshflow.smooth(z + np.int16(1), **FIXED))


TAKEN = {
    "a band": lambda z: da.from_array(z[None], (1, 30, 40))[0],
    "a stack": lambda z: da.stack([da.from_array(z, (30, 40))])[0],
    "squeezed": lambda z: da.from_array(z[None], (1, 30, 40)).squeeze(),
    "reshaped": lambda z: da.from_array(z[None], (1, 30, 40)).reshape(z.shape),
    "joined": lambda z: da.concatenate([da.from_array(part, 30) for part in (z[:40], z[40:])]),
    "optimized": lambda z: dask.optimize(da.from_array(z[None], (1, 30, 40))[0])[0],
    "held": lambda z: da.from_array(z[None], (1, 30, 40))[0].persist(),
}


@pytest.mark.parametrize("made", TAKEN.values(), ids=TAKEN)
def test_whatever_the_array_was_made_of_it_is_computed(made):
    z = heights()
    same(meshflow.smooth(made(z), **FIXED).compute(), meshflow.smooth(z, **FIXED))


def test_noise_that_is_given_with_values_that_nobody_has_read_is_not_doubted():
    lazy, _ = counting(heights(), (30, 40))
    assert not any("largest difference" in word for word in meshflow.smooth(lazy, **FIXED, result=True).warnings)


def test_a_value_marks_missing_samples():
    z = np.where(np.isnan(heights()), np.float32(-7777), heights())
    for word in ("nodata", "missing"):
        done = meshflow.smooth(da.from_array(z, (30, 40)), **{word: -7777.0}, **FIXED)
        same(done.compute(), meshflow.smooth(z, **{word: -7777.0}, **FIXED))


def test_missing_samples_may_be_lazy():
    z, gone = heights(), np.random.default_rng(5).random((H, W)) < 0.1
    done = meshflow.smooth(da.from_array(z, (30, 40)), missing=da.from_array(gone, (50, 20)), **FIXED)
    same(done.compute(), meshflow.smooth(z, missing=gone, **FIXED))


MASKED = {
    "a mask": lambda z, gone: (np.ma.masked_array(z, mask=gone), da.ma.masked_array(da.from_array(z, 31), mask=gone)),
    "invalid": lambda z, _: (np.ma.masked_invalid(z), da.ma.masked_invalid(da.from_array(z, 31))),
    "nothing": lambda z, _: (np.ma.masked_array(z), da.from_array(np.ma.masked_array(z), 31)),
    "unsaid": lambda z, gone: (
        np.ma.masked_array(z, mask=gone),
        da.from_array(z, 31).map_blocks(np.ma.masked_greater, 9e3, meta=np.zeros((0,) * z.ndim, z.dtype)),
    ),
}


@pytest.mark.parametrize(
    "options", [FIXED, {"method": "quick"}, {**FIXED, "time": 20.0}], ids=["given", "found", "long"]
)
@pytest.mark.parametrize("kind", [{}, {"dtype": "float64"}, {"k": 3}], ids=["float32", "float64", "three"])
@pytest.mark.parametrize("made", MASKED.values(), ids=MASKED)
def test_masked_arrays_come_back_masked_and_equal_the_whole(made, kind, options):
    z = heights(**kind)
    gone = np.random.default_rng(6).random(z.shape) < 0.05
    gone[:31, 31:62] = True  # a chunk
    z[gone] = 9999.0
    whole, lazy = made(z, gone)
    done = meshflow.smooth(lazy, **options)
    assert done.chunks == lazy.chunks
    found, expected = done.compute(), meshflow.smooth(whole, **options)
    assert isinstance(found, np.ma.MaskedArray)
    assert found.dtype == expected.dtype
    same(np.ma.getmaskarray(found), np.ma.getmaskarray(expected))
    same(found.data, expected.data)


def test_a_masked_lazy_data_array_has_nan_where_it_was_masked():
    xr = pytest.importorskip("xarray")
    z, gone = heights(), np.random.default_rng(6).random((H, W)) < 0.1
    dims = ("y", "x")
    whole = meshflow.smooth(xr.DataArray(np.ma.masked_array(z, mask=gone), dims=dims), **FIXED)
    done = meshflow.smooth(xr.DataArray(da.ma.masked_array(da.from_array(z, 30), mask=gone), dims=dims), **FIXED)
    assert np.isnan(done.values[gone]).all()
    same(done.values, whole.values)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"stop": meshflow.Displacement(0.9)}, "stop: not in windows"),
        ({"camera": meshflow.Pinhole(100, 100, 30, 30)}, "camera: no option of an array of dask"),
        ({"kind": "mesh"}, "kind: terrain of shape"),
        ({"constraints": Mask(np.ones((3, 3), bool))}, "mask: one number per sample, shape"),
        ({"missing": np.ones((3, 3), bool)}, "missing: one number per sample, shape"),
    ],
)
def test_a_refusal_says_why(options, why):
    with pytest.raises(InputError, match=why):
        meshflow.smooth(da.from_array(heights(), (30, 40)), **options)
    with pytest.raises(InputError, match="at least 2 x 2 samples, expected"):
        meshflow.smooth(da.from_array(np.zeros((1, 9)), (1, 4)), **FIXED)


# --- xarray -------------------------------------------------------------------------------------------------------------


def field(values, **chunks):
    xr = pytest.importorskip("xarray")
    dims = ("y", "x", "band")[: values.ndim]
    coords = {"y": 5000.0 - 20 * np.arange(H), "x": 300.0 + 30 * np.arange(W)}
    array = xr.DataArray(values, dims=dims, coords=coords, attrs={"units": "m"}, name="height")
    return array.chunk(chunks) if chunks else array


@pytest.mark.parametrize("order", [("y", "x"), ("x", "y")])
def test_a_data_array_comes_back_lazy_with_all_around_its_numbers(order):
    z = heights()
    lazy = field(z, y=30, x=40).transpose(*order)
    options = {**FIXED, "time": 300.0}
    done = meshflow.smooth(lazy, **options)
    assert done.chunks == lazy.chunks
    assert done.dims == order
    assert done.attrs == lazy.attrs
    assert done.name == "height"
    whole = meshflow.smooth(field(z).transpose(*order), **options)
    same(done.compute().values, whole.values)
    assert np.array_equal(done.y, lazy.y)


def test_bands_of_a_data_array_are_channels():
    z = heights(k=3)
    lazy = field(z, y=30, x=40, band=1).transpose("band", "y", "x")
    done = meshflow.smooth(lazy, **FIXED | {"time": 300.0})
    whole = meshflow.smooth(field(z).transpose("band", "y", "x"), **FIXED | {"time": 300.0})
    same(done.compute().values, whole.values)


# --- more than one process ----------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="starts processes")
def test_two_processes_compute_the_bits_of_one():
    distributed = pytest.importorskip("distributed")
    z = heights()
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster),
    ):
        done = meshflow.smooth(da.from_array(z, (20, 20)), outliers="include").compute()
    same(done, meshflow.smooth(z, method=Search(second_stage=False), outliers="include"))


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="starts processes")
def test_a_worker_that_dies_changes_no_bit(tmp_path):
    distributed = pytest.importorskip("distributed")
    z, died = heights(), tmp_path / "died"

    def deadly(block):
        """Ends the process that computes the first chunk."""
        if not died.exists():
            died.touch()
            os._exit(1)
        return block

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster),
    ):
        lazy = da.from_array(z, (20, 20)).map_blocks(deadly, dtype=z.dtype, meta=np.zeros((0, 0), z.dtype))
        done = meshflow.smooth(lazy, method=Beltrami(contrast=5.0), time=8.0, noise=2.0, outliers="include").compute()
    assert died.exists()
    same(done, meshflow.smooth(z, method=Beltrami(contrast=5.0), time=8.0, noise=2.0, outliers="include"))
