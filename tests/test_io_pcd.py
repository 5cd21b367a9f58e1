"""Organised clouds of PCL. meshflow.io.formats.pcd, pcd_layout."""

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, InputError
from meshflow.io.files import read, write
from meshflow.surfaces.range_image import RangeImage

H, W = 24, 30
HOW = ("ascii", "binary", "binary_compressed")


def organised(noise=0.0, eye=(0.0, 0.0, 0.0), seed=3):
    """Points (H, W, 3) of a slanted plane with a hole, as a depth camera at the eye sees it."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:H, :W]
    rays = np.stack([(u - W / 2) / 40, (v - H / 2) / 40, np.ones((H, W))], -1)
    depth = 2.0 / (1 - 0.3 * rays[..., 0]) + noise * rng.normal(size=(H, W))
    points = rays * depth[..., None] + eye
    points[5:8, 9:12] = np.nan
    return points.astype(np.float32)


def compressed(content):
    """LZF with repeats: a literal, then the same byte again and again where it repeats."""
    out, at = b"", 0
    while at < len(content):
        run = 1
        while at + run < len(content) and run < 200 and content[at + run] == content[at]:
            run += 1
        out += b"\0" + content[at : at + 1]
        if run > 9:
            out += bytes([7 << 5, run - 1 - 9, 0])
            at += run
        elif run > 3:
            out += bytes([(run - 3) << 5, 0])
            at += run
        else:
            at += 1
    return out


def pcd(path, points, how, height=H, width=W, viewpoint="0 0 0 1 0 0 0"):
    rows = np.zeros(
        len(points.reshape(-1, 3)), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("_", "u1", (4,)), ("rgb", "<u4")]
    )
    for axis, column in zip("xyz", points.reshape(-1, 3).T, strict=True):
        rows[axis] = column
    rows["rgb"] = np.arange(len(rows)) % 7
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U U\n"
        f"COUNT 1 1 1 4 1\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT {viewpoint}\nPOINTS {len(rows)}\nDATA {how}\n"
    ).encode()
    if how == "ascii":
        body = "".join(f"{r['x']!s} {r['y']!s} {r['z']!s} 0 0 0 0 {r['rgb']}\n" for r in rows).encode()
    elif how == "binary":
        body = rows.tobytes()
    else:
        content = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
        packed = compressed(content)
        body = np.array([len(packed), len(content)], "<u4").tobytes() + packed
    path.write_bytes(header + body)
    return path


@pytest.mark.parametrize("how", HOW)
def test_an_organised_cloud_is_a_range_image_and_comes_back_as_it_came(tmp_path, how):
    points = organised()
    path = pcd(tmp_path / "a.pcd", points, how)
    document = read(path)
    assert isinstance(document.data, RangeImage)
    assert document.data.depth.shape == (H, W)
    assert np.array_equal(document.data.missing, np.isnan(points[..., 0]))
    there = ~document.data.missing
    assert np.abs(document.data.cloud[there] - points[there]).max() < 1e-12
    write(document, tmp_path / "b.pcd")
    again = read(tmp_path / "b.pcd")
    assert np.array_equal(again.data.cloud, document.data.cloud, equal_nan=True)
    for name in ("rgb", "_:3"):
        assert np.array_equal(again.source.file.rows[name], document.source.file.rows[name])
    if how != "binary_compressed":
        assert (tmp_path / "b.pcd").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("eye", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_points_move_along_their_rays_and_come_nearer_to_the_truth(tmp_path, how, eye):
    truth, noisy = organised(eye=eye), organised(0.01, eye)
    path = pcd(tmp_path / "a.pcd", noisy, how, viewpoint=" ".join(map(str, eye)) + " 1 0 0 0")
    result = meshflow.smooth(path, result=True)
    write(result.data, tmp_path / "b.pcd")
    cloud, there = read(tmp_path / "b.pcd").data.cloud, ~np.isnan(truth[..., 0])
    before, after = (np.linalg.norm((some - truth)[there], axis=1) for some in (noisy, cloud))
    assert np.sqrt(np.mean(after**2)) < 0.6 * np.sqrt(np.mean(before**2))
    across = np.cross(cloud - eye, noisy - eye)[there]
    assert np.abs(across).max() < 1e-5, "points leave their rays"


def test_a_compressed_file_of_open3d_is_unpacked(tmp_path):
    o3d = pytest.importorskip("open3d")
    points = np.nan_to_num(organised(0.01), nan=0.5)
    cloud = o3d.t.geometry.PointCloud(points.reshape(-1, 3))
    o3d.t.io.write_point_cloud(str(tmp_path / "a.pcd"), cloud, compressed=True)
    content = (tmp_path / "a.pcd").read_bytes()
    assert b"DATA binary_compressed" in content
    content = content.replace(b"WIDTH %d\n" % (H * W), b"WIDTH %d\n" % W).replace(b"HEIGHT 1\n", b"HEIGHT %d\n" % H)
    (tmp_path / "a.pcd").write_bytes(content)
    found = read(tmp_path / "a.pcd").data
    assert np.abs(found.cloud - points).max() < 1e-6
    write(read(tmp_path / "a.pcd"), tmp_path / "b.pcd")
    again = o3d.t.io.read_point_cloud(str(tmp_path / "b.pcd"))
    assert np.abs(again.point.positions.numpy() - points.reshape(-1, 3)).max() < 1e-6, "open3d reads what is written"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"HEIGHT 24", b"HEIGHT 1", "30 x 1 points, but POINTS 720"),
        (b"HEIGHT 24\n", b"HEIGHT 0\n", "above zero"),
        (b"HEIGHT 24\n", b"HEIGHT 4000000000\n", "but POINTS"),
        (b"FIELDS x y z", b"FIELDS x y w", "x, y, z of one float"),
        (b"COUNT 1 1 1 4", b"COUNT 1 2 1 4", "x, y, z of one float"),
        (b"TYPE F F F", b"TYPE F F Q", "type Q"),
        (b"COUNT 1 1 1", b"COUNT 1 1", "same length"),
        (b"VIEWPOINT 0 0 0", b"VIEWPOINT 0 nan 0", "VIEWPOINT"),
        (b"VIEWPOINT 0 0 0", b"VIEWPOINT a b c", "VIEWPOINT"),
        (b"DATA ", b"DATUM ", "ends with a line DATA"),
    ],
)
@pytest.mark.parametrize("how", HOW)
def test_a_damaged_header_is_named(tmp_path, how, old, new, said):
    path = pcd(tmp_path / "a.pcd", organised(), how)
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(FormatError, match=said):
        read(path)


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.99])
def test_no_truncated_cloud_gives_other_data(tmp_path, how, share):
    path = pcd(tmp_path / "a.pcd", organised(), how)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(FormatError, match=r"cut off|ends with a line DATA|unpacked"):
        read(path)


def test_a_cloud_without_rows_is_refused_by_what_it_is(tmp_path):
    points = organised()
    path = pcd(tmp_path / "a.pcd", points, "binary", 1, H * W)
    with pytest.raises(FormatError, match=r"without rows and columns.*reconstruct"):
        read(path)
    with pytest.raises(InputError, match="is a depth image"):
        read(pcd(tmp_path / "a.pcd", points, "binary"), kind="mesh")
    with pytest.raises(FormatError, match="does not fit into .pcd"):
        write(read(pcd(tmp_path / "a.pcd", points, "binary")).data, tmp_path / "c.pcd")
    with pytest.raises(FormatError, match="none of its"):
        read(pcd(tmp_path / "n.pcd", np.full_like(points, np.nan), "binary"))


def test_it_becomes_a_range_grid_of_stanford(tmp_path):
    document = read(pcd(tmp_path / "a.pcd", organised(), "binary"))
    write(document, tmp_path / "a.ply")
    assert np.allclose(read(tmp_path / "a.ply").data.cloud, document.data.cloud, atol=1e-6, equal_nan=True)
