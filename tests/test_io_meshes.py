"""Mesh files: what must survive between a reader and a writer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.mesh_files import again, cube_obj, moved, whole

from meshflow.errors import FormatError, InputError
from meshflow.geometry.connectivity import boundary_edges
from meshflow.io.files import Document, read, write
from meshflow.io.objects import from_object
from meshflow.io.vertex_merging import joined
from meshflow.smoothing import smooth
from meshflow.surfaces.mesh import Mesh

SHARED = Path(__file__).parents[2] / "shared" / "data"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is not there")
FILES = sorted(
    path.relative_to(SHARED / "meshes").as_posix()
    for folder in ("attributes", "messy", "irregular")
    for path in (SHARED / "meshes" / folder).glob("*")
    if path.suffix not in (".jpg", ".mtl")
)


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize("name", FILES)
def test_a_real_file_comes_back_moved_and_otherwise_equal(name, tmp_path):
    source = SHARED / "meshes" / name
    target = tmp_path / f"out{source.suffix}"
    document, _ = again(source, target)
    back = read(target)
    assert np.array_equal(back.data.faces, document.data.faces)
    scale = np.abs(document.data.points).max()
    np.testing.assert_allclose(back.data.points, document.data.points + np.float32(0.01), atol=2e-7 * scale + 1e-9)
    if source.suffix == ".vtp":
        before, after = pyvista.read(source), pyvista.read(target)
        assert np.array_equal(before.faces, after.faces)
        assert before.points.dtype == after.points.dtype
        return
    before, after = (trimesh.load_scene(path, process=False) for path in (source, target))
    assert sum(len(mesh.vertices) for mesh in before.geometry.values()) == sum(
        len(m.vertices) for m in after.geometry.values()
    )
    for old, new in zip(before.geometry.values(), after.geometry.values(), strict=True):
        assert np.array_equal(old.faces, new.faces)
        assert old.visual.kind == new.visual.kind
        if old.visual.kind == "vertex":
            assert np.array_equal(old.visual.vertex_colors, new.visual.vertex_colors)
        if old.visual.kind == "texture":
            assert np.array_equal(old.visual.uv, new.visual.uv)
        assert ("vertex_normals" in old._cache.cache) == ("vertex_normals" in new._cache.cache)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off", ".glb", ".vtp", ".vtk"])
def test_points_and_faces_survive_every_format(suffix, tmp_path):
    points = trimesh.creation.icosphere(subdivisions=2)
    path, target = tmp_path / f"in{suffix}", tmp_path / f"out{suffix}"
    if suffix in (".vtp", ".vtk"):
        pyvista.PolyData.from_regular_faces(points.vertices, points.faces).save(path)
    else:
        points.export(path)
    document, _ = again(path, target)
    assert document.data.points.shape == (162, 3)
    back = read(target).data
    assert np.array_equal(back.faces, document.data.faces)
    np.testing.assert_allclose(back.points, document.data.points + 0.01, atol=3e-7)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".vtp", ".vtk"])
def test_what_did_not_move_keeps_its_bits(suffix, tmp_path):
    rng = np.random.default_rng(0)
    mesh = trimesh.creation.icosphere(subdivisions=1)
    points = mesh.vertices + rng.normal(size=mesh.vertices.shape) * 0.1
    path, target = tmp_path / f"in{suffix}", tmp_path / f"out{suffix}"
    if suffix in (".vtp", ".vtk"):
        pyvista.PolyData.from_regular_faces(points, mesh.faces).save(path)
    else:
        trimesh.Trimesh(points, mesh.faces, process=False).export(path)
    document = read(path)
    write(document, target, tags={})
    assert np.array_equal(read(target).data.points, document.data.points)
    if suffix in (".ply", ".obj", ".off"):
        assert target.read_bytes() == path.read_bytes()


def test_colours_are_channels_that_are_rounded_and_clipped_and_alpha_is_untouched(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    colors = np.random.default_rng(1).integers(0, 255, (len(mesh.vertices), 4)).astype(np.uint8)
    mesh.visual.vertex_colors = colors
    mesh.export(tmp_path / "in.ply")
    document = read(tmp_path / "in.ply", channels="colors", moves="channels")
    assert document.data.moves == "channels"
    np.testing.assert_array_equal(document.data.channels, colors[:, :3])
    louder = document.holding(replace(document.data, channels=document.data.channels + np.float32(60.4)))
    write(louder, tmp_path / "out.ply", tags={})
    back = whole(tmp_path / "out.ply")
    np.testing.assert_array_equal(back.visual.vertex_colors[:, 3], colors[:, 3])
    np.testing.assert_array_equal(back.visual.vertex_colors[:, :3], np.minimum(colors[:, :3].astype(int) + 60, 255))
    np.testing.assert_array_equal(back.vertices, whole(tmp_path / "in.ply").vertices)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".vtp"])
def test_a_named_scalar_is_a_channel_and_returns_to_its_place(suffix, tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    heat = np.linspace(0, 1, len(mesh.vertices), dtype=np.float32)
    mesh.vertex_attributes["_heat"] = heat
    path = tmp_path / f"in{suffix}"
    if suffix == ".vtp":
        poly = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
        poly["_heat"] = heat
        poly.save(path)
    else:
        mesh.export(path)
    document = read(path, channels="_heat", moves="all")
    np.testing.assert_array_equal(document.data.channels[:, 0], heat)
    write(
        document.holding(replace(document.data, channels=document.data.channels * 2)),
        tmp_path / f"out{suffix}",
        tags={},
    )
    again_read = read(tmp_path / f"out{suffix}", channels="_heat")
    np.testing.assert_allclose(again_read.data.channels[:, 0], heat * 2, atol=1e-6)


def test_colours_of_an_obj_are_channels(tmp_path):
    lines = [f"v {x} {y} {z} {x} 0.5 0.25" for x, y, z in np.eye(4, 3)]
    (tmp_path / "in.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]))
    document = read(tmp_path / "in.obj", channels="colors", moves="channels")
    write(document.holding(replace(document.data, channels=document.data.channels / 2)), tmp_path / "out.obj", tags={})
    words = [line.split() for line in (tmp_path / "out.obj").read_text().splitlines()]
    assert words[0] == ["v", "1.0", "0.0", "0.0", "0.5", "0.25", "0.125"]
    assert words[-1] == ["f", "1", "3", "4"]


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".glb", ".vtp"])
def test_an_unknown_channel_is_refused_by_name(suffix, tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    if suffix == ".vtp":
        pyvista.wrap(mesh).save(tmp_path / "in.vtp")
    else:
        mesh.export(tmp_path / f"in{suffix}")
    with pytest.raises(FormatError, match=rf"in\{suffix}.*nothing"):
        read(tmp_path / f"in{suffix}", channels="nothing")


def test_colours_that_an_obj_has_not_are_refused(tmp_path):
    (tmp_path / "in.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FormatError, match="have no colours"):
        read(tmp_path / "in.obj", channels="colors")


@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
def test_every_array_survives_in_its_type(suffix, tmp_path):
    poly = pyvista.Sphere(theta_resolution=8, phi_resolution=8)
    poly.point_data["whole"] = np.arange(poly.n_points, dtype=np.int64) * 10**12
    poly.point_data["vector"] = np.random.default_rng(0).random((poly.n_points, 3))
    poly.cell_data["patch"] = np.arange(poly.n_cells, dtype=np.uint8)
    poly.field_data["era"] = np.array([1.5])
    poly.points = poly.points.astype(np.float64)
    poly.save(tmp_path / f"in{suffix}")
    document = read(tmp_path / f"in{suffix}")
    write(moved(document), tmp_path / f"out{suffix}", tags={"scale": "2 m"})
    back = pyvista.read(tmp_path / f"out{suffix}")
    assert back.points.dtype == np.float64
    for name, data in (
        ("whole", "point_data"),
        ("vector", "point_data"),
        ("patch", "cell_data"),
        ("era", "field_data"),
    ):
        before, after = getattr(poly, data)[name], getattr(back, data)[name]
        assert before.dtype == after.dtype
        assert np.array_equal(before, after)
    assert back.field_data["meshflow:scale"][0] == "2 m"


def test_other_data_sets_of_vtk_are_refused_with_the_way_out(tmp_path):
    pyvista.ImageData(dimensions=(3, 3, 1)).save(tmp_path / "in.vtk")
    with pytest.raises(FormatError, match=r"ImageData.*extract_surface"):
        read(tmp_path / "in.vtk")


def test_what_another_format_does_not_hold_is_said(tmp_path):
    document = read(cube_obj(tmp_path / "a"))
    (note, *_) = write(document, tmp_path / "out.stl", tags={})
    assert note == "STL does not hold: texture coordinates, texture image, materials, vertex normals"
    notes = write(document, tmp_path / "out.off", tags={})
    assert any("joined again" in note for note in notes)
    assert read(tmp_path / "out.off").data.points.shape == (8, 3)
    (note,) = write(document, tmp_path / "out.vtp", tags={})
    assert note == "VTP does not hold: texture image, materials"
    assert pyvista.read(tmp_path / "out.vtp").active_texture_coordinates.shape == (24, 2)


def test_attributes_survive_from_ply_to_vtp_and_back(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.vertex_attributes["heat"] = np.linspace(0, 1, 42)
    mesh.face_attributes["patch"] = np.arange(80, dtype=np.int32)
    mesh.visual.vertex_colors = np.random.default_rng(0).integers(0, 255, (42, 4)).astype(np.uint8)
    mesh.export(tmp_path / "in.ply")
    document = read(tmp_path / "in.ply", channels="heat")
    document = document.holding(replace(document.data, channels=document.data.channels + 1))
    assert write(document, tmp_path / "mid.vtp", tags={"a": "b"}) == ()
    poly = pyvista.read(tmp_path / "mid.vtp")
    np.testing.assert_allclose(poly.point_data["heat"], np.linspace(1, 2, 42))
    assert poly.cell_data["patch"].dtype == np.int32
    write(read(tmp_path / "mid.vtp"), tmp_path / "out.ply", tags={})
    back = whole(tmp_path / "out.ply")
    raw = back.metadata["_ply_raw"]
    np.testing.assert_allclose(raw["vertex"]["data"]["heat"], np.linspace(1, 2, 42))
    assert np.array_equal(raw["face"]["data"]["patch"], np.arange(80))
    assert np.array_equal(back.visual.vertex_colors, mesh.visual.vertex_colors)


def test_rounding_to_float32_is_said(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.apply_translation([500000.123, 4000000.456, 10])
    mesh.export(tmp_path / "in.off")
    notes = write(read(tmp_path / "in.off"), tmp_path / "out.ply", tags={})
    assert any("rounded to float32" in note and "0.1" in note for note in notes)


def test_a_name_with_spaces_is_renamed_for_ply_and_said(tmp_path):
    poly = pyvista.Icosphere(nsub=1)
    poly["the heat"] = np.arange(poly.n_points)
    poly["on"] = np.arange(poly.n_points) % 2 == 0
    poly.save(tmp_path / "in.vtp")
    notes = write(read(tmp_path / "in.vtp"), tmp_path / "out.ply", tags={})
    assert any("the_heat" in note for note in notes)
    raw = whole(tmp_path / "out.ply").metadata["_ply_raw"]["vertex"]
    assert np.array_equal(raw["data"]["the_heat"], np.arange(poly.n_points))
    assert raw["properties"]["on"] == "<u1"


def test_an_obj_is_written_with_its_image_and_never_over_another_file(tmp_path):
    mesh = whole(cube_obj(tmp_path / "a"))
    mesh.export(tmp_path / "in.glb")
    notes = write(read(tmp_path / "in.glb"), tmp_path / "out.obj", tags={})
    assert any("out.mtl" in note for note in notes)
    assert np.array_equal(
        np.asarray(whole(tmp_path / "out.obj").visual.material.image)[..., :3],
        np.arange(192, dtype=np.uint8).reshape(8, 8, 3),
    )
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "out.mtl").write_text("mine")
    with pytest.raises(FormatError, match="differs"):
        write(read(tmp_path / "in.glb"), tmp_path / "c" / "out.obj", tags={})
    assert (tmp_path / "c" / "out.mtl").read_text() == "mine"
    assert not (tmp_path / "c" / "out.obj").exists()


def test_parts_with_and_without_texture_do_not_go_into_one_obj(tmp_path):
    textured = whole(cube_obj(tmp_path / "a"))
    trimesh.Scene({"a": textured, "b": trimesh.creation.icosphere(subdivisions=1)}).export(tmp_path / "in.glb")
    document = read(tmp_path / "in.glb")
    with pytest.raises(FormatError, match="write .glb"):
        write(document, tmp_path / "out.obj", tags={})


def test_scalars_that_a_split_would_lose_are_refused_in_another_format(tmp_path):
    path = tmp_path / "in.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "property float heat\nelement face 2\nproperty list uchar int vertex_indices\n"
        "property list uchar float texcoord\nend_header\n0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n"
        "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 .5 .5 1 1 0 1\n"
    )
    document = read(path)
    with pytest.raises(FormatError, match="heat"):
        write(document, tmp_path / "out.vtp", tags={})
    assert write(moved(document), tmp_path / "out.ply", tags={}) == ()
    assert (tmp_path / "out.ply").read_text().splitlines()[-1] == "3 0 2 3 6 .5 .5 1 1 0 1"


def test_a_mesh_that_came_from_arrays_is_written(tmp_path):
    data = Mesh(np.eye(4, 3), np.array([[0, 1, 2], [0, 2, 3]]), np.arange(4.0))
    document = Document(data, tmp_path / "x.npz")
    write(document, tmp_path / "out.vtp", tags={})
    back = read(tmp_path / "out.vtp", channels="channels").data
    assert np.array_equal(back.points, data.points)
    assert np.array_equal(back.channels, data.channels)
    flat = replace(document, data=Mesh(np.eye(3)[:, :2], np.array([[0, 1, 2]])))
    with pytest.raises(InputError, match=r"R\^3"):
        write(flat, tmp_path / "flat.ply", tags={})


SCAN = Path(__file__).parents[2] / "shared" / "cases" / "scan"


def soup_of(mesh, apart=0.0, seed=0):
    """Three vertices of its own for every triangle, positions apart by so much."""
    points = np.array(mesh.vertices)[mesh.faces].reshape(-1, 3)
    points += apart * np.random.default_rng(seed).uniform(-1, 1, size=points.shape)
    return points, np.arange(len(points)).reshape(-1, 3)


@pytest.mark.parametrize("apart", [0.0, 1e-7])
def test_a_soup_of_arrays_is_one_surface_while_it_moves_and_a_soup_again(apart):
    ball = trimesh.creation.icosphere(3)
    ball.vertices *= 1.0 + 0.02 * np.random.default_rng(1).normal(size=(len(ball.vertices), 1))
    points, faces = soup_of(ball, apart)
    result = smooth((points, faces), result=True)
    after = result.data[0]
    assert len(after) == len(points)
    assert np.array_equal(result.data[1], faces)
    said, silent = (result.warnings, result.notes) if apart else (result.notes, result.warnings)
    assert any("3840 stored vertices are 642 of the surface" in note for note in said)
    assert not any("stored vertices" in note for note in silent)
    whole = smooth((np.array(ball.vertices), np.array(ball.faces)))[0]
    assert np.abs(after - whole[ball.faces].reshape(-1, 3)).max() < 1e-5 + 10 * apart
    assert np.abs(after - points).max() > 0.01


def test_vertices_a_rounding_apart_are_joined_and_come_back_to_the_bit():
    points, faces = soup_of(trimesh.creation.cylinder(1, 3, sections=32), 1e-7)
    document = from_object((points, faces))
    assert len(document.data.points) == 66
    assert np.array_equal(smooth((points, faces))[0], points)


def test_welding_takes_no_edge_from_a_triangle():
    corners = np.array([[0, 0, 0], [1e-8, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    first, home = joined(corners, faces=np.array([[0, 1, 2], [1, 3, 2]]))
    assert np.array_equal(home, np.arange(4))
    assert len(first) == 4


def test_a_vertex_that_no_triangle_uses_may_be_anything():
    ball = trimesh.creation.icosphere(3)
    points = np.array(ball.vertices) * (1.0 + 0.02 * np.random.default_rng(1).normal(size=(len(ball.vertices), 1)))
    expected = smooth((points, np.array(ball.faces)))[0]
    after = smooth((np.concatenate([points, [[np.nan] * 3]]), np.array(ball.faces)))[0]
    np.testing.assert_allclose(after[:-1], expected, atol=1e-12)
    assert np.isnan(after[-1]).all()
    with pytest.raises(InputError, match="NaN or infinity"):
        smooth((np.where(np.arange(len(points))[:, None] == 5, np.nan, points), np.array(ball.faces)))


@pytest.mark.shared
@pytest.mark.skipif(not SCAN.is_dir(), reason="../shared/cases is not there")
def test_the_parts_of_the_cases_are_closed_and_stay_and_the_noisy_soup_is_smoothed():
    block = read(SCAN / "angle_block.STL")
    assert len(block.data.points) == 352
    assert len(boundary_edges(block.data.faces)) == 0
    for name in ("angle_block.STL", "octagonal_pocket.ply"):
        part = read(SCAN / name)
        assert np.array_equal(smooth(part.data, result=True).after.points, part.data.points)
    soup = read(SCAN / "soup_1ulp.stl")
    assert len(soup.data.points) == 642
    assert np.abs(smooth(soup.data, result=True).after.points - soup.data.points).max() > 0.01
