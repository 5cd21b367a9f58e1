"""Runs that are cut into legs, between which windows exchange their state: the same bits, and nothing is left behind."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raster_files import make
from helpers.windows import Sized, by_windows, same, terrain, volume
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow import AreaLoss, Beltrami, Compute, Explicit, Residual
from meshflow.errors import FormatError, InputError
from meshflow.estimate import second_stage
from meshflow.estimate.request import Request
from meshflow.io.files import read
from meshflow.io.metadata import ReadOptions
from meshflow.large import between, chunks
from meshflow.large.between import Between
from meshflow.large.legs import BETWEEN, Legs
from meshflow.large.outputs import Output
from meshflow.large.rasters import smooth_raster
from meshflow.large.sample import places_in, sample_of
from meshflow.large.source import Held
from meshflow.large.windows import windowed
from meshflow.results.given_steps import Track
from meshflow.results.run import run
from meshflow.surfaces.data import array_of

EXPLICIT = Compute(stepper="explicit")
SMALL = Sized(1e9, (64, 64))


def heights():
    y, x = np.mgrid[0:130, 0:170]
    rng = np.random.default_rng(0)
    z = 30 * np.sin(y / 9) * np.cos(x / 7) + 20 * (x > 85) + 2 * rng.normal(size=(1, 130, 170))
    return z.astype("float32")


def request(method=Beltrami(contrast=5.0), time=900.0, **options):  # noqa: B008 - frozen
    return Request.of(method, time=time, noise=2.0, outliers="include", **options)


@settings(deadline=None)
@given(
    rates=st.lists(st.lists(st.integers(1, 9), max_size=12), min_size=1, max_size=3),
    passes=st.lists(st.integers(5, 30), max_size=3),
    most=st.integers(0, 90),
)
def test_legs_hold_all_steps_in_their_order_and_reach_no_further_than_they_may(rates, passes, most):
    tracks = tuple(Track(Explicit(), (0.1,) * len(one), tuple(one)) for one in rates)
    legs = Legs(tracks, (2,) * len(tracks), tuple(passes), 3)
    cut = legs.cut(most)
    done = [(s.number, at) for leg in cut for s in leg.stretches for at in range(s.begin, s.end)]
    every = [(i, at) for i, one in enumerate((*rates, passes)) for at in range(len(one))]
    assert done == every
    alone = max([2 * max(one, default=0) for one in rates] + passes)
    assert all(leg.halo <= max(most, 3 + alone) for leg in cut)
    assert legs.one.halo == legs.halo == 3 + 2 * max(map(sum, rates)) + sum(passes)
    assert all(leg.held == (len(cut) > 1) * (1 + 2 * (len(tracks) > 1)) for leg in cut)


def test_a_run_is_cut_where_that_saves_work():
    track = Track(Explicit(), (0.1,) * 400, (1,) * 400)
    legs = Legs((track,), (1,))
    short = Legs((Track(Explicit(), (0.1,) * 20, (1,) * 20),), (1,))
    assert len(short.cheapest(lambda leg: (4096, 4096), (9000, 9000))) == 1
    cut = legs.cheapest(lambda leg: (256, 256), (9000, 9000))
    assert len(cut) > 4
    work = sum((1 + 2 * leg.halo / 256) ** 2 * (leg.work + BETWEEN) for leg in cut)
    assert work < 0.5 * (1 + 2 * 400 / 256) ** 2 * (400 + BETWEEN)

    def room(leg):
        if leg.halo > 100:
            raise InputError("too little")
        return (4096, 4096)

    assert max(leg.halo for leg in legs.cheapest(room, (9000, 9000))) <= 100


@settings(max_examples=30, deadline=None)
@given(
    sides=st.tuples(*[st.tuples(st.integers(0, 6), st.integers(1, 7))] * 3), k=st.integers(1, 2), seed=st.integers(0, 9)
)
def test_what_is_written_between_legs_is_read_in_windows_of_any_shape(sides, k, seed):
    rng, shape = np.random.default_rng(seed), (7, 9, 8)
    held, whole = Between(between.Path("."), shape), rng.random((*shape, k), np.float32)
    halves = [
        tuple(slice(*cut) if axis == 1 else slice(0, size) for axis, size in enumerate(shape))
        for cut in ((0, 4), (4, 9))
    ]
    for window in halves:
        held.write(window, {"u": whole[window], "kept": 2 * whole[window].astype(np.float64)})
    window = tuple(slice(begin, min(begin + length, size)) for (begin, length), size in zip(sides, shape, strict=True))
    found = held.read(window)
    same(found["u"], whole[window])
    same(found["kept"], 2 * whole[window].astype(np.float64))
    held.close()


@pytest.mark.parametrize(
    "asked",
    [
        request(time=9000.0),
        request(time=6500.0, compute=EXPLICIT),
        request(method=Beltrami(contrast=5.0, twicing=0.5), time=3000.0),
        request(method=Beltrami(contrast=5.0, second_stage=True)),
    ],
)
def test_a_raster_in_legs_is_that_of_the_whole_and_nothing_else_is_left(asked, tmp_path):
    path, target = make(tmp_path / "in.tif", heights()), tmp_path / "out.tif"
    outcome = smooth_raster(path, target, asked, ReadOptions(), Output(SMALL))
    assert len(outcome.legs) > 1
    assert f"in {len(outcome.legs)} legs" in outcome.summary
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in.tif", "out.tif"]
    same(array_of(read(target).data), array_of(run(read(path).data, asked, record=None).after))


@pytest.mark.parametrize("after", [0, 5])
def test_a_full_disk_between_legs_leaves_the_old_file_and_nothing_else(after, tmp_path, monkeypatch):
    path, target = make(tmp_path / "in.tif", heights()), tmp_path / "out.tif"
    target.write_bytes(b"old")
    put, calls = between._put, []

    def full(*words):
        calls.append(1)
        if len(calls) > 64 * after:
            raise OSError(28, "No space left on device")
        put(*words)

    monkeypatch.setattr(between, "_put", full)
    with pytest.raises(FormatError, match="the state between two legs .*No space left.*; nothing is left of it"):
        smooth_raster(path, target, request(time=9000.0), ReadOptions(), Output(SMALL, overwrite=True))
    assert target.read_bytes() == b"old"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in.tif", "out.tif"]


@pytest.mark.parametrize("stop", [Residual(0.8), AreaLoss(0.05)])
@pytest.mark.parametrize("kind", ["terrain", "image", "volume"])
def test_a_stop_is_met_by_all_samples_and_not_by_those_of_the_tiles(kind, stop):
    data = volume((20, 22, 24)) if kind == "volume" else terrain(90, 80, k=2 * (kind == "image"))
    sides, side, enough = ((12, 22, 24), 12, 6000) if kind == "volume" else ((31, 80), 16, 2000)
    outliers = None if kind == "volume" else "include"
    asked = Request.of(Beltrami(contrast=2.0), stop, noise=1.0, boundary="neumann", outliers=outliers, compute=EXPLICIT)
    whole = run(data, asked, record=None)
    done, found = by_windows(data, asked, sides, enough, side, legs=2)
    same(done, array_of(whole.after))
    assert found.found.time == pytest.approx(whole.end.time, rel=1e-12)
    assert any("tiles spread over the whole" in word for word in found.warnings)


def test_a_stop_that_is_not_met_says_so():
    asked = Request.of(Beltrami(contrast=2.0), Residual(1.0), time=0.5, noise=3.0, outliers="include", compute=EXPLICIT)
    done, found = by_windows(terrain(90, 80), asked, (30, 80), 2000)
    assert "the stop is not met in the time of the run" in found.warnings
    same(done, array_of(run(terrain(90, 80), asked, record=None).after))


@pytest.mark.parametrize("method", [Beltrami(contrast=2.0), Beltrami(contrast=2.0, twicing=0.5)])
def test_chunks_exchange_their_state_where_the_halo_is_wide(method):
    da = pytest.importorskip("dask.array")
    z = np.where(terrain(120, 130).missing, np.nan, terrain(120, 130).z)
    options = {"method": method, "time": 12.0, "noise": 1.0, "outliers": "include", "compute": EXPLICIT}
    found = meshflow.smooth(da.from_array(z, (30, 33)), **options, result=True)
    assert len(found.legs) > 1
    same(found.data.compute(), meshflow.smooth(z, **options))


@pytest.mark.parametrize("stop", [Residual(0.8), AreaLoss(0.05)])
def test_a_stop_is_met_by_all_chunks_when_they_are_computed(stop, monkeypatch):
    da = pytest.importorskip("dask.array")
    monkeypatch.setattr(chunks, "places_in", lambda form: places_in(form, 2000, 16))
    z = terrain(90, 80, holes=0.0).z
    options = {
        "method": Beltrami(contrast=2.0),
        "noise": 1.0,
        "boundary": "neumann",
        "outliers": "include",
        "stop": stop,
    }
    whole = meshflow.smooth(z, **options, compute=EXPLICIT, result=True)
    found = meshflow.smooth(da.from_array(z, (30, 80)), **options, compute=EXPLICIT, result=True)
    assert "at a time that is known once it is computed" in found.stopped_because
    same(found.data.compute(), whole.data)


def test_a_volume_by_blocks_has_its_second_stage_and_a_large_one_has_none_by_default():

    data = volume((14, 20, 17), holes=0.0)
    form = replace(Held(data).form, shape=(400, 400, 400))
    for known, expected in ((Held(data).form, True), (form, False)):
        asked = Request.of(meshflow.Search(second_stage=None))
        assert second_stage.is_considered(known.kind, known.values) == expected
        found = windowed(known, sample_of(Held(data)), asked)
        assert expected or (found.local.plan.groups is None and "second_stage" not in found.found.decided)
