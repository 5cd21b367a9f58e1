"""One camera of each kind, and what is special in each."""

from dataclasses import replace

import numpy as np
import pytest

from meshflow.surfaces.camera import Orthographic, Pinhole
from meshflow.surfaces.scanner import Scanner, Spherical

H, W = 30, 40
PLAIN = Pinhole(50, 55, 19.5, 14.5)
LENSES = [
    (0.1, -0.05, 0.001, -0.002),
    (-0.28, 0.07, 0.0003, 0.0002, -0.01),
    (0.3, -0.1, 0.001, 0.002, 0.02, 0.25, -0.08, 0.01),
]
SWEEP = Spherical((60, -60), (15, -25))


def rays_of(camera, measure=None):
    lines = camera.lines((H, W), measure or camera.usual)
    return np.broadcast_to(lines.at(np.ones((H, W))) - lines.at(np.zeros((H, W))), (H, W, 3))


def offset_scanner():
    """Nearly parallel rays from points of their own."""
    c, r = np.meshgrid(np.arange(W) * 0.02, np.arange(H) * 0.025)
    return Scanner(np.broadcast_to([0.0, 0.0, -1.0], (H, W, 3)), np.stack([c, -r, 0 * c], -1))


CAMERAS = {
    "pinhole": PLAIN,
    **{f"lens {len(lens)}": replace(PLAIN, distortion=lens) for lens in LENSES},
    "orthographic": Orthographic(0.02, 0.03),
    "spherical": SWEEP,
    "spherical rows": Spherical((-170, 170), tuple(np.linspace(20, 2, 15)) + tuple(np.linspace(1, -30, 15))),
    "scanner": Scanner(rays_of(PLAIN) * 3.0, (0.1, 0.2, 0.3)),
    "parallel": offset_scanner(),
}
ALL = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
