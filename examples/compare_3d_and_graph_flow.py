"""A noisy terrain as a mesh: full curvature flow in space, and the flows of its heights alone, for the same times.

The noise of a height field is vertical. The flow in space moves the points sideways, too, where the surface is steep or rough;
the flow of the graph knows which direction is free. Both are measured at the same places: the surface that moved in space is
interpolated back to the samples of the grid. The graph flow is the same motion of the shape, so it errs alike; the Beltrami flow
keeps what is steep.
"""

from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator

import meshflow
from meshflow.flow.methods import Beltrami

DATA = Path(__file__).resolve().parents[1] / "data"


def rms(z: np.ndarray, truth: np.ndarray, there: np.ndarray) -> float:
    """Root mean square error, metres, where there is a sample."""
    there = there & np.isfinite(z)
    return float(np.sqrt(np.mean((z - truth)[there] ** 2)))


def main() -> tuple[float, float]:
    """The least rms errors, metres, of the flow in space and of the flow of the heights, over four times."""
    terrain = meshflow.read(DATA / "terrain.tif").data
    truth, there = meshflow.read(DATA / "terrain_truth.tif").data.z, ~terrain.missing
    surface = terrain.lifted(meshflow.Lift(diagonals="forward"))
    in_space = meshflow.Surface(
        surface.points, surface.triangulations, fixed=terrain.missing.ravel(), boundary="plane-preserving"
    )
    flow, used = meshflow.MeshFlow(in_space), np.unique(surface.triangulations[0])

    print(f"rms error before {rms(terrain.z, truth, there):.2f} m; after, in space | of the graph | Beltrami:")
    errors = []
    for time in (25.0, 50.0, 100.0, 200.0):  # m^2; the samples are 10 m apart
        *_, end = meshflow.march(flow, meshflow.Until(time=time))
        back = LinearNDInterpolator(end.u[used, :2], end.u[used, 2])(surface.points[:, :2]).reshape(truth.shape)
        graph, beltrami = (
            meshflow.smooth(terrain, method=Beltrami(gamma=g, contrast=1.0), time=time).z for g in (-2.0, 0.0)
        )
        errors.append([rms(z, truth, there) for z in (back, graph, beltrami)])
        print(f"{time:4.0f} m²: {errors[-1][0]:.3f} | {errors[-1][1]:.3f} | {errors[-1][2]:.3f} m")
    space, _, heights = np.min(errors, axis=0)
    return float(space), float(heights)


if __name__ == "__main__":
    main()
