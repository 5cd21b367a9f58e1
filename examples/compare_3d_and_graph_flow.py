"""A noisy terrain as a mesh: full curvature flow in space, and the flows of its heights alone, for the same times.

The noise of a height field is vertical. The flow in space moves the points sideways, too, where the surface is steep or rough;
the flow of the graph knows which direction is free. Both are measured at the same places: the surface that moved in space is
interpolated back to the samples of the grid. The graph flow is the same motion of the shape, so it errs alike; the Beltrami flow
keeps what is steep.

``python examples/compare_3d_and_graph_flow.py [PICTURE.png]``
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from scipy.interpolate import LinearNDInterpolator

import meshflow
from meshflow.flow.methods import Beltrami
from meshflow.surfaces.height_field import HeightField
from meshflow.view.look import looking
from meshflow.view.scene import of_one

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page

# The times, m²; the samples are 10 m apart. The third one is drawn.
TIMES, DRAWN = (25.0, 50.0, 100.0, 200.0), 2
DATA = Path(__file__).resolve().parents[1] / "data"


def rms(z: np.ndarray, truth: np.ndarray, there: np.ndarray) -> float:
    """Root mean square error, metres, where there is a sample."""
    there = there & np.isfinite(z)
    return float(np.sqrt(np.mean((z - truth)[there] ** 2)))


def in_space(terrain: HeightField) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Heights (h, w) of the surface that moved in space, at the samples, and how far each point went sideways; per time."""
    surface = terrain.lifted(meshflow.Lift(diagonals="forward"))
    free = meshflow.Surface(
        surface.points, surface.triangulations, fixed=terrain.missing.ravel(), boundary="plane-preserving"
    )
    flow, used = meshflow.MeshFlow(free), np.unique(surface.triangulations[0])
    heights, sideways = [], []
    for time in TIMES:
        *_, end = meshflow.march(flow, meshflow.Until(time=time))
        moved = LinearNDInterpolator(end.u[used, :2], end.u[used, 2])(surface.points[:, :2])
        heights.append(moved.reshape(terrain.z.shape))
        sideways.append(np.linalg.norm((end.u - surface.points)[:, :2], axis=1).reshape(terrain.z.shape))
    return heights, sideways


def main(picture: Path | None = None) -> tuple[float, float]:
    """The least rms errors, metres, of the flow in space and of the flow of the heights, over four times."""
    terrain = meshflow.read(DATA / "terrain.tif").data
    truth, there = meshflow.read(DATA / "terrain_truth.tif").data.z, ~terrain.missing
    space, sideways = in_space(terrain)
    graph, beltrami = (
        [meshflow.smooth(terrain, method=Beltrami(gamma=g, contrast=1.0), time=time).z for time in TIMES]
        for g in (-2.0, 0.0)
    )
    errors = np.array([[rms(z, truth, there) for z in ways] for ways in zip(space, graph, beltrami, strict=True)])
    print(f"rms error before {rms(terrain.z, truth, there):.2f} m; after, in space | of the graph | Beltrami:")
    for time, row in zip(TIMES, errors, strict=True):
        print(f"{time:4.0f} m²: {row[0]:.3f} | {row[1]:.3f} | {row[2]:.3f} m")
    if picture is not None:
        draw(picture, terrain, (space[DRAWN], graph[DRAWN], beltrami[DRAWN], truth), errors[DRAWN], sideways[DRAWN])
    least = errors.min(axis=0)
    return float(least[0]), float(least[2])


def draw(
    path: Path, terrain: HeightField, heights: tuple[np.ndarray, ...], errors: np.ndarray, sideways: np.ndarray
) -> None:
    """Hillshades of the terrain and of what each flow made of it, and the sideways motion in colours."""
    look = looking(altitude=25, renderer="hillshade")
    fields = [terrain, *(replace(terrain, z=z, missing=terrain.missing | ~np.isfinite(z)) for z in heights)]
    shades = [of_one(field, look).picture(0, (900, 900)) for field in fields]
    most = float(np.quantile(sideways[~terrain.missing], 0.99))
    drift = colormaps["viridis"](np.clip(sideways / most, 0, 1))[..., :3] * 255
    drift[terrain.missing] = 255
    labels = [
        "noisy",
        f"points move in space, rms error {errors[0]:.2f} m",
        f"heights move alone: graph flow, {errors[1]:.2f} m",
        f"heights move alone: Beltrami, {errors[2]:.2f} m",
        "the truth",
        f"how far points in space went sideways: 0 to {most:.1f} m",
    ]
    size = shades[0].shape[0] / shades[0].shape[1]
    panels = list(zip(labels, [*shades, drift.astype(np.uint8)], strict=True))
    page(panels, path, f"A noisy terrain at time {TIMES[DRAWN]:g} m²", columns=3, tall=size)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
