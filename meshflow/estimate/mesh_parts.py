"""Preparation of a mesh: a consistent orientation of its triangles, and the noise of its connected parts."""

from dataclasses import replace

import numpy as np

from meshflow.estimate.mesh_noise import IMPULSIVE, PointNoise, noise_of_points
from meshflow.estimate.mesh_pieces import pieces
from meshflow.estimate.mesh_regions import clean_region
from meshflow.estimate.voxels import blocks_of, voxels_of
from meshflow.geometry.orientation import alike, parts
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["noise_by_parts", "turned_alike", "unlike_parts"]

# The largest number of parts that are examined separately, and their least number of vertices.
MOST, LEAST = 16, 50
# Parts are unlike if their mean edges, or the noise of each on its own, differ by more than this factor.
UNLIKE = 1.5
# The root mean square distance of the vertices from the surface that was voxelized, in edges of voxels.
IN_STEPS = 0.2


def turned_alike(data: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh with consistently oriented triangles, and a sentence if some were not."""
    faces, turned = alike(data.faces)
    if not turned:
        return data, ()
    said = f"{turned} of {len(faces)} triangles are oriented against their neighbours; they were reversed for the smoothing"
    return replace(data, faces=faces), (said,)


def noise_by_parts(data: Mesh) -> tuple[PointNoise, Array]:
    """The noise of the points of a mesh along its normals, and the mask (n,) of the vertices of parts, or of a region, without
    noise, if others have it.

    For a large mesh or part it is estimated on some pieces.
    """
    count, label = parts(data.faces, len(data.points))
    if (found := _of_voxels(data.points, data.faces)) is not None and found.voxels is not None:
        return found, blocks_of(found.voxels, data.points, label)
    clean = np.zeros(len(data.points), bool)
    large = _large(count, label)
    if len(large) < 2:
        return _noise_by_regions(data)
    of_face = label[data.faces[:, 0]]
    for part in large:
        alone = _alone(data, of_face == part)
        if _noise_of(alone).sigma == 0 and voxels_of(alone.points, alone.faces) is None:
            clean |= label == part
    if not clean.any() or all(clean[label == part].all() for part in large):
        return _noise_of(data), np.zeros_like(clean)
    left = ~clean[data.faces[:, 0]]
    return _of_voxels(data.points, data.faces[left]) or _noise_of(_alone(data, left)), clean


def unlike_parts(data: Mesh) -> tuple[Array, ...]:
    """Masks (n,) of groups of parts that are smoothed on their own, because one noise and one time do not suit them all; the
    first one also has all parts without noise. Empty where one suits all.
    """
    count, label = parts(data.faces, len(data.points))
    large = _large(count, label)
    if len(large) < 2 or voxels_of(data.points, data.faces) is not None:
        return ()
    of_face, known = label[data.faces[:, 0]], []
    for part in large:
        alone = _alone(data, of_face == part)
        if (sigma := _noise_of(alone).sigma) > 0:
            known.append((alone.step, sigma, part))
    groups: list[list[tuple[float, float, int]]] = []
    for one in sorted(known):
        like = next((group for group in groups if _alike(group[0], one)), None)
        if like is None:
            groups.append([one])
        else:
            like.append(one)
    if len(groups) < 2:
        return ()
    masks = [np.isin(label, [part for _, _, part in group]) for group in groups]
    masks.sort(key=lambda mask: -int(mask.sum()))
    return (~np.any(masks[1:], axis=0), *masks[1:])


def _alike(one: tuple[float, float, int], other: tuple[float, float, int]) -> bool:
    """Whether mean edge and noise of two parts are about the same."""
    return all(max(a, b) <= UNLIKE * min(a, b) for a, b in zip(one[:2], other[:2], strict=True))


def _large(count: int, label: Array) -> list[int]:
    """The largest parts, of which each is examined on its own."""
    sizes = np.bincount(label, minlength=count)
    return [int(part) for part in np.argsort(-sizes, kind="stable")[:MOST] if sizes[part] >= LEAST]


def _of_voxels(points: Array, faces: Array) -> PointNoise | None:
    """The noise of a level set of a binary volume; None for any other mesh."""
    voxels = voxels_of(points, faces)
    if voxels is None:
        return None
    sigma = IN_STEPS * voxels.across
    return PointNoise(sigma, 0.0, (sigma,), how="voxels", voxels=voxels)


def _noise_by_regions(data: Mesh) -> tuple[PointNoise, Array]:
    """The noise of one part, and the mask (n,) of a region without noise, if others plainly have it."""
    clean, noisy = clean_region(data.points, data.faces)
    if clean.any():
        mine = np.all(noisy[data.faces], axis=1)
        noise = _noise_of(_alone(data, np.asarray(mine)))
        if noise.sigma > 0 and noise.kurtosis <= IMPULSIVE:
            return noise, clean
    return _noise_of(data), np.zeros_like(clean)


def _noise_of(data: Mesh) -> PointNoise:
    """The noise of a mesh, or of pieces of a large one."""
    piece, counted, _ = pieces(replace(data, fixed=np.zeros(len(data.points), bool)))
    return noise_of_points(piece.points, piece.faces, counted)


def _alone(data: Mesh, mine: Array) -> Mesh:
    """A mesh of only the triangles with mask (m,)."""
    used, faces = np.unique(data.faces[mine], return_inverse=True)
    return Mesh(data.points[used], faces.reshape(-1, 3))
