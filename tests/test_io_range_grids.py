"""Range grids of Stanford's PLY and range maps of VCG. meshflow.io.formats.range_grids, plygrids."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.io.document import Document
from meshflow.io.files import read, write
from meshflow.io.formats.range_grids import Scan
from meshflow.smoothing import smooth
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.scanner import Scanner

H, W = 12, 16
RNG = np.random.default_rng(1)
ORDERS = ("ascii", "binary_little_endian", "binary_big_endian")


def scan(noise=0.0, dtype=np.float32):
    """Points (H, W, 3) of a curved sheet, millimetres, and where they are."""
    c, r = np.meshgrid(np.arange(W) * 0.5, np.arange(H) * 0.5)
    z = 0.02 * c**2 - 0.03 * r**2 + noise * RNG.normal(size=(H, W))
    there = RNG.random((H, W)) > 0.1
    return np.stack([c, -r, z], -1).astype(dtype), there


def grid_ply(path, points, there, order="ascii", info=(), extra=True):
    kind = "double" if points.dtype == np.float64 else "float"
    columns = [(axis, points[there][:, i]) for i, axis in enumerate("xyz")]
    if extra:
        columns.append(("confidence", np.linspace(0, 1, there.sum()).astype(points.dtype)))
    header = [
        "ply",
        f"format {order} 1.0",
        f"obj_info num_cols {there.shape[1]}",
        f"obj_info num_rows {there.shape[0]}",
        *info,
        f"element vertex {there.sum()}",
        *(f"property {kind} {name}" for name, _ in columns),
        f"element range_grid {there.size}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    vertex = np.cumsum(there.ravel()) - 1
    body = b""
    if order == "ascii":
        body += "".join(
            " ".join(str(x) for x in row) + "\n" for row in zip(*(v for _, v in columns), strict=True)
        ).encode()
        body += "".join(f"1 {v}\n" if t else "0\n" for v, t in zip(vertex, there.ravel(), strict=True)).encode()
    else:
        sign = "<" if "little" in order else ">"
        body += np.stack([v for _, v in columns], -1).astype(sign + points.dtype.str[1:]).tobytes()
        for v, t in zip(vertex, there.ravel(), strict=True):
            body += b"\x01" + np.array(v, sign + "i4").tobytes() if t else b"\x00"
    path.write_bytes("\n".join([*header, ""]).encode() + body)
    return path


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_range_grid_that_did_not_move_comes_out_as_the_bytes_that_came_in(tmp_path, order, dtype):
    points, there = scan(0.01, dtype)
    path = grid_ply(tmp_path / "a.ply", points, there, order)
    document = read(path)
    assert isinstance(document.data, RangeImage)
    assert (document.kind, type(document.source)) == ("depth", Scan)
    assert np.array_equal(document.data.missing, ~there)
    assert np.allclose(document.data.cloud[there], points[there], rtol=1e-15)
    write(document, tmp_path / "b.ply")
    assert (tmp_path / "b.ply").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("order", ORDERS)
def test_points_of_a_range_grid_move_along_their_lines_of_sight_and_nothing_else_changes(tmp_path, order):
    points, there = scan(0.05)
    document = read(grid_ply(tmp_path / "a.ply", points, there, order))
    done = document.holding(smooth(document.data, time=4.0))
    write(done, tmp_path / "b.ply", tags={"meshflow:time": "4"})
    again = read(tmp_path / "b.ply")
    assert b"comment meshflow:time 4" in (tmp_path / "b.ply").read_bytes()
    before, after = document.data.cloud[there], again.data.cloud[there]
    assert np.array_equal(before[:, :2], after[:, :2])
    assert np.abs(after[:, 2] - before[:, 2]).max() > 0.02
    smooth_z = 0.02 * before[:, 0] ** 2 - 0.03 * before[:, 1] ** 2
    assert np.std(after[:, 2] - smooth_z) < 0.85 * np.std(before[:, 2] - smooth_z)
    assert np.array_equal(again.source.file.vertices["confidence"], document.source.file.vertices["confidence"])
    assert np.array_equal(again.source.index, document.source.index)
    assert document.data.camera == again.data.camera


def test_trimesh_reads_the_range_grid_that_is_written(tmp_path):
    points, there = scan()
    write(read(grid_ply(tmp_path / "a.ply", points, there)), tmp_path / "b.ply")
    cloud = trimesh.load(tmp_path / "b.ply", process=False)
    assert np.allclose(cloud.vertices, points[there])
    assert cloud.metadata["_ply_raw"]["range_grid"]["length"] == H * W


@pytest.mark.parametrize("given", [True, False])
def test_with_a_viewpoint_values_are_distances_from_it(tmp_path, given):
    points, there = scan()
    info = () if given else ("obj_info viewpoint 4 -3 50",)
    path = grid_ply(tmp_path / "a.ply", points, there, info=info)
    document = read(path, **({"viewpoint": (4, -3, 50)} if given else {}))
    away = np.linalg.norm(points - np.array([4, -3, 50.0]), axis=2)
    assert np.allclose(document.data.depth[there], away[there])
    assert "seen from (4, -3, 50)" in document.notes[0]
    moved = replace(document.data, depth=document.data.depth + 1)
    write(document.holding(moved), tmp_path / "b.ply")
    assert np.allclose(
        np.linalg.norm(read(tmp_path / "b.ply").data.cloud[there] - (4, -3, 50), axis=1), away[there] + 1
    )


def test_the_command_takes_a_viewpoint(tmp_path):
    from typer.testing import CliRunner

    from meshflow.cli.commands import app

    points, there = scan(0.05)
    words = [str(grid_ply(tmp_path / "a.ply", points, there)), str(tmp_path / "b.ply"), "--time", "1"]
    done = CliRunner().invoke(app, ["smooth", *words, "--viewpoint", "4", "-3", "50"])
    assert done.exit_code == 0, done.exception
    assert "seen from (4, -3, 50), as given" in done.output
    before, after = (read(tmp_path / name, viewpoint=(4, -3, 50)).data for name in ("a.ply", "b.ply"))
    moved = (after.cloud - before.cloud)[there]
    assert np.linalg.norm(moved, axis=1).max() > 0.01
    assert np.abs(np.cross(moved, before.camera.directions[there])).max() < 1e-3  # along their rays
    reported = CliRunner().invoke(app, ["info", words[0], "--viewpoint", "4", "-3", "50"])
    assert "seen from (4, -3, 50)" in reported.output


def test_any_range_image_is_written_as_a_range_grid(tmp_path):
    depth = 1 + RNG.random((H, W))
    depth[2:4, 3] = 0
    data = RangeImage(depth, Pinhole(20, 20, 7.5, 5.5))
    document = Document(data, tmp_path / "a.png")
    write(document, tmp_path / "b.ply", tags={"meshflow:time": "4"})
    again = read(tmp_path / "b.ply", viewpoint=(0, 0, 0)).data
    assert np.array_equal(again.missing, data.missing)
    assert np.allclose(again.cloud[~data.missing], data.cloud[~data.missing], atol=1e-6)


def vcg_ply(path, points, faces=(), shift=0.25, **changes):
    """A range map as MeshLab keeps it: camera at (1, 2, 3), turned, looking along its -z; ``element camera`` first."""
    turn = trimesh.transformations.euler_matrix(0.3, 0.6, 0.1)[:3, :3]
    eye = np.array([1.0, 2.0, 3.0])
    world = points @ turn + eye  # rows of turn are the axes
    axes = {f"{name}_axis{part}": turn[i, j] for i, name in enumerate("xyz") for j, part in enumerate("xyz")}
    camera = {f"view_p{part}": x for part, x in zip("xyz", eye, strict=True)} | axes
    camera |= {
        "focal": 10.0,
        "scalex": 0.05,
        "scaley": 0.05,
        "centerx": 8,
        "centery": 6,
        "viewportx": W,
        "viewporty": H,
    }
    camera = {name: value for name, value in (camera | changes).items() if value is not None}
    header = ["ply", "format binary_little_endian 1.0", "element camera 1"]
    header += [f"property float {name}" for name in camera]
    header += [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    body = np.array(list(camera.values()), "<f4").tobytes() + world.astype("<f8").tobytes()
    body += b"".join(b"\x03" + np.asarray(face, "<i4").tobytes() for face in faces)
    path.write_bytes("\n".join(header).encode() + body)
    return path, world, eye


def seen_points():
    """Points (n, 3) before an OpenGL camera of focal length 200 pixels, each in a pixel of its own."""
    rows, columns = np.nonzero(RNG.random((H, W)) > 0.1)
    z = 5 + 0.01 * columns
    x, y = (columns - 7.75) / 200 * z, -(rows - 5.75) / 200 * z
    return np.stack([x, y, -z], -1), rows, columns


def test_a_range_map_of_vcg_is_read_by_its_camera_and_comes_out_as_it_came_in(tmp_path):
    points, rows, columns = seen_points()
    faces = [(0, 1, 2), (3, 4, 5)]
    path, world, eye = vcg_ply(tmp_path / "a.ply", points, faces)
    assert isinstance(read(path).data, Mesh)
    document = read(path, kind="depth")
    data = document.data
    assert data.depth.shape == (rows.max() - rows.min() + 1, columns.max() - columns.min() + 1)
    assert np.allclose(data.cloud[rows - rows.min(), columns - columns.min()], world)
    assert np.allclose(data.camera.origins, eye)
    assert len(data.lifted(Lift()).triangulations[0]) > 200
    write(document, tmp_path / "b.ply")
    assert (tmp_path / "b.ply").read_bytes() == path.read_bytes()


def test_a_scan_is_smoothed_from_file_to_file(tmp_path):
    points, there = scan(0.05)
    path = grid_ply(tmp_path / "a.ply", points, there, "binary_little_endian")
    result = smooth(read(path).data)
    assert result.depth.dtype == np.float64
    assert isinstance(result.camera, Scanner)


def test_an_element_before_the_vertices_does_not_end_the_process(tmp_path):
    path = vcg_ply(tmp_path / "a.ply", seen_points()[0])[0]
    with pytest.raises(FormatError, match="triangles expected|a.ply"):
        meshflow.read(path)
    assert meshflow.read(path, kind="depth").kind == "depth"


GRID = "ply\nformat ascii 1.0\nobj_info num_cols 2\nobj_info num_rows 2\nelement vertex 4\nproperty float x\nproperty float y\n"
GRID += "property float z\nelement range_grid 4\nproperty list uchar int vertex_indices\nend_header\n"
GRID += "0 0 0\n1 0 0\n0 1 0\n1 1 0\n1 0\n1 1\n1 2\n1 3\n"
BAD = [
    ("no ply at all", "no PLY header"),
    (GRID.replace("num_rows 2", "num_rows 3"), "a range_grid of 2 x 3 = 6 cells expected, got 4"),
    (GRID.replace("obj_info num_cols 2\n", ""), "num_cols and num_rows expected"),
    (GRID.replace("1 3\n", "1 4\n"), "range_grid names vertex 4, there are 4"),
    (GRID.replace("\n1 0\n1 1\n1 2\n1 3\n", "\n0\n0\n0\n0\n"), "none of the 4 cells of the grid has a point"),
    (GRID.replace("1 2\n1 3\n", ""), "cut off, .*4 cells of range_grid expected"),
    (GRID.replace("1 1 0\n1 0\n", "1 one 0\n1 0\n"), "a word that is no number"),
    (GRID.replace("float", "int"), "positions stored as whole numbers"),
    (GRID.replace("property float z\n", "").replace(" 0\n", "\n"), "vertices with x, y, z, .* expected, got x, y"),
    (GRID.replace("format ascii", "format binary"), "format ascii, binary_little_endian or binary_big_endian expected"),
    (GRID.replace("property float z", "property quad z"), "'property quad z' is no line of a PLY header"),
    (GRID.replace("obj_info num_rows", "obj_info viewpoint 1 2\nobj_info num_rows"), "viewpoint of three numbers"),
]


@pytest.mark.parametrize(("words", "expected"), BAD, ids=[words[:40] for _, words in BAD])
def test_broken_range_grids_are_refused(tmp_path, words, expected):
    (tmp_path / "a.ply").write_text(words)
    with pytest.raises(InputError, match=expected):
        read(tmp_path / "a.ply", kind="depth")


def test_viewpoints_and_kinds_that_cannot_be_are_refused(tmp_path):
    (tmp_path / "a.ply").write_text(GRID)
    for viewpoint, words in [
        ((0, 0), r"viewpoint of three numbers x, y, z expected, got \(0.0, 0.0\)"),
        ((1, 1, 0), r"viewpoint \(1.0, 1.0, 0.0\) is a point of the scan"),
        ("there", "viewpoint: a finite number expected"),
    ]:
        with pytest.raises(InputError, match=words):
            read(tmp_path / "a.ply", viewpoint=viewpoint)
    with pytest.raises(InputError, match="camera: no option of a range grid"):
        read(tmp_path / "a.ply", camera="tum")


def test_cameras_of_vcg_that_do_not_see_their_vertices_one_by_one_are_refused(tmp_path):
    points = seen_points()[0]
    for changes, words in [
        ({"focal": None}, r"an element camera .* expected, got neither \(without focal\)"),
        ({"scalex": 0.0}, "focal, scalex, scaley above zero expected in the camera, got 10, 0, 0.05"),
        ({"focal": 1.0}, "one pixel of its camera for each vertex expected"),
        ({"focal": 1e4}, "one pixel of its camera for each vertex expected"),
    ]:
        path = vcg_ply(tmp_path / "a.ply", points, **changes)[0]
        with pytest.raises(FormatError, match=words):
            read(path, kind="depth")
