"""GLB and glTF: what moves changes, what trimesh does not keep is kept or said, what cannot be read is refused."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.mesh_files import again, whole

from meshflow.errors import FormatError
from meshflow.io.files import read, write


def test_primitives_of_one_mesh_are_connected_and_separate_bodies_are_not(tmp_path):
    left, right = trimesh.creation.box(), trimesh.creation.box()
    right.apply_translation([1, 0, 0])
    scene = trimesh.Scene({"left": left, "right": right})
    scene.export(tmp_path / "in.glb")
    assert read(tmp_path / "in.glb").data.points.shape == (16, 3)
    content = (tmp_path / "in.glb").read_bytes()
    one = _as_primitives(content)
    (tmp_path / "one.glb").write_bytes(one)
    document, _ = again(tmp_path / "one.glb", tmp_path / "out.glb")
    assert document.data.points.shape == (12, 3)
    assert len(trimesh.load_scene(tmp_path / "out.glb", process=False).geometry) == 2


def _as_primitives(content):
    """A GLB whose two meshes have become the primitives of one."""
    header, rest = opened(content)
    header["meshes"] = [{"name": "both", "primitives": [p for mesh in header["meshes"] for p in mesh["primitives"]]}]
    header["nodes"] = [{"name": "node", "mesh": 0}]
    header["scenes"], header["scene"] = [{"nodes": [0]}], 0
    return closed(header, rest)


def opened(content):
    """The header of a GLB, and what stands behind it."""
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length]), content[20 + length :]


def closed(header, rest=b""):
    """A GLB of a header and what stands behind it."""
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    return b"glTF" + struct.pack("<III", 2, 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest


def animated_ball(path):
    """A GLB of a ball with normals, tangents, a joint, and animations; without them trimesh would write it as well."""
    ball = trimesh.creation.icosphere(2)
    normals = np.array(ball.vertex_normals)
    header, rest = opened(ball.export(None, file_type="glb", include_normals=True))
    along = np.cross(normals, [0.3, 0.5, 0.8])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    stored = np.column_stack([along, np.ones(len(along))]).astype("<f4").tobytes()
    joints = bytes(4 * len(along))
    attributes = header["meshes"][0]["primitives"][0]["attributes"]
    binary = rest[8:]
    for name, content, kind, number in (("TANGENT", stored, "VEC4", 5126), ("JOINTS_0", joints, "VEC4", 5121)):
        header["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content)})
        attributes[name] = len(header["accessors"])
        at = len(header["bufferViews"]) - 1
        header["accessors"].append({"bufferView": at, "componentType": number, "type": kind, "count": len(along)})
        binary += content
    header["buffers"][0]["byteLength"] = len(binary)
    header["animations"] = [{"name": "turning", "channels": [], "samplers": []}]
    path.write_bytes(closed(header, len(binary).to_bytes(4, "little") + b"BIN\0" + binary))
    return ball


def test_of_a_glb_only_what_moves_changes(tmp_path):
    ball = animated_ball(tmp_path / "in.glb")
    document = read(tmp_path / "in.glb")
    assert not any("not written" in note for note in document.notes)
    write(document, tmp_path / "same.glb")
    assert opened((tmp_path / "same.glb").read_bytes()) == opened((tmp_path / "in.glb").read_bytes())
    flat = document.data.points * [1.0, 1.0, 0.5]
    write(document.holding(replace(document.data, points=flat)), tmp_path / "out.glb")
    (before, was), (after, now) = (opened((tmp_path / name).read_bytes()) for name in ("in.glb", "out.glb"))
    place = after["meshes"][0]["primitives"][0]["attributes"]
    position = after["accessors"][place["POSITION"]]
    assert position["max"] == pytest.approx([1.0, 1.0, 0.5], abs=1e-6)
    for end in ("min", "max"):
        before["accessors"][place["POSITION"]][end] = position[end]
    assert after == before
    changed = np.frombuffer(now, np.uint8) != np.frombuffer(was, np.uint8)
    joints = after["bufferViews"][after["accessors"][place["JOINTS_0"]]["bufferView"]]
    indices = after["bufferViews"][after["accessors"][after["meshes"][0]["primitives"][0]["indices"]]["bufferView"]]
    for view in (joints, indices):
        assert not changed[8 + view["byteOffset"] :][: view["byteLength"]].any()
    again_ = trimesh.load(tmp_path / "out.glb", force="mesh", process=False)
    np.testing.assert_allclose(again_.vertices, flat, atol=1e-7)
    normals = np.array(again_.vertex_normals)
    slopes = ball.vertices * [1.0, 1.0, 2.0]
    assert np.einsum("ij,ij->i", normals, slopes / np.linalg.norm(slopes, axis=1, keepdims=True)).min() > 0.98
    tangent = after["bufferViews"][after["accessors"][place["TANGENT"]]["bufferView"]]
    along = np.frombuffer(now[8 + tangent["byteOffset"] :][: tangent["byteLength"]], "<f4").reshape(-1, 4)
    assert np.abs(np.einsum("ij,ij->i", along[:, :3], normals)).max() < 1e-5


def test_what_a_glb_loses_is_said(tmp_path):
    header, rest = opened(trimesh.creation.box().export(None, file_type="glb"))
    attributes = header["meshes"][0]["primitives"][0]["attributes"]
    attributes["TANGENT"] = attributes["POSITION"]  # of another width than tangents have: not written in place
    header["accessors"][attributes["POSITION"]]["sparse"] = {"count": 0}
    header["animations"] = [{}]
    (tmp_path / "in.glb").write_bytes(closed(header, rest))
    assert any("TANGENT, animations" in note for note in read(tmp_path / "in.glb").notes)


def test_compressed_geometry_is_refused_and_not_read_as_zeros(tmp_path):
    header = {"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"], "meshes": []}
    (tmp_path / "in.glb").write_bytes(closed(header))
    with pytest.raises(FormatError, match="decompress"):
        read(tmp_path / "in.glb")


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_attributes_of_any_number_type_are_written_as_gltf_has_them(tmp_path, suffix):
    ball = trimesh.creation.icosphere(1)
    numbers = np.arange(42)
    for kind in (np.int32, np.uint32, np.float64, np.int16):
        ball.vertex_attributes[f"of_{np.dtype(kind).name}"] = numbers.astype(kind)
    ball.vertex_attributes["signed"] = (numbers - 20).astype(np.int32)
    ball.export(tmp_path / "in.ply")
    write(read(tmp_path / "in.ply"), tmp_path / f"out{suffix}")
    back = whole(tmp_path / f"out{suffix}").vertex_attributes
    assert np.array_equal(back["_of_int32"].ravel(), numbers)
    assert np.array_equal(back["_signed"].ravel(), numbers - 20)


def test_quantized_positions_are_refused_and_not_read_as_whole_numbers(tmp_path):
    header, rest = opened(trimesh.creation.box().export(None, file_type="glb"))
    header["accessors"][header["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]["normalized"] = True
    (tmp_path / "in.glb").write_bytes(closed(header, rest))
    with pytest.raises(FormatError, match="gltf-transform dequantize"):
        read(tmp_path / "in.glb")
