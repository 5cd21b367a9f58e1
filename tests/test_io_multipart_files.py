"""Files of several meshes: each part as if it were alone, names and all else as they were."""

import json
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.scenes import BALL, FACES, FRAME, NOISY, ball, scene
from typer.testing import CliRunner

import meshflow.viewer.session
from meshflow.cli.commands import app
from meshflow.errors import FormatError, InputError
from meshflow.estimate.constraints import Fixed, Mask
from meshflow.estimate.request import Request
from meshflow.flow.stops import Steps
from meshflow.io.files import read, write
from meshflow.smoothing import smooth
from meshflow.view.appearance import flowing_together

SHARED = Path(__file__).parents[2] / "shared" / "data"
BOX = trimesh.creation.box([3, 3, 3]).subdivide().subdivide()
WAY = ["--method", "curvature", "--steps", "2"]


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result


def obj(path, *meshes, key="o", shared=False):
    """An OBJ of named meshes; where shared, a triangle of each group takes a vertex of the first."""
    lines, start = [], 1
    for name, mesh in meshes:
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"{key} {name}", *("f " + " ".join(str(int(v) + start) for v in face) for face in mesh.faces)]
        if shared and start > 1:
            lines.append(f"f 1 {start} {start + 1}")
        start += len(mesh.vertices)
    path.write_text("\n".join(lines) + "\n")
    return path


def stl(path, *meshes):
    text = "".join(
        trimesh.exchange.stl.export_stl_ascii(mesh).replace("solid ", f"solid {name}", 1) for name, mesh in meshes
    )
    path.write_text(text)
    return path


def glb(path, *meshes):
    made = trimesh.Scene()
    for name, mesh in meshes:
        made.add_geometry(mesh, geom_name=name, node_name=f"node {name}", transform=FRAME)
    made.export(path)
    return path


def vtm(path, *meshes):
    blocks = {name: pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces) for name, mesh in meshes}
    pyvista.MultiBlock(blocks).save(path)
    return path


@pytest.mark.long
@pytest.mark.parametrize(("made", "suffix"), [(glb, ".glb"), (obj, ".obj"), (stl, ".stl"), (vtm, ".vtm")])
@pytest.mark.parametrize("words", [[], ["--method", "curvature", "--preserve", "volume"]], ids=["search", "curvature"])
def test_a_part_of_a_file_is_smoothed_to_the_bit_as_if_it_were_alone(made, suffix, words, tmp_path):
    one, two = ("one", ball(attribute=False)), ("two", BOX)
    made(tmp_path / f"both{suffix}", two, one)
    made(tmp_path / f"alone{suffix}", one)
    for name in ("both", "alone"):
        run("smooth", tmp_path / f"{name}{suffix}", tmp_path / f"{name} out{suffix}", *words)
    document, alone = read(tmp_path / f"both out{suffix}"), read(tmp_path / f"alone out{suffix}").data
    assert [name.removesuffix(".stl") for name, _ in document.sections] == ["two", "one"]
    points = document.data.points[document.sections[1][1]]
    assert np.array_equal(points, alone.points)
    before = read(tmp_path / f"alone{suffix}").data
    assert np.abs(points - before.points).max() > 1e-3  # it was smoothed


def test_a_scene_file_keeps_names_frames_materials_and_attributes(tmp_path):
    scene().export(tmp_path / "in.glb")
    run("smooth", tmp_path / "in.glb", tmp_path / "out.glb", *WAY)
    before, after = (trimesh.load_scene(tmp_path / name, process=False) for name in ("in.glb", "out.glb"))
    assert list(before.geometry) == list(after.geometry)
    assert np.allclose(after.graph["right"][0], FRAME)
    for name in ("left", "right"):
        assert np.array_equal(before.geometry[name].visual.vertex_colors, after.geometry[name].visual.vertex_colors)
        assert np.array_equal(before.geometry[name].faces, after.geometry[name].faces)
    assert np.array_equal(before.geometry["dots"].vertices, after.geometry["dots"].vertices)


def test_the_command_lists_the_parts(tmp_path):
    path = glb(tmp_path / "in.glb", ("a", ball()), ("b", BOX))
    result = run("smooth", path, tmp_path / "out.glb", "--json", "--report", tmp_path / "r.html", *WAY)
    reported = json.loads(result.stdout)
    assert list(reported["parts"]) == ["a", "b"]
    sigmas = [reported["parts"][name]["parameters"]["noise"]["value"] for name in "ab"]
    assert sigmas[0] != sigmas[1]
    assert reported["parts"]["a"]["steps"] == 2
    assert "2 parts, each smoothed separately" in result.stderr
    assert "  a: took all 2 steps" in result.stderr
    page = (tmp_path / "r.html").read_text()
    assert "a: noise" in page
    assert "b: time" in page
    assert "<th>a</th><td>took all 2 steps" in page
    run("smooth", path, tmp_path / "again.glb", "--report", tmp_path / "r.png", *WAY)
    assert run("info", path).stderr.count("2 parts: a, b") == 1


def test_objects_that_share_vertices_are_one_part_and_groups_count_where_there_is_one_object(tmp_path):
    meshes = ("a", ball(attribute=False)), ("b", BOX)
    assert read(obj(tmp_path / "o.obj", *meshes, shared=True)).sections == ()
    names = [name for name, _ in read(obj(tmp_path / "g.obj", *meshes, key="g")).sections]
    assert names == ["a", "b"]
    # Two boxes that touch stay two, though a textured OBJ joins what coincides.
    touching = BOX.copy()
    touching.apply_translation([3, 0, 0])
    path = obj(tmp_path / "t.obj", ("a", BOX), ("b", touching))
    path.write_text(path.read_text() + "vt 0 0\n")
    document = read(path)
    assert [len(rows) for _, rows in document.sections] == [len(BOX.vertices)] * 2
    assert len(document.data.points) == 2 * len(BOX.vertices)


def test_arrays_per_vertex_of_a_file_are_cut_into_its_parts(tmp_path):
    path = glb(tmp_path / "in.glb", ("a", ball()), ("b", ball(3)))
    document = read(path)
    held = np.zeros(600, bool)
    held[:300] = True
    np.save(tmp_path / "held.npy", held.astype(np.uint8))
    run("smooth", path, tmp_path / "out.glb", "--fixed", tmp_path / "held.npy", *WAY)
    after = read(tmp_path / "out.glb").data
    assert np.array_equal(after.points[:300], document.data.points[:300])
    results = smooth(document, method="curvature", stop=Steps(2), constraints=Fixed(held), result=True)
    assert results["a"].stopped_because.startswith("no sample may move")
    assert (after.points[300:] != document.data.points[300:]).any(axis=1).all()
    python = smooth(document, method="curvature", stop=Steps(2), constraints=Fixed(held))
    assert np.allclose(python.data.points, after.points, atol=1e-5)
    with pytest.raises(InputError, match="one number per vertex of the file, 600, expected, got 300"):
        smooth(document, constraints=Mask(held[:300]))


def test_what_was_read_is_smoothed_and_written_in_python(tmp_path):
    path = glb(tmp_path / "in.glb", ("a", ball()), ("b", BOX))
    document = read(path)
    write(smooth(document, method="curvature", stop=Steps(2)), tmp_path / "python.glb")
    run("smooth", path, tmp_path / "shell.glb", *WAY)
    assert np.array_equal(read(tmp_path / "python.glb").data.points, read(tmp_path / "shell.glb").data.points)
    one = read(glb(tmp_path / "one.glb", ("a", ball())))
    done = smooth(one, method="curvature", stop=Steps(2))
    assert type(done) is type(one)
    assert not np.array_equal(done.data.points, one.data.points)
    with pytest.raises(InputError, match=r"a file already says channels; read it with them"):
        smooth(one, channels="colors")


def test_a_scene_told_in_full_has_a_result_for_each_part():
    before = scene()
    results = smooth(before, method="curvature", stop=Steps(2), result=True)
    alone = smooth(ball(), method="curvature", stop=Steps(2), result=True)
    assert isinstance(results, meshflow.Results)
    assert list(results) == ["left", "right"]
    assert np.array_equal(results.data.geometry["left"].vertices, alone.data.vertices)
    assert results["left"].parameters == alone.parameters
    assert str(alone) in str(results)
    assert json.loads(results.to_json())["parts"]["left"] == json.loads(alone.to_json())
    assert np.array_equal(
        smooth(before, method="curvature", stop=Steps(2), result=True)["left"].after.points, alone.after.points
    )
    assert len(results.after.points) == 600


def test_the_same_name_twice_is_told_apart():
    blocks = pyvista.MultiBlock([pyvista.PolyData.from_regular_faces(NOISY, FACES)] * 2)
    blocks.set_block_name(0, "it")
    blocks.set_block_name(1, "it")
    assert list(smooth(blocks, method="curvature", stop=Steps(1), result=True)) == ["it", "it (2)"]


def test_a_refusal_names_its_part(tmp_path):
    path = glb(tmp_path / "in.glb", ("closed", ball()), ("open", trimesh.Trimesh(BALL, FACES[5:], process=False)))
    result = CliRunner().invoke(app, ["smooth", str(path), str(tmp_path / "o.glb"), "--preserve", "volume", *WAY])
    assert result.exit_code != 0
    assert "part open: " in str(result.exception)


def test_blocks_keep_the_files_of_others_in_their_folder(tmp_path):
    path = vtm(tmp_path / "in.vtm", ("a", BOX), ("b", ball(attribute=False)))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    run("smooth", path, tmp_path / "out.vtm", *WAY)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["mine.txt", "out_0.vtp", "out_1.vtp"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "in.vtm", "out", "out.vtm"]
    with pytest.raises(FormatError, match="blocks are written of what came in blocks"):
        write(read(glb(tmp_path / "in.glb", ("a", BOX))), tmp_path / "other.vtm")


def test_what_shows_all_parts_in_one_flow_says_so(tmp_path):
    path = glb(tmp_path / "in.glb", ("a", ball()), ("b", BOX))
    notes = meshflow.viewer.session.view(
        read(path),
        place=meshflow.viewer.controls.Page(tmp_path / "p.html"),
        states=meshflow.viewer.controls.States(2),
        request=Request.of(time=0.01),
    )
    assert any("all parts are smoothed together here" in note for note in notes)
    assert flowing_together(read(glb(tmp_path / "one.glb", ("a", ball())))) == ()


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is not there")
def test_solids_of_a_real_file_are_parts(tmp_path):
    path = SHARED / "meshes" / "messy" / "multibody.stl"
    document = read(path)
    assert [name for name, _ in document.sections] == ["bodyB", "bodyA"]
    results = smooth(document, method="curvature", stop=Steps(3), result=True)
    for name, rows in document.sections:
        at = np.full(len(document.data.points), -1)
        at[rows] = np.arange(len(rows))
        faces = at[document.data.faces]
        alone = smooth((document.data.points[rows], faces[(faces >= 0).all(axis=1)]), method="curvature", stop=Steps(3))
        assert np.array_equal(results[name].after.points, alone[0])
    write(results.data, tmp_path / "out.stl")
    assert [name for name, _ in read(tmp_path / "out.stl").sections] == ["bodyB", "bodyA"]
    for name in ("fuze.obj", "cubevc.glb"):
        assert read(SHARED / "meshes" / "attributes" / name).sections == ()
