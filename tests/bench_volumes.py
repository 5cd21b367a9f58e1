"""Volumes and tensors by default beside peers that are told the truth: ``pytest -m bench -s -n 0 tests/bench_volumes.py``.

Three phantoms, and two volumes of heads that dipy bundles, which are taken for the truth although they have some noise, with
Gaussian and Rician noise of 3, 9 and 15 %: peak signal to noise ratio in decibels. Peers have the parameter that is best for the
truth, and BM4D is told the noise; those that are not installed (SimpleITK, dipy, bm4d) are left out by name. The table of the
guide of volumes is printed. Then tensors of diffusion: errors of fractional anisotropy and of directions.
"""

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from peers.volumes import EVERY, PEERS, decibels, local_pca, non_local_means_of_dipy, total_variation
from skimage.restoration import denoise_tv_chambolle

import meshflow
from meshflow.geometry.symmetric import unpacked
from meshflow.synthetic import head, shepp_logan, thorax

pytestmark = [pytest.mark.bench, pytest.mark.timeout(7200)]
SIDE = int(os.environ.get("BENCH_SIDE", "64"))
NOISES = os.environ.get("BENCH_NOISE", "Gaussian,Rician").split(",")


def bundled():
    """The volumes of dipy, cut to the middle, (name, values); none where it is not installed."""
    place = find_spec("dipy")
    if place is None or place.origin is None:
        return
    for name in ("S0_10slices", "aniso_vox"):
        path = Path(place.origin).parent / "data" / "files" / f"{name}.nii.gz"
        values = np.squeeze(import_module("nibabel").load(path).get_fdata())
        most = (2 * SIDE, 2 * SIDE, SIDE)
        starts = [max(0, (n - m) // 2) for n, m in zip(values.shape, most, strict=True)]
        middle = values[tuple(slice(a, a + m) for a, m in zip(starts, most, strict=True))]
        yield f"dipy {name}", middle / np.percentile(values, 99.9)


def truths():
    """The volumes without noise, (name, values)."""
    for phantom in (shepp_logan, head, thorax):
        yield phantom.__name__, phantom(SIDE)
    yield from bundled()


def noisy(truth, sigma, kind):
    draw = np.random.default_rng(0)
    x = truth + sigma * draw.normal(size=truth.shape)
    x = np.hypot(x, sigma * draw.normal(size=truth.shape)) if kind == "Rician" else x
    return x.astype(np.float32)


@pytest.mark.parametrize("kind", NOISES)
def test_the_default_is_ahead_of_tuned_peers_in_the_mean(kind):
    for name in sorted(EVERY.keys() - PEERS.keys()):
        print(f"left out, not installed: {name}")
    print(f"\n| phantom, {kind} noise | noisy | by default | quick | " + " | ".join(PEERS) + " |", flush=True)
    gains = []
    for name, truth in truths():
        for sigma in (0.03, 0.09, 0.15):
            x = noisy(truth, sigma, kind)
            own = [meshflow.smooth(x, kind="volume"), meshflow.smooth(x, kind="volume", method="quick")]
            found = [run(x, sigma, truth, kind == "Rician") for run in PEERS.values()]
            row = [decibels(one, truth) for one in (x, *own, *found)]
            print(f"| {name}, {sigma:.0%} | " + " | ".join(f"{one:.1f}" for one in row) + " |", flush=True)
            gains.append(row[1] - np.array(row[3:]))
    mean = dict(zip(PEERS, np.mean(gains, axis=0), strict=True))
    print("default ahead in the mean, dB: " + ", ".join(f"{name} {gain:+.2f}" for name, gain in mean.items()))
    if kind == "Gaussian":  # of magnitudes dipy alone removes the bias of Rice
        assert all(gain > 0 for name, gain in mean.items() if name != "BM4D")


def anisotropy(tensors):
    """Fractional anisotropy (...) of tensors (..., 3, 3)."""
    values = np.linalg.eigvalsh(tensors)
    mean = values.mean(axis=-1, keepdims=True)
    return np.sqrt(1.5 * np.square(values - mean).sum(-1) / np.maximum(np.square(values).sum(-1), 1e-12))


def bundles(side):
    """Directions (d, h, w, 3) of three bundles of fibres, and tensors (d, h, w, 3, 3), 1e-3 mm²/s."""
    z, y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j, -1 : 1 : side * 1j]
    inner, below = np.hypot(x, y) < 0.5, z < -0.2
    angle = np.where(inner, 0.4 + 0.5 * y, np.where(below, 1.9 + 0.3 * x, 2.8 + 0.4 * z))
    lift = np.where(below, 0.0, 0.6)
    fibre = np.stack([np.cos(angle) * np.cos(lift), np.sin(angle) * np.cos(lift), np.sin(lift)], axis=-1)
    return fibre, 0.3 * np.eye(3) + 1.4 * np.einsum("...i,...j->...ij", fibre, fibre)


def apart(components, run):
    """Components (d, h, w, 6), each smoothed by itself."""
    return np.stack([run(np.ascontiguousarray(one)) for one in np.moveaxis(components, -1, 0)], -1)


def test_tensors_of_diffusion_by_signals_and_by_tensors():
    side = int(os.environ.get("BENCH_TENSORS", "20"))
    fibre, truth = bundles(side)
    draw = np.random.default_rng(1)
    gradients = draw.normal(size=(18, 3))
    gradients /= np.linalg.norm(gradients, axis=1, keepdims=True)
    gradients[:2] = 0
    i, j = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    weights = np.where(np.equal(i, j), 1.0, np.sqrt(2))
    design = np.column_stack([-gradients[:, i] * gradients[:, j] * weights, np.ones(18)])
    clean = np.exp(-np.einsum("ki,...ij,kj->...k", gradients, truth, gradients))

    def fitted(signals):
        logs = np.log(np.maximum(signals, 0.01)).reshape(-1, 18)
        return np.linalg.lstsq(design, logs.T, rcond=None)[0][:6].T.reshape(side, side, side, 6)

    for noise in (0.05, 0.1):
        signals = np.hypot(clean + noise * draw.normal(size=clean.shape), noise * draw.normal(size=clean.shape))
        alone = np.moveaxis(signals, -1, 0)
        found = {
            "as measured": fitted(signals),
            "signals as channels, by default": fitted(meshflow.smooth(signals, kind="volume")),
            "tensors, by default": meshflow.smooth(meshflow.Tensors(fitted(signals), definite=True)).values,
            "tensors, metric='noise'": meshflow.smooth(
                meshflow.Tensors(fitted(signals), definite=True, metric="noise")
            ).values,
            "each component, by default": apart(fitted(signals), lambda one: meshflow.smooth(one, kind="volume")),
            "each component, total variation": apart(
                fitted(signals),
                lambda one: denoise_tv_chambolle(one, 1.3 * float(np.std(np.diff(one, axis=0))) / 2**0.5),
            ),
            "each signal, by default": fitted(np.stack([meshflow.smooth(one, kind="volume") for one in alone], -1)),
            "each signal, total variation, told the truth": fitted(
                np.stack(
                    [
                        total_variation(*pair, True)
                        for pair in zip(alone, [noise] * 18, np.moveaxis(clean, -1, 0), strict=True)
                    ],
                    -1,
                )
            ),
        }
        if "dipy NLMEANS" in PEERS:
            told = [non_local_means_of_dipy(one, noise, clean[..., k], True) for k, one in enumerate(alone)]
            found["each signal, dipy NLMEANS, told the truth"] = fitted(np.stack(told, -1))
            found["signals together, dipy LPCA, told the noise"] = fitted(local_pca(signals, noise))
        print(f"\n| SNR {1 / noise:.0f}: smoothed | FA error, rms | direction, degrees | not positive definite |")
        for name, components in found.items():
            tensors = unpacked(components)
            values, axes = np.linalg.eigh(tensors)
            turn = np.degrees(np.arccos(np.minimum(np.abs((axes[..., -1] * fibre).sum(-1)), 1))).mean()
            wrong = np.sqrt(np.mean(np.square(anisotropy(tensors) - anisotropy(truth))))
            print(f"| {name} | {wrong:.3f} | {turn:.1f} | {int((values[..., 0] <= 0).sum())} |", flush=True)
