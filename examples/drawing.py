"""Panels side by side, for the figures: pictures with a label each, renders of meshes, reliefs of grids."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

INK, FAINT = "#26282b", "#6b7075"


def page(panels: Sequence[tuple[str, np.ndarray]], path: Path, title: str, columns: int = 3, tall: float = 1.0) -> None:
    """Write a picture, 1400 pixels wide, of panels (label, colours (h, w, 3)); ``tall``: height over width of each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, gap, head, label = -(-len(panels) // columns), 0.12, 0.5, 0.32
    wide = (14.0 - gap * (columns + 1)) / columns
    height = head + rows * (wide * tall + label + gap)
    figure = Figure(figsize=(14.0, height), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    figure.text(gap / 14, 1 - 0.5 * head / height, title, fontsize=15, color=INK, va="center")
    for i, (words, colours) in enumerate(panels):
        x = gap + (i % columns) * (wide + gap)
        y = height - head - (i // columns) * (wide * tall + label + gap) - label
        figure.text(x / 14, (y + 0.09) / height, words, fontsize=11.5, color=FAINT)
        axes = figure.add_axes((x / 14, (y - wide * tall) / height, wide / 14, wide * tall / height))
        grey = {"cmap": "gray", "vmin": 0, "vmax": 255} if colours.ndim == 2 else {}
        colours = colours if colours.dtype == np.uint8 or colours.ndim == 2 else np.clip(colours / 255.0, 0, 1)
        axes.imshow(colours, aspect="equal", interpolation="lanczos" if colours.shape[0] > 300 else "nearest", **grey)
        axes.set_axis_off()
    figure.savefig(path, dpi=100)


def render(
    mesh: object, size: tuple[int, int], camera: Sequence[Sequence[float]] | str, zoom: float = 1.0, **look: object
) -> np.ndarray:
    """A mesh of meshflow, flat shaded by VTK; ``look``: as ``pyvista.Plotter.add_mesh`` takes it."""
    import pyvista as pv

    drawn = pv.PolyData.from_regular_faces(np.asarray(mesh.points, float), np.asarray(mesh.faces))
    plotter = pv.Plotter(off_screen=True, window_size=size)
    plotter.set_background("white")
    arrows = look.pop("arrows", None)
    plotter.add_mesh(drawn, **{"color": "#e4ded3", "smooth_shading": False, **look})
    if arrows is not None:
        plotter.add_mesh(arrows, color="#26282b")
    plotter.camera_position = camera
    plotter.camera.zoom(zoom)
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(picture)


def cropped(whole: np.ndarray, rim: float = 0.04) -> np.ndarray:
    """The part of a picture that is not white, without a share of it on each side."""
    seen = [np.flatnonzero((whole < 250).any(axis=(1 - axis, 2)))[[0, -1]] for axis in (0, 1)]
    rows, columns = (slice(round((1 - rim) * a + rim * b), round(rim * a + (1 - rim) * b)) for a, b in seen)
    return whole[rows, columns]
