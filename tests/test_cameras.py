"""Cameras: lines and points, back to pixels, footprints, and what they refuse. meshflow.surfaces.camera, lens, scanner."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.cameras import ALL, CAMERAS, LENSES, PLAIN, SWEEP, H, W, offset_scanner, rays_of

from meshflow.errors import InputError
from meshflow.evaluate.metrics import compare
from meshflow.flow.controls import Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.march import march
from meshflow.smoothing import smooth
from meshflow.surfaces.camera import Camera, Orthographic, Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Scanner, Spherical

RNG = np.random.default_rng(5)


@ALL
def test_every_camera_projects_its_points_to_their_pixels(camera):
    assert isinstance(camera, Camera)
    depth = 1 + RNG.random((H, W))
    data = RangeImage(depth, camera)
    columns, rows = np.meshgrid(np.arange(W), np.arange(H))
    found = camera.project(data.cloud.reshape(-1, 3), (H, W))
    assert np.abs(found - np.stack([columns.ravel(), rows.ravel()], -1)).max() < 1e-8


@pytest.mark.parametrize("name", ["pinhole", "lens 5", "spherical", "scanner"])
def test_points_between_pixels_project_between_them(name):
    camera, fine = CAMERAS[name], (2 * H - 1, 2 * W - 1)
    finer = {
        "spherical": SWEEP,
        "scanner": replace(PLAIN, fx=100, fy=110, cx=39, cy=29),
    }.get(name) or replace(camera, fx=100, fy=110, cx=39, cy=29)
    points = RangeImage(np.ones(fine), finer).cloud + (np.array([0.1, 0.2, 0.3]) if name == "scanner" else 0)
    found = camera.project(points[1:-1, 1:-1].reshape(-1, 3), (H, W)).reshape(fine[0] - 2, fine[1] - 2, 2)
    columns, rows = np.meshgrid(np.arange(1, fine[1] - 1) / 2, np.arange(1, fine[0] - 1) / 2)
    assert np.abs(found - np.stack([columns, rows], -1)).max() < (0.01 if name == "scanner" else 1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_rays_of_a_lens_are_those_of_opencv(lens):
    cv2 = pytest.importorskip("cv2")
    camera = Pinhole(500, 510, 319.5, 239.5, lens)
    matrix = np.array([[500, 0, 319.5], [0, 510, 239.5], [0, 0, 1.0]])
    rays = camera.rays((480, 640))
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), -1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14)
    theirs = cv2.undistortPoints(pixels, matrix, np.array(lens), criteria=criteria)
    assert np.abs(rays[..., :2].reshape(-1, 2) - theirs[:, 0]).max() < 1e-9
    again, _ = cv2.projectPoints(rays.reshape(-1, 3), np.zeros(3), np.zeros(3), matrix, np.array(lens))
    assert np.abs(again - pixels).max() < 1e-8
    assert np.abs(camera.project(rays.reshape(-1, 3)) - pixels[:, 0]).max() < 1e-9


def test_a_lens_without_distortion_is_no_lens_and_stays_separable():
    assert Pinhole(50, 55, 19.5, 14.5, (0, 0, 0, 0)) == PLAIN
    assert [part.shape for part in PLAIN.lines((H, W), "depth").directions] == [(1, W), (H, 1), (1, 1)]


@pytest.mark.parametrize("name", ["pinhole", "lens 8", "orthographic"])
def test_depth_and_range_of_the_same_points_give_the_same_surface_and_time_unit(name):
    camera, depth = CAMERAS[name], 1 + RNG.random((H, W))
    length = np.linalg.norm(rays_of(camera, "depth"), axis=2)
    one = RangeImage(depth, camera, jump=None).lifted(Lift())
    other = RangeImage(depth * length, camera, measure="range", jump=None).lifted(Lift())
    assert np.allclose(one.points, other.points, rtol=1e-13)
    assert np.allclose(one.time_factor, other.time_factor, rtol=1e-13)
    assert np.allclose(np.linalg.norm(rays_of(camera, "range"), axis=2), 1)


def test_footprints_are_the_width_of_a_pixel_on_the_surface():
    u = np.full((H, W), 2.0)
    assert np.allclose(PLAIN.footprint(u, "depth"), 2 / np.sqrt(50 * 55))
    assert np.allclose(Orthographic(0.02, 0.03).footprint(u, "depth"), np.sqrt(0.02 * 0.03))
    da, de = np.radians(120 / (W - 1)), np.radians(40 / (H - 1))
    elevation = np.radians(np.linspace(15, -25, H))
    assert np.allclose(SWEEP.footprint(u, "range"), 2 * np.sqrt(da * de * np.cos(elevation))[:, None])
    assert np.allclose(offset_scanner().footprint(u, "range"), np.sqrt(0.02 * 0.025))


def test_footprints_of_a_scanner_from_one_point_are_those_of_the_camera_whose_rays_it_has():
    u = np.full((H, W), 2.0)
    u[4:7, 5:9] = np.nan
    swept = Scanner(rays_of(SWEEP)).footprint(u, "range")
    assert np.allclose(swept[1:-1, 1:-1], SWEEP.footprint(u, "range")[1:-1, 1:-1], rtol=1e-3, equal_nan=True)
    seen = Scanner(rays_of(PLAIN)).footprint(u, "depth")
    middle = seen[H // 2, W // 2]
    assert middle == pytest.approx(PLAIN.footprint(u, "depth")[H // 2, W // 2], rel=1e-2)


@ALL
def test_both_engines_move_alike_for_every_camera(camera):
    depth = 2 + 0.02 * RNG.normal(size=(H, W))
    missing = np.zeros((H, W), bool)
    missing[3:8, 10:14], missing[20, ::7] = True, True
    depth[missing] = np.nan
    for time_factor in ("footprint", "length"):
        data = RangeImage(depth, camera, time_unit=time_factor)
        variant = Variant(gamma=0.5)
        slow, fast = MeshFlow(data.lifted(Lift()), variant), GridFlow(data.gridded(Lift()), variant)
        one, other = (flow.rate(flow.start(), 1) for flow in (slow, fast))
        assert np.isfinite(one).all()
        assert np.abs(one - other).max() <= 1e-10 * np.abs(one).max()
        assert np.abs(one).max() > 0
        bounds = [flow.bound(flow.start()) for flow in (slow, fast)]
        assert (
            bounds[0] * (1 - 1e-9) <= bounds[1] < 1.5 * bounds[0]
        )  # the grid leaves out an indicator that is at most 1


@ALL
def test_planes_rest_for_every_camera(camera):
    rays, origins = rays_of(camera), camera.lines((H, W), camera.usual).at(np.zeros((H, W)))
    normal = np.array([0.1, -0.1, 1.0]) if not isinstance(camera, Spherical) else np.array([0.1, -0.1, 1.0])
    across = rays @ normal
    away = np.where(np.abs(across) > 0.05, (3.0 * np.sign(np.median(across)) - origins @ normal) / across, np.nan)
    away[away <= 0] = np.nan
    data = RangeImage(away, camera, jump=None)
    flow = GridFlow(data.gridded(Lift()), Variant())
    for turn in (0, 1):
        rate = flow.rate(flow.start(), turn)
        time_factor = data.gridded(Lift()).surface().time_factor[:, None]
        scale = np.nanmax(away)
        assert (
            np.abs(rate[time_factor > 0] / time_factor[time_factor > 0]).max() * np.median(time_factor[time_factor > 0])
            < 1e-10 * scale
        )


def test_time_in_length_is_time_in_footprints_where_all_footprints_are_equal():
    depth = 2 + 0.01 * RNG.normal(size=(H, W))
    camera = Orthographic(0.02, 0.02)
    one = smooth(depth, camera=camera, time=5.0, kind="depth")
    other = smooth(depth, camera=camera, time=5.0 * 0.02**2, kind="depth", time_unit="length")
    assert np.abs(one - other).max() < 1e-12
    assert RangeImage(depth, camera, time_unit="length").step == pytest.approx(0.02)
    assert np.array_equal(
        smooth(depth, camera=camera, time_unit="length"), smooth(depth, camera=camera)
    ) or np.allclose(smooth(depth, camera=camera, time_unit="length"), smooth(depth, camera=camera), atol=1e-12)


def test_values_of_a_scanner_with_origins_of_its_own_may_be_zero_and_below():
    camera = offset_scanner()
    data = RangeImage(np.where(np.arange(W) % 2, 0.001, -0.001) * np.ones((H, 1)), camera)
    assert not data.missing.any()
    assert data.gridded(Lift()).jump is None
    flow = GridFlow(data.gridded(Lift()), Variant())
    *_, last = march(flow, Until(time=3.0))
    assert np.abs(last.u).mean() < 0.0003
    with pytest.raises(InputError, match="depths above zero expected, got -0.001"):
        RangeImage(data.depth, CAMERAS["scanner"])


def test_rays_matter_only_where_there_are_samples():
    rays = rays_of(PLAIN).copy()
    rays[2, 3], rays[5, 6] = 0.0, np.nan
    depth = np.full((H, W), 2.0)
    with pytest.raises(InputError, match=r"longer than zero expected, 2 are not, the first in row 2, column 3"):
        RangeImage(depth, Scanner(rays))
    depth[2, 3] = depth[5, 6] = 0
    data = RangeImage(depth, Scanner(rays))
    for flow in (GridFlow(data.gridded(Lift()), Variant()), MeshFlow(data.lifted(Lift()), Variant())):
        assert np.isfinite(flow.rate(flow.start())).all()
    origins = np.zeros((H, W, 3))
    origins[0, 0] = np.nan
    with pytest.raises(InputError, match="1 are not, the first in row 0, column 0"):
        RangeImage(np.ones((H, W)), Scanner(rays_of(PLAIN), origins))


@ALL
def test_a_thinned_camera_sees_the_samples_that_are_kept_where_they_were(camera):
    depth = 1 + RNG.random((H, W))
    whole = RangeImage(depth, camera).cloud[::3, ::3]
    thin = RangeImage(depth[::3, ::3], camera.thinned(3, (H, W))).cloud
    assert np.abs(whole - thin).max() < 1e-9


def test_scanners_are_equal_where_their_lines_are():
    one, other = offset_scanner(), offset_scanner()
    assert one == other
    assert one != Scanner(one.directions, np.asarray(one.origins) + 0.1)
    assert one != Scanner(one.directions[1:], np.asarray(one.origins)[1:])
    assert one != PLAIN
    assert "30 x 40 rays origins of their own" in one.summary
    assert "from (0.1, 0.2, 0.3)" in CAMERAS["scanner"].summary


def test_depths_and_ranges_are_not_compared():
    one, other = (RangeImage(np.ones((H, W)), PLAIN, measure=measure) for measure in ("depth", "range"))
    with pytest.raises(InputError, match="compare: one measure expected, got depth and range; read both alike"):
        compare(one, other)


def test_nothing_of_the_callers_rays_is_shared():
    rays = np.array(rays_of(PLAIN))
    camera = Scanner(rays)
    rays[:] = 0
    assert camera == Scanner(rays_of(PLAIN))


IMAGE = np.ones((H, W))
BAD = [
    (
        lambda: RangeImage(IMAGE, Pinhole(4.2, 4.2, 20, 15)),
        r"fx = 4.2 pixels gives 40 pixels a field of view of 156\.\d deg",
    ),
    (lambda: RangeImage(IMAGE, Pinhole(400, 2.1, 20, 15)), r"fy = 2.1 .* f_px = f_mm \* width_px / sensor_width_mm"),
    (lambda: Pinhole(0, 1, 1, 1), "camera fx: a positive finite number of pixels expected, got 0"),
    (lambda: Pinhole(1, -2, 1, 1), "camera fy: a positive finite number of pixels expected, got -2"),
    (lambda: Pinhole(1, 1, 1, 1, (0.1, 0.2)), "distortion: 0, 4, 5 or 8 numbers .* got 2; undistort the image first"),
    (lambda: Pinhole(1, 1, 1, 1, (0.1, 0.2, 0, np.nan)), "distortion: a finite number expected, got nan"),
    (lambda: Pinhole(50, 50, 20, 15, (-3.0, 0, 0, 0)).rays((H, W)), r"no ray is found for \d+ of 1200 pixels"),
    (lambda: RangeImage(IMAGE, PLAIN, measure="z"), "measure: depth or range expected, got 'z'"),
    (
        lambda: RangeImage(IMAGE, PLAIN, time_unit="metres"),
        "time_unit: footprint, length or noise expected, got 'metres'",
    ),
    (lambda: RangeImage(IMAGE, "kinect"), "camera: a Pinhole, Orthographic, Spherical or Scanner expected, got str"),
    (lambda: Orthographic(0, 1), "camera dx: a positive finite number of length per pixel expected, got 0"),
    (lambda: Spherical((0, 0), (1, 2)), r"camera azimuth: .* at most a turn apart, expected, got 0, 0"),
    (lambda: Spherical(np.arange(1800.0), (1, 2)), r"got 0, 1, 2, 3, ... \(1800 numbers\)$"),
    (lambda: Spherical((0, 361), (1, 2)), r"at most a turn apart"),
    (lambda: Spherical((0, 90), (1, 3, 2)), "elevation: .* all falling or all rising, expected, got 1, 3, 2"),
    (lambda: Spherical((0, 90), (1, 95)), "-90 to 90 degrees expected, got 1, 95"),
    (lambda: Spherical((0, 90), ("a", 2)), "camera elevation: a finite number expected"),
    (lambda: RangeImage(IMAGE, Spherical((0, 90), (1, 2, 3))), "2 or 30 numbers, one for each row .* got 3"),
    (lambda: RangeImage(IMAGE, SWEEP, measure="depth"), "a spherical camera has no optical axis"),
    (lambda: SWEEP.project(np.ones((1, 3))), r"the shape \(h, w\) of the image expected"),
    (lambda: Scanner(np.ones((3, 4))), r"directions: shape \(h, w, 3\) expected, got \(3, 4\)"),
    (lambda: Scanner(np.ones((3, 4, 3)), np.ones((3, 4))), r"origins: shape \(3,\) or \(3, 4, 3\)"),
    (lambda: Scanner(np.ones((3, 4, 3)), (0, np.nan, 0)), "origins: finite numbers expected"),
    (lambda: Scanner(np.zeros((3, 4, 3))), "all 12 are zero or NaN"),
    (
        lambda: RangeImage(IMAGE, Scanner(np.ones((3, 4, 3)))),
        r"shape \(30, 40, 3\), as the image, expected, got \(3, 4, 3\)",
    ),
    (lambda: RangeImage(IMAGE, offset_scanner(), measure="depth"), "rays with z above zero expected"),
    (
        lambda: Scanner(rays_of(PLAIN), RNG.random((H, W, 3))).project(np.ones((1, 3))),
        "rays from one origin, or parallel, expected",
    ),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=[words[:40] for _, words in BAD])
def test_cameras_that_cannot_be_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
