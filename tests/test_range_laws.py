"""Laws of the ray flow: planes rest wherever they are seen from, spheres shrink as they must, silhouettes stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import meshflow
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import CAMERA, depth_scene
from meshflow.synthetic.solids import Ball


def engines(image, variant=None):
    """The flow of a range image on both engines."""
    return meshflow.MeshFlow(image.lifted(Lift()), variant), meshflow.GridFlow(image.gridded(Lift()), variant)


@settings(max_examples=25, deadline=None)
@given(
    tilt=st.floats(0.0, 80.0),
    turn=st.floats(0.0, 360.0),
    focal=st.floats(20.0, 400.0),
    middle=st.tuples(st.floats(-5.0, 30.0), st.floats(-5.0, 30.0)),
    distance=st.floats(0.01, 1000.0),
)
def test_planes_rest_whatever_camera_sees_them_from_wherever(tilt, turn, focal, middle, distance):
    camera, shape = Pinhole(focal, 1.3 * focal, *middle), (24, 26)
    across, turn = np.sin(np.radians(tilt)), np.radians(turn)
    normal = np.array([across * np.cos(turn), across * np.sin(turn), np.cos(np.radians(tilt))])
    slope = camera.rays(shape) @ normal
    depth = np.divide(distance, slope, out=np.full(shape, np.nan), where=slope > 0.02)
    depth[8:11, 9:15] = np.nan
    if np.isfinite(depth).sum() < 20:
        return
    image = RangeImage(depth, camera, jump=None)
    for flow in engines(image):
        *_, end = meshflow.march(flow, meshflow.Until(steps=5))
        start = flow.start()
        moved = np.abs(end.u - start)[start > 0] / start[start > 0]
        assert moved.max() < 1e-12


@pytest.mark.parametrize("gamma", [0.0, -1.0])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 2.0), (0.3, -0.2, 1.5)])
def test_spheres_shrink_by_the_theory_of_the_ray_flow(gamma, centre):
    # B = (2 / R) n, and along the unit ray r the motion is -(B . r) r times the squared footprint (u / f)^2 and
    # (edge indicator)^gamma; the indicator of a surface seen under the angle t is cos t.
    radius, errors = 0.5, []
    for focal in (60.0, 120.0, 240.0):
        size = round(focal * 0.8)
        camera = Pinhole(
            focal,
            focal,
            (size - 1) / 2 - focal * centre[0] / centre[2],
            (size - 1) / 2 - focal * centre[1] / centre[2],
        )
        rays, ball = camera.rays((size, size)), Ball(centre, radius)
        depth = ball.cast(rays)
        depth[~np.isfinite(depth)] = np.nan
        normals = ball.normals(depth[..., None] * rays)
        facing = np.einsum("ijk,ijk->ij", normals, rays)
        cosine = -facing / np.linalg.norm(rays, axis=2)
        expected = -2.0 / radius * facing / (rays**2).sum(axis=2) * (depth / focal) ** 2 * cosine**gamma
        image = RangeImage(depth, camera, jump=None)
        variant = meshflow.Variant(gamma=gamma)
        middle = cosine > 0.8
        error = 0.0
        for flow in engines(image, variant):
            rate = flow.rate(flow.start(), 0)[:, 0].reshape(depth.shape)
            error = max(error, np.abs(rate - expected)[middle].max() / expected[middle].max())
        errors.append(error)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders[-1] > 1.8, f"observed orders {orders}, errors {errors}"
    assert orders[0] > 1.7, f"observed orders {orders}, errors {errors}"
    assert errors[-1] < 2e-3, f"relative errors {errors}"


def test_silhouettes_of_the_analytic_scene_do_not_move():
    scene, sight = depth_scene(), Sight.through(CAMERA, (240, 320))
    image = RangeImage(scene.noisy, CAMERA)
    smoothed = meshflow.smooth(image, time=5.0)
    faces = image.lifted(Lift(diagonals="forward")).triangulations[0]
    used = np.isin(np.arange(scene.noisy.size), faces)
    points = sight.at(smoothed.depth).reshape(-1, 3)
    pixels, _ = sight.pixels(points[used], np.flatnonzero(used))
    row, column = np.divmod(np.flatnonzero(used), 320)
    drift = np.hypot(pixels[:, 0] - column, pixels[:, 1] - row)
    assert drift.max() < 1e-9, f"silhouettes move by {drift.max():.2g} pixels; 0.05 are allowed"
    seen = sight.rendered(np.nan_to_num(points), faces)
    assert np.array_equal(np.isfinite(seen).ravel(), used)
    assert np.abs(seen - smoothed.depth).ravel()[used].max() < 1e-6


def test_pixels_beside_a_silhouette_see_after_the_flow_what_they_saw_before():
    scene = depth_scene()
    smoothed = meshflow.smooth(RangeImage(scene.noisy, CAMERA), time=5.0)
    truth, solid = scene.truth, scene.seen
    wrong = beside = 0
    for one, two in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1),), (slice(1, None),)),
    ):
        step = np.abs(truth[one] - truth[two])
        jump = (solid[one] != solid[two]) & (step > 0.1)  # NaN, nothing behind, is none
        for here in (one, two):
            beside += jump.sum()
            wrong += (jump & (np.abs(smoothed.depth - truth)[here] > step / 2)).sum()
    assert beside > 500
    assert wrong == 0, f"{wrong} of {beside} pixels beside a silhouette see the other side"


@pytest.mark.long
def test_rays_that_nearly_meet_end_by_implicit_steps(tmp_path):
    """An organised cloud whose viewpoint does not see it: explicit steps would be shorter and shorter for hours."""
    rough = np.random.default_rng(0).normal(size=(40, 50)).cumsum(axis=0)
    y, x = np.mgrid[:40, :50].astype(float)
    points = np.stack([x, y, rough], axis=2)
    header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 50\nHEIGHT 40\n"
    lines = "\n".join("{:f} {:f} {:f}".format(*p) for p in points.reshape(-1, 3))
    path = tmp_path / "cloud.pcd"
    path.write_text(f"{header}VIEWPOINT 0 0 -100 1 0 0 0\nPOINTS 2000\nDATA ascii\n{lines}\n")
    found = meshflow.smooth(meshflow.read(path).data, method="quick", time=4.0, result=True)
    assert found.end.time == pytest.approx(4.0)
    assert any("implicit ones were taken" in warning for warning in found.warnings)
