"""The systems that the paper cites on several channels, on meshes and by windows: each is what its equation says."""

import naive
import numpy as np
import pytest
from helpers.cliffs import cliff
from helpers.shapes import sphere

import meshflow
from meshflow import classics
from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.engines.graph_motion import GraphMotion
from meshflow.flow.stops import Steps
from meshflow.geometry.normals import mean_edge
from meshflow.geometry.operator import mass, stiffness
from meshflow.geometry.volume import volume
from meshflow.large.sample import sample_of
from meshflow.large.source import Held
from meshflow.large.windows import windowed
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.image import Image


def rms(a):
    return float(np.sqrt(np.mean(np.square(a))))


def test_the_graph_flow_of_several_channels_is_the_motion_of_the_graph_to_second_order():
    errors = []
    for n in (20, 40, 80):
        h = 4.0 / n
        y, x = np.mgrid[0:n, 0:n] * h
        values = np.stack([1.2 * np.sin(x + 0.3 * y), np.cos(0.7 * x - y) + 0.5 * x], -1)
        flow = GraphMotion(Image(values, h).lifted(Lift(diagonals="both")))
        ours = flow.rate(flow.start()).reshape(n, n, 2)[2:-2, 2:-2]
        literal = naive.graph_motion(values, h)[1:-1, 1:-1]
        errors.append(np.abs(ours - literal).max() / np.abs(literal).max())
    order = np.log2(errors[0] / errors[2]) / 2
    assert order > 1.8, f"relative errors {errors}, observed order {order:.2f}, expected 2"


def test_the_graph_flow_by_name_is_the_motion_and_the_papers_formula_another():
    draw = np.random.default_rng(9)
    image = draw.normal(size=(20, 20, 2))
    image[:, 10:, 0] += 8.0
    run = {"time": 1.0, "kind": "image", "boundary": "neumann"}
    motion = meshflow.smooth(image, method=meshflow.GraphFlow(contrast=1.0), **run)
    paper = meshflow.smooth(image, method=meshflow.GraphFlow(contrast=1.0, formula="paper"), **run)
    same = meshflow.smooth(image, method=meshflow.Beltrami(gamma=-2.0, contrast=1.0, indicator="projection"), **run)
    assert np.array_equal(paper, same)
    assert rms(motion - paper) > 0.01 * image.std()
    assert image.min() <= motion.min() <= motion.max() <= image.max()
    one = meshflow.smooth(image[..., 0], method=meshflow.GraphFlow(contrast=1.0), **run)
    assert np.array_equal(
        one, meshflow.smooth(image[..., 0], method=meshflow.Beltrami(gamma=-2.0, contrast=1.0), **run)
    )
    tilted = np.stack(np.meshgrid(np.arange(12.0), 2 * np.arange(14.0)), -1)
    assert (
        np.abs(meshflow.smooth(tilted, method="graph", noise=1.0, time=3.0, boundary="plane-preserving") - tilted).max()
        < 1e-9
    )


def ball(noise=0.02):
    points, faces = sphere(400)
    return points, points * (1 + noise * np.random.default_rng(10).normal(size=(len(points), 1))), faces


@pytest.mark.parametrize("operator", ["curvature", "umbrella", "scale-dependent"])
def test_implicit_fairing_is_the_system_of_the_paper(operator):
    _, noisy, faces = ball()
    time = 0.02
    found = meshflow.smooth((noisy, faces), method=meshflow.ImplicitFairing(operator=operator), time=time)[0]
    n = len(noisy)
    if operator == "curvature":
        a = stiffness(noisy, faces).toarray() / mass(noisy, faces)[:, None]
    else:
        around = [set(faces[(faces == i).any(axis=1)].ravel()) - {i} for i in range(n)]
        h = mean_edge(noisy, faces)
        a = np.zeros((n, n))
        for i, others in enumerate(around):
            length = {j: np.linalg.norm(noisy[i] - noisy[j]) for j in others}
            for j in others:
                pull = 4 / (h**2 * len(others)) if operator == "umbrella" else 4 / (length[j] * sum(length.values()))
                a[i, j] -= pull
                a[i, i] += pull
    assert np.abs(found - np.linalg.solve(np.eye(n) + time * a, noisy)).max() < 1e-8


def test_implicit_fairing_runs_as_named_and_keeps_the_volume_if_asked():
    true, noisy, faces = ball()
    found = meshflow.smooth((noisy, faces), method="implicit-fairing", time=0.02, result=True)
    assert found.parameters["operator"].value == "curvature"
    assert found.end.step == 1
    kept = meshflow.smooth(
        (noisy, faces), method="implicit-fairing", time=0.02, constraints=meshflow.PreserveVolume(by="scaling")
    )[0]
    assert volume(kept, faces) == pytest.approx(volume(noisy, faces), rel=1e-12)
    assert np.linalg.norm(kept, axis=1).std() < 0.6 * np.linalg.norm(noisy, axis=1).std()
    soft = meshflow.smooth(
        (noisy, faces), method="implicit-fairing", time=0.02, constraints=meshflow.Mobility(np.zeros(len(noisy)))
    )[0]
    assert np.array_equal(soft, noisy)
    named = meshflow.smooth((noisy, faces), method=meshflow.Fairing(order=1), time=0.02, result=True)
    assert named.parameters["weights"].value == "cotangent"  # what is named is what runs


def test_taubins_pairs_are_the_classic_ones_and_keep_the_size():
    _, noisy, faces = ball()
    found = meshflow.smooth((noisy, faces), method="taubin", stop=Steps(10))[0]
    assert np.abs(found - classics.taubin(noisy, faces, 0.5, 0.1, 10)).max() < 1e-12
    assert volume(found, faces) > 0.97 * volume(noisy, faces)
    fewer = meshflow.smooth((noisy, faces), method=meshflow.LambdaMu(weight=0.4, passband=0.05), result=True)
    assert fewer.end.step > 0


def test_steps_by_the_loss_of_area_shorten_as_the_noise_goes():
    truth, noisy = cliff(24)
    method = meshflow.MeanCurvatureDiffusion(contrast=2.0, area_steps=True)
    found = meshflow.smooth(noisy, method=method, time=4.0, result=True)
    steps = found.history.dt[1:-1]
    assert found.end.stepper == "explicit"
    assert steps[0] == steps.max() > 1.5 * steps[-1]
    assert (
        rms(found.data - meshflow.smooth(noisy, method=meshflow.MeanCurvatureDiffusion(contrast=2.0), time=4.0)) < 0.05
    )


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ((500, 3), r"looks like points: a mesh is \(points, faces\).*kind='terrain'"),
        ((12, 14, 16), "looks like a volume.*kind='volume'.*kind='image'"),
        ((3, 40, 50), "3 channels that come first.*moveaxis"),
    ],
)
def test_points_volumes_and_channels_that_come_first_are_refused_with_the_way_out(shape, words):
    data = np.random.default_rng(0).normal(size=shape)
    with pytest.raises(InputError, match=words):
        meshflow.smooth(data)
    kind = "terrain" if len(shape) == 2 else "image"
    assert meshflow.smooth(data, kind=kind, method="heat", time=0.1).shape == shape


@pytest.mark.parametrize(
    "method", ["min-max", "rof", "graph", meshflow.MeanCurvatureDiffusion(area_steps=True)], ids=str
)
def test_windows_refuse_schemes_of_their_own(method):
    held = Held(Image(np.random.default_rng(0).normal(size=(40, 40, 2))))
    with pytest.raises(InputError, match="not in windows"):
        windowed(held.form, sample_of(held, 1 << 22, 16), Request.of(method, time=1.0))
