"""Facts about data: size, spacing, missing samples, area, quality of the triangles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshflow.geometry import operator
from meshflow.geometry.connectivity import boundary_edges
from meshflow.geometry.tetrahedra import Tetrahedra
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import KINDS, Data, data_from
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["describe"]

# The number of samples whose triangles are looked at together.
AT_ONCE = 1 << 19


def describe(data: Data | Array) -> dict[str, Any]:
    """Facts about a data object by name, in reading order; lengths are in the unit of the data.

    An array (h, w) is a height field, an array (h, w, k) an image, with a spacing of 1.

    The area of an image is that of (x, y, channels) at contrast 1; angles are those of triangles between valid samples.

    Example:

        >>> import numpy as np
        >>> from meshflow import HeightField
        >>> describe(HeightField(np.zeros((4, 5)), spacing=10.0))["rows x columns"]
        '4 x 5'

    :param data: a data object, or an array.
    """
    known = data_from(data, KINDS, "describe")
    if isinstance(known, Volume):
        return _of_volume(known)
    if isinstance(known, TetMesh):
        return _of_tetrahedra(known)
    if isinstance(known, Mesh):
        facts, triangles = _of_mesh(known, known.faces), _Triangles.of(known)
    else:
        facts, triangles = _of_grid(known), _Triangles.joined([_Triangles.of(part) for part in _bands(known)])
    return facts | {"triangles": triangles.count, "area": triangles.area} | triangles.quality


@dataclass(frozen=True)
class _Triangles:
    """What is told of triangles.

    :ivar sound: those that have an area; ``smallest``: their smallest angles, degrees, float32.
    """

    count: int
    area: float
    sound: int
    smallest: Array

    @classmethod
    def of(cls, data: Mesh | HeightField | Image | RangeImage) -> "_Triangles":
        """Those of a surface."""
        surface = data.lifted(Lift(diagonals="forward"))
        faces = surface.triangulations[0]
        if surface.charts:
            forms, points = operator.forms(surface.charts[0]), surface.start
        else:
            forms, points = None, surface.points
        cot, area = operator.cotangents(points, faces, forms)
        sound = area > 0
        smallest = np.degrees(np.arctan2(1.0, cot[sound].max(axis=1))) if sound.any() else np.zeros(0)
        return cls(len(faces), float(area.sum()), int(sound.sum()), smallest.astype(np.float32))

    @classmethod
    def joined(cls, parts: "Sequence[_Triangles]") -> "_Triangles":
        """All of them."""
        smallest = np.concatenate([part.smallest for part in parts]) if parts else np.zeros(0, np.float32)
        sums = [sum(getattr(part, name) for part in parts) for name in ("count", "area", "sound")]
        return cls(int(sums[0]), float(sums[1]), int(sums[2]), smallest)

    @property
    def quality(self) -> dict[str, Any]:
        """The number of degenerate triangles, and the smallest angles of the others."""
        facts: dict[str, Any] = {"triangles without area": self.count - self.sound}
        if self.smallest.size:
            least, median = self.smallest.min(), np.median(self.smallest)
            facts["smallest angle"] = f"{least:.3g} degrees (median of the triangles {median:.3g})"
        return facts


def _bands(data: HeightField | Image | RangeImage) -> Iterator[HeightField | Image | RangeImage]:
    """Bands of rows of a grid, which have a row in common: the triangles of all take fifty times its memory."""
    h, w = data.missing.shape
    if isinstance(data, RangeImage) or data.missing.size <= AT_ONCE:
        yield data
        return
    count = -(-(h - 1) // max(1, AT_ONCE // w))
    ends = np.linspace(0, h - 1, count + 1).astype(int)
    for top, bottom in zip(ends[:-1], ends[1:], strict=True):
        rows, (dx, dy) = slice(top, bottom + 1), data.spacing
        own = {"spacing": (dx if np.ndim(dx) == 0 else np.asarray(dx)[rows], dy), "missing": data.missing[rows]}
        if data.missing[rows].all():
            continue
        if isinstance(data, HeightField):
            yield HeightField(data.z[rows], **own)
        else:
            yield Image(data.values[rows], **own)


def _of_grid(data: HeightField | Image | RangeImage) -> dict[str, Any]:
    values = {HeightField: "z", Image: "values", RangeImage: "depth"}[type(data)]
    array = getattr(data, values)
    missing = data.missing
    valid = array[~missing]
    facts: dict[str, Any] = {
        "kind": {HeightField: "height field", Image: "image", RangeImage: "range image"}[type(data)],
        "rows x columns": f"{array.shape[0]} x {array.shape[1]}",
        "type": str(array.dtype),
    }
    if isinstance(data, RangeImage):
        facts["camera"] = data.camera.summary
    else:
        dx, dy = data.spacing
        wide = f"{dx:.6g}" if np.ndim(dx) == 0 else f"{np.min(dx):.6g} to {np.max(dx):.6g} (per row)"
        facts["spacing"] = f"{wide} x {dy:.6g}"
    if isinstance(data, Image):
        facts["channels"] = 1 if array.ndim == 2 else array.shape[2]
    facts["least"], facts["greatest"] = float(valid.min()), float(valid.max())
    gone = int(missing.sum())
    return facts | {"missing": f"{gone} of {missing.size} samples ({gone / missing.size:.1%})"}


def _of_volume(data: Volume) -> dict[str, Any]:
    d, h, w = data.missing.shape
    dz, dy, dx = data.spacing
    there, gone = data.values[~data.missing], int(data.missing.sum())
    return {
        "kind": "volume",
        "slices x rows x columns": f"{d} x {h} x {w}",
        "type": str(data.values.dtype),
        "spacing": f"{dz:.6g} x {dy:.6g} x {dx:.6g}",
        "channels": 1 if data.values.ndim == 3 else data.values.shape[3],
        "least": float(there.min()),
        "greatest": float(there.max()),
        "missing": f"{gone} of {data.missing.size} samples ({gone / data.missing.size:.1%})",
    }


def _of_tetrahedra(data: TetMesh) -> dict[str, Any]:
    there, gone = data.values[~data.missing], int(data.missing.sum())
    volumes = Tetrahedra.of(data.points, data.tetrahedra).volumes
    return {
        "kind": "tetrahedra",
        "points": len(data.points),
        "type": str(data.values.dtype),
        "extent": " x ".join(f"{size:.6g}" for size in np.ptp(data.points, axis=0)),
        "mean edge": data.step,
        "channels": 1 if data.values.ndim == 1 else data.values.shape[1],
        "least": float(there.min()),
        "greatest": float(there.max()),
        "missing": f"{gone} of {data.missing.size} vertices ({gone / data.missing.size:.1%})",
        "tetrahedra": len(volumes),
        "volume": float(volumes.sum()),
        "tetrahedra without volume": int((volumes <= 0).sum()),
    }


def _of_mesh(data: Mesh, faces: Array) -> dict[str, Any]:
    edges = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)
    low, high = data.points.min(axis=0), data.points.max(axis=0)
    return {
        "kind": "mesh",
        "points": len(data.points),
        "type": str(data.points.dtype),
        "extent": " x ".join(f"{size:.6g}" for size in high - low),
        "mean edge": data.step,
        "channels": 0 if data.channels is None else data.channels.shape[1],
        "isolated points": int(len(data.points) - len(np.unique(faces))),
        "boundary edges": len(boundary_edges(faces)),
        "non-manifold edges": int((uses > 2).sum()),
    }
