"""Nouns: what they accept, what they refuse, and that lowering undoes lifting."""

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.flow.family import Variant
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.free import Axes, Rays
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Scanner
from meshflow.surfaces.surface import Surface
from meshflow.surfaces.triangles import grid_triangulations, triangles_there

TRIANGLE = (np.eye(3), np.array([[0, 1, 2]]))
CAMERA = Pinhole(100, 100, 2, 2)
RNG = np.random.default_rng(0)


def surfaces(dtype):
    z = RNG.normal(size=(6, 7)) + 5
    z[2, 3] = np.nan
    points = RNG.normal(size=(9, 3)).astype(dtype)
    faces = RNG.permutation(9).reshape(3, 3)
    colour = RNG.random((9, 4)).astype(dtype)
    return [
        HeightField(z.astype(dtype), (2.0, 3.0)),
        HeightField(z.astype(dtype), (np.linspace(1, 2, 6), 3.0)),
        Image(np.stack([z, 2 * z], -1).astype(dtype)),
        RangeImage(z.astype(dtype), CAMERA),
        Mesh(points, faces),
        Mesh(points, faces, colour),
        Mesh(points, faces, colour, "all"),
    ]


def test_a_data_object_tells_its_size_and_not_its_numbers():
    reported = [
        repr(data) for data in (*surfaces(np.float32), RangeImage(np.ones((40, 50)), Scanner(np.ones((40, 50, 3)))))
    ]
    assert all(len(words) < 130 and "array" not in words for words in reported), reported
    assert reported[0] == "HeightField(7 x 6 float32, spacing 2.44949, 1 missing)"
    assert reported[3] == "RangeImage(7 x 6 float32, fx 100, fy 100, cx 2, cy 2 pixels, 1 missing)"
    assert reported[5] == "Mesh(9 points in R^3 float32, 3 triangles, 4 channels, channels move)"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_lowering_what_did_not_move_gives_back_every_bit(dtype):
    for data in surfaces(dtype):
        lift = Lift(contrast=1.0 if isinstance(data, RangeImage) or getattr(data, "moves", "") == "points" else 0.37)
        back = data.lowered(data.lifted(lift).start)
        for name in ("z", "values", "depth", "points", "channels"):
            if getattr(data, name, None) is not None:
                before, after = getattr(data, name), getattr(back, name)
                assert before.dtype == after.dtype == dtype
                assert before.tobytes() == after.tobytes()


def test_lowering_a_shift_shifts_the_valid_samples_and_no_others():
    for data, name, lift in [
        (surfaces(np.float64)[0], "z", Lift(4.0)),
        (surfaces(np.float64)[2], "values", Lift(4.0)),
        (surfaces(np.float64)[3], "depth", Lift()),
    ]:
        after = getattr(data.lowered(data.lifted(lift).start + 1.0), name)
        before, gone = getattr(data, name), data.missing
        assert np.allclose(after[~gone], before[~gone] + 1.0)
        assert np.array_equal(after[gone], before[gone], equal_nan=True)


def test_nothing_of_the_callers_is_changed():
    z = RNG.normal(size=(6, 7))
    z.flags.writeable = False
    data = HeightField(z)
    lifted = data.lifted(Lift(2.0))
    data.lowered(lifted.start + 3)
    lifted.start[:] = 0
    assert not np.shares_memory(lifted.points, z)


@pytest.mark.parametrize(
    "make",
    [
        lambda z: z.astype(np.int16),
        lambda z: z.astype(">f4"),
        lambda z: np.asfortranarray(z),
        lambda z: np.repeat(np.repeat(z, 2, 0), 3, 1)[::2, ::3],
        lambda z: np.ma.masked_array(z, np.zeros(z.shape, bool)),
        lambda z: z.astype(bool),
        lambda z: z.tolist(),
    ],
)
def test_any_real_array_of_two_dimensions_is_a_height_field(make):
    z = RNG.integers(0, 2, (5, 6)).astype(float)
    data = HeightField(make(z))
    assert data.z.dtype in (np.float32, np.float64)
    assert np.array_equal(data.z, z)


def test_masked_nan_infinite_and_named_samples_are_all_missing():
    z = np.ma.masked_array(np.ones((4, 5)), np.zeros((4, 5), bool))
    z[0, 0] = np.ma.masked
    z.data[1, 1], z.data[2, 2] = np.nan, np.inf
    more = np.zeros((4, 5), bool)
    more[3, 3] = True
    missing = HeightField(z, missing=more).missing
    assert [tuple(p) for p in np.argwhere(missing)] == [(0, 0), (1, 1), (2, 2), (3, 3)]
    image = np.ones((4, 5, 3))
    image[1, 2, 0] = np.nan
    assert np.argwhere(Image(image).missing).tolist() == [[1, 2]]
    depth = np.ones((4, 5))
    depth[1, 2] = 0
    assert np.argwhere(RangeImage(depth, CAMERA).missing).tolist() == [[1, 2]]


def test_a_missing_sample_removes_its_triangles():
    valid = np.ones((5, 6), bool)
    valid[2, 2] = False
    for diagonals, sheets, lost in (("forward", 1, 6), ("backward", 1, 6), ("both", 2, 6), ("alternate", 2, 6)):
        found = grid_triangulations(triangles_there(~valid), diagonals)
        assert len(found) == sheets
        for faces in found:
            assert len(faces) == 2 * 4 * 5 - lost
            assert 2 * 6 + 2 not in faces


def test_triangles_of_a_grid_turn_counter_clockwise_and_begin_with_the_right_angle():
    surface = HeightField(np.zeros((4, 5)), (2.0, 3.0)).lifted(Lift(diagonals="both"))
    for faces in surface.triangulations:
        a, b, c = (surface.points[faces[:, i], :2] for i in range(3))
        u, v = b - a, c - a
        assert (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0).all()
        assert (np.einsum("ij,ij->i", u, v) == 0).all()


def test_triangles_across_a_jump_of_depth_are_left_out():
    depth = np.full((4, 6), 2.0)
    depth[:, 3:] = 3.0
    whole, cut = (RangeImage(depth, CAMERA, jump=jump).lifted(Lift()).triangulations[0] for jump in (None, 0.05))
    assert len(whole) == 2 * 3 * 5
    assert len(cut) == 2 * 3 * 4


def test_points_of_a_range_image_project_to_their_pixels():
    depth = 1 + RNG.random((4, 6))
    points = RangeImage(depth, Pinhole(80, 90, 2.5, 1.5)).lifted(Lift()).points.reshape(4, 6, 3)
    assert np.allclose(points[..., 2], depth)
    assert np.allclose(80 * points[..., 0] / depth + 2.5, np.arange(6)[None])
    assert np.allclose(90 * points[..., 1] / depth + 1.5, np.arange(4)[:, None])


def test_a_spacing_per_row_measures_each_row_with_its_own():
    dx = np.array([1.0, 2.0, 4.0])
    surface = HeightField(np.zeros((3, 4)), (dx, 5.0)).lifted(Lift(diagonals="forward"))
    corners = surface.charts[0]
    legs = np.abs(corners[:, 1:] - corners[:, :1]).max(axis=1)
    rows = surface.triangulations[0][:, 0] // 4
    assert np.allclose(legs[:, 0], dx[rows])
    assert np.allclose(legs[:, 1], 5.0)


BAD = [
    (lambda: HeightField(np.zeros((0, 3))), "nothing to smooth or to draw, the array of shape"),
    (lambda: HeightField(np.zeros((1, 9))), r"at least 2 x 2 samples .* got \(1, 9\)"),
    (lambda: HeightField(np.zeros((9, 1))), r"at least 2 x 2 samples .* got \(9, 1\)"),
    (lambda: HeightField(np.zeros(9)), r"2 dimensions expected, got shape \(9,\)"),
    (lambda: HeightField(np.full((3, 3), np.nan)), "all 9 samples are missing"),
    (lambda: HeightField(np.ones((3, 3), complex)), "real numbers expected, got dtype complex128"),
    (lambda: HeightField(np.full((3, 3), "a")), "real numbers expected"),
    (lambda: HeightField(np.ones((3, 3)), spacing=0), "spacing: a positive finite number"),
    (lambda: HeightField(np.ones((3, 3)), spacing=(1, -2)), "spacing dy: a positive finite number expected, got -2"),
    (lambda: HeightField(np.ones((3, 3)), spacing=(1, 2, 3)), "one number or a pair"),
    (lambda: HeightField(np.ones((3, 3)), spacing=(np.ones(4), 1)), r"3 of them, one per row.* got shape \(4,\)"),
    (lambda: HeightField(np.ones((3, 3)), missing=np.zeros((2, 3), bool)), r"missing: a mask of shape \(3, 3\)"),
    (
        lambda: HeightField(np.ones((3, 3)), fixed=np.full((3, 3), "a")),
        "fixed: a mask of booleans, or of numbers, expected, got dtype <U1",
    ),
    (lambda: Image(np.ones((3, 3, 0))), "empty"),
    (lambda: Image(np.ones((3, 3, 3, 3))), "2 or 3 dimensions expected"),
    (lambda: RangeImage(-np.ones((3, 3)), CAMERA), "depths above zero expected, got -1.0"),
    (lambda: RangeImage(np.zeros((3, 3)), CAMERA), "all 9 depths are missing"),
    (lambda: RangeImage(np.ones((3, 3)), CAMERA, jump=0), "jump: a positive"),
    (lambda: RangeImage(np.ones((3, 3)), CAMERA).lifted(Lift(2.0)), "for range images only 1 has a meaning"),
    (lambda: Pinhole(0, 1, 1, 1), "camera fx: a positive finite number of pixels expected, got 0"),
    (lambda: Pinhole(1, 1, np.nan, 1), "camera cx: a finite number of pixels"),
    (lambda: Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), "nothing to smooth"),
    (lambda: Mesh(np.eye(3), np.zeros((0, 3), int)), "at least one triangle expected"),
    (lambda: Mesh(np.eye(3), np.array([[0, 1, 3]])), "vertices 0 to 2 expected, got 3"),
    (lambda: Mesh(np.eye(3), np.array([[0, 1, -1]])), "vertices 0 to 2 expected, got -1"),
    (lambda: Mesh(np.eye(3), np.array([[0, 1, 2, 0]])), r"triangles of shape \(m, 3\) expected, got \(1, 4\)"),
    (lambda: Mesh(np.eye(3), np.array([[0.5, 1, 2]])), "whole numbers expected, got 0.5"),
    (lambda: Mesh(np.array([[np.nan, 0, 0], [0, 1, 0], [0, 0, 1]]), TRIANGLE[1]), "1 of 3 points hold NaN or infinity"),
    (lambda: Mesh(np.array([[np.inf, 0, 0], [0, 1, 0], [0, 0, 1]]), TRIANGLE[1]), "1 of 3 points hold NaN or infinity"),
    (lambda: Mesh(np.zeros((3, 1)), TRIANGLE[1]), r"shape \(n, d\) with d >= 2"),
    (lambda: Mesh(*TRIANGLE, channels=np.ones((4, 2))), r"shape \(3, k\) expected, got \(4, 2\)"),
    (lambda: Mesh(*TRIANGLE, channels=np.array([0, 1, np.nan])), "finite numbers expected"),
    (lambda: Mesh(*TRIANGLE, moves="channels"), "the mesh has no channels"),
    (lambda: Mesh(*TRIANGLE, moves="colours"), "points, channels or all expected"),
    (lambda: Mesh(*TRIANGLE).lifted(Lift(2.0)), "a factor on the channels"),
    (lambda: Surface(np.eye(3), (TRIANGLE[1],), Axes((0, 0))), "different coordinates from 0 to 2"),
    (lambda: Surface(np.eye(3), (TRIANGLE[1],), Axes((1, 2))), "one coordinate that stays spans no area"),
    (lambda: Surface(np.eye(4), (TRIANGLE[1],), Rays(np.eye(4), np.eye(4), np.ones((4, 1)))), "rays need points in R"),
    (lambda: Surface(np.eye(3), (TRIANGLE[1],), boundary="free"), "neumann, plane-preserving or fixed expected"),
    (lambda: Surface(np.eye(3), (TRIANGLE[1],), time_factor=np.ones(2)), r"time factor: shape \(3,\)"),
    (lambda: Lift(contrast=np.inf), "contrast: a positive finite number"),
    (
        lambda: HeightField(np.ones((3, 3))).lifted(Lift(diagonals="cross")),
        "diagonals: forward, backward, both or alternate",
    ),
    (lambda: Variant(gamma=np.nan), "gamma: a finite number"),
    (lambda: Variant(indicator="slope"), "metric or projection expected"),
    (lambda: Variant(mass="lumped"), "barycentric, voronoi or ring expected"),
    (lambda: Variant(floor=2), r"floor: a number in \(0, 1\]"),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=[words[:40] for _, words in BAD])
def test_bad_input_is_refused_with_what_came_and_what_to_do(make, words):
    with pytest.raises(InputError, match=words):
        make()
