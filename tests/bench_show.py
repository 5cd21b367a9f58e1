"""Real data of ../shared/data, smoothed and measured against its truth: ``pytest -m bench -s tests/bench_show.py``."""

import subprocess
import sys
import time
from pathlib import Path

import matplotlib.cbook
import numpy as np
import pytest
import rasterio
import trimesh

import meshflow
from meshflow import view
from meshflow.estimate.request import Request
from meshflow.evaluate import metrics
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Beltrami
from meshflow.smoothing import noise_facts
from meshflow.synthetic import shapes
from meshflow.synthetic.scenes import fractal_terrain

SHARED = Path(__file__).parents[2] / "shared" / "data"
pytestmark = [pytest.mark.bench, pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is absent")]


def rms(error):
    return float(np.sqrt(np.mean(np.square(error))))


def test_mola_quantised_to_200_m():
    coarse = meshflow.read(SHARED / "dem/mola_olympus_crop_q200m_derived.tif").data
    truth = meshflow.read(SHARED / "dem/mola_olympus_crop_derived.tif").data.z.astype(float)
    default = meshflow.smooth(coarse, result=True)
    known = meshflow.smooth(
        coarse, method=Beltrami(gamma=0, contrast=coarse.step / 115), time=coarse.step**2, result=True
    )
    print(f"\nMOLA, 200 m steps: rms to the unquantised truth {rms(coarse.z - truth):.1f} m before")
    for name, run in (("by default", default), ("gamma 0, contrast h / 115 m, time 1 h²", known)):
        print(f"  {name}: {rms(run.after.z - truth):.1f} m after {run.end.step} steps")
    assert max(rms(known.after.z - truth), rms(default.after.z - truth)) < 40 < rms(coarse.z - truth)


def _scenes():
    rng, data = np.random.default_rng(0), Path(__file__).parents[1] / "data"
    steps = np.kron(rng.integers(0, 8, (8, 8)) * 12.0, np.ones((16, 16)))
    yield "steps, sigma 2", meshflow.HeightField(steps + 2 * rng.normal(size=steps.shape)), steps
    relief = np.load(matplotlib.cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))["elevation"].astype(
        float
    )
    yield "Jacksboro, sigma 5 m", meshflow.HeightField(relief + 5 * rng.normal(size=relief.shape)), relief
    yield "data/terrain.tif", meshflow.read(data / "terrain.tif").data, meshflow.read(data / "terrain_truth.tif").data.z
    yield (
        "data/picture.png",
        meshflow.read(data / "picture.png").data,
        meshflow.read(data / "picture_truth.png").data.values,
    )
    coarse = meshflow.read(SHARED / "dem/mola_olympus_crop_q200m_derived.tif").data
    yield "MOLA, 200 m steps", coarse, meshflow.read(SHARED / "dem/mola_olympus_crop_derived.tif").data.z


def test_default_contrast_and_time_against_the_best_of_a_grid():
    print("\nrms error: before, by default, the best of contrast 0.5 to 3 h / noise and time 1 to 8 h²")
    for name, data, truth in _scenes():
        key = "values" if isinstance(data, meshflow.Image) else "z"
        found = noise_facts(data)["noise"]

        def error(smoothed, key=key, truth=truth, there=~data.missing):
            return rms((getattr(smoothed, key).astype(float) - truth)[there])

        runs = {
            (c, t): error(
                meshflow.smooth(
                    data, method=Beltrami(gamma=0, contrast=c * data.step / found), time=t * data.step**2, result=True
                ).after
            )
            for c in (0.5, 1.0, 1.5, 2.0, 3.0)
            for t in (1, 2, 3, 5, 8)
        }
        best, default = min(runs, key=runs.__getitem__), error(meshflow.smooth(data, result=True).after)
        print(f"  {name:21} {error(data):8.3f} {default:8.3f} {runs[best]:8.3f} at contrast {best[0]}, time {best[1]}")
        assert default < error(data)


def test_saint_helens_keeps_its_ragged_mask(tmp_path):
    path = SHARED / "dem/SainteHelens.dem"
    document = meshflow.read(path)
    run = meshflow.smooth(document.data, result=True)
    meshflow.write(document.holding(run.after), tmp_path / "out.tif")
    with rasterio.open(path) as before, rasterio.open(tmp_path / "out.tif") as after:
        same = np.array_equal(before.read_masks(1), after.read_masks(1))
    removed = rms((run.after.z - document.data.z)[~document.data.missing])
    print(
        f"\nSt Helens: {document.data.missing.sum()} samples missing, mask {'identical' if same else 'CHANGED'}; ",
        end="",
    )
    print(f"noise found {noise_facts(document.data)['noise']:.2f} m, rms removed {removed:.2f} m")
    assert same


def test_horse_with_noise_of_a_quarter_of_its_edges():
    clean = meshflow.read(SHARED / "meshes/irregular/horse.vtp").data
    points = clean.points.astype(float)
    normals = trimesh.Trimesh(points, clean.faces, process=False).vertex_normals
    noisy = points + 0.25 * clean.step * np.random.default_rng(0).normal(size=(len(points), 1)) * normals
    run = meshflow.smooth(meshflow.Mesh(noisy, clean.faces), result=True)
    print(
        "\nHorse, noise of a quarter of its mean edge along the normals; distance to the points that it came from, normals:"
    )
    for name, p in (("noisy", noisy), ("smoothed by default", run.after.points)):
        angle = metrics.normal_angle(p, points, clean.faces)
        print(
            f"  {name}: rms {rms(np.linalg.norm(p - points, axis=1)) / clean.step:.3f} edges, mean angle {angle:.1f} degrees"
        )
    assert metrics.normal_angle(run.after.points, points, clean.faces) < 0.5 * metrics.normal_angle(
        noisy, points, clean.faces
    )


def _scored(name, points, camera, clean):
    """Error of points (n, 3) at the pixels where they are seen now: median, rms, and how many left their pixel."""
    h, w = clean.shape
    u, v = camera.fx * points[:, 0] / points[:, 2] + camera.cx, camera.fy * points[:, 1] / points[:, 2] + camera.cy
    column, row = np.clip(np.rint(u), 0, w - 1).astype(int), np.clip(np.rint(v), 0, h - 1).astype(int)
    seen = clean[row, column] > 0
    error = 1000 * (points[:, 2] - clean[row, column])[seen]
    print(f"  {name}: median |error| {np.median(np.abs(error)):.2f} mm, rms {rms(error):.1f} mm, ", end="")
    near = error[np.abs(error) < 50]
    print(f"rms of the errors below 50 mm {rms(near):.2f} mm ({len(near) / len(error):.1%})")
    return np.median(np.abs(error)), rms(near)


@pytest.mark.parametrize("frame", [0, 1])
def test_livingroom_along_rays_and_in_space(frame):
    folder = SHARED / "range/icl_livingroom_pairs"
    camera = folder / "camera_primesense.json"
    noisy = meshflow.read(folder / f"noisy_0000{frame}.png", camera=camera).data
    clean = meshflow.read(folder / f"clean_0000{frame}.png", camera=camera).data.depth
    lift, until = meshflow.Lift(), meshflow.Until(time=5.0)
    surface = noisy.lifted(lift)
    valid = ~noisy.missing.ravel()
    free = meshflow.Surface(
        surface.points,
        surface.triangulations,
        boundary="plane-preserving",
        alternate=True,
        time_factor=surface.time_factor,
    )
    *_, along = meshflow.march(meshflow.MeshFlow(surface), until)
    *_, space = meshflow.march(meshflow.MeshFlow(free), until, meshflow.SemiImplicit())
    print(f"\nICL living room, frame {frame}, 5 pixel footprints:")
    _scored("noisy", surface.points[valid], noisy.camera, clean)
    rays = _scored("along the rays", surface.points_at(along.u)[valid], noisy.camera, clean)
    flat = _scored("in space (3D)", space.u[valid], noisy.camera, clean)
    assert rays < flat


def _timed(words, act):
    begun = time.perf_counter()
    done = act()
    print(f"  {words}: {time.perf_counter() - begun:.2f} s")
    return done


def test_time_to_the_first_picture_and_frames_per_second(tmp_path):
    code = (
        "import numpy as np, meshflow.view as v; from meshflow.synthetic.scenes import fractal_terrain;"
        f"v.show(fractal_terrain(1000), {str(tmp_path / 'a.png')!r})"
    )
    print("\nLooking, headless:")
    _timed(
        "first picture of a 1000 x 1000 terrain, from the start of Python",
        lambda: subprocess.run([sys.executable, "-c", code], check=True, capture_output=True),
    )
    field = meshflow.HeightField(fractal_terrain(1000))
    _timed("a picture more", lambda: view.show(field, tmp_path / "b.png"))
    _timed("the first without OpenGL", lambda: view.show(field, tmp_path / "c.png", renderer="hillshade"))
    _timed("compare, three panels", lambda: view.compare(field, field, tmp_path / "d.png"))
    large = meshflow.HeightField(fractal_terrain(4096).astype(np.float32))
    reported = _timed("4096 x 4096", lambda: view.show(large, tmp_path / "e.png"))
    print(f"    said: {', '.join(reported.notes)}")
    _timed("its mean curvature, of all samples", lambda: view.measured(large, "curvature"))
    assert "every 5th sample" in " ".join(reported.notes)


def test_a_mesh_of_millions_of_triangles_stays_interactive():
    ring = shapes.ring(1600, 820)
    mesh = meshflow.Mesh(ring.points, ring.faces)
    print(f"\n{len(mesh.faces)} triangles in a window of 1600 x 1200:")
    window = _timed("opened", lambda: view.plotter(mesh, off_screen=True))
    window.screenshot(None, return_img=True)
    style, rates = window.iren.get_interactor_style(), {}
    for word, event in (("while it turns", "StartInteractionEvent"), ("at rest", "EndInteractionEvent")):
        style.InvokeEvent(event)
        window.camera.Azimuth(5)
        window.render()
        begun = time.perf_counter()
        for _ in range(5):
            window.camera.Azimuth(5)
            window.render()
        rates[word] = 5 / (time.perf_counter() - begun)
        print(f"  {word}: {rates[word]:.1f} frames per second")
    window.close()
    assert rates["while it turns"] > 4 * rates["at rest"]


@pytest.mark.parametrize("size", [1000])
def test_frames_per_second_of_the_slider_through_time(size):
    from meshflow.view.look import Look
    from meshflow.viewer.screen import Screen
    from meshflow.viewer.session import Session

    data = meshflow.HeightField(fractal_terrain(size) + np.random.default_rng(1).normal(size=(size, size)))
    begun = time.perf_counter()
    session = Session.begun(
        data, Request.of(method=Beltrami(gamma=0.0, contrast=2.0), time=8.0, compute=Compute(search=False)), count=16
    )
    timeline = session.run()
    states = time.perf_counter() - begun
    begun = time.perf_counter()
    screen = Screen(timeline.at(0), timeline.at(len(timeline) - 1), Look(size=(1280, 900)), off_screen=True)
    screen.picture()
    first = time.perf_counter() - begun
    print(f"\n{len(timeline)} states of {size}² in {states:.1f} s; first picture {first:.2f} s")
    for colouring in ("surface", "removed"):
        took = []
        for index in range(len(timeline)):
            begun = time.perf_counter()
            screen.show(timeline.at(index), colouring)
            screen.picture()
            took.append(time.perf_counter() - begun)
        print(f"  slider, {colouring}: {1 / np.median(took):.1f} frames per second, without a graphics card")
    screen.plotter.close()
