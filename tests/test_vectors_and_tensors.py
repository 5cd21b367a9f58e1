"""Vectors and symmetric tensors come back as they came, in any frame, and what is positive definite stays so."""

import nibabel
import nrrd
import numpy as np
import pytest
from helpers.command import run

import meshflow
from meshflow import Compute, Heat, InputError, Tensors, Vectors
from meshflow.geometry.symmetric import exponential, held_definite, logarithm, packed, unpacked
from meshflow.geometry.whitening import whitening
from meshflow.view import vectors

DRAW = np.random.default_rng(0)
SAMPLES = DRAW.normal(size=(18, 20, 3, 6)) * np.array([2.0, 1.0, 0.3])[:, None]
COVARIANCE = SAMPLES @ np.swapaxes(SAMPLES, 2, 3) / 6  # far apart, and some of them nearly singular
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
HEAT = {"method": Heat(twicing=0), "time": 2.0}
# As it would be: by search, with twicing, with patches, with much sharpness.
WAYS = [
    {},
    {"method": "beltrami"},
    {"method": "heat", "strength": 3.0},
    {"method": "patches"},
    {"method": Heat(twicing=1), "time": 3.0},
]


def smallest(tensors):
    return np.linalg.eigvalsh(tensors).min()


@pytest.mark.parametrize("d", [2, 3])
def test_components_keep_distances_and_come_back(d):
    tensors = COVARIANCE[..., :d, :d]
    components = packed(tensors)
    assert np.abs(unpacked(components) - tensors).max() < 1e-12
    apart, norm = components[0, 0] - components[1, 1], tensors[0, 0] - tensors[1, 1]
    assert np.linalg.norm(apart) == pytest.approx(np.linalg.norm(norm))
    assert np.abs(exponential(logarithm(tensors)) - tensors).max() < 1e-10


@pytest.mark.parametrize("metric", ["euclidean", "noise", "log-euclidean"])
def test_matrices_and_components_give_the_same_result(metric):
    whole = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **HEAT).values
    components = meshflow.smooth(Tensors(packed(COVARIANCE), metric=metric), **HEAT).values
    assert np.abs(packed(whole) - components).max() < 1e-12
    assert whole.shape == COVARIANCE.shape


@pytest.mark.parametrize("metric", ["euclidean", "noise", "log-euclidean"])
def test_the_frame_of_the_tensors_makes_no_difference(metric):
    beltrami = {"method": meshflow.Beltrami(contrast=1.0, twicing=0, second_stage=False), "time": 1.0}
    straight = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **beltrami).values
    turned = meshflow.smooth(Tensors(TURN @ COVARIANCE @ TURN.T, metric=metric), **beltrami).values
    assert np.abs(turned - TURN @ straight @ TURN.T).max() < 1e-9


@pytest.mark.parametrize("way", WAYS, ids=str)
@pytest.mark.parametrize("metric", ["euclidean", "noise", "log-euclidean"])
def test_no_result_is_not_positive_definite(metric, way):
    result = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **way).values
    assert smallest(result) > 0
    if metric != "log-euclidean":
        assert smallest(result) >= smallest(COVARIANCE) * (1 - 1e-6)


@pytest.mark.parametrize("stepper", ["explicit", "semi-implicit"])
def test_a_mean_keeps_the_smallest_eigenvalue_by_itself(stepper):
    compute = Compute(stepper=stepper)
    after = unpacked(meshflow.smooth(packed(COVARIANCE), kind="image", boundary="neumann", compute=compute, **HEAT))
    assert smallest(after) >= smallest(COVARIANCE)


def test_tensors_that_would_leave_the_cone_make_the_largest_part_of_their_change_that_does_not():
    before, after = np.eye(2)[None], np.diag([1.0, -1.0])[None]
    held, count = held_definite(before, after, 0.5)
    assert count == 1
    assert held[0] == pytest.approx(np.diag([1.0, 0.5]), abs=1e-8)
    same, count = held_definite(before, np.diag([2.0, 0.6])[None], 0.5)
    assert count == 0
    assert np.array_equal(same, np.diag([2.0, 0.6])[None])


def test_tensors_that_are_not_definite_by_nature_are_left_so_unless_told():
    stress = COVARIANCE - 1.5 * np.eye(3)
    assert smallest(meshflow.smooth(Tensors(stress), **HEAT).values) < 0
    noisy = COVARIANCE + 0.2 * packed_noise()
    assert smallest(noisy) < 0
    assert smallest(meshflow.smooth(Tensors(noisy, definite=True), **HEAT).values) > 0


def packed_noise():
    return unpacked(np.random.default_rng(2).normal(size=(18, 20, 6)))


def test_missing_tensors_and_vectors_come_back_as_they_came():
    holes = COVARIANCE.astype(np.float32)
    holes[3, 4, 0, 1] = np.nan
    for metric in ("euclidean", "noise", "log-euclidean"):
        after = meshflow.smooth(Tensors(holes, metric=metric), **HEAT)
        assert np.array_equal(after.values[3, 4], holes[3, 4], equal_nan=True)
        assert np.isfinite(np.delete(after.values.reshape(-1, 9), 3 * 20 + 4, axis=0)).all()
        assert after.values.dtype == np.float32
    field = np.ones((9, 9, 2))
    field[2, 2, 1] = np.nan
    for smoothed in ("whole", "direction-and-magnitude"):
        after = meshflow.smooth(Vectors(field, smoothed=smoothed), **HEAT)
        assert np.array_equal(after.values[2, 2], field[2, 2], equal_nan=True)


def test_noise_that_is_unequal_and_correlated_is_made_white_beside_edges_and_slopes():
    draw = np.random.default_rng(3)
    root = np.diag([3.0, 1.5, 1.0, 1.0, 0.7, 0.5]) @ np.linalg.qr(draw.normal(size=(6, 6)))[0]
    y, x = np.indices((60, 60))
    noise = draw.normal(size=(60, 60, 6)) @ root
    values = noise + 0.5 * x[..., None] + 40.0 * np.where(x > y, 1.0, 0.0)[..., None] * draw.normal(size=6)
    white = noise @ whitening(values, np.zeros((60, 60), bool))
    variances = np.linalg.eigvalsh(np.cov(white.reshape(-1, 6).T))
    assert variances == pytest.approx(np.full(6, np.mean(np.square(noise))), rel=0.15)
    assert np.array_equal(whitening(np.ones((5, 5, 3)), np.zeros((5, 5), bool)), np.eye(3))


def test_the_metric_of_noise_keeps_an_edge_that_little_noise_shows():
    # An edge in a component of little noise, which is hidden in the norm by another one of much noise.
    draw = np.random.default_rng(4)
    truth = np.zeros((40, 40, 3))
    truth[:, 20:, 2] = 1.0
    noisy = truth + draw.normal(size=truth.shape) * [2.0, 0.2, 0.2]
    error = [np.std(meshflow.smooth(Tensors(noisy, metric=m), method="quick").values - truth, axis=(0, 1))[2]
             for m in ("euclidean", "noise")]  # fmt: skip
    assert error[1] < 0.6 * error[0], f"{error}"


# Vectors


def bend(speed=3.0, n=32):
    angle = np.linspace(0, np.pi / 2, n)
    return speed * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None] * np.ones((n, 1, 1))


def test_the_frame_of_the_vectors_makes_no_difference():
    noisy = bend() + 0.3 * np.random.default_rng(3).normal(size=(32, 32, 2))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    beltrami = {"method": meshflow.Beltrami(contrast=2.0, twicing=0, second_stage=False), "time": 2.0}
    straight = meshflow.smooth(Vectors(noisy), **beltrami).values
    turned = meshflow.smooth(Vectors(noisy @ turn.T), **beltrami).values
    assert np.abs(turned - straight @ turn.T).max() < 1e-9


def test_apart_a_stream_keeps_its_speed_around_a_bend_and_as_a_whole_it_slows_down():
    much = {"method": Heat(twicing=0), "time": 40.0}
    whole = meshflow.smooth(Vectors(bend()), **much)
    apart = meshflow.smooth(Vectors(bend(), smoothed="direction-and-magnitude"), **much)
    assert whole.magnitude[:, 12:20].max() < 0.95 * 3.0
    assert np.abs(apart.magnitude - 3.0).max() < 1e-6
    cosine = np.einsum("ijk,ijk->ij", apart.values, whole.values) / 3.0 / whole.magnitude
    assert cosine.min() == pytest.approx(1.0)


def test_apart_there_is_a_result_for_each_with_its_unit():
    noisy = bend() + 0.3 * np.random.default_rng(4).normal(size=(32, 32, 2))
    found = meshflow.smooth(Vectors(noisy, unit="m/s", smoothed="direction-and-magnitude"), result=True)
    assert list(found) == ["direction", "magnitude"]
    assert found["magnitude"].parameters["noise"].unit == "m/s"
    assert np.std(found.data.values - bend()) < 0.5 * 0.3


@pytest.mark.parametrize("drawn", ["arrows", "streamlines"])
def test_vectors_are_drawn_before_and_after(tmp_path, drawn):
    field = Vectors(bend(n=20), unit="m/s")
    assert vectors(field, field, tmp_path / "v.png", drawn=drawn).stat().st_size > 5000
    with pytest.raises(InputError, match="exists|there"):
        vectors(field, field, tmp_path / "v.png", drawn=drawn)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Vectors(np.zeros((4, 4))), r"shape \(h, w, 2\), \(h, w, 3\) or \(d, h, w, 3\) expected, got \(4, 4\)"),
        (lambda: Vectors(np.zeros((2, 4, 4))), "components come last"),
        (
            lambda: Vectors(np.zeros((4, 4, 2)), smoothed="apart"),
            "whole or direction-and-magnitude expected, got 'apart'",
        ),
        (
            lambda: Tensors(np.zeros((4, 4, 4))),
            r"or components \(h, w, 3\) or \(h, w, 6\), or these with .* got \(4, 4, 4\)",
        ),
        (lambda: Tensors(np.zeros((2, 2, 4, 4, 3, 3))), "or these with d before h"),
        (
            lambda: meshflow.smooth(np.zeros((4, 4, 2)), kind="vectors", camera="kinect"),
            "no option of an array of vectors",
        ),
        (lambda: Tensors(np.arange(36.0).reshape(2, 2, 3, 3)), "symmetric ones expected, 4 of 4 differ"),
        (lambda: meshflow.smooth(Tensors(-COVARIANCE, metric="log-euclidean")), "360 of 360 are not"),
        (lambda: meshflow.smooth(Tensors(-COVARIANCE, definite=True)), "at least one positive definite"),
        (lambda: meshflow.smooth(Tensors(COVARIANCE), spacing=2), "spacing: no option of a Tensors"),
        (lambda: meshflow.smooth(Vectors(bend(), smoothed="direction-and-magnitude"), spacing=2), "spacing: no option"),
        (lambda: vectors(Vectors(bend()), bend(), "v.png"), "two fields of one size"),
    ],
)
def test_a_refusal_says_what_was_expected(made, words):
    with pytest.raises(InputError, match=words):
        made()


# Fields in space, and files.


def fibres(shape=(6, 7, 8), noise=0.1):
    """Noisy tensors (d, h, w, 3, 3) around fibres along x."""
    draw = np.random.default_rng(5)
    truth = np.broadcast_to(np.diag([1.5, 0.3, 0.3]), (*shape, 3, 3))
    change = noise * draw.normal(size=truth.shape)
    return truth + (change + np.swapaxes(change, -1, -2)) / 2, truth


@pytest.mark.parametrize("metric", ["euclidean", "noise", "log-euclidean"])
def test_tensors_in_space_come_back_in_either_form_and_stay_definite(metric):
    noisy, truth = fibres(noise=0.05)
    whole = meshflow.smooth(Tensors(noisy, (2.0, 1.0, 1.0), metric=metric), **HEAT).values
    assert whole.shape == noisy.shape
    assert np.std(whole - truth) < 0.5 * np.std(noisy - truth)
    parts = meshflow.smooth(Tensors(packed(noisy), (2.0, 1.0, 1.0), metric=metric), **HEAT).values
    assert np.abs(packed(whole) - parts).max() < 1e-12
    assert smallest(meshflow.smooth(Tensors(noisy)).values) > 0


@pytest.mark.parametrize("smoothed", ["whole", "direction-and-magnitude"])
def test_vectors_in_space_come_back_as_vectors(smoothed, tmp_path):
    noise = 0.2 * np.random.default_rng(6).normal(size=(6, 7, 8, 3))
    wind = Vectors(noise + [1.0, 2.0, 0.0], smoothed=smoothed)
    calm = meshflow.smooth(wind, method="quick")
    assert isinstance(calm, Vectors)
    assert np.std(calm.values - [1.0, 2.0, 0.0]) < 0.6 * 0.2
    assert calm.magnitude.shape == (6, 7, 8)
    assert vectors(wind, calm, tmp_path / "wind.png").stat().st_size > 0


def test_arrays_and_files_are_fields_where_their_kind_says_so(tmp_path):
    noisy, truth = fibres()
    done = meshflow.smooth(noisy, kind="tensors", **HEAT)
    assert np.array_equal(done, meshflow.smooth(Tensors(noisy), **HEAT).values)
    np.save(tmp_path / "t.npy", noisy)
    said = run(
        "smooth", tmp_path / "t.npy", tmp_path / "out.npy", "--kind", "tensors", "--method", "heat", "--time", "2"
    )
    assert said.returncode == 0
    assert np.std(np.load(tmp_path / "out.npy") - truth) < 0.5 * np.std(noisy - truth)
    wind = np.random.default_rng(0).normal(size=(9, 9, 2))
    np.savez(tmp_path / "w.npz", values=wind, place=np.arange(3))
    said = run("smooth", tmp_path / "w.npz", tmp_path / "o.npz", "--kind", "vectors", "--method", "heat", "--time", "2")
    assert said.returncode == 0
    found = np.load(tmp_path / "o.npz")
    assert found["values"].shape == wind.shape
    assert np.array_equal(found["place"], np.arange(3))


def test_medical_files_of_tensors_and_vectors_keep_header_and_order(tmp_path):
    noisy, _ = fibres()
    lower = np.stack([noisy[..., i, j] for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))], -1)[:, :, :, None]
    image = nibabel.Nifti1Image(lower.astype(np.float32), np.diag([2.0, 1.0, 1.0, 1.0]))
    image.header.set_intent("symmetric matrix", (3,))
    image.to_filename(tmp_path / "t.nii.gz")
    document = meshflow.read(tmp_path / "t.nii.gz", kind="tensors")
    assert document.data.spacing == (2.0, 1.0, 1.0)
    meshflow.write(document, tmp_path / "same.nii.gz")
    back = nibabel.load(tmp_path / "same.nii.gz")
    assert np.abs(back.get_fdata() - image.get_fdata()).max() < 1e-6
    assert back.header.get_intent()[0] == "symmetric matrix"
    meshflow.write(meshflow.smooth(document, **HEAT), tmp_path / "calm.nii.gz")
    upper = np.stack([noisy[..., i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    header = {
        "kinds": ["3D-symmetric-matrix", "space", "space", "space"],
        "space directions": [[np.nan] * 3, *np.eye(3)],
    }
    nrrd.write(str(tmp_path / "t.nrrd"), upper, {**header, "space": "right-anterior-superior"})
    meshflow.write(meshflow.read(tmp_path / "t.nrrd", kind="tensors"), tmp_path / "same.nrrd")
    values, found = nrrd.read(str(tmp_path / "same.nrrd"))
    assert np.abs(values - upper).max() < 1e-12
    assert found["kinds"][0] == "3D-symmetric-matrix"
    calm = nibabel.load(tmp_path / "calm.nii.gz").get_fdata()
    expected = meshflow.smooth(Tensors(noisy.astype(np.float32), (2.0, 1.0, 1.0)), **HEAT).values
    assert np.abs(calm[..., 0, 1] - expected[..., 1, 0]).max() < 1e-5
    wind = np.random.default_rng(0).normal(size=(4, 5, 6, 1, 3)).astype(np.float32)
    nibabel.Nifti1Image(wind, np.eye(4)).to_filename(tmp_path / "w.nii")
    meshflow.write(meshflow.read(tmp_path / "w.nii", kind="vectors"), tmp_path / "w2.nii")
    assert np.array_equal(nibabel.load(tmp_path / "w2.nii").get_fdata(), wind)


def test_components_of_unknown_order_are_refused(tmp_path):
    nibabel.Nifti1Image(np.zeros((4, 4, 4, 6), np.float32), np.eye(4)).to_filename(tmp_path / "a.nii")
    with pytest.raises(InputError, match=r"order differs between programs.*\.npy"):
        meshflow.read(tmp_path / "a.nii", kind="tensors")
    nrrd.write(str(tmp_path / "a.nrrd"), np.zeros((3, 4, 4, 4)), {"kinds": ["domain"] * 4})
    with pytest.raises(InputError, match="one of components expected"):
        meshflow.read(tmp_path / "a.nrrd", kind="vectors")
    with pytest.raises(InputError, match=r"is read from \.npy"):
        meshflow.read("data/terrain.tif", kind="vectors")
