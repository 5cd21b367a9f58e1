"""Colours, texture and data of faces of real files come through a smoothing untouched."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from meshflow.flow.methods.searched import Search
from meshflow.flow.stops import Steps
from meshflow.io.files import read, write
from meshflow.smoothing import smooth
from meshflow.synthetic.shapes import dome

FOLDER = Path(__file__).parents[2] / "shared" / "data" / "meshes" / "attributes"
FILES = sorted(p for p in FOLDER.glob("*") if p.suffix in (".ply", ".glb", ".obj"))
MOVED = {"x", "y", "z", "nx", "ny", "nz"}


def parts(path):
    return trimesh.load_scene(path, process=False).geometry


def columns(path):
    """Every number of a PLY by element and property."""
    raw = next(iter(parts(path).values())).metadata["_ply_raw"]
    for element, held in raw.items():
        names = held["properties"]
        for name in names:
            column = held["data"][name]
            yield (element, name), column["f1"] if column.dtype.names else column


def visuals(mesh):
    """What is drawn: texture coordinates, colours, the pixels of the image."""
    uv, material = getattr(mesh.visual, "uv", None), getattr(mesh.visual, "material", None)
    if uv is not None:
        yield "uv", np.asarray(uv)
    if mesh.visual.kind in ("vertex", "face"):
        yield (
            "colours",
            np.asarray(mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else mesh.visual.face_colors),
        )
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None:
        yield "image", np.asarray(image)
    yield from ((name, np.asarray(values)) for name, values in mesh.vertex_attributes.items() if "color" not in name)
    yield from ((name, np.asarray(values)) for name, values in mesh.face_attributes.items())


@pytest.mark.shared
@pytest.mark.skipif(not FOLDER.exists(), reason="no ../shared/data/meshes")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_attributes_of_real_files_come_back_as_they_were(path, tmp_path):
    document = read(path)
    step = document.data.step
    shaken = document.data.points + 0.05 * step * np.random.default_rng(0).normal(size=document.data.points.shape)
    data = smooth(
        document.holding(type(document.data)(shaken, document.data.faces)).data, method="curvature", stop=Steps(2)
    )
    target = tmp_path / path.name
    write(document.holding(data), target)
    before, after = parts(path), parts(target)
    assert list(before) == list(after)
    moved = 0.0
    for name in before:
        assert np.array_equal(before[name].faces, after[name].faces)
        moved = max(moved, np.abs(before[name].vertices - after[name].vertices).max())
        one, two = dict(visuals(before[name])), dict(visuals(after[name]))
        assert list(one) == list(two)
        for what, values in one.items():
            assert np.array_equal(values, two[what]), what
    assert moved > 1e-3 * step
    if path.suffix == ".ply":
        kept = dict(columns(target))
        for where, values in columns(path):
            if where[1] not in MOVED:
                assert kept[where].dtype == values.dtype
                assert np.array_equal(kept[where], values), where


@pytest.mark.long
def test_a_smooth_field_on_an_irregular_mesh_loses_its_noise_by_the_heat_equation_and_steps_by_another():
    mesh, rng = dome(1500), np.random.default_rng(0)
    x, y, z = mesh.points.T
    for field, method, most in (
        (np.sin(2 * x + y)[:, None], "heat", 0.3),
        (np.stack([np.sin(2 * x + y), np.cos(2 * y), z * x], axis=1), "heat", 0.3),
        ((np.sin(5 * x) > 0)[:, None] * 1.0, "beltrami", 0.8),
    ):
        noisy = field + 0.05 * rng.normal(size=field.shape)
        result = smooth((mesh.points, mesh.faces), channels=noisy, result=True)
        left = np.sqrt(np.mean((result.data[2] - field) ** 2)) / 0.05
        assert result.parameters["method"].value == method
        assert left < most, f"{left:.3f} of the noise"


def test_a_given_contrast_excludes_the_heat_equation_which_has_none():
    mesh, rng = dome(600), np.random.default_rng(0)
    noisy = mesh.points[:, :1] + 0.05 * rng.normal(size=(len(mesh.points), 1))
    result = smooth((mesh.points, mesh.faces), channels=noisy, method=Search(contrast=2.0), result=True)
    assert result.parameters["method"].value == "beltrami"
    assert result.parameters["contrast"].value == 2.0
