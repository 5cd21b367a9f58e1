"""Scenes, blocks and meshio: parts by themselves, everything else as it was. meshflow.io.adapters.multipart, scenes, meshios."""

import sys

import meshio
import numpy as np
import pytest
import pyvista
import trimesh
from helpers.parts import parts
from helpers.scenes import BALL, FACES, FRAME, NOISY, ball, scene

import meshflow
from meshflow.errors import InputError, MissingPackage
from meshflow.estimate.constraints import Fixed, Mask, PreserveVolume
from meshflow.flow.compute import Compute
from meshflow.io.adapters.multipart import multipart
from meshflow.io.metadata import ReadOptions
from meshflow.smoothing import smooth

WORDS = {"method": "curvature", "steps": 2}


def test_parts_of_a_scene_are_smoothed_as_if_each_were_alone():
    before = scene()
    after = smooth(before, **parts(**WORDS))
    alone = smooth(ball(), **parts(**WORDS))
    assert type(after) is trimesh.Scene
    assert list(after.geometry) == list(before.geometry)
    assert np.array_equal(after.graph["right"][0], FRAME)
    for name in ("left", "right"):  # scaled by two, it is the same surface
        mesh = after.geometry[name]
        assert np.allclose(mesh.vertices, alone.vertices, atol=1e-12)
        assert np.array_equal(mesh.visual.vertex_colors, before.geometry[name].visual.vertex_colors)
        assert np.array_equal(mesh.vertex_attributes["half"], before.geometry[name].vertex_attributes["half"])
    assert np.array_equal(after.geometry["dots"].vertices, np.eye(3))
    assert np.array_equal(before.geometry["left"].vertices, NOISY)  # the caller's


def test_a_part_is_not_changed_by_what_is_beside_it():
    by_default = smooth(ball(), compute=Compute(search=False))
    two = trimesh.Scene({"a": ball(), "b": trimesh.creation.box([30, 30, 30]).subdivide()})
    assert np.array_equal(smooth(two, compute=Compute(search=False)).geometry["a"].vertices, by_default.vertices)
    volumes = smooth(
        trimesh.Scene({"a": ball(), "b": ball(3)}), method="curvature", time=0.01, constraints=PreserveVolume()
    )
    for name, first in (("a", ball()), ("b", ball(3))):
        assert volumes.geometry[name].volume == pytest.approx(first.volume, rel=1e-10)


def test_a_region_of_a_scene_is_named_in_each_part():
    held = smooth(scene(), **parts(fixed="half", **WORDS)).geometry["left"].vertices
    half = BALL[:, 2] > 0
    assert np.array_equal(held[half], NOISY[half])
    assert (held[~half] != NOISY[~half]).any(axis=1).all()
    with pytest.raises(InputError, match=r"part left: mask='hlf': no such array; there are half"):
        smooth(scene(), **parts(mask="hlf", **WORDS))
    channels = smooth(scene(), time=0.01, compute=Compute(search=False), channels="colors")
    assert np.array_equal(channels.geometry["left"].vertices, NOISY)
    assert (channels.geometry["left"].visual.vertex_colors != ball().visual.vertex_colors).any()


def test_blocks_are_smoothed_one_by_one_and_stay_where_they_were():
    poly = pyvista.PolyData.from_regular_faces(NOISY, FACES)
    poly.cell_data["patch"] = np.arange(len(FACES))
    blocks = pyvista.MultiBlock({"a": poly, "none": None, "in": pyvista.MultiBlock({"b": poly.copy()})})
    after = smooth(blocks, **parts(**WORDS))
    alone = smooth(poly, **parts(**WORDS))
    assert list(after.keys()) == ["a", "none", "in"]
    assert after["none"] is None
    for block in (after["a"], after["in"]["b"]):
        assert np.array_equal(block.points, alone.points)
        assert np.array_equal(block.cell_data["patch"], poly.cell_data["patch"])
    assert np.array_equal(blocks["a"].points, poly.points)
    cloud = pyvista.MultiBlock({"a": poly, "dots": pyvista.PolyData(np.eye(3))})
    with pytest.raises(InputError, match="block dots: .*a cloud has no surface"):
        smooth(cloud)
    with pytest.raises(InputError, match="at least one block"):
        smooth(pyvista.MultiBlock())


def test_what_is_of_one_surface_is_refused_for_several():
    with pytest.raises(InputError, match="mask: of several parts the name"):
        smooth(scene(), constraints=Mask(np.ones(600, bool)))
    with pytest.raises(InputError, match="fixed: of several parts the name"):
        smooth(scene(), constraints=Fixed(np.ones(600, bool)))
    with pytest.raises(InputError, match=r"trimesh.Scene: no triangles in it; a mesh expected"):
        smooth(trimesh.Scene([trimesh.PointCloud(np.eye(3))]))
    assert multipart(ball(), ReadOptions()) is None


def mixed():
    """A cube of triangles and quadrilaterals, with lines, data and sets."""
    box = trimesh.creation.box()
    quads = [[0, 1, 3, 2]]
    faces = [f for f in box.faces.tolist() if not set(f) <= set(quads[0])]
    return meshio.Mesh(
        box.vertices * np.float32(1),
        [("triangle", faces), ("quad", quads), ("line", [[0, 1]])],
        point_data={"heat": np.arange(8, dtype=np.int16), "Normals": np.asarray(box.vertex_normals, np.float32)},
        cell_data={"patch": [np.arange(len(faces)), np.array([7]), np.array([9])]},
        point_sets={"corner": np.array([0])},
        field_data={"wall": np.array([1, 2])},
    )


def test_a_mesh_of_meshio_comes_back_with_all_that_it_had():
    before = mixed()
    after = smooth(before, method="curvature", time=0.02)
    assert type(after) is meshio.Mesh
    assert after.points.dtype == before.points.dtype
    assert (after.points != before.points).any()
    assert np.array_equal(before.points, mixed().points)
    for one, two in zip(after.cells, before.cells, strict=True):
        assert one.type == two.type
        assert np.array_equal(one.data, two.data)
    for one, two in zip(after.cell_data["patch"], before.cell_data["patch"], strict=True):
        assert np.array_equal(one, two)
    assert np.array_equal(after.point_data["heat"], before.point_data["heat"])
    assert np.array_equal(after.point_sets["corner"], [0])
    assert np.array_equal(after.field_data["wall"], [1, 2])
    assert after.point_data["Normals"].dtype == np.float32
    warm = smooth(before, time=0.2, compute=Compute(search=False), channels="heat")
    assert np.array_equal(warm.points, before.points)
    assert warm.point_data["heat"].dtype == np.int16
    still = smooth(before, method="curvature", time=0.02, constraints=Fixed("heat"))
    assert (still.points != before.points).any(axis=1).tolist() == [True] + [False] * 7
    result = smooth(before, method="curvature", time=0.02, result=True)
    assert any("1 quadrilaterals" in word for word in result.notes)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ([("tetra", [[0, 1, 2, 3]])], "name of point data expected.*there are none.*extract_surface"),
        ([("vertex", [[0]])], "a cloud has no surface"),
        ([("triangle6", [[0, 1, 2, 3, 4, 5]])], "1 cells triangle6"),
    ],
)
def test_what_is_no_surface_of_meshio_is_refused_with_the_way_out(cells, said):
    with pytest.raises(InputError, match=said):
        smooth(meshio.Mesh(np.random.default_rng(0).normal(size=(6, 3)), cells))


def test_hints_that_do_not_fit_meshio_are_refused(monkeypatch):
    for hints, said in (
        ({"channels": "het"}, "no such point data; there are heat, Normals"),
        ({"spacing": 1.0}, "no option of a meshio mesh"),
        ({"kind": "terrain"}, "kind='terrain'"),
    ):
        with pytest.raises(InputError, match=said):
            smooth(mixed(), **parts(**hints))
    with pytest.raises(InputError, match="a meshio.Mesh expected"):
        smooth(mixed().cells[0])
    data = mixed()
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(MissingPackage, match=r"pip install 'meshflow\[meshio\]'"):
        meshflow.smooth(data)
