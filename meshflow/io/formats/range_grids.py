"""Scans on a grid: the range_grid of Stanford's PLY, and range maps of VCG (MeshLab) with a camera element.

Each point moves along its line of sight; the file is written with the same bytes around new positions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.errors import Fact, FormatError, InputError
from meshflow.geometry.validation import Array, number
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions, depths_of
from meshflow.io.formats.ply_layout import PlyBytes, loaded
from meshflow.io.formats.scan_points import range_image_of
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.range_image import RangeImage

__all__ = ["can_write", "read", "write"]

NAME: str = "a range grid"
READS: tuple[str, ...] = ("kind", "viewpoint", "jump", "time_unit")
WRITES: tuple[str, ...] = ()

# The largest number of cells per vertex at which the pixels of a camera element can belong to the points.
SPARSE = 64


@dataclass(frozen=True, eq=False)
class Scan(Source):
    """A PLY that was read.

    :param file: its bytes.
    :param index: (h, w), the vertex of each sample, -1 where there is none.
    :param start: (h, w), the values as they were read.
    """

    file: PlyBytes
    index: Array
    start: Array


def read(path: Path, options: ReadOptions) -> Document:
    """Read a scan as a range image of a :class:`Scanner`, in the unit of the points.

    With a viewpoint (given, from ``obj_info viewpoint x y z``, or from the camera element of VCG) values are distances from it.
    Without one, lines of sight are parallel to z, seen from above as by a Cyberware scanner, and values are -z.

    :param options: ``viewpoint`` (x, y, z), the position of the scanner in the frame of the points; ``jump`` as in
        :class:`RangeImage`, where a share needs a viewpoint; ``time_unit``.
    :raises FormatError: for a damaged file, and a file without a range grid or a camera that locates its points.
    :raises InputError: for another kind, or a viewpoint that is not finite or is a point of the scan.
    """
    if options.kind not in (None, "depth"):
        raise InputError(f"{path.name}: a range grid is a depth image, got kind={options.kind!r}; leave it out")
    file = loaded(path)
    index = _by_grid(path, file, file.grid) if file.grid is not None else _by_camera(path, file)
    if not (index >= 0).any():
        raise FormatError(f"{path.name}: none of the {index.size} cells of the grid has a point; is it whole?")
    eye, how = _viewpoint(path, file, options.viewpoint)
    points = np.where((index >= 0)[..., None], file.points[index], np.nan)
    data = range_image_of(points, eye, options, path.name)
    return Document(data, path, Scan(file, index, data.depth), (how,))


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a range image and the file a PLY."""
    return isinstance(document.data, RangeImage) and suffix == ".ply"


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write a PLY range grid: a scan that was read with the same bytes around new positions, other range images as float.

    :param options: tags are kept as comments.
    :raises FormatError: when the file cannot be written.
    :raises InputError: for data that is no range image.
    """
    tags = {name.removeprefix("meshflow:"): word for name, word in options.tags.items()}
    data = depths_of(document)
    there, cloud = ~np.asarray(data.missing), data.cloud
    with beside(path) as temporary:
        scan = document.source
        if not isinstance(scan, Scan):
            temporary.write_bytes(_fresh(cloud, there, tags))
            return ()
        points = scan.file.points
        moved = there & (data.depth != scan.start)  # all others keep their bits
        points[scan.index[moved]] = cloud[moved]
        temporary.write_bytes(scan.file.holding(points, tags))
        normals = {"nx", "ny", "nz"} & set(scan.file.vertices.dtype.names or ())
    return ("its vertex normals are those from before; compute them again",) if normals else ()


def _by_grid(path: Path, file: PlyBytes, grid: Array) -> Array:
    """(h, w) of the cells of a range grid."""
    try:
        w, h = int(file.info["num_cols"]), int(file.info["num_rows"])
    except (KeyError, ValueError) as cause:
        raise FormatError(
            f"{path.name}: obj_info num_cols and num_rows expected beside a range_grid, got none"
        ) from cause
    if w * h != grid.size:
        raise FormatError(f"{path.name}: a range_grid of {w} x {h} = {w * h} cells expected, got {grid.size}")
    return grid.reshape(h, w)


def _by_camera(path: Path, file: PlyBytes) -> Array:
    """(h, w) of the pixels at which the camera of VCG sees the vertices."""
    missing = [name for name in _CAMERA if name not in file.camera]
    if missing:
        raise FormatError(
            f"{path.name}: a range_grid, or an element camera with {', '.join(_CAMERA)}, expected, got neither"
            f"{' (without ' + ', '.join(missing) + ')' if file.camera else ''}; as a mesh it is read without kind='depth'"
        )
    c = {name: file.camera[name] for name in _CAMERA}
    if min(c["focal"], c["scalex"], c["scaley"]) <= 0:
        raise FormatError(
            f"{path.name}: focal, scalex, scaley above zero expected in the camera, got "
            f"{c['focal']:g}, {c['scalex']:g}, {c['scaley']:g}"
        )
    x, y, z = ((file.points - _eye(file)) @ np.array([c[f"{axis}_axis{part}"] for part in "xyz"]) for axis in "xyz")
    with np.errstate(divide="ignore", invalid="ignore"):
        columns, rows = (
            _whole(c["focal"] / c[scale] * part / np.abs(z)) for part, scale in ((x, "scalex"), (-y, "scaley"))
        )
    h, w = int(rows.max()) + 1, int(columns.max()) + 1
    taken = len(np.unique(rows * w + columns))
    if h * w > SPARSE * len(rows) or taken < len(rows):
        raise FormatError(
            f"{path.name}: one pixel of its camera for each vertex expected, got {len(rows)} vertices on {taken} of {w} x {h} "
            "pixels; it is no range map as it was seen: smooth it as a mesh, without kind='depth'"
        )
    index = np.full((h, w), -1, np.int64)
    index[rows, columns] = np.arange(len(rows))
    return index


_CAMERA = (
    "view_px",
    "view_py",
    "view_pz",
    *(f"{axis}_axis{part}" for axis in "xyz" for part in "xyz"),
    "focal",
    "scalex",
    "scaley",
)


def _whole(places: Array) -> Array:
    """Places as whole numbers from 0; all places have the same fractional part."""
    if not np.isfinite(places).all():
        return np.zeros(len(places), np.int64)  # a vertex beside the camera: several will share a pixel
    phase = np.angle(np.mean(np.exp(2j * np.pi * places))) / (2 * np.pi)
    whole = np.rint(places - phase).astype(np.int64)
    return whole - whole.min()


def _eye(file: PlyBytes) -> Array:
    return np.array([file.camera[f"view_p{part}"] for part in "xyz"])


def _viewpoint(path: Path, file: PlyBytes, given: Sequence[float] | None) -> tuple[Array | None, str]:
    """The viewpoint, and a note on it."""
    if given is not None:
        eye, how = np.array([number(x, "viewpoint") for x in np.ravel(given)]), "as given"
    elif "viewpoint" in file.info:
        eye, how = np.array([_float(word) for word in file.info["viewpoint"].split()]), "as its header says"
    elif all(f"view_p{part}" in file.camera for part in "xyz"):
        eye, how = _eye(file), "as its camera says"
    else:
        return (
            None,
            "no viewpoint is known: points move along z, as a scanner that looks along -z sees them (viewpoint)",
        )
    if len(eye) != 3 or not np.isfinite(eye).all():
        raise InputError(f"{path.name}: viewpoint of three numbers x, y, z expected, got {tuple(eye.tolist())}")
    said = f"seen from ({eye[0]:g}, {eye[1]:g}, {eye[2]:g}), {how}: points move along their rays"
    return np.array(eye, dtype=np.float64), Fact(said)


def _float(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


def _fresh(cloud: Array, there: Array, tags: Mapping[str, str]) -> bytes:
    """A binary range grid: points (n, 3) as float, one cell per sample."""
    h, w = there.shape
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment meshflow:{name} {' '.join(str(word).split())}" for name, word in tags.items()),
        f"obj_info num_cols {w}",
        f"obj_info num_rows {h}",
        f"element vertex {int(there.sum())}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element range_grid {h * w}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    cells, vertex = [], np.cumsum(there.ravel()) - 1
    for at, is_there in zip(vertex, there.ravel(), strict=True):
        cells.append(b"\x01" + int(at).to_bytes(4, "little") if is_there else b"\x00")
    return "\n".join([*lines, ""]).encode() + cloud[there].astype("<f4").tobytes() + b"".join(cells)
