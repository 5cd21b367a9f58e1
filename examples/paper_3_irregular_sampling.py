"""Figure 3 of the paper: an irregularly sampled mesh, smoothed by uniform weights and by cotangents.

Uniform weights take the mesh for regular, so vertices slide until it is: triangles lose their shapes, and with them whatever was
drawn on the surface. Cotangents know where the vertices lie, and move the shape alone.

``python examples/paper_3_irregular_sampling.py [PICTURE.png]``
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view
from meshflow.estimate.constraints import PreserveVolume
from meshflow.flow.methods import Fairing
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.samples import irregular_mesh


def slide(mesh: Mesh, before: Mesh) -> float:
    """How far vertices went along the surface, rms, in mean edges."""
    motion = mesh.points - before.points
    along = motion - np.einsum("nd,nd->n", motion, before.normals)[:, None] * before.normals
    return float(np.sqrt(np.mean(along**2)) / before.step)


def main(picture: Path | None = None) -> float:
    """How far vertices slide with cotangents, over how far with uniform weights."""
    sample = irregular_mesh(3000, noise=0.01, density=12.0)
    noisy, clean = Mesh(sample.noisy, sample.faces), Mesh(sample.truth, sample.faces)

    uniform, cotangent = (
        meshflow.smooth(
            noisy, method=Fairing(order=1, weights=weights), time=2.0 * noisy.step**2, constraints=PreserveVolume()
        )
        for weights in ("uniform", "cotangent")
    )

    drifts = [slide(mesh, clean) for mesh in (uniform, cotangent)]
    print(f"vertices slide by {drifts[0]:.2f} edges with uniform weights, {drifts[1]:.2f} with cotangents")
    if picture is not None:
        meshflow.view.compare(
            uniform,
            cotangent,
            picture,
            quantity="triangles",
            labels=("uniform weights", "cotangents"),
            size=(1400, 1000),
            overwrite=True,
        )
    return drifts[1] / drifts[0]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
