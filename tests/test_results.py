"""What is said of a run is what was done. meshflow.results.result, meshflow.estimate.points, meshflow.cli.options."""

import numpy as np
import pytest
from helpers import command
from helpers.parts import parts
from helpers.shapes import along_normals, sphere
from PIL import Image as Picture

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.evaluate.metrics import compare
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Fairing, Search
from meshflow.geometry.normals import normals_at
from meshflow.smoothing import smooth
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view.findings import found

BALL, FACES = sphere(400)
NOISY = along_normals(BALL, FACES, 0.2)


def test_what_was_removed_of_points_is_one_number_wherever_it_is_said():
    result = smooth(
        (NOISY, FACES), method=Fairing(order=2, weights="uniform"), compute=Compute(search=False), result=True
    )
    along = np.einsum("ij,ij->i", NOISY - result.after.points, normals_at(NOISY, FACES))
    rms = float(np.sqrt(np.mean(along**2)))
    assert np.sqrt(np.mean(np.sum(result.removed**2, axis=1))) > 1.05 * rms  # what slides is not counted
    assert result.removed.shape == NOISY.shape
    assert np.allclose(result.counted, along)
    assert f"removed along the normals rms {rms:.4g} of noise" in result.summary
    assert f"removed      along the normals rms {rms:.6g}" in str(result)
    assert result.to_dict()["removed"]["rms"] == pytest.approx(rms)
    reported = compare(result.before, result.after).words()
    assert reported["rms along the normals"] == pytest.approx(rms)
    assert reported["rms difference"] > 1.05 * rms
    facts = dict(found(result, "").facts)
    assert facts["removed"].startswith(f"rms {rms:.4g}, largest")
    assert facts["removed"].endswith("along the normals")


def test_what_channels_lost_is_counted_by_channel():
    data = Mesh(BALL, FACES, channels=np.random.default_rng(0).normal(size=(400, 2)))
    result = smooth(data, time=0.01, compute=Compute(search=False), result=True)
    assert np.array_equal(result.counted, result.removed)
    assert "; removed rms" in result.summary
    assert "rms along the normals" not in compare(result.before, result.after).words()


def test_a_summary_names_what_had_an_effect():
    result = smooth((NOISY, FACES), time=0.01, result=True)
    for name in ("gamma", "sharpness", "patch", "contrast", "indicator"):
        assert name not in result.parameters
    assert "method curvature; removed" in result.summary
    depth = 2 + 0.01 * np.random.default_rng(1).normal(size=(20, 20))
    summary = smooth(RangeImage(depth, Pinhole(50, 50, 10, 10)), result=True).summary
    assert "gamma" in summary
    assert not any(word in summary for word in ("sharpness", "patch", "contrast"))
    both = smooth((NOISY, FACES), time=0.01, channels=BALL, moves="all", result=True)
    assert "contrast" in both.parameters


@pytest.mark.parametrize("options", [{"contrast": 2.0}, {"twicing": 0.5}, {"indicator": "projection"}])
def test_options_without_effect_on_points_are_told_and_choose_no_other_method(options):
    plain = smooth((NOISY, FACES), result=True)
    reported = smooth((NOISY, FACES), method=Search(**options), result=True)
    assert np.array_equal(reported.after.points, plain.after.points)
    assert f"{next(iter(options))}: no effect where points move" in reported.warnings


@pytest.mark.parametrize(
    "words", [{"method": "graph"}, {"gamma": -1.0}, {"sharpness": 2.0}, {"method": "mean-curvature"}]
)
def test_variants_of_grids_say_that_they_have_no_effect_on_points(words):
    result = smooth((NOISY, FACES), **parts(time=0.01, **words), result=True)
    plain = smooth((NOISY, FACES), time=0.01, result=True)
    (warning,) = [warning for warning in result.warnings if "no effect where points move" in warning]
    assert words.get("method", "beltrami") in warning  # exponents are those of beltrami
    assert np.array_equal(result.after.points, plain.after.points)
    assert not plain.warnings


def test_a_method_that_takes_the_shape_with_the_noise_is_a_warning():
    ball = meshflow.synthetic.sphere(2)
    points, faces = ball.points, ball.faces
    noisy = points + 0.02 * np.random.default_rng(0).normal(size=points.shape)
    for word in ("quick", "curvature"):
        result = smooth((noisy, faces), method=word, result=True)
        assert any("times the noise was removed" in warning for warning in result.warnings)
    assert not any("times" in warning for warning in smooth((noisy, faces), result=True).warnings)


@pytest.mark.parametrize("word", ["heat", "perona-malik", "rof", "min-max", "total-variation", "paper"])
def test_methods_of_values_are_refused_where_points_move(word):
    with pytest.raises(
        InputError, match=f"method='{word}': only for heights, images and channels.*; methods for this data are search"
    ):
        smooth((NOISY, FACES), method=word)


def test_an_unknown_method_is_refused_in_one_line(tmp_path):
    np.save(tmp_path / "z.npy", np.eye(8))
    done = command.run("smooth", tmp_path / "z.npy", tmp_path / "o.npy", "--method", "nonsense")
    assert done.returncode != 0
    assert done.stderr.startswith("meshflow: nonsense: no such method; there are search, quick, beltrami, ")
    assert done.stderr.endswith(", normal-channels\n")
    assert done.stderr.count("\n") == 1


def test_a_file_without_a_vertex_is_not_called_a_cloud(tmp_path):
    path = tmp_path / "empty.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
    path.write_text(head + "element face 0\nproperty list uchar int vertex_indices\nend_header\n")
    with pytest.raises(FormatError, match="got none, not even a vertex"):
        meshflow.read(path)


def test_grey_of_sixteen_bit_may_be_depths_and_is_told_so(tmp_path):
    values = np.random.default_rng(0).integers(500, 4000, (16, 16)).astype(np.uint16)
    Picture.fromarray(values).save(tmp_path / "d.png")
    Picture.fromarray((values // 256).astype(np.uint8)).save(tmp_path / "p.png")
    assert any("if these are depths, name their camera" in note for note in meshflow.read(tmp_path / "d.png").notes)
    assert not meshflow.read(tmp_path / "p.png").notes
    assert not meshflow.read(tmp_path / "d.png", kind="image").notes
