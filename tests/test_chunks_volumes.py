"""Volumes of dask, and DataArrays that hold one: lazy in, lazy out, the same chunks, the same bits."""

import numpy as np
import pytest
from helpers.windows import same
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow import Beltrami, InputError, Mask, MaxChange

da = pytest.importorskip("dask.array")
xarray = pytest.importorskip("xarray")
SHAPE = 18, 22, 16
FIXED = {"method": Beltrami(contrast=2.0), "time": 0.4, "noise": 1.0, "kind": "volume"}


def values(k=0, seed=0):
    rng = np.random.default_rng(seed)
    z, y, x = np.mgrid[tuple(slice(size) for size in SHAPE)]
    made = 4 * np.sin(z / 5) * np.cos(y / 4) + 6 * (x > 7) + rng.normal(size=SHAPE)
    made[3:6, :9] = np.nan
    if k:
        made = np.stack([made + i for i in range(k)], axis=3) + rng.normal(size=(*SHAPE, k))
    return made.astype("float32")


@settings(max_examples=8, deadline=None)
@given(
    sides=st.tuples(st.integers(8, 18), st.integers(8, 22), st.integers(8, 16)),
    k=st.sampled_from([0, 2]),
    held=st.sampled_from(["none", "mask", "limits"]),
)
def test_chunks_of_any_size_equal_the_whole_bit_for_bit(sides, k, held):
    made, numbers = values(k), np.random.default_rng(1).random(SHAPE)
    constraints = {"none": [], "mask": [Mask(numbers < 0.8)], "limits": [MaxChange(numbers)]}[held]
    lazy = da.from_array(made, (*sides, *made.shape[3:]))
    done = meshflow.smooth(lazy, **FIXED, constraints=constraints)
    assert done.chunks == lazy.chunks
    same(done.compute(scheduler="threads"), meshflow.smooth(made, **FIXED, constraints=constraints))


def test_a_graph_is_built_without_reading_a_sample_where_all_is_given():
    reads, made = [], values()

    def read(block):
        reads.append(block.shape)
        return block

    lazy = da.from_array(made, (9, 11, 16)).map_blocks(read, meta=np.zeros((0, 0, 0), "float32"))
    done = meshflow.smooth(lazy, **FIXED)
    assert reads == []
    same(done.compute(), meshflow.smooth(made, **FIXED))


def test_a_data_array_is_a_volume_by_name_lazy_or_not():
    places = {"z": 2.0 * np.arange(18), "y": 1.5 * np.arange(22)[::-1], "x": np.arange(16.0)}
    array = xarray.DataArray(values(), places, ("z", "y", "x"), attrs={"long_name": "velocity"})
    for name in places:
        array.coords[name].attrs["units"] = "m"
    found = meshflow.smooth(array, **FIXED, result=True)
    assert found.after.spacing == (2.0, 1.5, 1.0)
    assert found.after.unit == "m"
    done = meshflow.smooth(array, **FIXED)
    assert done.attrs == array.attrs
    assert done.dims == array.dims
    same(done.to_numpy(), meshflow.smooth(values(), spacing=(2.0, 1.5, 1.0), **FIXED))
    lazy = meshflow.smooth(array.chunk({"z": 9, "y": 11}), **FIXED)
    assert lazy.chunks == ((9, 9), (11, 11), (16,))
    same(lazy.compute().to_numpy(), done.to_numpy())
    for wrong, why in (
        (array[0], "three dimensions expected"),
        (array.assign_coords(z=np.arange(18.0) ** 2), "regular coordinates"),
    ):
        with pytest.raises(InputError, match=why):
            meshflow.smooth(wrong, **FIXED)
    with pytest.raises(InputError, match="at least 2 x 2 x 2 samples"):
        meshflow.smooth(da.from_array(values()[:1], (1, 9, 9)), **FIXED)


@pytest.mark.parametrize("method", [meshflow.Search(second_stage=False), "quick"])
def test_what_is_found_without_a_second_stage_is_that_of_the_whole(method):
    made = values()
    done = meshflow.smooth(da.from_array(made, (9, 22, 16)), method=method, kind="volume")
    same(done.compute(), meshflow.smooth(made, method=method, kind="volume"))
