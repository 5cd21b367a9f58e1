"""Figure 9 of the paper: a head from a noisy range image, smoothed along the lines of sight, flat shaded.

``python examples/paper_9_head.py [PICTURE.png]``; the scan is a sample of pymeshlab (``pip install pymeshlab``), noise is added.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import meshflow
from meshflow.surfaces.mesh import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page, render

NOISE = 0.5  # mm


def scan() -> Path | None:
    """The range map of a face; None where pymeshlab is not installed."""
    package = find_spec("pymeshlab")
    if package is None or package.origin is None:
        return None
    path = Path(package.origin).parent / "tests" / "sample_meshes" / "rangemaps" / "face000.ply"
    return path if path.exists() else None


def main(picture: Path | None = None) -> float:
    """The rms error along the lines of sight after over that before, of noise that was added."""
    path = scan()
    if path is None:
        print("pymeshlab is not installed: skipped")
        return 0.0
    head = meshflow.read(path).data
    toward = np.array([0.0, 0.0, 1.0])  # the scanner looked along z
    errors = NOISE * np.random.default_rng(0).normal(size=(len(head.points), 1))
    noisy = Mesh(head.points + errors * toward, head.faces, errors, moves="points")
    depth = Mesh(head.points * (1, 1, 0), head.faces, noisy.points[:, 2:])  # z moves, above x and y
    moved = meshflow.smooth(depth, method="beltrami")
    smoothed = Mesh(np.column_stack([head.points[:, :2], moved.channels]), head.faces)
    before, after = (float(np.sqrt(np.mean((mesh.points - head.points)[:, 2] ** 2))) for mesh in (noisy, smoothed))
    print(f"head: rms error along the lines of sight {before:.2f} mm before, {after:.2f} mm after")
    if picture is not None:
        middle = head.points.mean(axis=0)
        seen = [tuple(middle + (140.0, 30.0, 420.0)), tuple(middle), (0, 1, 0)]
        panels = [
            (f"({a}) {words}", render(mesh, (900, 1050), seen, 1.25))
            for a, words, mesh in (("a", "noisy depths", noisy), ("b", "denoised, flat shaded", smoothed))
        ]
        page(panels, picture, "Figure 9: a head", columns=2, tall=1050 / 900)
    return after / before


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
