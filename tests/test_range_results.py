"""What a result says of range images: units, samples that cannot move, and words of the command."""

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

import meshflow
from meshflow import Pinhole, RangeImage
from meshflow.cli.commands import app
from meshflow.estimate.constraints import MaxChange
from meshflow.flow.compute import Compute
from meshflow.io.files import read

CAMERA = Pinhole(60.0, 60.0, 23.5, 19.5)
SHAPE = (40, 48)
DEPTH = 2.0 + 0.01 * np.arange(48) + 0.01 * np.random.default_rng(3).normal(size=SHAPE)


def test_depths_of_a_file_are_metres_and_the_result_says_so(tmp_path):
    np.save(tmp_path / "a.npy", DEPTH)
    with rasterio.open(tmp_path / "a.png", "w", driver="PNG", height=40, width=48, count=1, dtype="uint16") as out:
        out.write(np.rint(1000 * DEPTH).astype(np.uint16), 1)
    for name in ("a.npy", "a.png"):
        data = read(tmp_path / name, camera=CAMERA).data
        assert data.unit == "m"
        result = meshflow.smooth(data, constraints=MaxChange(0.02), result=True)
        units = {key: result.parameters[key].unit for key in ("noise", "quantum", "max_change", "time")}
        assert units == {"noise": "m", "quantum": "m", "max_change": "m", "time": "pixels²"}
        assert result.data.unit == "m"
        assert " m of noise 0.0" in result.summary
        assert " m, largest " in str(result)
    chosen = meshflow.smooth(data, result=True).parameters
    assert {chosen[key].unit for key in ("noise", "quantum", "risk")} == {"m"}
    assert chosen["noise"].value == pytest.approx(0.01, rel=0.15)
    assert meshflow.smooth(data, compute=Compute(search=True), result=True).parameters["risk"].unit == "m"
    assert meshflow.smooth(DEPTH, camera=CAMERA, result=True).parameters["noise"].unit == ""  # nobody has said which


def test_in_inverse_depth_what_is_reported_is_in_depths_whether_the_domain_is_written_out_or_not():
    image = RangeImage(DEPTH, CAMERA, unit="m")
    limit = MaxChange(0.005)
    written, chosen = (
        meshflow.smooth(image, constraints=limit, result=True, **words) for words in ({"domain": "disparity"}, {})
    )
    for result in (written, chosen):
        assert {result.parameters[name].unit for name in ("noise", "quantum", "risk", "max_change")} == {"m"}
        assert result.parameters["max_change"].value == 0.005
        assert result.parameters["noise"].value == result.noise.sigma == pytest.approx(0.01, rel=0.15)
        assert result.summary.endswith(f"m of noise {result.noise.sigma:.4g} m")
        assert result.candidates[0].risk == pytest.approx(result.parameters["risk"].value)
        assert 0.1 * 0.01 < result.parameters["risk"].value < 0.01
    assert [written.parameters["domain"].origin, chosen.parameters["domain"].origin] == ["given", "default"]
    others = [{k: v for k, v in one.parameters.items() if k != "domain"} for one in (written, chosen)]
    assert others[0] == others[1]
    np.testing.assert_array_equal(written.data.depth, chosen.data.depth)
    named = meshflow.smooth(image, method="beltrami", domain="disparity", result=True)
    assert named.parameters["contrast"].unit == "pixels per 1/m"


def test_a_given_noise_is_one_of_depths_whether_the_domain_is_written_out_or_not():
    image = RangeImage(DEPTH, CAMERA)
    written, chosen = (
        meshflow.smooth(image, noise=0.005, result=True, **words) for words in ({"domain": "disparity"}, {})
    )
    np.testing.assert_array_equal(written.data.depth, chosen.data.depth)
    assert written.noise.sigma == written.parameters["noise"].value == chosen.parameters["noise"].value == 0.005
    assert written.parameters["noise"].origin == "given"
    assert np.std(written.removed) < np.std(meshflow.smooth(image, noise=0.02, result=True).removed)
    (said,) = meshflow.smooth(image, noise=5.0, domain="disparity", result=True).warnings
    assert "noise 5: more than the largest difference of the values" in said


def test_a_given_noise_of_each_pixel_counts_in_inverse_depth_too():
    sigma = 0.004 * DEPTH**2
    found, other = (
        meshflow.smooth(RangeImage(DEPTH, CAMERA, sigma=s), domain="disparity", result=True) for s in (sigma, 2 * sigma)
    )
    assert found.parameters["noise"].value == pytest.approx(np.median(sigma))
    assert found.parameters["noise"].origin == "given"
    assert np.std(found.removed) < np.std(other.removed)


def test_the_noise_that_is_left_is_what_the_flow_leaves_of_white_noise():
    truth = np.full((120, 160), 2.0)
    noisy = truth + 0.004 * np.random.default_rng(1).normal(size=truth.shape)
    result = meshflow.smooth(RangeImage(noisy, Pinhole(200.0, 200.0, 79.5, 59.5)), time=5.0, result=True)
    inner = np.s_[10:-10, 10:-10]
    assert result.left == pytest.approx(np.std((result.data.depth - truth)[inner]), rel=0.15)


def test_samples_without_a_triangle_are_counted_where_they_are_more_than_a_few():
    depth = DEPTH.copy()
    depth[1:-1:4, 1:-1:4] += 1.0  # each of these alone
    alone = depth[1:-1:4, 1:-1:4].size
    result = meshflow.smooth(RangeImage(depth, CAMERA), result=True)
    (words,) = result.warnings
    assert words.startswith(f"{alone} of {depth.size} samples have no triangle, cut off by discontinuities")
    np.testing.assert_array_equal(result.data.depth[1:-1:4, 1:-1:4], depth[1:-1:4, 1:-1:4])
    depth = DEPTH.copy()
    depth[1:9:4, 1:9:4] += 1.0
    assert meshflow.smooth(RangeImage(depth, CAMERA), result=True).warnings == ()


def test_a_depth_picture_beside_its_result_asks_for_the_camera(tmp_path):
    (tmp_path / "camera.json").write_text('{"fx": 60, "fy": 60, "cx": 23.5, "cy": 19.5}')
    with rasterio.open(tmp_path / "a.png", "w", driver="PNG", height=40, width=48, count=1, dtype="uint16") as out:
        out.write(np.rint(1000 * DEPTH).astype(np.uint16), 1)
    a, b, camera = (str(tmp_path / name) for name in ("a.png", "b.tif", "camera.json"))
    assert CliRunner().invoke(app, ["smooth", a, b, "--camera", camera, "-q"]).exit_code == 0
    refused = CliRunner().invoke(app, ["compare", a, b])
    assert "got image and terrain; give --camera if they are depth images" in str(refused.exception)
    assert CliRunner().invoke(app, ["compare", a, b, "--camera", camera]).exit_code == 0


def test_a_picture_of_sixteen_bit_says_what_rounding_costs_beside_the_noise_that_is_left(tmp_path):
    (tmp_path / "camera.json").write_text('{"fx": 60, "fy": 60, "cx": 23.5, "cy": 19.5}')
    np.save(tmp_path / "a.npy", 1.0 + 0.1 * (DEPTH - DEPTH.min()))
    words = ["smooth", str(tmp_path / "a.npy"), str(tmp_path / "b.png"), "--camera", str(tmp_path / "camera.json")]
    reported = CliRunner().invoke(app, words)
    assert reported.exit_code == 0, reported.exception
    assert "rounding to 1 mm errs by 0.29 mm (rms): the" in reported.output
    np.save(tmp_path / "c.npy", DEPTH)
    words[1:3] = str(tmp_path / "c.npy"), str(tmp_path / "d.png")
    assert "noise that is left" not in CliRunner().invoke(app, words).output
