"""Shapes with known answers, sampled irregularly on purpose."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from meshflow.geometry import normals


def outward(points, faces):
    """Faces turned so that normals point away from the centre."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces = faces.copy()
    faces[inward] = faces[inward][:, ::-1]
    return faces


def sphere(n=1500, seed=0, radius=1.0, shake=0.35):
    """A sphere sampled irregularly: a spiral, shaken by a share of its spacing, three times denser on one side."""
    rng = np.random.default_rng(seed)
    i = np.arange(n) + 0.5
    theta, phi = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    points += rng.uniform(-1, 1, points.shape) * shake * np.sqrt(4 * np.pi / n)
    points[:, 2] += 0.3
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    faces = outward(points, ConvexHull(points).simplices.astype(np.int64))
    return points, faces


def square(n=500, seed=0, size=1.0):
    """A flat square with irregular points, z = 0; points (n, 3), faces, and the mask of its inside."""
    rng = np.random.default_rng(seed)
    border = np.linspace(0, 1, 20)
    rim = np.concatenate(
        [
            np.stack([border, 0 * border], 1),
            np.stack([border, 0 * border + 1], 1),
            np.stack([0 * border[1:-1], border[1:-1]], 1),
            np.stack([0 * border[1:-1] + 1, border[1:-1]], 1),
        ]
    )
    inner = rng.uniform(0.02, 0.98, (n, 2))
    flat = np.concatenate([rim, inner])
    faces = Delaunay(flat).simplices.astype(np.int64)
    a, b, c = (flat[faces[:, i]] for i in range(3))
    faces = faces[np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) > 1e-9]
    inside = np.arange(len(flat)) >= len(rim)
    return np.column_stack([flat * size, np.zeros(len(flat))]), faces, inside


def tube(profile, rings, around, length, seed=0, shake=0.2):
    """A surface of revolution of radius profile(s), s in [-length/2, length/2], sampled irregularly; and its inside mask."""
    rng = np.random.default_rng(seed)
    s, a = np.meshgrid(np.linspace(-0.5, 0.5, rings) * length, np.arange(around) * 2 * np.pi / around, indexing="ij")
    s, a = s.copy(), a + np.arange(rings)[:, None] * np.pi / around
    s[1:-1] += rng.uniform(-1, 1, s[1:-1].shape) * shake * length / rings
    a += rng.uniform(-1, 1, a.shape) * shake * 2 * np.pi / around
    points = np.stack([profile(s) * np.cos(a), profile(s) * np.sin(a), s], axis=-1).reshape(-1, 3)
    index = np.arange(rings * around).reshape(rings, around)
    p, q = index[:-1], index[1:]
    right_p, right_q = np.roll(p, -1, 1), np.roll(q, -1, 1)
    odd = (np.arange(rings - 1) % 2 == 1)[:, None] & np.ones_like(p, bool)
    one = np.where(odd[..., None], np.stack([p, right_p, right_q], -1), np.stack([p, right_p, q], -1))
    two = np.where(odd[..., None], np.stack([p, right_q, q], -1), np.stack([right_p, right_q, q], -1))
    faces = np.concatenate([one.reshape(-1, 3), two.reshape(-1, 3)])
    rows = np.arange(rings * around) // around
    return points, faces, (rows > 1) & (rows < rings - 2)


def soup(n=40, m=80, d=3, seed=0):
    """Random triangles over random points in R^d: nothing manifold about it."""
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, n, (3 * m, 3))
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)][:m]
    return rng.normal(size=(n, d)), faces


def along_normals(points, faces, share, seed=0):
    """The points with Gaussian noise along their normals, share mean edges strong."""
    noise = share * normals.mean_edge(points, faces) * np.random.default_rng(seed).normal(size=(len(points), 1))
    return points + noise * normals.normals_at(points, faces)
