"""Data as geometry in space: triangles, colours, and the view. It needs numpy only, except for the conversion to VTK."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, SurfaceData, on_surface
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.triangles import grid_triangulations, triangles_there
from meshflow.view.look import Look, Seen, View, camera_view, mesh_view, picture_view, side_view, terrain_view
from meshflow.view.texture import Texture, Textured

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["SAMPLES", "Geometry", "as_shown", "drawable", "geometry_of", "raised", "thinned"]

SAMPLES = 1000  # per side: more than a panel has pixels
_RELIEF = 0.15  # height of a relief over its width, for the automatic exaggeration
_FORWARD = Lift(diagonals="forward")  # one diagonal per cell, so that each cell is drawn once


@dataclass(frozen=True, eq=False)
class Geometry:
    """Triangles in space, and their view.

    :param points: (n, 3), those used by triangles.
    :param faces: (m, 3).
    :param samples: (n,), the index of each point among the samples or vertices of the data object.
    :param view: the position of the viewer.
    :param colours: (n, 3), its own colours in uint8, if any.
    :param triangles: (m,), the index of each triangle in the data object; None: they are the same.
    :param texture: of its triangles, if any; its colours are then those of the texture at the points.
    :param normals: (m, 3), the unit normals by which triangles are shaded; None: their own.
    """

    points: Array
    faces: Array
    samples: Array
    view: View
    colours: Array | None = None
    triangles: Array | None = None
    texture: Texture | None = None
    normals: Array | None = None

    @property
    def corners(self) -> Array:
        """The corners (3 m, 3) of the triangles in order, as a texture with seams needs them."""
        return self.points[self.faces].reshape(-1, 3)

    def polydata(self) -> "pv.PolyData":
        """The geometry for VTK, without normals of points, so that shading is flat and noise is visible."""
        import pyvista as pv

        shape = pv.PolyData.from_regular_faces(np.ascontiguousarray(self.points, dtype=np.float64), self.faces)
        if self.normals is not None:
            shape.cell_data.active_normals = self.normals
        return shape

    def textured(self, texture: Texture) -> "pv.PolyData":
        """The geometry with texture coordinates; each corner is a separate point."""
        import pyvista as pv

        corners = np.ascontiguousarray(self.corners, dtype=np.float64)
        shape = pv.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3))
        shape.active_texture_coordinates = texture.corners.reshape(-1, 2)
        return shape


def drawable(data: Data, look: Look, most: int = SAMPLES) -> tuple[int, float, tuple[str, ...]]:
    """The thinning and the exaggeration of all panels, and notes on both.

    :param most: the largest number of samples per side that are drawn.
    :raises InputError: for an exaggeration of data without heights, and ``up`` of data that is no mesh.
    """
    if look.exaggeration is not None and not isinstance(data, HeightField):
        raise InputError(f"exaggeration: of height fields only, this is a {type(data).__name__}; leave it out")
    if look.up is not None and not isinstance(data, Mesh):
        raise InputError(f"up: of meshes only, this is a {type(data).__name__}; leave it out")
    step = _thinning(data, most)
    notes = [f"every {step}{'nd' if step == 2 else 'rd' if step == 3 else 'th'} sample"] if step > 1 else []
    exaggeration = 1.0
    if isinstance(data, HeightField):
        exaggeration = _exaggeration(data) if look.exaggeration is None else float(look.exaggeration)
        notes.append(f"heights × {exaggeration:g}")
    if isinstance(data, Mesh) and data.points.shape[1] > 3:
        notes.append(f"the first 3 of {data.points.shape[1]} coordinates")
    return step, exaggeration, tuple(notes)


def geometry_of(
    data: Data,
    look: Look,
    step: int = 1,
    exaggeration: float = 1.0,
    shown: Callable[[Array], Array] | None = None,
) -> Geometry:
    """The triangles of data, their colours, and their view.

    :param look: its side, its axis that is up, and whether channels of a mesh are its colours; images that are seen from the
        side are :func:`raised` before.
    :param step: take every ``step``-th sample of a grid.
    :param exaggeration: factor on the heights of a height field.
    :param shown: for an image, its channels as colours: :func:`as_shown`.
    :raises InputError: when there is no triangle to draw.
    """
    seen, data, normals = look.seen, on_surface(data, "triangles"), None
    if isinstance(data, Mesh):
        points, faces, colours = _three(data.points), data.faces, _mesh_colours(data, look.own_colours)
        view = mesh_view(points, look.up, seen)
    elif isinstance(data, Image):
        points, faces, colours = _flat(data, step, shown or as_shown(data))
        view = picture_view()
    else:
        surface = thinned(data, step).lifted(_FORWARD)
        points, faces, colours = surface.points, surface.triangulations[0], None
        if isinstance(data, HeightField):
            points = points * (1.0, 1.0, exaggeration)
            view = picture_view() if seen == "front" else terrain_view()
        else:
            view = side_view() if seen == "side" else camera_view()
        normals = _of_cells(points, faces, -(-data.missing.shape[1] // step))
    if len(faces) == 0:
        what = type(data).__name__
        raise InputError(f"nothing to draw: no triangle of the {what} has all three corners, too much is missing")
    used = np.zeros(len(points), bool)
    used[faces] = True
    samples, place = np.flatnonzero(used), np.cumsum(used) - 1
    texture = data.texture if look.own_colours and isinstance(data, Textured) else None
    own = None if colours is None else colours[samples]
    return Geometry(points[samples], place[faces], samples, view, own, texture=texture, normals=normals)


def _of_cells(points: Array, faces: Array, width: int) -> Array:
    """Unit normals (m, 3) of the cells of a grid to which triangles belong, the same for both triangles of a cell.

    By the normals of its triangles, the diagonal of each cell would show as a hatch on steep slopes.

    :param width: the number of samples in a row.
    """
    corner = points[faces]
    areas = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    row, column = np.divmod(faces, width)
    cell = row.min(axis=1, initial=len(points)) * width + column.min(axis=1, initial=width)
    normals = np.stack([np.bincount(cell, weights=area, minlength=1)[cell] for area in areas.T], axis=1)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)


def raised(data: Data, seen: Seen | None) -> Data:
    """Data for a view from the side: an image as heights of its brightness (the mean of the channels); other data unchanged."""
    if seen != "side" or not isinstance(data, Image):
        return data
    values = data.values if data.values.ndim == 2 else data.values.mean(axis=2)
    return HeightField(values, data.spacing, data.missing)


def _thinning(data: Data, most: int) -> int:
    """The step between drawn samples, so that a side has at most ``most``; 1 for a mesh."""
    return 1 if isinstance(data, Mesh) else -(-max(data.missing.shape) // most)


def as_shown(*images: Image) -> Callable[[Array], Array]:
    """A function from channels (..., k) to colours (..., 3) in uint8, the same for all these images.

    Three and four channels are red, green, blue; for any other number the mean is shown. Ranges from 0 to 1, 255 or
    65535 are recognized; any other range runs from black to white.
    """
    values = np.concatenate([image.values[~image.missing].ravel() for image in images])
    low, high = (float(v) for v in np.percentile(values, (1, 99)))
    black, white = low, high if high > low else low + 1.0
    for full in (1.0, 255.0, 65535.0):
        if full / 4 <= high <= full * 1.1 and low >= -0.1 * full:
            black, white = 0.0, full
            break

    def shown(channels: Array) -> Array:
        """Channels (..., k) as colours (..., 3)."""
        coloured = channels.shape[-1] in (3, 4)
        three = channels[..., :3] if coloured else np.repeat(channels.mean(axis=-1, keepdims=True), 3, axis=-1)
        bright = np.clip((np.nan_to_num(three, nan=black) - black) / (white - black), 0, 1)
        return np.round(255 * bright).astype(np.uint8)

    return shown


def thinned(data: Data, step: int) -> SurfaceData:
    """Every ``step``-th sample of a grid, in the same place; a mesh unchanged."""
    data = on_surface(data, "pictures of samples")
    if step == 1 or isinstance(data, Mesh):
        return data
    every = (slice(None, None, step),) * 2
    missing = data.missing[every]
    if not isinstance(data, RangeImage):
        dx, dy = data.spacing
        dx = dx * step if np.ndim(dx) == 0 else np.asarray(dx)[::step] * step
        if isinstance(data, Image):
            return replace(data, values=data.values[every], spacing=(dx, dy * step), missing=missing, fixed=None)
        cuts = None if data.cuts is None else _thinned_cuts(data.cuts, step)
        return replace(data, z=data.z[every], spacing=(dx, dy * step), missing=missing, fixed=None, cuts=cuts)
    camera = data.camera.thinned(step, data.depth.shape)
    sigma = data.sigma[every] if isinstance(data.sigma, np.ndarray) and data.sigma.ndim else data.sigma
    return replace(data, depth=data.depth[every], camera=camera, missing=missing, fixed=None, sigma=sigma)


def _thinned_cuts(cuts: Cuts, step: int) -> Cuts:
    """Edges between every ``step``-th sample; cut where any of the edges in between is cut."""

    def of_rows(edges: Array) -> Array:
        """Edges along rows; cut where any of the edges in between is cut."""
        edges = edges[::step]
        count = edges.shape[1] // step
        return np.logical_or.reduce(edges[:, : count * step].reshape(len(edges), count, step), axis=2)

    return Cuts(of_rows(cuts.right), of_rows(cuts.down.T).T)


def _exaggeration(field: HeightField) -> float:
    """A round factor (1, 2 or 5 times a power of ten) that makes the relief about a seventh as high as wide."""
    low, high = np.percentile(field.z[~field.missing], (1, 99))
    h, w = field.z.shape
    width = np.sqrt(h * field.spacing[1] * w * np.mean(field.spacing[0]))
    if high <= low:
        return 1.0
    factor = _RELIEF * width / (float(high) - float(low))
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(digit for digit in (1, 2, 5) if digit <= factor / power * (1 + 1e-9)))


def _flat(image: Image, step: int, shown: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
    """An image as a flat sheet with a colour at each sample: points, faces, colours."""
    every = (slice(None, None, step),) * 2
    missing, values = image.missing[every], image.values[every]
    rows, columns = np.mgrid[0 : missing.shape[0], 0 : missing.shape[1]]
    width = float(np.mean(image.spacing[0]))
    points = np.stack([columns.ravel() * width, -rows.ravel() * image.spacing[1], np.zeros(missing.size)], axis=1)
    return points, grid_triangulations(triangles_there(missing), "forward")[0], shown(values.reshape(missing.size, -1))


def _three(points: Array) -> Array:
    """Points (n, d) in space: a third coordinate is added to two; of more than three the first three are taken."""
    flat = points[:, :3].astype(np.float64)
    return flat if flat.shape[1] == 3 else np.column_stack([flat, np.zeros(len(flat))])


def _mesh_colours(mesh: Mesh, own: bool) -> Array | None:
    """Channels as colours, without opacity, where they move or are requested, and are red, green, blue from 0 to 255."""
    if (mesh.moves == "points" and not own) or mesh.channels is None or mesh.channels.shape[1] not in (3, 4):
        return None
    low, high = np.percentile(mesh.channels, (1, 99))
    if not own and (low < -25 or not 1 < high <= 280):  # noise may exceed the range of a byte
        return None
    bright = mesh.channels[:, :3] * (255.0 if own and high <= 1 else 1.0)
    return np.clip(np.round(bright), 0, 255).astype(np.uint8)
