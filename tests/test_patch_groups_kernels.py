"""The kernel of groups of similar patches: beside the slow way, for every kind of grid, with the same bits for all threads."""

import naive
import numpy as np
import pytest

from meshflow.kernels.patch_groups import GroupOptions, patch_groups

SMALL = (1, 5, 3, 4, 12, 0.2, 0.9)  # slices, side, stride, reach, members, near, loss
OF_VOLUME = (2, 3, 2, 2, 12, 0.2, 0.9)


def scene(k=1, shape=(1, 19, 23), holes=False, seed=0, dtype=np.float64):
    """A step and a wave with noise of deviation 1, a pilot with little of it, and where nothing is."""
    rng = np.random.default_rng(seed)
    z, r, c = np.indices(shape)
    r = r + z
    truth = np.stack([8.0 * (c > 9 + q) + 3 * np.sin(0.7 * r + q) for q in range(k)])
    missing = rng.random(shape) < 0.01 if holes else np.zeros(shape, bool)
    values = truth + rng.normal(size=truth.shape)
    values[:, missing] = np.nan
    return values.astype(dtype), (truth + 0.2 * rng.normal(size=truth.shape)).astype(dtype), missing


def filtered(values, pilot, missing, noise=None, options=SMALL, threads=2):
    out = np.empty_like(pilot)
    noise = np.eye(options[0] * options[1] ** 2) if noise is None else noise
    patch_groups(values, pilot, missing, noise, GroupOptions(*options), out, None, threads)
    return out


def exponential(side, rate=0.5):
    """Correlation that falls with the distance along each axis."""
    r, c = (axis.ravel() for axis in np.mgrid[:side, :side])
    return rate ** (abs(r[:, None] - r) + abs(c[:, None] - c))


@pytest.mark.parametrize("holes", [False, True], ids=["whole", "holes"])
@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("noise", [None, exponential(5)], ids=["white", "correlated"])
def test_groups_are_those_of_the_equation(k, holes, noise):
    values, pilot, missing = scene(k, holes=holes)
    there = np.where(missing, 0.0, values), np.where(missing, 0.0, pilot)
    expected = naive.patch_groups(*there, missing, np.eye(25) if noise is None else noise, *SMALL)
    found = filtered(values, pilot, missing, noise)
    worst = np.abs(found - expected)[:, ~missing].max()
    assert worst < 1e-11, f"{worst:.2g}"


@pytest.mark.parametrize(("side", "stride"), [(3, 1), (4, 2), (6, 4)])
def test_any_side_and_stride(side, stride):
    values, pilot, missing = scene()
    options = (1, side, stride, 4, 12, 0.2, 0.5)
    expected = naive.patch_groups(values, pilot, missing, np.eye(side * side), *options)
    np.testing.assert_allclose(filtered(values, pilot, missing, options=options), expected, atol=1e-11)


@pytest.mark.parametrize("holes", [False, True], ids=["whole", "holes"])
@pytest.mark.parametrize(("k", "deep"), [(1, 2), (2, 3)])
def test_groups_of_a_volume_are_those_of_the_equation(k, deep, holes):
    values, pilot, missing = scene(k, (7, 8, 9), holes)
    there = np.where(missing, 0.0, values), np.where(missing, 0.0, pilot)
    options = (deep, *OF_VOLUME[1:])
    expected = naive.patch_groups(*there, missing, np.eye(9 * deep), *options)
    worst = np.abs(filtered(values, pilot, missing, options=options) - expected)[:, ~missing].max()
    assert worst < 1e-11, f"{worst:.2g}"


def test_samples_that_no_patch_covers_are_those_of_the_pilot():
    values, pilot, missing = scene()
    missing[:, 4::5] = True
    np.testing.assert_array_equal(filtered(values, pilot, missing), pilot)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_equal_bits_for_any_number_of_threads(dtype):
    for shape, options in (((1, 90, 130), SMALL), ((17, 20, 22), OF_VOLUME)):
        values, pilot, missing = scene(2, shape, holes=True, dtype=dtype)
        one = filtered(values, pilot, missing, options=options, threads=1)
        for threads in (2, 3, 7):
            found = filtered(values, pilot, missing, options=options, threads=threads)
            np.testing.assert_array_equal(found, one)


def test_the_result_may_be_written_over_the_pilot():
    values, pilot, missing = scene()
    expected = filtered(values, pilot, missing)
    patch_groups(values, pilot, missing, np.eye(25), GroupOptions(*SMALL), pilot)
    np.testing.assert_array_equal(pilot, expected)


@pytest.mark.parametrize("shape", [(19, 23), (20, 24), (50, 41)])
def test_turned_and_mirrored_grids_give_turned_and_mirrored_results(shape):
    values, pilot, missing = scene(shape=(1, *shape), holes=True)
    whole = filtered(values, pilot, missing)
    for name, move in {
        "mirrored": lambda a: a[..., ::-1],
        "turned": lambda a: np.rot90(a, axes=(-2, -1)),
        "transposed": lambda a: np.swapaxes(a, -2, -1),
    }.items():
        moved = filtered(*(np.ascontiguousarray(move(a)) for a in (values, pilot, missing)))
        worst = np.abs(moved - move(whole))[..., ~move(missing)].max()
        assert worst < 1e-11, f"{name}: {worst:.2g}"


def test_turned_volumes_give_turned_results():
    options = (3, *OF_VOLUME[1:])  # a cube, which is one along each axis
    values, pilot, missing = scene(shape=(14, 9, 11), holes=True)
    whole = filtered(values, pilot, missing, options=options)
    for axes in ((1, 2, 0), (2, 1, 0)):
        moved = filtered(
            *(np.ascontiguousarray(a.transpose(0, *(i + 1 for i in axes))[:, ::-1]) for a in (values, pilot)),
            np.ascontiguousarray(missing.transpose(axes)[::-1]),
            options=options,
        )
        worst = np.abs(moved - whole.transpose(0, *(i + 1 for i in axes))[:, ::-1])
        assert worst[:, ~missing.transpose(axes)[::-1]].max() < 1e-11


def test_flat_data_is_as_flat_as_its_pilot():
    values, _, missing = scene()
    np.testing.assert_allclose(filtered(values, np.full_like(values, 7.0), missing), 7.0, rtol=1e-14)


def test_a_covariance_that_is_none_gives_numbers_all_the_same():
    values, pilot, missing = scene()
    assert np.isfinite(filtered(values, 0 * pilot, missing, noise=np.ones((25, 25)))).all()


def test_sizes_that_make_no_sense_are_refused():
    values, pilot, missing = scene()
    for wrong in ({2: 0}, {3: 0}, {4: 1}, {4: 300}, {0: 2}):
        options = tuple(wrong.get(i, number) for i, number in enumerate(SMALL))
        with pytest.raises(ValueError, match="patch_groups"):
            filtered(values, pilot, missing, options=options)
