"""Ours by default and at its best beside every peer at its best: ``pytest -m bench -s tests/bench_quality.py``.

Scenes, noise and searches are seeded; all that is chosen for a peer is chosen with the truth in hand. From the environment:

- ``BENCH_SCENES=steps,mesas`` and ``BENCH_LEVELS=2,5``: these alone (a quantised scene has its quantum as its level);
- ``BENCH_CROP=160``: the middle of each scene, so many samples a side at most: minutes a level instead of hours;
- ``BENCH_PEERS=TV,NLM``: these peers alone;
- ``BENCH_CACHE=peers.json``: what was found for the peers is kept there, and asked again only where a version of a package, a
  range of a search, a scene or its noise has changed. Ours is never kept.
"""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from helpers.parts import parts
from helpers.photographs import SCENES
from peers.grids import PEERS
from peers.search import tuned

import meshflow
from meshflow.errors import InputError, MissingPackage
from meshflow.evaluate.grids import EDGE_REACH, EDGE_SHARE, GridQuality, grid_quality
from meshflow.kernels.library import default_threads
from meshflow.synthetic.scenes import Subject

DEM = Path(__file__).parents[2] / "shared" / "data" / "dem"
SEED = 7
pytestmark = [pytest.mark.bench, pytest.mark.timeout(12 * 3600)]

# Times in squared sample distances.
TIMES = (0.5, 1, 2, 3, 5, 7.5, 10, 15, 20, 30, 45, 60, 90, 120)
# Members of the family; contrast in sample distances over the noise, patch in samples. Patches go without gamma -1: there they
# leak along edges and make the flow stiff (one such run at time 30 took minutes).
VARIANTS = [
    {"gamma": gamma, "sharpness": sharpness, "contrast": contrast} | ({"patch": patch} if patch else {})
    for sharpness, gamma, contrasts, patches in (
        (1, 0, (1, 1.5, 2, 3, 4), (0, 0.5, 0.7, 1, 1.5)),
        (1, -1, (2, 3, 4), (0,)),
        (1.5, -1, (1.5, 2, 3, 4, 6), (0,)),
        (1.5, -0.5, (2, 3, 4), (1,)),
        (2, -1, (0.5, 0.7, 1, 1.5, 2, 3, 4.5), (0,)),
        (3, -1, (0.3, 0.5, 0.7, 1, 1.5, 2), (0,)),
        (4, -1, (0.3, 0.5, 0.7, 1, 1.5), (0,)),
    )
    for contrast, patch in product(contrasts, patches)
] + [{"gamma": 0, "contrast": contrast, "patch": 1.5, "twicing": 1.0, "sharpness": 1} for contrast in (0.2, 0.4, 0.8)]
# Both are tried on heights, since the defaults choose natural there.
BOUNDARIES = ("neumann", "plane-preserving")
# With several channels the flow of a sharp member is stiff, and no step of h²/6 holds (DESIGN.md, "Sharpness"): the sharpest
# would take hours, and are not near the best.
SHARPEST, STEEPEST = 2, 4.5
# Times ascend until the rms has grown this often in a row.
PATIENCE = 3
# Tried on quantised data beside none: no sample leaves what was recorded, in quanta.
LIMITS = (0.5,)


@dataclass(frozen=True, eq=False)
class Case:
    """A scene at one level of noise; sigma is that of the rounding where there is no noise."""

    subject: Subject
    level: float
    truth: np.ndarray
    noisy: np.ndarray

    @property
    def name(self):
        return f"{self.subject.name} {'rounded to' if self.subject.quantum else 'sigma'} {self.level:g}"

    @property
    def sigma(self):
        return self.level / np.sqrt(12) if self.subject.quantum else self.level

    @property
    def group(self):
        if self.subject.quantum:
            return "quantised heights"
        return "images" if self.subject.kind == "image" else "heights with noise"

    def quality(self, found):
        return grid_quality(found, self.truth, self.subject.kind, self.subject.spacing, self.subject.peak)

    def rms(self, found):
        return float(np.sqrt(np.mean(np.square(found - self.truth))))


@dataclass(frozen=True, eq=False)
class Row:
    """What the table says of one denoiser."""

    name: str
    quality: GridQuality
    words: str = ""


def _mola():
    """MOLA elevations of Olympus Mons in steps of 200 m, and the same before they were rounded; None where the data is absent."""
    names = ("mola_olympus_crop_derived.tif", "mola_olympus_crop_q200m_derived.tif")
    if not all((DEM / name).exists() for name in names):
        print(f"  mola is left out: {DEM} is absent")
        return None
    truth, coarse = (meshflow.read(DEM / name).data for name in names)
    spacing = tuple(float(np.mean(time_factor)) for time_factor in truth.spacing)
    subject = Subject("mola", lambda: truth.z.astype(np.float64), (), spacing=spacing, quantum=200.0)
    return Case(subject, 200.0, subject.truth(), coarse.z.astype(np.float64))


def cropped(truth):
    """The middle of a scene."""
    side = int(os.environ.get("BENCH_CROP", "0")) or max(truth.shape)
    top, left = (max(0, (size - side) // 2) for size in truth.shape[:2])
    return np.ascontiguousarray(truth[top : top + side, left : left + side])


def cases():
    """The scenes and levels that the environment asks for."""
    wanted = [name for name in os.environ.get("BENCH_SCENES", "").split(",") if name] or [*SCENES, "mola"]
    unknown = set(wanted) - {*SCENES, "mola"}
    assert not unknown, f"BENCH_SCENES: {', '.join((*SCENES, 'mola'))} expected, got {unknown}"
    levels = {float(level) for level in os.environ.get("BENCH_LEVELS", "").split(",") if level}
    for name in wanted:
        if name == "mola":
            found = [_mola()]
        else:
            subject = SCENES[name]
            try:
                truth = subject.truth()
            except MissingPackage as cause:
                print(f"  {name} is left out: {cause}")
                continue
            truth = cropped(truth)
            asked = subject.levels or (subject.quantum,)
            found = [Case(subject, level, truth, subject.measured(truth, level, SEED)) for level in asked]
        yield from (case for case in found if case and (not levels or case.level in levels))


def ours(case, z=None, **options):
    """The front door; an image is said to be one, since arrays (h, w) are heights."""
    kind = {"kind": "image"} if case.subject.kind == "image" else {}
    return meshflow.smooth(case.noisy if z is None else z, **parts(**kind, **options))


def per_channel(case, **options):
    """The front door, once for each channel."""
    planes = np.moveaxis(case.noisy, 2, 0)
    return np.stack([ours(case, np.ascontiguousarray(plane), **options) for plane in planes], axis=-1)


@cache
def _refused(word):
    """Whether the front door does not take an option of the members; it is named once."""
    try:
        meshflow.smooth(np.random.default_rng(SEED).normal(size=(16, 16)), time=0.5, **parts(**{word: 0.7}))
    except InputError as cause:
        print(f"  members with {word} are left out: {cause}")
        return True
    return False


def variants(case):
    """The members that this meshflow takes, in the units of a case."""
    found = [variant | {"contrast": variant["contrast"] / case.sigma} for variant in VARIANTS]
    if case.noisy.ndim == 3:
        found = [
            m
            for m in found
            if m["sharpness"] <= SHARPEST and m["sharpness"] * m["contrast"] * case.sigma < STEEPEST + 0.1
        ]
    if case.subject.kind == "terrain":
        found = [variant | {"boundary": boundary} for boundary, variant in product(BOUNDARIES, found)]
    if case.subject.quantum:
        found += [variant | {"max_change": share * case.level} for share, variant in product(LIMITS, found)]
    words = [
        word
        for word in ("patch", "max_change", "twicing")
        if any(word in variant for variant in found) and _refused(word)
    ]
    return [variant for variant in found if not any(word in variant for word in words)]


def best_of_ours(case, smoothed: Callable = ours):
    """The member and time of least rms: all members, times until the rms has grown :data:`PATIENCE` times in a row."""
    errors = {}
    for i, variant in enumerate(found := variants(case)):
        grown, last = 0, np.inf
        for time in TIMES:
            errors[i, time] = now = case.rms(smoothed(case, time=time, **variant))
            grown, last = grown + 1 if now > last else 0, now
            if grown == PATIENCE:
                break
    i, time = min(errors, key=errors.__getitem__)
    words = found[i] | {"time": time}
    words["contrast"] = f"{words['contrast'] * case.sigma:g} / sigma"
    edge = ("time",) if time in (TIMES[0], TIMES[-1]) else ()
    return Row("ours, best", case.quality(smoothed(case, time=time, **found[i])), _said(words, edge))


def _said(choice, edge=()):
    """A choice in words, * at what lies on the edge of its range."""
    values = {k: v if isinstance(v, str) else f"{v:g}" for k, v in choice.items()}
    return ", ".join(f"{name} {value}{'*' if name in edge else ''}" for name, value in values.items())


class Cache:
    """What was found for the peers, by case and peer, in the file that BENCH_CACHE names."""

    def __init__(self):
        self.path = Path(os.environ["BENCH_CACHE"]) if "BENCH_CACHE" in os.environ else None
        self.found = json.loads(self.path.read_text()) if self.path and self.path.exists() else {}

    def row(self, case, peer):
        """The row of a peer, searched where it is not kept."""
        reported = hashlib.sha256(case.truth.tobytes() + case.noisy.tobytes()).hexdigest()[:16]
        state = f"{peer.package} {version(peer.package)}, data {reported}, {dict(peer.grid)}"
        kept = self.found.get(case.name, {}).get(peer.name)
        if kept is None or kept["state"] != state:
            found = tuned(peer, case.noisy, case.sigma, case.rms)
            words = f"{_said(found.choice, found.edge)} ({found.runs} runs)"
            kept = {"state": state, "words": words, "quality": asdict(case.quality(found.result))}
            self.found.setdefault(case.name, {})[peer.name] = kept
            if self.path:
                self.path.write_text(json.dumps(self.found, indent=1))
        return Row(peer.name, GridQuality(**kept["quality"]), kept["words"])


def peers_of(case, kept):
    wanted = [name for name in os.environ.get("BENCH_PEERS", "").split(",") if name] or [peer.name for peer in PEERS]
    for peer in (peer for peer in PEERS if peer.name in wanted):
        if case.noisy.ndim == 3 and not peer.channels:
            continue
        if peer.name.startswith("whitebox") and case.subject.kind == "image":
            continue
        try:
            yield kept.row(case, peer)
        except (MissingPackage, PackageNotFoundError) as cause:
            print(f"  {peer.name} is left out: {cause}")


def _table(case, rows):
    image = case.subject.kind == "image"
    last = "SSIM" if image else "normals"
    print(f"\n{case.name}, {' x '.join(map(str, case.truth.shape))}, {case.subject.unit}")
    print(f"  {'':35s} {'rms':>8s} {'edges':>8s} {last:>8s} {'PSNR':>6s}")
    for row in rows:
        q = row.quality
        print(
            f"  {row.name:35s} {q.rms:8.4g} {q.rms_near_edges:8.4g} {q.ssim if image else q.normal_error:8.4g}"
            f" {q.psnr:6.2f}  {row.words}",
            flush=True,
        )


def _versions():
    names = sorted({peer.package for peer in PEERS} | {"numpy", "PyWavelets", "matplotlib"}, key=str.lower)
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "absent"
    return ", ".join(f"{name} {value}" for name, value in found.items())


def _share_threads():
    """As many threads for the peers as ours: the machine may be shared."""
    threads = default_threads()
    try:
        import cv2

        cv2.setNumThreads(threads)
    except ImportError as cause:
        print(f"  cv2: {cause}")
    try:
        import SimpleITK as sitk

        sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
    except ImportError as cause:
        print(f"  SimpleITK: {cause}")


def _mean(ratios):
    return float(np.exp(np.mean(np.log(ratios))))


def _ratios(case, rows):
    """Rms of ours by default over our best, the best peer but BM3D, and the best of the NLMs; NaN where there is none."""
    rms = {row.name: row.quality.rms for row in rows}
    peers = {name: value for name, value in rms.items() if name in {peer.name for peer in PEERS} - {"BM3D"}}
    best = min(peers, key=peers.__getitem__) if peers else ""
    nlm = min((value for name, value in peers.items() if name.startswith("NLM")), default=np.nan)
    ours_now = rms["ours, defaults"]
    return case, (ours_now / rms["ours, best"], ours_now / peers.get(best, np.nan), ours_now / nlm), best


def _summary(found):
    print(f"\nrms of ours by default over {'our best':>12s} {'best peer':>10s} {'NLM':>8s}")
    for case, ratios, best in found:
        print(f"  {case.name:27s} {ratios[0]:8.3f} {ratios[1]:10.3f} {ratios[2]:8.3f}  {best}")
    for group in sorted({case.group for case, _, _ in found}) + ["all"]:
        ratios = np.array([ratios for case, ratios, _ in found if group in (case.group, "all")])
        print(f"  {group + ', geometric mean':27s} " + " {:7.3f} {:10.3f} {:8.3f}".format(*map(_mean, ratios.T)))
        print(f"  {group + ', at worst':27s} " + " {:7.3f} {:10.3f} {:8.3f}".format(*ratios.max(axis=0)))
    return np.array([ratios for _, ratios, _ in found])


def test_defaults_alone():
    print(
        f"\nby default, seed {SEED} of the noise, meshflow {version('meshflow')}: noise found, expected error, rms error"
    )
    for case in cases():
        kind = {"kind": "image"} if case.subject.kind == "image" else {}
        result = meshflow.smooth(case.noisy.astype(np.float32), **kind, result=True)
        risk = result.parameters.get("risk")
        expected = "-" if risk is None else f"{risk.value:.4g}"
        print(f"  {case.name:27s} {case.rms(case.noisy):8.4g} {result.noise.sigma:8.4g} {expected:>8s} "
              f"{case.rms(result.data):8.4g}  {result.summary}", flush=True)  # fmt: skip
        assert case.rms(result.data) < case.rms(case.noisy)


def test_defaults_beside_our_best_and_beside_every_peer_at_its_best():
    print(f"\nquality against the truth, seed {SEED} of the noise, meshflow {version('meshflow')}; {_versions()}")
    print(f"edges: within {EDGE_REACH} samples of the top {EDGE_SHARE:.0%} of the truth's gradient; normals: degrees;")
    print(f"multiples are of sigma; * lies on the edge of its range; {len(VARIANTS)} members at times {TIMES} h²")
    _share_threads()
    kept, found = Cache(), []
    for case in cases():
        rows = [
            Row("ours, defaults", case.quality(ours(case))),
            best_of_ours(case),
            *sorted(peers_of(case, kept), key=lambda row: row.quality.rms),
        ]
        _table(case, [Row("nothing", case.quality(case.noisy)), *rows])
        found.append(_ratios(case, rows))
    if not found:
        pytest.skip("no scene is left of BENCH_SCENES and BENCH_LEVELS")
    ratios = _summary(found)
    assert _mean(ratios[:, 0]) < 1.15, "the defaults are further from the best parameters than that"


def test_colour_coupled_beside_per_channel():
    found = [case for case in cases() if case.truth.ndim == 3]
    if not found:
        pytest.skip("BENCH_SCENES or BENCH_LEVELS leave no scene of colours")
    for case in found:
        psnr = {}
        print(f"\n{case.name}: PSNR, decibels")
        for name, smoothed in (("coupled", ours), ("per channel", per_channel)):
            best = best_of_ours(case, smoothed)
            psnr[name] = case.quality(smoothed(case)).psnr, best.quality.psnr
            print(f"  {name:12s} defaults {psnr[name][0]:.2f}, best {psnr[name][1]:.2f}  {best.words}")
        gains = np.subtract(psnr["coupled"], psnr["per channel"])
        print(f"  coupled is better by {gains[0]:.2f} by default, {gains[1]:.2f} at best")
        assert (gains > 0).all()
