"""What a run has to say reaches its caller: as a warning at his line, in the Result, or once in the command."""

import inspect
import warnings

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import meshflow
from meshflow import MeshflowWarning
from meshflow.cli.commands import app

RANDOM = np.random.default_rng(14)
Z = np.sin(np.arange(48) / 5.0) + np.arange(40)[:, None] / 9.0 + RANDOM.normal(0, 0.05, (40, 48))
UNDECLARED = np.where((np.arange(48) > 20) & (np.arange(48) < 27) & (np.arange(40)[:, None] < 9), -9999.0, Z)
# Colours with noise, and an alpha without; a surface as rough as noise.
TRANSPARENT = np.clip(128 + 12 * np.random.default_rng(5).normal(size=(48, 64, 4)), 0, 255).round()
TRANSPARENT[..., 3] = np.add.outer(np.arange(48), np.arange(64))
_STEPS = np.hypot(np.fft.fftfreq(128)[:, None], np.fft.rfftfreq(128)) + 1e-9
ROUGH = np.fft.irfft2(np.fft.rfft2(np.random.default_rng(6).normal(size=(128, 128))) * _STEPS**-1.6, s=(128, 128))


def ball():
    mesh = trimesh.creation.icosphere(3)
    mesh.vertices += np.random.default_rng(3).normal(0, 0.01, mesh.vertices.shape)
    return mesh


def warned(call):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        call()
    return [one for one in found if issubclass(one.category, MeshflowWarning)]


CASES = [
    (lambda **how: meshflow.smooth(UNDECLARED, **how), "-9999"),
    (lambda **how: meshflow.smooth(ball(), time=1e9, **how), "vanished"),
    (lambda **how: meshflow.smooth(ball(), time=0.1, **how), "of its area; a smaller time"),
    (lambda **how: meshflow.smooth(ball(), method="graph", **how), "no effect where points move"),
    (lambda **how: meshflow.smooth(TRANSPARENT, **how), "if it is alpha"),
    (lambda **how: meshflow.smooth(ROUGH, **how), "the estimate of the noise is uncertain: two estimates differ"),
]


@pytest.mark.long
@pytest.mark.parametrize(("call", "word"), CASES)
def test_each_warning_of_a_result_is_issued_where_no_result_is_returned(call, word):
    result = []
    assert not warned(lambda: result.append(call(result=True)))
    found = warned(call)
    assert {str(one.message) for one in found} >= {next(w for w in result[0].warnings if word in w)}
    assert len(found) == len(result[0].warnings)


def test_a_warning_names_the_line_of_the_caller_and_none_of_ours():
    here = inspect.currentframe().f_lineno + 1
    [one] = warned(lambda: meshflow.smooth(UNDECLARED))
    assert (one.filename, one.lineno) == (__file__, here)


def test_an_accessor_is_not_the_caller():
    xarray = pytest.importorskip("xarray")
    import meshflow.accessors  # noqa: F401

    [one] = warned(lambda: xarray.DataArray(UNDECLARED, {"y": np.arange(40), "x": np.arange(48)}).meshflow.smooth())
    assert one.filename == __file__


def test_a_warning_of_a_part_begins_with_its_name():
    scene = trimesh.Scene()
    scene.add_geometry(ball(), geom_name="left")
    scene.add_geometry(ball(), geom_name="right")
    found = [str(one.message) for one in warned(lambda: meshflow.smooth(scene, time=1e9))]
    assert [word.partition(":")[0] for word in found] == ["left", "right"]


def test_fused_frames_warn_like_one():
    frames = [RANDOM.normal(2, 0.01, (24, 32)) for _ in range(3)] + [np.full((24, 32), np.nan)]
    camera = meshflow.Pinhole(40, 40, 16, 12)
    found = [str(one.message) for one in warned(lambda: meshflow.fuse(frames, camera=camera))]
    assert any("without a single depth" in word for word in found)


CAMERA = meshflow.Pinhole(60, 60, 24, 20)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: meshflow.smooth((2 + Z / 50) * 1000, camera=CAMERA), "give depth_scale"),
        (lambda: meshflow.smooth(Z, noise=1e6), "noise 1e.06: more than the largest difference of the values"),
        (lambda: meshflow.smooth(Z, noise=1.0, strength=1e6), "more than the largest difference of the values"),
        (lambda: meshflow.smooth(ball(), noise=5.0), "more than the largest difference of the values"),
    ],
)
def test_what_can_hardly_be_meant_is_warned_of(call, words):
    with pytest.warns(MeshflowWarning, match=words):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: meshflow.smooth(np.dstack([Z, Z, Z])),
        lambda: meshflow.smooth((2 + Z / 50) * 1000, camera=CAMERA, unit="mm"),
        lambda: meshflow.smooth(Z, noise=1.0),
        lambda: meshflow.smooth((2 + Z / 50) * 1000, camera=CAMERA, depth_scale=1000),
    ],
)
def test_what_can_be_meant_is_not_warned_of(call):
    assert not warned(call)


def test_what_says_nothing_in_a_result_says_nothing_at_all():
    assert not warned(lambda: meshflow.smooth(Z))


def test_the_command_says_each_warning_once(tmp_path):
    ball().export(tmp_path / "a.ply")
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        done = CliRunner().invoke(app, ["smooth", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "--time", "0.1"])
    assert done.exit_code == 0, done.output
    assert done.output.count("of its area") == 1
    assert not [one for one in found if issubclass(one.category, MeshflowWarning)]


def test_a_noise_beyond_all_measure_is_doubted_and_still_gives_numbers():
    for noise in (1e3, 1e12):
        found = []
        (one, *_) = warned(lambda noise=noise, found=found: found.append(meshflow.smooth(Z, noise=noise)))
        assert "more than the largest difference of the values" in str(one.message)
        assert np.isfinite(found[0]).all()


def test_notes_that_need_no_attention_are_no_warnings(tmp_path, recwarn):
    box = trimesh.creation.box()
    box = trimesh.Trimesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    assert meshflow.smooth(box, result=True).warnings == ()
    meshflow.smooth(box)
    box.export(tmp_path / "a.stl")
    document = meshflow.read(tmp_path / "a.stl")
    assert len(document.notes) == 1, "one note says how corners became vertices"
    assert "36 corners at bit-identical positions are 8 vertices" in document.notes[0]
    meshflow.smooth(document)
    assert not [one for one in recwarn if one.category is MeshflowWarning]


def test_what_is_changed_where_nothing_is_smoothed_is_said():
    y, x = np.mgrid[:64, :64]
    z = (0.01 * (x - 20.0) ** 2 + 0.02 * y).astype(np.float32)
    holed = z.copy()
    holed[5, [7, 30, 44]] += 500
    result = meshflow.smooth(holed, outliers="repair", result=True)
    assert (
        result.stopped_because
        == "3 outliers were replaced; no noise was found: nothing to remove, nothing else was changed"
    )
    assert np.count_nonzero(result.data != holed) == 3
    levelled = meshflow.smooth(z + (np.arange(64) % 3)[:, None].astype(np.float32), level="rows", result=True)
    assert levelled.stopped_because.startswith("the lines were levelled; ")
    picture = np.repeat(np.clip((2.0 * x + y) / 3, 0, 255)[..., None], 3, axis=2)
    picture[5, [7, 30, 44]] = 255
    result = meshflow.smooth(picture, result=True)
    assert np.array_equal(result.data, picture)
    assert "replaced from" not in " ".join(result.warnings), "nothing was replaced"
    result = meshflow.smooth(z, method="beltrami", time=1.0, result=True)
    assert "nothing was changed" not in " ".join(result.warnings)


def test_a_strength_that_leaves_nothing_is_said():
    noisy = np.random.default_rng(1).normal(size=(48, 48)) + 0.1 * np.arange(48)
    with pytest.warns(MeshflowWarning, match=r"strength 1e\+09 times noise 1.*all that varies counts as noise"):
        meshflow.smooth(noisy, strength=1e9)
    assert meshflow.smooth(noisy, strength=2.0, result=True).warnings == ()
