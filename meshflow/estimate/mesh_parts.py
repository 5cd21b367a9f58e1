"""A mesh before anything is measured on it: its triangles turned alike, and the noise of each of its parts."""

from dataclasses import replace

import numpy as np

from meshflow.estimate.mesh_noise import PointNoise, noise_of_points
from meshflow.estimate.mesh_pieces import pieces
from meshflow.geometry.orientation import alike, parts
from meshflow.geometry.validation import Array
from meshflow.surfaces.mesh import Mesh

__all__ = ["noise_by_parts", "turned_alike"]

# Parts that are looked at one by one, the largest, and the vertices that they have at least.
MOST, LEAST = 16, 50


def turned_alike(data: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh with neighbouring triangles turned alike, and a sentence where some were not."""
    faces, turned = alike(data.faces)
    if not turned:
        return data, ()
    said = f"{turned} of {len(faces)} triangles are turned against their neighbours; they are turned round while points move"
    return replace(data, faces=faces), (said,)


def noise_by_parts(data: Mesh) -> tuple[PointNoise, Array]:
    """The noise of the points of a mesh along its normals, and the vertices (n,) of parts that have none beside parts that do.

    Of a large mesh, or a large part, that of some pieces.
    """
    count, label = parts(data.faces, len(data.points))
    clean = np.zeros(len(data.points), bool)
    sizes = np.bincount(label, minlength=count)
    large = [part for part in np.argsort(-sizes, kind="stable")[:MOST] if sizes[part] >= LEAST]
    if len(large) < 2:
        return _noise_of(data), clean
    of_face = label[data.faces[:, 0]]
    for part in large:
        if _noise_of(_alone(data, of_face == part)).sigma == 0:
            clean |= label == part
    if not clean.any() or all(clean[label == part].all() for part in large):
        return _noise_of(data), np.zeros_like(clean)
    return _noise_of(_alone(data, ~clean[data.faces[:, 0]])), clean


def _noise_of(data: Mesh) -> PointNoise:
    """The noise of a mesh, or of pieces of a large one."""
    piece, counted, _ = pieces(replace(data, fixed=np.zeros(len(data.points), bool)))
    return noise_of_points(piece.points, piece.faces, counted)


def _alone(data: Mesh, mine: Array) -> Mesh:
    """Some triangles (m,) alone."""
    used, faces = np.unique(data.faces[mine], return_inverse=True)
    return Mesh(data.points[used], faces.reshape(-1, 3))
