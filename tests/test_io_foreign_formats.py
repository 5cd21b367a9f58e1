"""Formats of other programs: what is read comes whole or is named as lost; what is not read is refused as what it is."""

import codecs
import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image as Picture
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from meshflow.errors import FormatError
from meshflow.io.files import read, write
from meshflow.io.formats.gltf import _header as gltf_header

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.1\nf 1 2 3\nf 2 4 3\n"


@pytest.mark.parametrize(
    ("name", "what", "way"),
    [
        ("a.las", "a lidar cloud", "reconstruct"),
        ("a.xyz", "a point cloud", "reconstruct"),
        ("a.dae", "a scene of COLLADA", "glb"),
        ("a.vti", "a grid of VTK", r"pyvista.read"),
        ("a.step", "a CAD model", "mesh it first"),
        ("A.FBX", "a scene of FBX", "glb"),
        ("a.gz", "an archive", "unpack"),
    ],
)
def test_what_is_not_read_is_refused_as_what_it_is(tmp_path, name, what, way):
    (tmp_path / name).write_bytes(b"anything")
    with pytest.raises(FormatError, match=f"{what}.*{way}") as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert "GDAL opens" not in str(caught.value)


def test_a_grid_of_lines_of_x_y_z_is_still_a_raster(tmp_path):
    rows = [f"{x} {y} {x * y}" for y in (3, 2, 1) for x in (0, 1, 2, 3)]
    (tmp_path / "a.xyz").write_text("\n".join(rows) + "\n")
    assert np.array_equal(read(tmp_path / "a.xyz").data.z[0], [0, 3, 6, 9])


@pytest.mark.parametrize("begin", [b"OFF8 6 12", b"OFF 8 6 12", b"# a\nOFF\n8 6 12", b"\xef\xbb\xbfOFF\n8 6 12"])
def test_off_is_read_wherever_its_counts_stand(tmp_path, begin):
    box = trimesh.creation.box()
    corners = "\n".join(" ".join(map(repr, row)) for row in np.asarray(box.vertices).tolist())
    squares = "\n".join(["4 0 1 3 2", "4 4 6 7 5", "4 0 4 5 1", "4 2 3 7 6", "4 0 2 6 4", "4 1 5 7 3"])
    (tmp_path / "a.off").write_bytes(begin + f"\n{corners}\n{squares}\n".encode())
    document = read(tmp_path / "a.off")
    assert np.array_equal(document.data.points, box.vertices)
    assert len(document.data.faces) == 12
    write(document, tmp_path / "b.off")
    assert np.array_equal(read(tmp_path / "b.off").data.faces, document.data.faces)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-8-sig"])
def test_an_obj_with_a_byte_order_mark_is_read_whole(tmp_path, encoding):
    mark = codecs.BOM_UTF16_BE if encoding == "utf-16-be" else b""
    (tmp_path / "a.obj").write_bytes(mark + OBJ.encode(encoding))
    document = read(tmp_path / "a.obj")
    assert document.data.points.shape == (4, 3)
    assert document.data.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    write(document, tmp_path / "b.obj")
    assert (tmp_path / "b.obj").read_text() == OBJ


@pytest.mark.parametrize("kind", [np.float32, np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_colours_beside_a_texture_are_kept(tmp_path, kind, suffix):
    ball = trimesh.creation.icosphere(subdivisions=1)
    rng = np.random.default_rng(0)
    picture = Picture.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8))
    ball.visual = TextureVisuals(uv=rng.random((42, 2)), material=PBRMaterial(baseColorTexture=picture))
    colours = rng.integers(0, 256, (42, 4), dtype=np.uint8)
    ball.visual.vertex_attributes["color"] = colours
    (tmp_path / "a.glb").write_bytes(trimesh.Scene(ball).export(file_type="glb"))
    if kind is not np.uint8:
        retyped(tmp_path / "a.glb", colours, kind)
    document = read(tmp_path / "a.glb")
    moved = replace(document.data, points=document.data.points * 1.01)
    write(document.holding(moved), tmp_path / f"b{suffix}")
    (back,) = trimesh.load_scene(tmp_path / f"b{suffix}", process=False).geometry.values()
    kept = back.visual.vertex_attributes["color"]
    most = (
        255 if suffix == ".gltf" or kind is np.uint8 else 65535 if kind is np.uint16 else 1.0
    )  # a GLB keeps their type
    np.testing.assert_allclose(kept / most, colours / 255, atol=1e-6)
    (primitive,) = gltf_header(tmp_path / f"b{suffix}")["meshes"][0]["primitives"]
    assert {"COLOR_0", "TEXCOORD_0"} <= set(primitive["attributes"])


def retyped(path, colours, kind):
    """The colours of a GLB in another number type, behind everything else."""
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    header, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    values = (colours / 255).astype("<f4") if kind is np.float32 else colours.astype("<u2") * 257
    (primitive,) = header["meshes"][0]["primitives"]
    accessor = header["accessors"][primitive["attributes"]["COLOR_0"]]
    header["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
    accessor |= {"bufferView": len(header["bufferViews"]) - 1, "componentType": 5126 if kind is np.float32 else 5123}
    for name in ("min", "max"):
        accessor.pop(name, None)
    binary += values.tobytes()
    header["buffers"][0]["byteLength"] = len(binary)
    words = json.dumps(header).encode()
    words += b" " * (-len(words) % 4)
    whole = b"".join(
        [len(words).to_bytes(4, "little"), b"JSON", words, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    )
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(whole)).to_bytes(4, "little") + whole)


def test_a_gltf_is_written_as_one_file(tmp_path):
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "a.ply")
    document = read(tmp_path / "a.ply")
    write(document, tmp_path / "b.gltf")
    back = read(tmp_path / "b.gltf")
    assert np.array_equal(back.data.faces, document.data.faces)
    np.testing.assert_allclose(back.data.points, document.data.points, atol=1e-7)
    write(back, tmp_path / "c.gltf")
    assert np.array_equal(read(tmp_path / "c.gltf").data.points, back.data.points)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "b.gltf", "c.gltf"]


def test_3mf_comes_back_part_by_part(tmp_path):
    pytest.importorskip("lxml")
    scene = trimesh.Scene({"ball": trimesh.creation.icosphere(subdivisions=2), "box": trimesh.creation.box()})
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    document = read(tmp_path / "a.glb")
    write(document, tmp_path / "a.3mf")
    back = read(tmp_path / "a.3mf")
    assert len(back.sections) == 2
    assert len(back.data.faces) == len(document.data.faces)
    np.testing.assert_allclose(np.sort(back.data.points, axis=0), np.sort(document.data.points, axis=0), atol=1e-5)
    write(back, tmp_path / "b.3mf")
    np.testing.assert_allclose(read(tmp_path / "b.3mf").data.points, back.data.points, atol=1e-6)


def binary_off(kind="OFF", sizes=(4,), extra=0):
    """A box of polygons as Geomview writes it, with numbers per vertex beside the position and colours per face."""
    box = trimesh.creation.box()
    squares = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    rows = np.column_stack([box.vertices, np.arange(8 * extra).reshape(8, extra)]).astype(">f4")
    body = b"".join(
        np.array([4, *square, i % 3], ">i4").tobytes() + np.full(i % 3, 0.5, ">f4").tobytes()
        for i, square in enumerate(squares)
    )
    return f"{kind} BINARY\n".encode() + np.array([8, 6, 12], ">i4").tobytes() + rows.tobytes() + body


@pytest.mark.parametrize(("kind", "extra"), [("OFF", 0), ("NOFF", 3), ("COFF", 4), ("CNOFF", 7), ("STOFF", 2)])
def test_a_binary_off_is_read_and_written_with_the_same_bytes(tmp_path, kind, extra):
    (tmp_path / "a.off").write_bytes(binary_off(kind, extra=extra))
    document = read(tmp_path / "a.off")
    assert np.array_equal(document.data.points, trimesh.creation.box().vertices)
    assert len(document.data.faces) == 12
    write(document, tmp_path / "b.off")
    assert (tmp_path / "b.off").read_bytes() == binary_off(kind, extra=extra)
    moved = replace(document.data, points=document.data.points + 0.25)
    write(document.holding(moved), tmp_path / "c.off")
    again = read(tmp_path / "c.off")
    assert np.array_equal(again.data.points, moved.points)
    assert np.array_equal(again.data.faces, document.data.faces)
    write(document, tmp_path / "b.ply")
    assert len(read(tmp_path / "b.ply").data.faces) == 12


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6, 0.95])
def test_a_binary_off_that_is_cut_off_or_lies_is_refused(tmp_path, share):
    content = binary_off()
    (tmp_path / "a.off").write_bytes(content[: int(share * len(content))])
    with pytest.raises(FormatError, match=r"cut off|does not fit"):
        read(tmp_path / "a.off")
    for count in (b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff"):
        (tmp_path / "b.off").write_bytes(content[:11] + count + content[15:])
        with pytest.raises(FormatError, match="cut off"):
            read(tmp_path / "b.off")
