"""Vectors and symmetric tensors come back as they came, in any frame, and what is positive definite stays so."""

import numpy as np
import pytest

import meshflow
from meshflow import Compute, Heat, InputError, Tensors, Vectors
from meshflow.geometry.symmetric import exponential, held_definite, logarithm, packed, unpacked
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


@pytest.mark.parametrize("metric", ["euclidean", "log-euclidean"])
def test_matrices_and_components_give_the_same_result(metric):
    whole = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **HEAT).values
    components = meshflow.smooth(Tensors(packed(COVARIANCE), metric=metric), **HEAT).values
    assert np.abs(packed(whole) - components).max() < 1e-12
    assert whole.shape == COVARIANCE.shape


@pytest.mark.parametrize("metric", ["euclidean", "log-euclidean"])
def test_the_frame_of_the_tensors_makes_no_difference(metric):
    beltrami = {"method": meshflow.Beltrami(contrast=1.0, twicing=0, second_stage=False), "time": 1.0}
    straight = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **beltrami).values
    turned = meshflow.smooth(Tensors(TURN @ COVARIANCE @ TURN.T, metric=metric), **beltrami).values
    assert np.abs(turned - TURN @ straight @ TURN.T).max() < 1e-9


@pytest.mark.parametrize("way", WAYS, ids=str)
@pytest.mark.parametrize("metric", ["euclidean", "log-euclidean"])
def test_no_result_is_not_positive_definite(metric, way):
    result = meshflow.smooth(Tensors(COVARIANCE, metric=metric), **way).values
    assert smallest(result) > 0
    if metric == "euclidean":
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
    for metric in ("euclidean", "log-euclidean"):
        after = meshflow.smooth(Tensors(holes, metric=metric), **HEAT)
        assert np.array_equal(after.values[3, 4], holes[3, 4], equal_nan=True)
        assert np.isfinite(np.delete(after.values.reshape(-1, 9), 3 * 20 + 4, axis=0)).all()
        assert after.values.dtype == np.float32
    field = np.ones((9, 9, 2))
    field[2, 2, 1] = np.nan
    for smoothed in ("whole", "direction-and-magnitude"):
        after = meshflow.smooth(Vectors(field, smoothed=smoothed), **HEAT)
        assert np.array_equal(after.values[2, 2], field[2, 2], equal_nan=True)


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
        (lambda: Vectors(np.zeros((4, 4))), r"shape \(h, w, 2\) or \(h, w, 3\) expected, got \(4, 4\)"),
        (lambda: Vectors(np.zeros((2, 4, 4))), "components come last"),
        (
            lambda: Vectors(np.zeros((4, 4, 2)), smoothed="apart"),
            "whole or direction-and-magnitude expected, got 'apart'",
        ),
        (lambda: Tensors(np.zeros((4, 4, 4))), r"or components \(h, w, 3\) or \(h, w, 6\), got \(4, 4, 4\)"),
        (lambda: Tensors(np.zeros((2, 4, 4, 3, 3))), "slices of a volume"),
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
