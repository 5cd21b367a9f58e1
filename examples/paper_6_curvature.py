"""Figure 6 of the paper: the mean curvature of a horse, and of a piece of an irregular unit sphere, where it is 1.

``python examples/paper_6_curvature.py [PICTURE.png]``; the horse where ``../shared/data`` is present.
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic import shapes
from meshflow.synthetic.samples import irregular_mesh

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page, render

HORSE = Path(__file__).resolve().parents[2] / "shared" / "data" / "meshes" / "irregular" / "horse.vtp"
PLAIN = {"show_scalar_bar": False, "cmap": "jet"}


def uneven(points: np.ndarray, factor: float) -> np.ndarray:
    """Points of the unit sphere drawn together at one pole: projected to a plane from there, enlarged, and projected back."""
    x, y, z = points.T
    far, near = factor**2 * (1.0 + z), 1.0 - z
    return np.stack([2 * factor * x, 2 * factor * y, far - near], axis=1) / (far + near)[:, None]


def main(picture: Path | None = None) -> float:
    """How far from 1 the curvature of the sphere is, at 99 % of its vertices at most; 2 % in the paper."""
    even = shapes.sphere(4)
    shaken = even.points + 0.006 * np.random.default_rng(0).normal(size=even.points.shape)  # a tenth of an edge
    points = uneven(shaken / np.linalg.norm(shaken, axis=1, keepdims=True), 3.0)  # nine times as long at one pole
    sphere = Mesh(points, even.faces)
    curvature = meshflow.view.measured(sphere, "curvature").values
    within = float(np.percentile(np.abs(curvature - 1.0), 99))
    print(f"mean curvature of an uneven unit sphere: 99 % of the vertices within {100 * within:.2f} % of 1")
    if picture is not None:
        sample = irregular_mesh(4000, noise=0.0, density=8.0)
        body = meshflow.read(HORSE).data if HORSE.exists() else Mesh(sample.truth, sample.faces)
        bent = meshflow.view.measured(body, "curvature").values
        most, size = float(np.percentile(np.abs(bent), 97)), body.points.max(axis=0) - body.points.min(axis=0)
        middle = 0.5 * (body.points.max(axis=0) + body.points.min(axis=0))
        side = [tuple(middle + size.max() * np.array([2.4, -0.9, 0.5])), tuple(middle), (0, 0, 1)]
        left = render(body, (1000, 900), side, 1.2, scalars=np.abs(bent), clim=(0, most), **PLAIN)
        view, lines = [(3.5, -3.0, 2.5), (0, 0, 0), (0, 0, 1)], {"show_edges": True, "line_width": 0.6}
        right = render(sphere, (1000, 900), view, 1.0, scalars=curvature, clim=(0.9, 1.1), **lines, **PLAIN)
        panels = [
            (f"(a) 0 (blue) to {most:.3g} (red)", left),
            ("(b) unit sphere: 0.9 (blue) to 1.1 (red)", right),
        ]
        page(panels, picture, "Figure 6: magnitude of the mean curvature", columns=2, tall=0.9)
    return within


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
