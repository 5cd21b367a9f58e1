"""Scenes of several meshes: two noisy balls of which one is turned and scaled, and some dots."""

import numpy as np
import trimesh

from helpers.shapes import along_normals, sphere

BALL, FACES = sphere(300)
NOISY = along_normals(BALL, FACES, 0.2)
FRAME = trimesh.transformations.compose_matrix(scale=[2, 2, 2], angles=[0.3, 1, 2], translate=[5, 6, 7])


def ball(seed=0, attribute=True):
    mesh = trimesh.Trimesh(along_normals(BALL, FACES, 0.2, seed) if seed else NOISY, FACES, process=False)
    if attribute:
        mesh.vertex_attributes["half"] = (BALL[:, 2] > 0).astype(np.uint8)
    mesh.visual.vertex_colors = np.arange(1200).reshape(300, 4) % 255
    return mesh


def scene():
    made = trimesh.Scene()
    made.add_geometry(ball(), geom_name="left", node_name="left")
    made.add_geometry(ball(), geom_name="right", node_name="right", transform=FRAME)
    made.add_geometry(trimesh.PointCloud(np.eye(3)), geom_name="dots")
    return made
