"""Figure 3 of the paper: vertices of an irregular mesh slide under uniform weights, and hardly under mean curvature flow.

``python examples/paper_3_irregular_sampling.py [PICTURE.png]``
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
from meshflow.estimate.constraints import PreserveVolume
from meshflow.flow.methods import ImplicitFairing
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.samples import irregular_mesh

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page, render

VIEWS = ((0.0, 0.0, 0.0), 1.4), ((0.35, -0.1, 0.55), 3.4)  # the whole, and a close-up of the flat face
OPERATORS = {"umbrella": "(b) uniform weights", "curvature": "(c) mean curvature flow"}


def slid(mesh: Mesh, before: Mesh) -> np.ndarray:
    """How far each vertex (n,) went along the surface, in mean edges."""
    motion = mesh.points - before.points
    along = motion - np.einsum("nd,nd->n", motion, before.normals)[:, None] * before.normals
    return np.linalg.norm(along, axis=1) / before.step


def main(picture: Path | None = None) -> float:
    """How far vertices slide, rms, with cotangents, over how far with uniform weights."""
    sample = irregular_mesh(3000, noise=0.01, density=12.0)
    noisy, clean = Mesh(sample.noisy, sample.faces), Mesh(sample.truth, sample.faces)
    smooth = {
        operator: meshflow.smooth(
            noisy, method=ImplicitFairing(operator=operator), time=3.0 * noisy.step**2, constraints=PreserveVolume()
        )
        for operator in OPERATORS
    }
    drift = {operator: slid(mesh, clean) for operator, mesh in smooth.items()}
    rms = {operator: float(np.sqrt(np.mean(far**2))) for operator, far in drift.items()}
    print(f"vertices slide by {rms['umbrella']:.2f} edges with uniform weights, {rms['curvature']:.2f} with cotangents")
    if picture is not None:
        lines = {"show_edges": True, "edge_color": "#33373b", "line_width": 1.2}
        panels = []
        for at, near in VIEWS:
            view = [(2.6 + at[0], -3.4 + at[1], 3.6 + at[2]), at, (0, 0, 1)]
            panels.append(("(a) initial mesh", render(noisy, (900, 900), view, near, **lines)))
            for operator, label in OPERATORS.items():
                colours = {"scalars": drift[operator], "clim": (0, 1), "cmap": "YlOrRd", "show_scalar_bar": False}
                drawn = render(smooth[operator], (900, 900), view, near, **lines, **colours)
                panels.append((f"{label}: vertices slid by {rms[operator]:.2f} edges", drawn))
        page(panels, picture, "Figure 3: what slid along the surface, from 0 (pale) to 1 mean edge (dark red)")
    return rms["curvature"] / rms["umbrella"]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
