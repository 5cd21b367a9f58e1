"""Rows that end where they begin, around a globe or a scanner: no seam, wherever they are cut. meshflow.surfaces.joined."""

import numpy as np
import pytest
import rasterio

import meshflow
from meshflow import Compute, DataWeights, Fixed, HeightField, Image, MaxChange, RangeImage, Spherical
from meshflow.estimate.request import Request
from meshflow.io.files import read
from meshflow.results.run import states

H, W = 40, 96
RNG = np.random.default_rng(5)
TURN = np.arange(W) * 2 * np.pi / W
TRUTH = 10 * np.sin(2 * TURN) * np.cos(np.linspace(-1, 1, H))[:, None] + 6 * np.cos(TURN)
NOISY = TRUTH + RNG.normal(size=TRUTH.shape)
GIVEN = {
    "method": meshflow.Beltrami(contrast=0.7, twicing=0.0),
    "time": 2.0,
    "noise": 1.0,
    "boundary": "neumann",
    "compute": Compute(diagonals="both"),
}
SWEEP = Spherical((180.0, -180.0 + 360.0 / W), (12.0, -12.0))


def terrain(z=NOISY):
    return HeightField(z, period=W)


def picture(z=NOISY):
    return Image(np.stack([z, z[::-1]], axis=2), period=W)


def sweep(z=NOISY):
    return RangeImage(20 + 0.1 * z, SWEEP)


def values(data):
    return data.z if isinstance(data, HeightField) else data.values if isinstance(data, Image) else data.depth


@pytest.mark.parametrize("made", [terrain, picture, sweep])
@pytest.mark.parametrize("shift", [1, 37, -20])
def test_the_result_does_not_depend_on_where_rows_are_cut(made, shift):
    options = GIVEN if made is not sweep else {**GIVEN, "method": "beltrami", "noise": 0.1}
    one, other = (values(meshflow.smooth(made(z), **options)) for z in (NOISY, np.roll(NOISY, shift, axis=1)))
    assert np.abs(np.roll(one, shift, axis=1) - other).max() < 1e-12


@pytest.mark.parametrize("made", [terrain, picture, sweep])
def test_the_ends_are_as_good_as_the_middle(made):
    truth = values(made(TRUTH))
    error = np.abs(values(meshflow.smooth(made())) - truth)
    ends, middle = error[:, [0, 1, -2, -1]], error[:, 30:60]
    assert np.sqrt(np.mean(ends**2)) < 1.3 * np.sqrt(np.mean(middle**2))


def test_rows_with_two_ends_are_worse_there():
    ends = [
        np.abs(values(meshflow.smooth(data)) - TRUTH)[:, [0, -1]].mean() for data in (terrain(), HeightField(NOISY))
    ]
    assert ends[0] < 0.7 * ends[1]


def test_noise_is_that_of_the_samples_without_their_copies():
    joined, apart = (meshflow.smooth(data, result=True) for data in (terrain(), HeightField(NOISY)))
    assert joined.noise.sigma == pytest.approx(apart.noise.sigma, rel=0.02)
    assert joined.warnings == ()
    assert joined.removed.shape == joined.data.z.shape == (H, W)
    assert joined.before.period == joined.data.period == W


def test_a_column_that_is_the_first_once_more_stays_so():
    again = np.concatenate([NOISY, NOISY[:, :1]], axis=1)
    one = meshflow.smooth(HeightField(again, period=W), **GIVEN).z
    assert np.array_equal(one[:, 0], one[:, -1])
    assert np.abs(one[:, :-1] - meshflow.smooth(terrain(), **GIVEN).z).max() < 1e-12
    camera = Spherical((180.0, -180.0), (12.0, -12.0))
    swept = meshflow.smooth(RangeImage(20 + again, camera), method="beltrami", time=1.0).depth
    assert np.array_equal(swept[:, 0], swept[:, -1])
    unlike = meshflow.smooth(
        RangeImage(20 + 0.1 * again + 0.01 * np.arange(W + 1), camera), method="beltrami", time=1.0
    )
    assert not np.array_equal(unlike.depth[:, 0], unlike.depth[:, -1]), "a column of its own is kept"


def test_a_part_of_a_turn_has_two_ends():
    part = HeightField(NOISY[:, :50], period=W)
    assert np.array_equal(meshflow.smooth(part, **GIVEN).z, meshflow.smooth(HeightField(NOISY[:, :50]), **GIVEN).z)


def test_arrays_of_constraints_go_around_with_the_samples():
    fixed = np.zeros((H, W), bool)
    fixed[10:20, [0, 1, W - 1]] = True
    most, weights = np.full((H, W), 0.3), np.full((H, W), 0.1)
    most[:, 0], weights[5] = 0.05, 0.5
    done = meshflow.smooth(terrain(), constraints=[Fixed(fixed), MaxChange(most), DataWeights(weights)], **GIVEN).z
    assert np.array_equal(done[fixed], NOISY[fixed])
    assert (np.abs(done - NOISY) <= most + 1e-12).all()
    rolled = [np.roll(array, 31, axis=1) for array in (NOISY, fixed, most, weights)]
    held = [Fixed(rolled[1]), MaxChange(rolled[2]), DataWeights(rolled[3])]
    assert (
        np.abs(meshflow.smooth(terrain(rolled[0]), constraints=held, **GIVEN).z - np.roll(done, 31, axis=1)).max()
        < 1e-12
    )


def test_states_of_the_flow_have_the_size_of_the_data():
    request = Request.of(
        GIVEN["method"], (), (), time=2.0, noise=1.0, boundary="neumann", compute=Compute(diagonals="both")
    )
    *_, (time, last) = states(terrain(), request, 4)
    assert time == 2.0
    assert np.abs(last.z - meshflow.smooth(terrain(), **GIVEN).z).max() < 0.5
    assert last.z.shape == (H, W)


def globe(path, z, west=-180.0, dlon=360.0 / W, crs="EPSG:4326"):
    place = rasterio.Affine(dlon, 0, west, 0, -120.0 / H, 60.0)
    h, w = z.shape
    with rasterio.open(path, "w", "GTiff", w, h, 1, crs, place, "float64") as file:
        file.write(z, 1)
    return path


@pytest.mark.parametrize("west", [-180.0, 0.0, -360.0 / W / 2])
def test_a_global_raster_is_joined_and_says_so(tmp_path, west):
    document = read(globe(tmp_path / "a.tif", NOISY, west))
    assert document.data.period == W
    assert any("the two ends of each row meet, and are smoothed together" in note for note in document.notes)
    again = np.concatenate([NOISY, NOISY[:, :1]], axis=1)
    assert read(globe(tmp_path / "b.tif", again, west)).data.period == W
    assert read(globe(tmp_path / "c.tif", np.concatenate([NOISY, NOISY[:, 5:6]], axis=1), west)).data.period == 0
    assert read(globe(tmp_path / "d.tif", NOISY[:, 1:], west)).data.period == 0
    assert read(globe(tmp_path / "e.tif", NOISY, west, 100.0, "EPSG:32632")).data.period == 0


def test_a_global_data_array_is_joined():
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(
        NOISY, dims=("lat", "lon"), coords={"lat": np.linspace(60, -60, H), "lon": np.arange(W) * 360.0 / W}
    )
    ends = np.abs(meshflow.smooth(array).to_numpy() - TRUTH)[:, [0, -1]].mean()
    apart = np.abs(meshflow.smooth(array, spacing=(300e3, 300e3)).to_numpy() - TRUTH)[:, [0, -1]].mean()
    assert ends < 0.8 * apart


def test_a_period_is_a_whole_number():
    with pytest.raises(meshflow.InputError, match="period"):
        HeightField(NOISY, period=1.5)
