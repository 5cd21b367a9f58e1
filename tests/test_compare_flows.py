"""Four flows on one range image: matched in roughness, measured alike, and the ray flow where it must be exact."""

import json

import matplotlib.image as plt
import numpy as np
import pytest
from typer.testing import CliRunner

from meshflow.cli.commands import app
from meshflow.errors import InputError
from meshflow.evaluate import compare_flows
from meshflow.evaluate.flows import FLOWS
from meshflow.evaluate.outcome import Bends
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import SCENE
from meshflow.synthetic.sensors import StructuredLight, TimeOfFlight, observe
from meshflow.synthetic.solids import Panel
from meshflow.view.panels import flows

CAMERA, SHAPE = Pinhole(90.0, 90.0, 47.5, 35.5), (72, 96)
SIGHT = Sight.through(CAMERA, SHAPE)


@pytest.fixture(scope="module")
def frame():
    return observe(SCENE, SIGHT, StructuredLight(seed=1))


@pytest.fixture(scope="module")
def compared(frame):
    return compare_flows(frame.depth, CAMERA, frame.truth)


def test_all_four_are_stopped_at_the_same_roughness(compared):
    assert list(compared.after) == list(FLOWS)
    assert compared.roughness < 0.3 * compared.before.roughness
    for outcome in compared.after.values():
        assert outcome.matched
        assert outcome.roughness == pytest.approx(compared.roughness, rel=2e-3)


def test_the_ray_flow_alone_leaves_silhouettes_and_holes_exactly_where_they_were(compared):
    rays = compared.after["rays"]
    assert rays.drift_max < 1e-9
    assert (rays.lost, rays.gained) == (0, 0)
    for name in ("space", "normals", "z"):
        assert compared.after[name].drift_rms > 0.05
        assert compared.after[name].lost > 0


def test_the_ray_flow_seen_from_the_camera_is_the_depth_along_its_rays(compared):
    rays, start = compared.after["rays"], compared.start
    assert np.array_equal(np.isfinite(rays.depth), start.used)
    points = SIGHT.at(rays.depth)[start.used]
    assert np.abs(points - rays.points.reshape(*SHAPE, 3)[start.used]).max() < 1e-9


def test_the_flow_of_z_moves_no_point_aside_and_the_flow_along_rays_none_off_its_ray(compared):
    start = compared.start.points
    assert np.array_equal(compared.after["z"].points[:, :2], start[:, :2])
    moved = compared.after["rays"].points
    assert np.abs(np.cross(moved, SIGHT.directions.reshape(-1, 3))).max() < 1e-12
    assert np.abs(compared.after["space"].points - start)[:, :2].max() > 1e-3


def test_every_flow_comes_nearer_to_the_truth(compared):
    before = compared.before
    for outcome in compared.after.values():
        assert outcome.depth_median < 0.6 * before.depth_median
        assert outcome.distance_median < 0.6 * before.distance_median
        assert outcome.normal_error < 0.3 * before.normal_error
        assert outcome.area < before.area == 1.0


def test_a_plane_without_noise_rests_in_all_four():
    depth = observe((Panel((0.5, 0.2, np.sqrt(0.71)), 1.5),), SIGHT, TimeOfFlight(0.0, 0.0, flying=0.0)).depth
    depth[30:36, 40:50] = np.nan
    flat = compare_flows(depth, CAMERA, time=1.0)
    for outcome in flat.after.values():
        there = flat.start.used.ravel()
        assert np.abs(outcome.points - flat.start.points)[there].max() < 1e-9
        assert outcome.depth_median is None
        assert outcome.area == pytest.approx(1.0)


def test_the_roughness_of_a_roof_is_the_angle_of_its_ridge_over_all_inner_edges():
    rows, columns = np.mgrid[0:5, 0:5]
    height = np.abs(columns - 2.0)
    points = np.stack([columns, rows, height], axis=-1).reshape(-1, 3)
    first = (rows * 5 + columns)[:-1, :-1].ravel()
    faces = np.concatenate([first[:, None] + (0, 5, 1), first[:, None] + (6, 1, 5)])
    bends = Bends(faces)
    ridge = [pair for pair in bends.pairs if np.ptp(points[faces[pair]].reshape(-1, 3)[:, 0]) == 2]
    ends = [set(faces[a]) & set(faces[b]) for a, b in ridge]
    on_ridge = sum(all(points[v][0] == 2 for v in pair) for pair in ends)
    assert bends.roughness(points) == pytest.approx(90.0 * on_ridge / len(bends.pairs))


def test_numbers_are_json_and_the_table_has_a_column_for_each_flow(compared):
    words = json.loads(json.dumps(compared.as_dict()))
    assert words["flows"]["rays"]["lost"] == 0
    assert words["roughness"] == compared.roughness
    assert "points" not in words["before"]
    lines = str(compared).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[0].split() == ["before", "3D", "3D,", "normals", "z", "graph", "rays"]


def test_without_truth_there_are_drift_area_and_roughness_alone(frame):
    found = compare_flows(frame.depth, CAMERA, time=1.0)
    assert found.truth is None
    assert found.after["space"].depth_rms is None
    assert found.after["space"].drift_rms > 0
    assert "error" not in str(found)
    assert [panel.label for panel in found.panels()] == ["before", *FLOWS.values()]


def test_a_flow_that_does_not_come_to_the_roughness_says_so(frame, monkeypatch):
    monkeypatch.setattr("meshflow.evaluate.flows.PATIENCE", 0.1)
    found = compare_flows(frame.depth, CAMERA, time=2.0)
    assert not found.after["z"].matched
    assert "z graph (rougher)" in str(found)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"truth": np.ones((3, 4))}, r"truth: the shape of the image, \(72, 96\), expected, got \(3, 4\)"),
        ({"time": 0.0}, "time: a positive finite number of squared pixel footprints expected, got 0.0"),
        ({"dt": -1.0}, "dt: a positive finite number"),
        ({"depth": np.ones((3, 3))}, "no two triangles meet away from the rim; a larger image, or a larger jump"),
    ],
)
def test_what_cannot_be_compared_is_refused(frame, given, words):
    with pytest.raises(InputError, match=words):
        compare_flows(**{"depth": frame.depth, "camera": CAMERA, **given})


def test_a_truth_that_is_nowhere_where_the_image_is_is_refused(frame):
    truth = np.where(np.isfinite(frame.depth), np.nan, 1.0)
    with pytest.raises(InputError, match="no pixel has a truth, and a surface before and after each flow"):
        compare_flows(frame.depth, CAMERA, truth, time=0.25)


@pytest.fixture
def files(tmp_path, frame):
    np.save(tmp_path / "depth.npy", np.nan_to_num(frame.depth))
    np.save(tmp_path / "truth.npy", frame.truth)
    camera = {"fx": CAMERA.fx, "fy": CAMERA.fy, "cx": CAMERA.cx, "cy": CAMERA.cy}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    return tmp_path


def command(files, *words):
    given = ["compare-flows", str(files / "depth.npy"), *map(str, words)]
    return CliRunner().invoke(app, given, env={"COLUMNS": "200"})


@pytest.mark.long
def test_the_command_prints_what_the_library_measures_and_draws_it(files, compared):
    camera = ("--camera", files / "camera.json")
    done = command(files, *camera, "--truth", files / "truth.npy", "--json", "--picture", files / "flows.png")
    assert done.exit_code == 0, done.output
    words = json.loads(done.stdout)
    rays = compared.after["rays"]
    assert words["flows"]["rays"]["depth_rms"] == pytest.approx(rays.depth_rms, rel=1e-3)
    assert words["flows"]["space"]["drift_rms"] == pytest.approx(compared.after["space"].drift_rms, rel=1e-2)
    picture = plt.imread(files / "flows.png")
    assert picture.shape[1] == 1600
    assert picture[..., :3].std() > 0.1


def test_the_command_prints_a_table(files):
    done = command(files, "--camera", files / "camera.json", "--time", "0.5")
    assert done.exit_code == 0, done.output
    assert "silhouette drift, max [px]" in done.stdout
    assert "normals off by" not in done.stdout


def test_the_command_refuses_what_it_cannot_compare_or_write_before_it_works(files):
    with pytest.raises(InputError, match="rays are those of a camera; give --camera"):
        raise command(files).exception
    (files / "there.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"there.png exists; name another file, or overwrite it on purpose"):
        raise command(files, "--camera", files / "camera.json", "--picture", files / "there.png").exception


def test_a_picture_of_nothing_is_refused(tmp_path):
    with pytest.raises(InputError, match="panels with at least one triangle each expected"):
        flows([], tmp_path / "none.png")
