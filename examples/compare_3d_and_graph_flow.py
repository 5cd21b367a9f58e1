"""A noisy terrain as a mesh: curvature flow of its points in space, and the flows of its heights alone, for the same times.

The noise of a height field is vertical. The flow in space moves points sideways, too, where the surface is steep or rough; that
of the graph is the same motion of the shape, and errs alike; the Beltrami flow keeps what is steep. Errors are those at the
samples. ``python examples/compare_3d_and_graph_flow.py [PICTURE.png]``
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from scipy.interpolate import LinearNDInterpolator

import meshflow
from meshflow.flow.methods import Beltrami
from meshflow.view.look import looking
from meshflow.view.scene import of_one

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page

TIMES, DATA = (25.0, 50.0, 200.0, 100.0), Path(__file__).resolve().parents[1] / "data"  # m²; the last one is drawn


def main(picture: Path | None = None) -> tuple[float, float]:
    """The least rms errors, metres, of the flow in space and of the flow of the heights, over four times."""
    terrain = meshflow.read(DATA / "terrain.tif").data
    truth, there = meshflow.read(DATA / "terrain_truth.tif").data.z, ~terrain.missing
    surface = terrain.lifted(meshflow.Lift(diagonals="forward"))
    free = meshflow.Surface(surface.points, surface.triangulations, fixed=~there.ravel(), boundary="plane-preserving")
    flow, used, errors = meshflow.MeshFlow(free), np.unique(surface.triangulations[0]), []
    for time in TIMES:
        *_, end = meshflow.march(flow, meshflow.Until(time=time))
        back = LinearNDInterpolator(end.u[used, :2], end.u[used, 2])(surface.points[:, :2]).reshape(truth.shape)
        ways = [back, *(meshflow.smooth(terrain, method=Beltrami(gamma=g, contrast=1.0), time=time).z for g in (-2, 0))]
        errors.append([float(np.sqrt(np.nanmean((z - truth)[there] ** 2))) for z in ways])
        print(f"{time:4.0f} m², in space | graph | Beltrami: {' | '.join(f'{error:.3f}' for error in errors[-1])} m")
    if picture is not None:
        words = ("points move in space", "heights move alone: graph flow", "heights move alone: Beltrami")
        titles = ["noisy", *(f"{w}, {error:.2f} m" for w, error in zip(words, errors[-1], strict=True)), "the truth"]
        fields = [replace(terrain, z=z, missing=~there | ~np.isfinite(z)) for z in (terrain.z, *ways, truth)]
        look = looking(altitude=25, renderer="hillshade")
        panels = [(word, of_one(f, look).picture(0, (900, 900))) for word, f in zip(titles, fields, strict=True)]
        aside = np.linalg.norm((end.u - surface.points)[:, :2], axis=1).reshape(truth.shape)
        most = float(np.quantile(aside[there], 0.99))
        drift = (colormaps["viridis"](np.clip(aside / most, 0, 1))[..., :3] * 255).astype(np.uint8)
        drift[~there] = 255
        panels.append((f"how far points in space went sideways: 0 to {most:.1f} m", drift))
        page(panels, picture, f"A noisy terrain at time {TIMES[-1]:g} m²", columns=3, tall=1.0)
    return tuple(np.min(errors, axis=0)[[0, 2]].tolist())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
