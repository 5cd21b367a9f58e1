"""The rim of an open mesh loses its noise along the border curve, by default. meshflow.estimate.rims."""

import numpy as np
import pytest
from matplotlib.path import Path
from scipy.spatial import Delaunay, cKDTree

import meshflow
from meshflow.geometry.connectivity import connect
from meshflow.geometry.crossings import new_crossings
from meshflow.geometry.folds import new_folds
from meshflow.geometry.normals import mean_edge, normals_at
from meshflow.synthetic import shapes

H = 0.025


def sampled(x, y):
    """A closed outline as points H apart."""
    outline = np.stack([x, y], axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    at = np.arange(count := round(way[-1] / H)) / count * way[-1]
    return np.stack([np.interp(at, way, column) for column in outline.T], axis=1)


def patch(outline, lift=lambda xy: np.zeros(len(xy))):
    """Points (n, 3) and faces of a patch with this outline, irregularly sampled inside."""
    rng, low, high = np.random.default_rng(0), outline.min(axis=0), outline.max(axis=0)
    inner = np.stack(np.meshgrid(np.arange(low[0], high[0], H), np.arange(low[1], high[1], 0.87 * H)), axis=-1)
    inner[1::2, :, 0] += 0.5 * H
    inner = inner.reshape(-1, 2) + rng.uniform(-0.2, 0.2, (inner.size // 2, 2)) * H
    inner = inner[Path(outline).contains_points(inner) & (cKDTree(outline).query(inner)[0] > 0.6 * H)]
    xy = np.concatenate([outline, inner])
    faces = Delaunay(xy).simplices
    a, b, c = np.moveaxis(xy[faces], 1, 0)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    inside = Path(outline).contains_points(xy[faces].mean(axis=1)) & (np.abs(doubled) > 1e-3 * H**2)
    faces = np.where((doubled > 0)[:, None], faces, faces[:, ::-1])[inside]
    return np.column_stack([xy, lift(xy)]), faces


TURN = np.linspace(0.0, 2.0 * np.pi, 4001)
SIDE = np.arange(40) / 40
SQUARE = np.concatenate(
    [
        np.stack(pair, axis=1)
        for pair in ((SIDE, 0 * SIDE), (0 * SIDE + 1, SIDE), (1 - SIDE, 0 * SIDE + 1), (0 * SIDE, 1 - SIDE))
    ]
)
WAVE = 0.6 + 0.06 * np.sin(7 * TURN)
DOME = shapes.dome(1800)
PATCHES = {
    "disk": patch(sampled(0.6 * np.cos(TURN), 0.6 * np.sin(TURN))),
    "square": patch(SQUARE),
    "vault": patch(SQUARE, lambda xy: 0.3 * np.cos(2.0 * xy[:, 0] - 1.0)),
    "face": patch(
        sampled(0.5 * np.cos(TURN), 0.7 * np.sin(TURN)),
        lambda xy: 0.25 * np.exp(-(xy**2).sum(axis=1) / 0.08) - 0.5 * (xy**2).sum(axis=1),
    ),
    "wavy": patch(sampled(WAVE * np.cos(TURN), WAVE * np.sin(TURN))),
    "half sphere": (DOME.points, DOME.faces),
}


def noisy(points, faces, kind, level, seed=5):
    """Points with noise in all directions or along the normals, in edges."""
    rng, size = np.random.default_rng(seed), level * mean_edge(points, faces)
    if kind == "iso":
        return points + size * rng.normal(size=points.shape)
    return points + size * rng.normal(size=(len(points), 1)) * normals_at(points, faces)


def from_curve(some, points, faces):
    """The root mean square distance of the rim from the true border, in edges."""
    c = connect((faces,), len(points))
    begin, end = (points[faces[c.border // 3, (c.border + shift) % 3]] for shift in (1, 2))
    along, apart = end - begin, some[c.rim][:, None] - begin
    share = np.clip(np.einsum("red,ed->re", apart, along) / (along**2).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(apart - share[:, :, None] * along, axis=2).min(axis=1)
    return float(np.sqrt(np.mean(away**2))) / mean_edge(points, faces)


# What is left of the distance at most, measured with a quarter to spare.
LEFT = {"disk": 0.35, "square": 0.45, "vault": 0.75, "face": 0.45, "wavy": 0.55, "half sphere": 0.85}


@pytest.mark.long
@pytest.mark.parametrize(("kind", "level"), [("iso", 0.1), ("iso", 0.6), ("nrm", 0.3)])
@pytest.mark.parametrize("name", PATCHES)
def test_a_rim_loses_its_noise_and_nothing_folds_or_crosses(name, kind, level):
    points, faces = PATCHES[name]
    given = noisy(points, faces, kind, level)
    result = meshflow.smooth((given, faces), result=True)
    after = result.data[0]
    left = from_curve(after, points, faces) / from_curve(given, points, faces)
    assert left < LEFT[name], f"{left:.2f} of the distance of the rim is left"
    assert len(new_folds(given, after, faces)) == 0
    assert len(new_crossings(given, after, faces)) == 0
    assert "border curve" in result.parameters["boundary"].why


@pytest.mark.long
@pytest.mark.parametrize("name", ["square", "vault"])
@pytest.mark.parametrize("level", [0.1, 0.3])
def test_corners_of_a_border_stay_corners(name, level):
    points, faces = PATCHES[name]
    after = meshflow.smooth((noisy(points, faces, "iso", level), faces))[0]
    corners = [int(np.argmin(((points[:, :2] - at) ** 2).sum(axis=1))) for at in ((0, 0), (1, 0), (1, 1), (0, 1))]
    away = np.linalg.norm(after - points, axis=1)[corners] / mean_edge(points, faces)
    assert away.max() < 2.5 * level


@pytest.mark.parametrize("name", PATCHES)
def test_a_clean_border_of_a_clean_surface_stays_to_the_bit(name):
    points, faces = PATCHES[name]
    assert np.array_equal(meshflow.smooth((points, faces))[0], points)


def test_a_border_that_was_drawn_is_not_moved_along_a_noisy_surface():
    points, faces = PATCHES["disk"]
    given = noisy(points, faces, "nrm", 0.2)  # along z
    after = meshflow.smooth((given, faces))[0]
    rim = connect((faces,), len(points)).rim
    np.testing.assert_allclose(after[rim, :2], points[rim, :2], atol=0.1 * H)


def test_a_border_rougher_than_the_surface_was_cut_so():
    points, faces = patch(sampled(0.6 * np.cos(TURN), 0.6 * np.sin(TURN)))
    rim = connect((faces,), len(points)).rim
    points[rim, :2] *= 1.0 + 0.5 * H * np.random.default_rng(2).normal(size=(rim.sum(), 1))
    given = noisy(points, faces, "nrm", 0.1)
    after = meshflow.smooth((given, faces))[0]
    across = np.linalg.norm(after[rim, :2] - points[rim, :2], axis=1)
    assert np.sqrt(np.mean(across**2)) < 0.15 * H


def test_a_border_that_the_caller_holds_is_held():
    points, faces = PATCHES["square"]
    given = noisy(points, faces, "iso", 0.2)
    rim = connect((faces,), len(points)).rim
    assert np.array_equal(meshflow.smooth((given, faces), boundary="fixed")[0][rim], given[rim])


@pytest.mark.long
def test_the_rim_does_not_depend_on_numbering_turns_of_triangles_place_or_unit():
    points, faces = PATCHES["vault"]
    given, rng = noisy(points, faces, "iso", 0.3), np.random.default_rng(1)
    expected = meshflow.smooth((given, faces))[0]
    order = rng.permutation(len(given))
    back = np.argsort(order)
    other = rng.permutation(np.roll(back[faces], 1, axis=1))
    np.testing.assert_allclose(meshflow.smooth((given[order], other))[0], expected[order], atol=1e-10)
    # The other winding, another place and another unit at once: what depends on one of them is told by this, too.
    moved = meshflow.smooth((100.0 * given + 3.0, faces[:, ::-1]))[0]
    np.testing.assert_allclose(moved, 100.0 * expected + 3.0, atol=1e-8)
