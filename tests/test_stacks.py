"""DataArrays with a further dimension are smoothed slice by slice: each by its own choice, or all by one; lazily, too."""

import numpy as np
import pytest
from PIL import Image as Picture

import meshflow
from meshflow import Beltrami, Mask
from meshflow.cli.spoken import spoken
from meshflow.errors import InputError

xarray = pytest.importorskip("xarray")
da = pytest.importorskip("dask.array")
H, W = 60, 80
FIXED = {"method": Beltrami(contrast=5.0), "time": 800.0, "noise": 2.0, "outliers": "include"}


def stack(sigmas=(1.0, 2.0, 4.0), chunks=None, **dims):
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0:H, 0:W]
    z = 30 * np.sin(y / 9) * np.cos(x / 7) + 20 * (x > 50)
    z = np.stack([z + i + sigma * rng.normal(size=z.shape) for i, sigma in enumerate(sigmas)]).astype("float32")
    z[1, 20:30, 10:25] = np.nan
    days = np.array(["2020-01-01", "2020-02-01", "2020-03-01", "2020-04-01"], "datetime64[ns]")[: len(sigmas)]
    coords = {"time": days, "y": 10.0 * np.arange(H)[::-1], "x": 10.0 * np.arange(W)}
    values = z if chunks is None else da.from_array(z, chunks)
    return xarray.DataArray(values, coords, ("time", "y", "x"), "dem", {"units": "m"})


def same(one, two):
    assert one.dims == two.dims
    assert one.attrs == two.attrs
    assert all(one.coords[name].equals(two.coords[name]) for name in two.coords)
    assert np.asarray(one).tobytes() == np.asarray(two).tobytes()


@pytest.mark.long
def test_each_slice_is_smoothed_as_if_it_were_alone():
    data = stack()
    done = meshflow.smooth(data, slices="each", result=True)
    assert list(done) == ["time=2020-01-01", "time=2020-02-01", "time=2020-03-01"]
    assert done["time=2020-01-01"].noise.sigma < 1.5 < 3 < done["time=2020-03-01"].noise.sigma
    for i in range(3):
        same(done.data.isel(time=i), meshflow.smooth(data.isel(time=i)))
    assert "time=2020-02-01: " in done.summary
    assert set(done.to_dict()["slices"]) == set(done)


@pytest.mark.parametrize("chunks", [None, (1, 30, 40)])
def test_slices_alike_of_unlike_noise_are_warned_of_with_the_factor(chunks):
    for sigmas, factor in (((1.0, 2.0, 4.0), "4"), ((1.0, 1.3, 1.2), None), ((3.0, 3.0, 1.0, 3.0), "3")):
        data = stack(sigmas, chunks)
        found = meshflow.smooth(data, slices="alike", method="quick", result=True)
        said = [word for word in found.warnings if "the noise of the slices differs" in word]
        assert len(said) == (factor is not None)
        for word in said:
            assert float(word.partition("by a factor of ")[2].split(",")[0]) == pytest.approx(float(factor), rel=0.15)
            assert "slices='each'" in word
            assert "--slices each" in spoken(word, refusal=False)
    given = meshflow.smooth(stack(chunks=chunks), slices="alike", method="quick", noise=1.0, result=True)
    assert not any("differs" in word for word in given.warnings)


@pytest.mark.long
@pytest.mark.parametrize("options", [FIXED, {}], ids=["given", "found"])
def test_slices_alike_have_one_choice(options):
    data = stack((2.0, 2.0, 2.0))
    done = meshflow.smooth(data, slices="alike", result=True, **options)
    assert done.stopped_because.endswith("by 3 slices")
    one = meshflow.smooth(data.isel(time=[0]), slices=None, **options) if options else None
    if one is not None:
        same(done.data.isel(time=[0]), one)
    lazy = meshflow.smooth(stack((2.0, 2.0, 2.0), (1, H, W)), slices="alike", **options)
    same(lazy.compute(), done.data)
    gone = (np.asarray(data).astype(float) - np.asarray(done.data))[~np.isnan(np.asarray(data))]
    assert done.removed.rms == pytest.approx(np.sqrt(np.mean(gone**2)), rel=1e-6)


@pytest.mark.long
def test_slices_alike_may_be_looked_at_in_part():
    data = xarray.concat([stack((2.0, 2.0, 2.0, 2.0)).drop_vars("time")] * 3, "time")
    done = meshflow.smooth(data, slices="alike", result=True)
    assert "noise and method were found on 8 of 12 slices" in done.warnings
    assert done.noise.sigma == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("slices", ["each", "alike"])
@pytest.mark.parametrize("chunks", [(1, 30, 40), (3, 60, 80), (2, 17, 23)])
def test_a_lazy_stack_is_one_graph_of_the_same_bits(slices, chunks):
    lazy = meshflow.smooth(stack(chunks=chunks), slices=slices, **FIXED)
    assert type(lazy.data).__module__.startswith("dask.array")
    assert lazy.data.chunks[0] == (1, 1, 1)
    same(lazy.compute(), meshflow.smooth(stack(), slices=slices, **FIXED))


def test_no_sample_is_read_while_the_graph_of_a_stack_is_built():
    def never(block):
        raise AssertionError("a sample was read")

    values = da.map_blocks(never, stack(chunks=(1, 30, 40)).data, dtype="float32", meta=np.zeros((0, 0, 0), "float32"))
    for slices in ("each", "alike"):
        meshflow.smooth(stack().copy(data=values), slices=slices, **FIXED)


def test_two_further_dimensions_and_channels_keep_their_places():
    data = xarray.concat([stack(), stack() + 1], xarray.DataArray([5, 7], dims="level", name="level"))
    data = xarray.concat([data, 2 * data], "band").transpose("y", "level", "band", "time", "x")
    done = meshflow.smooth(data, slices="each", result=True, **FIXED)
    assert done.data.dims == data.dims
    assert "level=7, time=2020-03-01" in " | ".join(done) or "time=2020-03-01, level=7" in " | ".join(done)
    part = data.isel(level=1, time=2)
    same(done.data.isel(level=1, time=2), meshflow.smooth(part, **FIXED))


def test_a_mask_is_that_of_every_slice():
    mask = np.ones((H, W), bool)
    mask[:30] = False
    data = stack()
    for slices in ("each", "alike"):
        done = meshflow.smooth(data, slices=slices, constraints=Mask(mask), **FIXED)
        assert np.asarray(done)[:, :30].tobytes() == np.asarray(data)[:, :30].tobytes()
        assert not np.array_equal(np.asarray(done)[:, 40:], np.asarray(data)[:, 40:], equal_nan=True)


@pytest.mark.parametrize(
    ("data", "options", "why"),
    [
        (
            stack().isel(time=0),
            {"slices": "each"},
            "slices: a dimension with several entries .* expected, got .'y', 'x'",
        ),
        (
            np.zeros((3, 9, 9)),
            {"slices": "each"},
            "slices: of an xarray.DataArray with a further dimension, got ndarray",
        ),
        (stack(), {"slices": "some"}, "slices: each or alike expected, got 'some'"),
        (stack(), {"slices": "alike", "stop": meshflow.Displacement(0.9)}, "stop: not in windows"),
        (
            stack(),
            {"slices": "each", "missing": np.zeros((3, H, W), bool)},
            "missing: one mask .rows, columns. for all slices",
        ),
    ],
)
def test_what_is_no_stack_is_refused(data, options, why):
    with pytest.raises(InputError, match=why):
        meshflow.smooth(data, **options)


def test_each_variable_of_a_lazy_dataset_has_its_own_noise_and_stays_lazy():
    pytest.importorskip("meshflow.accessors")
    one, two = stack().isel(time=0), 100 * stack().isel(time=2)
    options = {"method": "beltrami", "time": 800.0}  # noise and contrast are found
    data = xarray.Dataset({"a": one.drop_vars("time"), "b": two.drop_vars("time"), "n": 3.0}).chunk({"y": 30, "x": 40})
    done = data.meshflow.smooth(**options)
    assert all(type(done[name].data).__module__.startswith("dask.array") for name in "ab")
    for name in "ab":
        same(done[name].compute(), meshflow.smooth(data[name], **options).compute())
    sigmas = [meshflow.smooth(data[name], result=True, **options).noise.sigma for name in "ab"]
    assert 100 * sigmas[0] < sigmas[1]
    assert float(done["n"]) == 3.0


def test_slices_of_a_dataset_are_those_of_the_variables_that_have_some():
    pytest.importorskip("meshflow.accessors")
    series = stack()
    data = xarray.Dataset({"series": series, "dem": 3 * series.isel(time=0, drop=True)})
    options = {"method": "beltrami", "time": 800.0}
    found = data.meshflow.smooth(slices="each", result=True, **options)
    assert list(found) == ["series", "dem"]
    assert len(found["series"]) == series.sizes["time"]
    same(found.data["dem"], meshflow.smooth(data["dem"], **options))
    same(found.data["series"], meshflow.smooth(series, slices="each", **options))
    assert found.data.identical(data.meshflow.smooth(slices="each", **options))
    with pytest.raises(InputError, match="variable dem: slices: a dimension with several entries"):
        data.meshflow.smooth("dem", slices="each", **options)


def test_a_stack_of_pages_is_no_raster_of_the_first_one(tmp_path):
    pages = [Picture.fromarray(np.full((9, 8), 3.0 + i, np.float32)) for i in range(3)]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    for kind in (None, "image", "terrain"):
        with pytest.raises(InputError, match="a stack of 3 pages; give kind='volume'"):
            meshflow.read(tmp_path / "stack.tif", kind=kind)
    assert meshflow.read(tmp_path / "stack.tif", kind="volume").data.values.shape == (3, 9, 8)
    pages[0].save(tmp_path / "thumbnail.tif", save_all=True, append_images=[pages[1].resize((4, 4))])
    assert meshflow.read(tmp_path / "thumbnail.tif").data.z.shape == (9, 8)
