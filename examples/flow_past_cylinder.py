"""Anisotropic diffusion of noise along a vector field [PR99]: the flow past a cylinder at a Reynolds number of 35.

``python examples/flow_past_cylinder.py [PICTURE.png]``; the field is in ``../shared/data``, and nothing is drawn without it.
"""

import sys
from pathlib import Path

import numpy as np

from meshflow.classics import field_diffusion

sys.path.insert(0, str(Path(__file__).parent))
from drawing import cropped, page

FIELD = Path(__file__).resolve().parents[2] / "shared" / "data" / "fields" / "cylinder_Re35" / "cylinder_Re35.case"
WINDOW = (1.6, 7.4, -1.5, 1.5)


def main(picture: Path | None = None, finer: int = 3) -> float:
    """How many times more the stripes vary across the flow than along it, on a mesh that is halved so often."""
    if not FIELD.exists():
        print(f"{FIELD.name} is not there: skipped")
        return np.inf
    import pyvista as pv

    grid = pv.get_reader(str(FIELD)).read()[0]
    faces = grid.extract_surface(algorithm=None).triangulate()
    # The mesh is coarse where nothing happens: a fine one takes the field from it.
    x, y, _ = faces.cell_centers().points.T
    inside = (x > WINDOW[0]) & (x < WINDOW[1]) & (y > WINDOW[2]) & (y < WINDOW[3])
    mesh = faces.extract_cells(inside).extract_surface(algorithm=None).triangulate().subdivide(finer)
    points, triangles = np.asarray(mesh.points)[:, :2], mesh.regular_faces
    velocity = np.asarray(mesh.sample(grid)["velocity"])[:, :2]
    stripes = field_diffusion(points, triangles, velocity, time=200.0, steps=8)

    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    way = points[ends[:, 1]] - points[ends[:, 0]]
    flow, speed = velocity[ends].mean(axis=1), np.linalg.norm(velocity, axis=1)
    fast = np.linalg.norm(flow, axis=1) > 0.001 * speed.max()
    along, with_flow = np.linalg.norm(way, axis=1), np.maximum(np.linalg.norm(flow, axis=1), 1e-9)
    cosine = np.abs((way * flow).sum(axis=1)) / along / with_flow
    rough = np.abs(stripes[ends[:, 1]] - stripes[ends[:, 0]]) / along
    share = float(rough[fast & (cosine < 0.2)].mean() / rough[fast & (cosine > 0.98)].mean())
    print(f"{len(points)} vertices: stripes vary {share:.1f} times more across the flow than along it")
    if picture is not None:
        plotter = pv.Plotter(off_screen=True, window_size=(2640, 1350))
        shade = pv.plotting.colors.get_cmap_safe("viridis")(speed / speed.max())[:, :3]
        colours = np.clip(shade * (0.35 + 0.95 * stripes[:, None]), 0, 1)
        plotter.add_mesh(mesh, scalars=(255 * colours).astype(np.uint8), rgb=True, lighting=False)
        plotter.view_xy()
        inner = cropped(np.asarray(plotter.screenshot(return_img=True)))  # without its ragged rim
        tall = len(inner) / inner.shape[1]
        page([("stripes along the flow; colour: speed", inner)], picture, "Flow past a cylinder [PR99]", 1, tall)
    return share


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
