"""Soft constraints, and words of one number per sample by the name of an array. meshflow.flow.mobility, meshflow.io.metadata."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.command import run as command
from helpers.mesh_files import ply
from helpers.parts import parts
from helpers.shapes import along_normals, sphere

import meshflow
from meshflow.errors import InputError
from meshflow.estimate.constraints import Fixed, Mask, Mobility, PreserveVolume
from meshflow.flow.blend import Blend, euler
from meshflow.flow.compute import Compute
from meshflow.flow.constraints import Faithful, trust_of
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.low_pass import LowPass
from meshflow.flow.methods import Fairing
from meshflow.flow.mobility import Slowed
from meshflow.flow.steppers import SemiImplicit
from meshflow.io.document import Source
from meshflow.smoothing import smooth
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

BALL, FACES = sphere(400)
NOISY = along_normals(BALL, FACES, 0.2)
RNG = np.random.default_rng(5)
Z = np.cumsum(RNG.normal(size=(24, 20)), axis=0)
WAYS = [
    {"method": "curvature"},
    {"method": "curvature", "stepper": "semi-implicit", "time": 0.02},
    {"method": "conformal", "time": 0.02, "preserve": "volume"},
    {"method": "fairing", "order": 4, "search": False},
    {"method": "fairing", "weights": "uniform", "search": False},
    {"method": "normal-filter", "steps": 2},
]


def engines():
    """Engines of both kinds and one step of each."""
    mesh = MeshFlow(Mesh(NOISY, FACES).lifted(Lift()))
    coloured = Mesh(NOISY, FACES, channels=BALL[:, :2]).lifted(Lift(contrast=2.0))
    for flow in (
        mesh,
        MeshFlow(coloured),
        GridFlow(HeightField(Z).gridded(Lift(contrast=0.5))),
        GridFlow(Image(np.stack([Z, Z**2], 2)).gridded(Lift())),
        MeshFlow(HeightField(Z).lifted(Lift())),
    ):
        yield flow, RNG.uniform(0.1, 1.0, (len(flow.start()), 1))


@pytest.mark.parametrize("index", range(5))
def test_the_speed_multiplies_the_rate_in_every_engine_and_stepper(index):
    flow, speed = list(engines())[index]
    slowed, u = Slowed(flow, speed), flow.start()
    rate = np.array(flow.rate(u))
    dt = 1.0 / slowed.bound(u)
    assert np.allclose(slowed.rate(u), speed * rate, rtol=1e-12)
    assert np.allclose(slowed.rate(u, 0, euler(dt)), u + dt * speed * rate, rtol=1e-12, atol=1e-12)
    more = slowed.rate(u, 0, Blend(1.0, dt, ((0.25, rate),), (0.5, rate)), np.empty_like(u, order="F"))
    assert np.allclose(more, u + dt * speed * rate + 0.25 * (rate - u) + 0.5 * rate, rtol=1e-12, atol=1e-12)
    # Implicit: (M / s + dt L) change = dt M rate.
    system, inner = slowed.system(u), flow.system(u)
    change = SemiImplicit("direct").step(slowed, u, 10 * dt, 0) - u
    stiffness = inner.matrix(1.0) - inner.matrix(0.0)
    left = (np.asarray(inner.mass)[:, None] / speed) * change + 10 * dt * (stiffness @ change)
    assert np.allclose(system.mass, np.asarray(inner.mass) / speed[:, 0])
    assert np.allclose(left, 10 * dt * np.asarray(inner.mass)[:, None] * rate, atol=1e-8 * np.abs(left).max())


@pytest.mark.parametrize("way", WAYS, ids=lambda way: " ".join(map(str, way.values())))
def test_speed_one_is_the_flow_itself_and_speed_zero_is_fixed(way):
    free = smooth((NOISY, FACES), **parts(**way))[0]
    same = smooth((NOISY, FACES), **parts(mobility=np.ones(len(NOISY)), **way))[0]
    assert np.abs(same - free).max() < 1e-9
    stays = np.arange(len(NOISY)) % 3 == 0
    still = smooth((NOISY, FACES), **parts(mobility=np.where(stays, 0.0, 1.0), **way))[0]
    fixed = smooth((NOISY, FACES), **parts(fixed=stays, **way))[0]
    assert np.array_equal(still[stays], NOISY[stays])
    assert np.abs(still - fixed).max() < 1e-9
    half = smooth((NOISY, FACES), **parts(mobility=np.full(len(NOISY), 0.3), **way))[0]
    assert 0 < np.linalg.norm(half - NOISY) < np.linalg.norm(free - NOISY)


def test_half_the_speed_everywhere_is_half_the_time():
    words = {"gamma": 0.0, "contrast": 0.7, "stepper": "explicit"}
    half = smooth(Z, **parts(mobility=np.full(Z.shape, 0.5), time=2.0, dt=0.1, **words))
    assert np.allclose(half, smooth(Z, **parts(time=1.0, dt=0.05, **words)), atol=1e-10)
    fairing = {"method": "fairing", "order": 2, "weights": "cotangent"}
    filtered = smooth((NOISY, FACES), **parts(mobility=np.full(len(NOISY), 0.5), time=0.02, **fairing))[0]
    assert np.allclose(filtered, smooth((NOISY, FACES), **parts(time=0.01, **fairing))[0], atol=1e-6)


def test_a_grid_goes_slower_where_it_is_told_to_with_a_fidelity_too():
    speed = np.ones(Z.shape)
    speed[:, :10] = 0.1
    for words in ({}, {"data_weights": 0.1}, {"max_change": 1.0}, {"stepper": "super-time"}):
        moved = np.abs(smooth(Z, **parts(mobility=speed, time=1.0, search=False, **words)) - Z)
        free = np.abs(smooth(Z, **parts(time=1.0, search=False, **words)) - Z)
        assert moved[:, :8].mean() < 0.6 * free[:, :8].mean()
        assert np.allclose(moved[:, 14:].mean(), free[:, 14:].mean(), rtol=0.1)
    flow = GridFlow(HeightField(Z).gridded(Lift()))
    held = Faithful(Slowed(flow, speed.reshape(-1, 1)), trust_of(0.5, Z.shape, Z.size, 1.0))
    assert np.allclose(held.rate(flow.start() + 1.0), speed.reshape(-1, 1) * flow.rate(flow.start() + 1.0) - 0.5)


def test_the_volume_is_kept_by_what_is_free_to_go():
    speed = np.linspace(0.0, 1.0, len(NOISY))
    found = smooth((NOISY, FACES), method="curvature", constraints=[Mobility(speed), PreserveVolume()])[0]
    assert np.array_equal(found[0], NOISY[0])
    assert meshflow.evaluate.metrics.volume(found, FACES) == pytest.approx(
        meshflow.evaluate.metrics.volume(NOISY, FACES), rel=1e-10
    )


@pytest.mark.parametrize("way", [{}, {"method": "heat"}, {"method": "perona-malik", "contrast": 2.0}], ids=str)
def test_a_search_at_half_the_speed_takes_twice_the_time(way):
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:64, :48]
    noisy = 3 * np.sin(rows / 9) + 3 * np.cos(columns / 7) + rng.normal(size=rows.shape)
    one, half = (smooth(noisy, **parts(mobility=np.full(noisy.shape, s), **way), result=True) for s in (1.0, 0.5))
    assert half.parameters["time"].value == pytest.approx(2 * one.parameters["time"].value, rel=0.15)
    assert half.parameters["risk"].value == pytest.approx(one.parameters["risk"].value, rel=0.05)
    assert smooth(noisy, **parts(**way), result=True).parameters["time"].value == pytest.approx(
        one.parameters["time"].value, rel=1e-9
    )


def test_the_risk_of_a_search_counts_what_is_held_back():
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:300, :320]  # so large that the search looks at tiles
    truth = 3 * np.sin(rows / 9) + 3 * np.cos(columns / 7)
    noisy = truth + rng.normal(size=truth.shape)
    speed = np.where(columns < 160, 0.01, 1.0)
    free = smooth(noisy, noise=1.0, result=True)
    held = smooth(noisy, noise=1.0, constraints=Mobility(speed), result=True)
    for result in (free, held):
        error = np.sqrt(np.mean((result.data - truth) ** 2))
        assert result.parameters["risk"].value == pytest.approx(error, rel=0.1)
    assert held.parameters["risk"].value > 2 * free.parameters["risk"].value


@pytest.mark.long
def test_the_risk_of_a_mesh_counts_what_is_held_back():
    ball, faces = sphere(2000)
    noisy = along_normals(ball, faces, 0.2)
    speed = np.where(ball[:, 2] > 0, 0.01, 1.0)
    for way in (
        {"method": "fairing"},
        {"method": "normal-filter"},
        {"channels": ball[:, 0] + 0.2 * RNG.normal(size=2000)},
    ):
        data = (noisy, faces) if "method" in way else (ball, faces)
        free, held = (
            smooth(data, **parts(noise=0.2 if "channels" in way else None, **s, **way), result=True)
            for s in ({}, {"mobility": speed})
        )
        found = held.after
        off = found.channels[:, 0] - ball[:, 0] if "channels" in way else np.linalg.norm(found.points, axis=1) - 1.0
        assert held.parameters["risk"].value == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.2), way
        assert held.parameters["risk"].value > 1.5 * free.parameters["risk"].value, way
    one, half = (
        smooth(
            (noisy, faces),
            method=Fairing(order=2, weights="uniform"),
            constraints=Mobility(np.full(2000, s)),
            result=True,
        )
        for s in (1.0, 0.5)
    )
    assert half.parameters["time"].value == pytest.approx(2 * one.parameters["time"].value, rel=0.15)


def test_the_pieces_of_a_large_mesh_are_searched_at_their_own_speed():
    ball, faces = sphere(14_000)
    noisy = along_normals(ball, faces, 0.2)
    speed = np.where(ball[:, 2] > 0, 0.01, 1.0)
    free, held = (
        smooth((noisy, faces), **parts(method="fairing", order=2, weights="uniform", **s), result=True)
        for s in ({}, {"mobility": speed})
    )
    assert held.parameters["risk"].value > 2 * free.parameters["risk"].value


BAD = [
    (np.ones(5), r"mobility: a number, or one per sample, shape \(400,\), expected, got \(5,\)"),
    (np.full(400, 1.5), "between 0 .fixed. and 1 .* got 1.5"),
    (np.full(400, np.nan), "got nan"),
    (1.5, "a number, zero to 1, or an array expected, got 1.5"),
    (np.array([object()] * 400), "a number or an array of numbers expected"),
]


@pytest.mark.parametrize(("speed", "said"), BAD, ids=[said for _, said in BAD])
def test_speeds_that_make_no_sense_are_refused(speed, said):
    with pytest.raises(InputError, match=said):
        smooth((NOISY, FACES), constraints=Mobility(speed))


def test_one_speed_for_all_is_the_same_flow_for_as_much_less_time():
    for data, words in (((NOISY, FACES), {"method": "curvature"}), (Z, {"gamma": 0, "contrast": 1.0})):
        half = smooth(data, **parts(mobility=0.5, time=0.002, stepper="explicit", dt=0.0002, **words))
        short = smooth(data, **parts(time=0.001, stepper="explicit", dt=0.0001, **words))
        assert np.allclose(half[0], short[0], atol=1e-12)
    assert (
        smooth((NOISY, FACES), method="curvature", constraints=Mobility(0.5), result=True).parameters["mobility"].value
        == 0.5
    )


def test_a_mask_is_what_is_not_zero_however_it_is_given():
    half = BALL[:, 2] > 0
    mesh = trimesh.Trimesh(NOISY, FACES, process=False)
    mesh.vertex_attributes["mark"] = np.where(half, -0.5, np.where(BALL[:, 2] < -0.5, np.nan, 0.0))
    words = {"method": "curvature", "steps": 1}
    expected = np.asarray(smooth(mesh, **parts(fixed=half, **words)).vertices)
    for given in ("mark", mesh.vertex_attributes["mark"], half.astype(np.uint8), 255 * half.astype(int)):
        assert np.array_equal(smooth(mesh, **parts(fixed=given, **words)).vertices, expected)
        if not isinstance(given, str):
            assert np.array_equal(smooth((NOISY, FACES), **parts(fixed=given, **words))[0], expected)
            only = np.where(half, 0.0, 1.0)
            assert np.array_equal(smooth((NOISY, FACES), **parts(mask=only, **words))[0], expected)
    with pytest.raises(InputError, match="mask: a mask of booleans, or of numbers, expected, got dtype <U1"):
        smooth((NOISY, FACES), constraints=Mask(np.full(400, "a")))


def test_a_low_pass_of_a_slowed_grid_has_no_matrix():
    flow = GridFlow(HeightField(Z).gridded(Lift()))
    with pytest.raises(InputError, match="GridFlow has none"):
        LowPass().step(Slowed(flow, np.ones((Z.size, 1))), flow.start(), 1.0, 0)


def named():
    """Meshes of other packages with a selection, speeds and a vector by name."""
    half = BALL[:, 2] > 0
    speed = np.where(half, 0.0, 1.0)
    mesh = trimesh.Trimesh(NOISY, FACES, process=False)
    poly = pyvista.PolyData.from_regular_faces(NOISY, FACES)
    for data in (mesh.vertex_attributes, poly.point_data):
        data["half"], data["how"], data["flow"] = half.astype(np.uint8), speed, BALL
    return half, [(mesh, lambda mesh: np.asarray(mesh.vertices)), (poly, lambda mesh: np.asarray(mesh.points))]


@pytest.mark.parametrize("which", [0, 1], ids=["trimesh", "pyvista"])
def test_a_region_is_named_by_an_array_of_the_object(which):
    half, things = named()
    data, points = things[which]
    for words in ({"fixed": "half"}, {"mobility": "how"}):
        moved = points(smooth(data, **parts(method="curvature", **words))) != points(data)
        assert not moved[half].any()
        assert moved[~half].any(axis=1).all()
    moved = points(smooth(data, method="curvature", constraints=Mask("half"))) != points(data)
    assert not moved[~half].any()
    for words, said in (
        ({"mask": "hlf"}, "mask='hlf': no such array; there are half, how, flow"),
        ({"fixed": "hlf"}, "fixed='hlf': no such array; there are half, how, flow"),
        ({"mobility": "flow"}, "one number per vertex expected, got shape"),
        ({"mask": half[:-1]}, r"mask: a mask of shape \(400,\) expected"),
    ):
        with pytest.raises(InputError, match=said):
            smooth(data, **parts(**words))


def test_a_region_of_an_image_is_named_by_an_array_of_the_object():
    image = pyvista.ImageData(dimensions=(20, 24, 1))
    image.point_data["z"] = Z.ravel()
    image.point_data["still"] = (np.arange(480) < 100).astype(int)
    image.set_active_scalars("z")
    found = smooth(image, time=1.0, constraints=Fixed("still"), compute=Compute(search=False))
    moved = np.asarray(found.point_data["z"]) != Z.ravel()
    assert not moved[:100].any()
    assert moved[100:].mean() > 0.9
    with pytest.raises(InputError, match="there are z, still"):
        smooth(image, constraints=Fixed("stil"))


def test_a_surface_without_names_refuses_one():
    with pytest.raises(InputError, match="mask: an array expected, got 'region'"):
        smooth(Z, constraints=Mask("region"))


def test_joined_vertices_are_held_if_one_of_them_is():
    soup = trimesh.Trimesh(NOISY, FACES, process=False)
    soup.unmerge_vertices()
    one = np.zeros(len(soup.vertices), bool)
    one[0] = True
    for words in (
        {"mask": ~one},
        {"fixed": one},
        {"mobility": (~one).astype(float)},
        {"max_change": np.where(one, 0.0, 1.0)},
    ):
        found = smooth(soup, **parts(method="curvature", **words))
        copies = (np.asarray(soup.vertices) == soup.vertices[0]).all(axis=1)
        assert copies.sum() > 3
        assert np.array_equal(found.vertices[copies], soup.vertices[copies])
        assert (found.vertices != soup.vertices).any(axis=1)[~copies].all()


def test_the_command_takes_the_name_of_an_attribute_in_the_file(tmp_path):
    rows = [f"{x} {y} {z} {int(x > 0)} {min(abs(x), 1)}" for x, y, z in NOISY]
    vertex = ("double x", "double y", "double z", "uchar mark", "float how")
    path = ply(tmp_path / "ball.ply", vertex=vertex, rows=rows, faces=[f"3 {i} {j} {k}" for i, j, k in FACES])
    document = meshflow.read(path)
    mark = document.samples("mark", "fixed")
    assert np.array_equal(mark, NOISY[:, 0] > 0)

    def run(*words):
        return command("smooth", path, tmp_path / "o.ply", "--overwrite", "--method", "curvature", *words)

    for word, still in (("--fixed", mark), ("--mask", ~mark)):
        done = run(word, "mark")
        assert done.returncode == 0, done.stderr
        moved = (meshflow.read(tmp_path / "o.ply").data.points != document.data.points).any(axis=1)
        assert np.array_equal(moved, ~still)
    assert run("--mobility", "how").returncode == 0
    for word in ("--mobility", "--data-weights"):
        assert run(word, "0.5", "--time", "0.01").returncode == 0
    refusal = run("--fixed", "marc").stderr
    assert "--fixed marc: no such array; there are mark, how; nor is there a file of that name" in refusal
    assert refusal.count("\n") == 1


def test_every_mesh_format_says_which_names_it_has(tmp_path):
    mesh = trimesh.Trimesh(NOISY, FACES, process=False)
    poly = pyvista.PolyData.from_regular_faces(NOISY, FACES)
    mesh.vertex_attributes["_mark"] = poly.point_data["_mark"] = np.arange(400, dtype=np.float32)
    mesh.export(tmp_path / "m.glb")
    poly.save(tmp_path / "m.vtp")
    for name in ("m.glb", "m.vtp"):
        document = meshflow.read(tmp_path / name)
        assert np.array_equal(document.samples("_mark", "mobility"), np.arange(400))
        with pytest.raises(InputError, match="there are _mark"):
            document.samples("mark", "mask")
    mesh = trimesh.Trimesh(NOISY, FACES, process=False)
    for name in ("m.obj", "m.off", "m.stl"):
        mesh.export(tmp_path / name)
        with pytest.raises(InputError, match="there are none"):
            meshflow.read(tmp_path / name).samples("mark", "mask")
    assert replace(document, source=Source()).samples(mesh, "mask") is mesh
