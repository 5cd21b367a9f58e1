"""Scattered points, curvilinear grids and values around a globe become meshes with channels, and come back as they came."""

import numpy as np
import pytest

import meshflow
from meshflow import Compute, Curvilinear, Fixed, Heat, HeightField, InputError, OnSphere, Scattered
from meshflow.errors import NothingThere
from meshflow.geometry.healpix import healpix_places

PLACES = np.random.default_rng(0).uniform(0, 40, (500, 2))
INSIDE = ((PLACES > 6) & (PLACES < 34)).all(axis=1)
NOISE = np.random.default_rng(1).normal(size=500)
HEAT = {"method": Heat(twicing=0), "time": 1.0}


def ring(rows=12, columns=20):
    r, angle = np.geomspace(1, 3, rows), np.linspace(0.1, 2.5, columns)
    return r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)


# Scattered points


def test_a_plane_over_scattered_points_stays_inside_and_nothing_takes_it_for_noise():
    plane = 3.0 + PLACES @ [1.0, -2.0]
    smoothed = meshflow.smooth(Scattered(PLACES, plane), **HEAT).values
    assert np.abs(smoothed - plane)[INSIDE].max() < 1e-9
    assert meshflow.estimate_noise(Scattered(PLACES, plane)).sigma < 1e-9
    assert meshflow.estimate_noise(Scattered(PLACES, plane + 0.1 * NOISE)).sigma == pytest.approx(0.1, rel=0.1)


def test_the_default_removes_noise_from_a_slope_although_some_triangles_are_tiny():
    plane = PLACES @ [1.0, -2.0]
    smoothed = meshflow.smooth(Scattered(PLACES, plane + 0.5 * NOISE)).values
    assert np.std(smoothed - plane) < 0.4 * 0.5  # 0.7 where the search ended with the last time of 240 explicit steps


def test_heights_of_points_move_and_x_and_y_do_not():
    terrain = np.column_stack([PLACES, np.sin(PLACES[:, 0] / 6) + 0.1 * NOISE])
    smoothed = meshflow.smooth(Scattered(terrain), **HEAT)
    values = meshflow.smooth(Scattered(PLACES, terrain[:, 2]), **HEAT).values
    assert np.array_equal(smoothed.points[:, :2], PLACES)
    assert np.array_equal(smoothed.points[:, 2], values)
    assert smoothed.values is None


def test_values_of_points_of_a_terrain_are_measured_on_the_terrain():
    steep = np.column_stack([PLACES, 3.0 * PLACES[:, 0]])  # the same as places that are sqrt(10) times as far apart
    flat = PLACES * [np.sqrt(10.0), 1.0]
    faces = Scattered(PLACES, NOISE).mesh.faces
    one = meshflow.smooth(Scattered(steep, NOISE, faces), **HEAT).values
    two = meshflow.smooth(Scattered(flat, NOISE, faces), **HEAT).values
    assert np.abs(one - two).max() < 1e-9


def test_the_order_the_origin_and_the_turn_of_the_points_make_no_difference():
    expected = meshflow.smooth(Scattered(PLACES, NOISE), **HEAT).values
    order = np.random.default_rng(2).permutation(500)
    assert np.abs(meshflow.smooth(Scattered(PLACES[order], NOISE[order]), **HEAT).values - expected[order]).max() < 1e-9
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    far = PLACES @ turn + [5e5, 5.4e6]  # as in UTM
    assert np.abs(meshflow.smooth(Scattered(far, NOISE), **HEAT).values - expected).max() < 1e-6


def test_missing_points_are_left_out_and_come_back_as_they_came():
    values = np.stack([NOISE, 2 * NOISE], axis=1).astype(np.float32)
    values[[3, 40], 0] = np.nan, np.inf
    smoothed = meshflow.smooth(Scattered(PLACES, values), **HEAT)
    assert smoothed.values.dtype == np.float32
    assert smoothed.values.shape == (500, 2)
    assert np.array_equal(smoothed.values[[3, 40]], values[[3, 40]], equal_nan=True)
    there = np.isfinite(values).all(axis=1)
    alone = meshflow.smooth(Scattered(PLACES[there], values[there]), **HEAT).values
    assert np.array_equal(smoothed.values[there], alone)


def test_constraints_have_one_number_per_sample_as_they_came():
    held = np.zeros(500, bool)
    held[100:120] = True
    values = NOISE.copy()
    values[3] = np.nan
    smoothed = meshflow.smooth(Scattered(PLACES, values), constraints=Fixed(held), **HEAT).values
    assert np.array_equal(smoothed[held], values[held])
    assert (smoothed[~held & np.isfinite(values)] != values[~held & np.isfinite(values)]).all()


def test_a_largest_edge_and_an_outline_with_a_hole_bound_the_triangles():
    whole, near = Scattered(PLACES, NOISE).mesh, Scattered(PLACES, NOISE, max_edge=3.0).mesh
    sides = near.points[near.faces] - near.points[np.roll(near.faces, 1, axis=1)]
    assert np.linalg.norm(sides, axis=2).max() <= 3.0
    assert len(near.faces) < len(whole.faces)
    box = np.array([[5, 5], [35, 5], [35, 35], [5, 35]])
    hole = np.array([[15.0, 15], [25, 15], [25, 25], [15, 25]])
    mesh = Scattered(PLACES, NOISE, outline=[box, hole]).mesh
    x = np.abs(mesh.points[mesh.faces].mean(axis=1) - 20).max(axis=1)
    assert x.max() < 15
    assert x.min() > 5
    assert np.array_equal(
        Scattered(PLACES, NOISE, outline=box).mesh.faces, Scattered(PLACES, NOISE, outline=[box]).mesh.faces
    )


def test_no_triangle_faces_the_rim_with_a_wide_angle():
    mesh = Scattered(PLACES, NOISE).mesh
    ends = np.sort(mesh.faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    _, which, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    rim = (count[which.reshape(-1)] == 1).reshape(-1, 3)
    corners = mesh.points[mesh.faces]
    one, two = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    cosine = (one * two).sum(axis=2) / np.linalg.norm(one, axis=2) / np.linalg.norm(two, axis=2)
    assert cosine[rim & (rim.sum(axis=1) == 1)[:, None]].min() >= -0.5
    assert len(np.unique(mesh.faces)) == len(PLACES)  # no point has lost its triangles


@pytest.mark.long
def test_spikes_are_left_out_and_kept_or_replaced_and_the_others_are_as_smooth_as_without_them():
    truth = np.sin(PLACES[:, 0] / 6)
    values = truth + 0.1 * NOISE
    spikes = np.random.default_rng(4).random(500) < 0.03
    spiked = values + np.where(spikes, np.where(NOISE > 0, 9.0, -5.0), 0.0)
    clean = np.std((meshflow.smooth(Scattered(PLACES, values)).values - truth)[~spikes])
    found = meshflow.smooth(Scattered(PLACES, spiked), result=True)
    assert np.array_equal(found.data.values[spikes], spiked[spikes])
    assert np.std((found.data.values - truth)[~spikes]) < 1.15 * clean
    assert found.warnings[0].startswith(f"{spikes.sum()} of 500 values are spikes, far from all around: excluded")
    repaired = meshflow.smooth(Scattered(PLACES, spiked), outliers="repair", result=True)
    assert np.abs(repaired.data.values - truth)[spikes].max() < 0.5
    assert "replaced by a plane" in repaired.warnings[0]
    assert not meshflow.smooth(Scattered(PLACES, spiked), outliers="include", result=True).warnings
    assert meshflow.estimate_noise(Scattered(PLACES, spiked)).sigma == pytest.approx(0.1, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("values", [np.hypot(*(PLACES - 20).T), (PLACES[:, 0] > 20) * 9.0 + NOISE, np.round(NOISE)])
def test_cones_steps_and_levels_have_no_spikes(values):
    assert not meshflow.smooth(Scattered(PLACES, values), result=True).warnings


# Curvilinear and rectilinear grids


def test_an_evenly_spaced_grid_is_the_height_field():
    z = np.random.default_rng(3).normal(size=(20, 24))
    y, x = np.mgrid[0:20, 0:24] * 2.0
    steps = {
        "method": Heat(twicing=0),
        "time": 0.25,
        "boundary": "neumann",
        "compute": Compute(stepper="explicit", dt=0.05),
    }
    smoothed = meshflow.smooth(Curvilinear(x, -y, z), **steps).values
    field = meshflow.smooth(HeightField(z, 2.0), **steps).z
    assert np.abs(smoothed - field)[6:-6, 6:-6].max() < 1e-12  # five steps from the border, whose corners differ
    row = Curvilinear(x[0], -y[:, 0], z)
    assert np.array_equal(row.mesh.faces, Curvilinear(x, -y, z).mesh.faces)


def test_a_rectilinear_grid_has_spacings_per_column_and_per_row():
    x, y = np.cumsum(np.linspace(0.5, 2, 20)), np.cumsum(np.linspace(2, 0.5, 16))
    plane = x - 2 * y[:, None]
    smoothed = meshflow.smooth(Curvilinear(x, y, plane), **HEAT).values
    assert np.abs(smoothed - plane)[4:-4, 4:-4].max() < 1e-9
    taken_for_even = meshflow.smooth(HeightField(plane), **HEAT).z
    assert np.abs(taken_for_even - plane)[4:-4, 4:-4].max() > 0.02


@pytest.mark.parametrize("turn", [np.fliplr, np.flipud])
def test_a_curvilinear_grid_has_no_preferred_corner(turn):
    (x, y), values = ring(), np.random.default_rng(4).normal(size=(12, 20))
    smoothed = meshflow.smooth(Curvilinear(x, y, values), method=Heat(twicing=0), time=0.02).values
    turned = meshflow.smooth(Curvilinear(turn(x), turn(y), turn(values)), method=Heat(twicing=0), time=0.02).values
    assert np.abs(turned - turn(smoothed)).max() < 0.02


def test_missing_samples_of_a_grid_are_holes_and_keep_their_bits():
    (x, y), values = ring(), np.random.default_rng(5).normal(size=(12, 20, 2))
    values[4:6, 7:9, 1] = np.nan
    x = x.copy()
    x[0, 0] = np.nan  # swaths have samples without a place
    grid = Curvilinear(x, y, values)
    smoothed = meshflow.smooth(grid, method=Heat(), time=0.02).values
    gone = np.isnan(values).any(axis=2)
    gone[0, 0] = True
    assert np.array_equal(smoothed[gone], values[gone], equal_nan=True)
    assert (smoothed[~gone] != values[~gone]).any(axis=1).all()
    assert len(grid.mesh.points) == (~gone).sum()


def test_a_grid_in_space_is_measured_there():
    angle, along = np.linspace(0, 3, 24), np.arange(15) * 0.2
    values = np.random.default_rng(6).normal(size=(15, 24))
    rolled = Curvilinear(
        np.broadcast_to(np.cos(angle), (15, 24)), np.broadcast_to(along[:, None], (15, 24)), values,
        z=np.broadcast_to(np.sin(angle), (15, 24)),
    )  # fmt: skip
    flat = Curvilinear(angle * (2 * np.sin(np.diff(angle)[0] / 2) / np.diff(angle)[0]), along, values)
    one, two = (meshflow.smooth(data, method=Heat(), time=0.05).values for data in (rolled, flat))
    assert np.abs(one - two)[2:-2, 2:-2].max() < 1e-3


# Around a globe


def euler(mesh):
    edges = np.unique(np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(mesh.faces)) - len(edges) + len(mesh.faces)


def globe(step=10, poles=True):
    lat = np.arange(-90, 91, step) if poles else np.arange(-90 + step / 2, 90, step)
    return np.arange(0, 360, step), lat


@pytest.mark.parametrize("poles", [True, False])
def test_a_global_grid_is_a_closed_surface(poles):
    lon, lat = globe(poles=poles)
    sphere = OnSphere(lon, lat, np.random.default_rng(7).normal(size=(len(lat), len(lon))))
    assert euler(sphere.mesh) == 2
    assert len(sphere.mesh.points) == (17 * 36 + 2 if poles else 18 * 36)
    x, y, z = (sphere.mesh.points[sphere.mesh.faces[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(y - x, z - x), x + y + z) > 0).all()  # all triangles face outwards


def test_samples_at_one_place_come_back_equal_and_rows_have_no_ends():
    lon, lat = globe()
    draw = np.random.default_rng(8).normal(size=(len(lat), len(lon)))
    smoothed = meshflow.smooth(OnSphere(lon, lat, draw), method=Heat(), time=0.02).values
    assert np.ptp(smoothed[0]) == np.ptp(smoothed[-1]) == 0
    closed = OnSphere(np.append(lon, 360), lat, np.column_stack([draw, draw[:, 0]]))
    again = meshflow.smooth(closed, method=Heat(), time=0.02).values
    assert np.abs(again[1:-1, :-1] - smoothed[1:-1]).max() < 0.02
    assert np.array_equal(again[:, 0], again[:, -1])
    rolled = meshflow.smooth(OnSphere(lon, lat, np.roll(draw, 7, axis=1)), method=Heat(), time=0.02).values
    assert np.abs(np.roll(smoothed, 7, axis=1) - rolled)[1:-1].max() < 0.02 * np.abs(smoothed).max() + 0.02


def test_a_spherical_harmonic_decays_as_it_must():
    values = np.zeros(12 * 8**2)
    x, y, z = OnSphere.healpix(values).mesh.points.T
    for degree, harmonic in ((1, z), (2, x * y), (3, z * (5 * z**2 - 3))):
        smoothed = meshflow.smooth(OnSphere.healpix(harmonic), method=Heat(twicing=0), time=0.05).values
        share = float(smoothed @ harmonic / (harmonic @ harmonic))
        assert share == pytest.approx(np.exp(-degree * (degree + 1) * 0.05), rel=0.02), degree


def test_the_pixels_of_healpix_lie_where_the_paper_has_them():
    for nside in (1, 2, 4, 8):
        ring, nest = (np.column_stack(healpix_places(12 * nside**2, nested)) for nested in (False, True))
        assert np.abs(ring[np.lexsort(ring.round(9).T)] - nest[np.lexsort(nest.round(9).T)]).max() < 1e-9
        z = np.sin(np.radians(ring[:, 1]))
        assert abs(z.sum()) < 1e-9
        assert (np.diff(ring[:, 1]) <= 1e-12).all()  # rings from north to south
    # Of the package healpix 2025.1: pix2ang(2, [0, 13, 47], lonlat=True), pix2ang(4, [0, 70, 150], nest=True, lonlat=True).
    for pixels, nest, which, lon, lat in (
        (48, False, [0, 13, 47], [45, 45, 315], [66.44353569, 19.47122063, -66.44353569]),
        (192, True, [0, 70, 150], [45, 11.25, 146.25], [9.59406823, 0, -41.8103149]),
    ):
        found = healpix_places(pixels, nest)
        assert found[0][which] == pytest.approx(lon)
        assert found[1][which] == pytest.approx(lat, abs=1e-8)


def test_places_on_less_than_half_of_the_sphere_have_a_border_and_missing_ones_are_holes():
    lon, lat = np.linspace(0, 40, 12), np.linspace(30, 60, 10)
    values = np.random.default_rng(9).normal(size=(10, 12))
    values[4, 5] = np.nan
    patch = OnSphere(lon, lat, values, radius=6371.0)
    assert euler(patch.mesh) == 0  # a disc with a hole
    assert np.linalg.norm(patch.mesh.points, axis=1) == pytest.approx(6371.0)
    assert np.isnan(meshflow.smooth(patch, method=Heat(), scale=50.0).values[4, 5])


def test_the_default_on_a_globe_removes_noise_at_the_poles_too():
    lon, lat = globe(10, poles=False)
    warm = np.sin(np.radians(lat))[:, None] + np.zeros(36)
    noise = 0.2 * np.random.default_rng(10).normal(size=warm.shape)
    left = meshflow.smooth(OnSphere(lon, lat, warm + noise)).values - warm
    assert np.std(left) < 0.5 * 0.2
    assert np.std(left[[0, 1, -2, -1]]) < 0.5 * 0.2


# Refusals

LINE = np.column_stack([np.arange(9.0), 2 * np.arange(9.0)])


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Scattered(PLACES), "heights: points \\(n, 3\\)"),
        (lambda: Scattered(PLACES[:, 0], NOISE), "shape \\(n, 2\\) or \\(n, 3\\)"),
        (lambda: Scattered(PLACES, NOISE[:9]), "values of shape \\(500\\)"),
        (lambda: Scattered(np.r_[PLACES, PLACES[:1]], np.zeros(501)), "points 0 and 500"),
        (lambda: Scattered(LINE, np.arange(9.0)), "9 on one line"),
        (lambda: Scattered(LINE[:2], np.arange(2.0)), "three points or more"),
        (lambda: Scattered(PLACES, NOISE, max_edge=1e-6), "leave none"),
        (lambda: Scattered(PLACES, NOISE, max_edge=-1), "max_edge"),
        (lambda: Scattered(PLACES, NOISE, outline=[[0, 0], [1, 1]]), "rings of three points"),
        (lambda: Scattered(PLACES, NOISE, faces=[[0, 1, 500]]), "500"),
        (lambda: Curvilinear(np.arange(4), np.arange(5), np.zeros((4, 5))), "values of shape \\(5, 4\\)"),
        (lambda: Curvilinear(np.zeros((3, 4)), np.zeros((4, 3)), np.zeros((3, 4))), "x and y: arrays of one shape"),
        (lambda: Curvilinear(np.arange(1), np.arange(5), np.zeros((5, 1))), "at least 2 x 2"),
        (lambda: OnSphere(np.arange(4), np.full(4, 91.0), np.zeros(4)), "from -90 to 90"),
        (lambda: OnSphere(np.arange(4), np.zeros(3), np.zeros(4)), "values \\(h, w\\) expected"),
        (lambda: OnSphere(np.arange(8), np.zeros(8), np.arange(8.0)), "which span no body"),
        (lambda: OnSphere(np.r_[0.0, 0, 120, 240], np.r_[90.0, 90, 0, 0], np.zeros(4)), "points 0 and 1"),
        (lambda: OnSphere.healpix(np.zeros(13)), "12 nside² pixels expected, such as 12"),
        (lambda: OnSphere.healpix(np.zeros(108), nest=True), "a power of two"),
        (lambda: meshflow.smooth(Scattered(PLACES, NOISE), spacing=2), "spacing: no option of a Scattered"),
    ],
)
def test_a_refusal_says_what_was_expected(made, words):
    with pytest.raises(InputError, match=words):
        made()


def test_nothing_but_missing_samples_is_refused():
    with pytest.raises(NothingThere, match="all 500 samples are missing"):
        Scattered(PLACES, np.full(500, np.nan))
