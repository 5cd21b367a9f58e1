"""Range images: ours by default and at its best beside what others use: ``pytest -m bench -s tests/bench_range_quality.py``.

Noise and searches are seeded; all that is chosen for a peer, and for ours at its best, is chosen with the truth in hand, for each
measure anew. From the environment:

- ``BENCH_SCENES=icl,motorcycle-0.25,motorcycle-1.5,structured-light,time-of-flight``: these alone;
- ``BENCH_PEERS=bilateral,TV``: peers whose names begin so alone;
- ``BENCH_CACHE=peers.json``: what was found for the peers is kept there, and asked again only where a version of a package, a
  range of a search, a scene or its noise has changed. Ours is never kept.
"""

import hashlib
import json
import os
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from helpers.parts import parts
from peers.range_images import range_peers
from peers.search import Peer, tuned

import meshflow
from meshflow import Pinhole, RangeImage
from meshflow.errors import MissingPackage
from meshflow.evaluate.range_images import REACH, range_quality
from meshflow.flow.stops import Steps
from meshflow.kernels.library import default_threads
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import CAMERA, SCENE
from meshflow.synthetic.sensors import StructuredLight, TimeOfFlight, observe

ICL = Path(__file__).parents[2] / "shared" / "data" / "range" / "icl_livingroom_pairs"
SEED = 7
pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]

# Ours is searched over times, in multiples of the default one.
TIMES = (0.15, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
# The motorcycle of Middlebury 2014 as scikit-image has it: focal length and principal point in pixels, baseline in metres, and
# what is added to a disparity.
FOCAL, MIDDLE, BASELINE, OFFSET = 994.978, (311.193, 254.877), 0.193001, 31.086
STEP = 0.125
PACKAGES = (
    "meshflow", "numpy", "scipy", "opencv-contrib-python-headless", "scikit-image", "pyrealsense2", "pymeshlab",
)  # fmt: skip


@dataclass(frozen=True)
class Column:
    """A measure as the table has it: a field of RangeQuality, times a factor."""

    name: str
    field: str
    scale: float = 1.0


NORMALS, FINE = Column("normals [deg]", "normal_error"), Column("fine rms [mm]", "fine", 1e3)
MEDIAN, RMS = Column("median error [mm]", "median", 1e3), Column("rms [mm]", "rms", 1e3)
PIXELS = Column("disparity rms [px]", "inverse_rms", FOCAL * BASELINE)


@dataclass(frozen=True, eq=False)
class Case:
    """Frames of one camera; depths in metres, NaN where missing."""

    name: str
    words: str
    camera: Pinhole
    truths: tuple[np.ndarray, ...]
    noisy: tuple[np.ndarray, ...]
    columns: tuple[Column, ...]
    reach: float = 0.0  # share of the depth; 0: REACH

    def measured(self, smoothed):
        """The columns, and the share of pixels kept, means over the frames, of a function of one noisy frame."""
        rows = []
        for truth, noisy in zip(self.truths, self.noisy, strict=True):
            reach = self.reach * np.nan_to_num(truth, nan=1.0) if self.reach else REACH
            q = range_quality(smoothed(noisy), np.where(np.isfinite(noisy), truth, np.nan), self.camera, reach)
            rows.append([column.scale * getattr(q, column.field) for column in self.columns] + [q.kept])
        return np.mean(rows, axis=0)

    @property
    def sigma(self):
        """What multiples are of: 1.48 times the median error of the first frame, the standard deviation of a normal one."""
        return 1.4826 * range_quality(self.noisy[0], self.truths[0], self.camera).median


@dataclass(frozen=True)
class Row:
    """Best values of each column, and the choices that gave them."""

    name: str
    values: tuple[float, ...]
    kept: tuple[float, ...]
    words: tuple[str, ...] = ()


def icl():
    """Two frames of the ICL-NUIM living room as Open3D has them, and the same before their noise."""
    if not ICL.exists():
        pytest.skip(f"{ICL} is absent")
    import imageio.v3 as iio

    def read(kind, k):
        depth = iio.imread(ICL / f"{kind}_0000{k}.png") / 1000.0
        return np.where(depth > 0, depth, np.nan)

    clean, noisy = (tuple(read(kind, k) for k in (0, 1)) for kind in ("clean", "noisy"))
    return Case(
        "icl", "ICL living room, frames 0 and 1, 480 x 640, simulated Kinect",
        Pinhole(525.0, 525.0, 319.5, 239.5), clean, noisy, (NORMALS, FINE, MEDIAN),
    )  # fmt: skip


def motorcycle(sigma):
    """Disparities with noise, rounded to 1/8 pixel, as depths."""
    from skimage.data import stereo_motorcycle

    disparity = stereo_motorcycle()[2].astype(np.float64)
    there = np.isfinite(disparity)
    measured = disparity + sigma * np.random.default_rng(SEED).normal(size=disparity.shape)
    measured = np.rint(measured / STEP) * STEP

    def depth(d):
        return np.where(there, FOCAL * BASELINE / (np.where(there, d, 1.0) + OFFSET), np.nan)

    return Case(
        f"motorcycle-{sigma:g}",
        f"motorcycle, 500 x 741, disparity noise {sigma:g} px, steps of 1/8 px, seed {SEED}; rms within 10 % of the depth",
        Pinhole(FOCAL, FOCAL, *MIDDLE), (depth(disparity),), (depth(measured),), (NORMALS, RMS, PIXELS), 0.1,
    )  # fmt: skip


def simulated(name, sensor):
    """The scene of the samples as a sensor of the study sees it."""
    frame = observe(SCENE, Sight.through(CAMERA, (240, 320)), sensor)
    return Case(
        name,
        f"panels, ball and cube, 240 x 320, {sensor}",
        CAMERA,
        (frame.truth,),
        (frame.depth,),
        (NORMALS, RMS, MEDIAN),
    )


CASES = {
    "icl": icl,
    "motorcycle-0.25": lambda: motorcycle(0.25),
    "motorcycle-1.5": lambda: motorcycle(1.5),
    "structured-light": lambda: simulated("structured-light", StructuredLight(seed=SEED)),
    "time-of-flight": lambda: simulated("time-of-flight", TimeOfFlight(seed=SEED)),
}


def ours(case, z, time_unit="footprint", **options):
    """The front door; missing stays NaN."""
    image = RangeImage(z.astype(np.float32), case.camera, time_unit=time_unit)
    found = meshflow.smooth(image, **parts(**options)).depth.astype(np.float64)
    return np.where(np.isfinite(z), found, np.nan)


def our_peer(case):
    """Ours at its best, as a peer with a grid: time in multiples of the default, gamma, pace."""
    whiles = {
        z.tobytes(): float(
            meshflow.smooth(RangeImage(z.astype(np.float32), case.camera), stop=Steps(1), result=True)
            .parameters["time"]
            .value
        )
        for z in case.noisy
    }

    def run(z, sigma, time, gamma, time_factor):
        return ours(case, z, time_factor, time=time * whiles[z.tobytes()], gamma=float(gamma))

    grid = {"time": TIMES, "gamma": ("0", "-1"), "time_unit": ("footprint", "noise")}
    return Peer("ours, best", "meshflow", run, grid)


def our_disparity_peer(case):
    """The same in inverse depth: width of the patches, time in squared pixels, and the noise times a factor."""

    def run(z, sigma, patch, time, strength):
        return ours(case, z, domain="disparity", patch=patch, time=time, strength=strength, search=False)

    grid = {
        "patch": (0.0, 0.7, 1.0, 1.5, 2.0, 2.5),
        "time": (3.0, 5.0, 7.5, 10.0, 15.0, 22.0, 32.0, 45.0),
        "strength": (0.5, 0.7, 1.0, 1.4, 2.0),
    }
    return Peer("ours, disparity, best", "meshflow", run, grid, frozenset({("patch", 0.0)}))


def best_of(case, peer):
    """The best of a peer for each column; what is asked twice is run once."""
    known, sigma, began = {}, case.sigma, perf_counter()

    def run(z, sigma, **choice):
        key = tuple(choice.items())
        if key not in known:
            known[key] = case.measured(lambda frame: peer.run(frame, sigma, **choice))
        return known[key]

    asked = Peer(peer.name, peer.package, run, peer.grid, peer.ends)
    best = [tuned(asked, case.noisy[0], sigma, lambda q, k=k: q[k]) for k in range(len(case.columns))]
    said = [", ".join(f"{n} {v}{'*' if n in b.edge else ''}" for n, v in b.choice.items()) for b in best]
    print(f"    {peer.name}: {len(known)} runs, {perf_counter() - began:.0f} s", flush=True)
    return Row(
        peer.name,
        tuple(float(b.error) for b in best),
        tuple(float(b.result[-1]) for b in best),
        tuple(f"{column.name}: {words}" for column, words in zip(case.columns, said, strict=True)),
    )


class Cache:
    """What was found for the peers, by case and peer, in the file that BENCH_CACHE names."""

    def __init__(self):
        self.path = Path(os.environ["BENCH_CACHE"]) if "BENCH_CACHE" in os.environ else None
        self.found = json.loads(self.path.read_text()) if self.path and self.path.exists() else {}

    def row(self, case, peer):
        """The row of a peer, searched where it is not kept."""
        reported = hashlib.sha256(b"".join(z.tobytes() for z in (*case.truths, *case.noisy))).hexdigest()[:16]
        asked = [column.name for column in case.columns]
        state = f"{peer.package} {version(peer.package)}, data {reported}, {dict(peer.grid)}, {asked}"
        kept = self.found.get(case.name, {}).get(peer.name)
        if kept is None or kept["state"] != state:
            row = best_of(case, peer)
            kept = {"state": state, "values": row.values, "kept": row.kept, "words": row.words}
            self.found.setdefault(case.name, {})[peer.name] = kept
            if self.path:
                self.path.write_text(json.dumps(self.found, indent=1))
        return Row(peer.name, tuple(kept["values"]), tuple(kept["kept"]), tuple(kept["words"]))


def once(case, name, smoothed):
    """The row of what has no choice."""
    *values, kept = case.measured(smoothed)
    return Row(name, tuple(values), (kept,) * len(values))


def peers_of(case, kept):
    """The rows of the peers that the environment asks for; what cannot run says so."""
    wanted = tuple(name for name in os.environ.get("BENCH_PEERS", "").split(",") if name) or ("",)
    for peer in range_peers(case.camera):
        if not peer.name.startswith(wanted):
            continue
        try:
            yield kept.row(case, peer)
        except (MissingPackage, PackageNotFoundError) as cause:
            print(f"  {peer.name} is left out: {cause}")


def table(case, rows):
    """Markdown; what each best was found with below."""
    print(f"\n{case.words}\n")
    print("| | " + " | ".join(column.name for column in case.columns) + " | pixels kept |")
    print("|---|" + "---:|" * (len(case.columns) + 1))
    for row in rows:
        values = (
            f"{value:.3f}" if c is PIXELS else f"{value:.2f}" for c, value in zip(case.columns, row.values, strict=True)
        )
        print(f"| {row.name} | " + " | ".join(values) + f" | {min(row.kept):.1%} |")
    print(f"\nmultiples are of {1e3 * case.sigma:.3g} mm; * lies on the edge of its range")
    for row in rows:
        for words in row.words:
            print(f"  {row.name}: {words}")
    print(flush=True)


def versions():
    """Of all that was run."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "absent"
    return ", ".join(f"{name} {value}" for name, value in found.items())


def ranges(case):
    """In what each is searched."""
    for peer in (our_peer(case), our_disparity_peer(case), *range_peers(case.camera)):
        print(f"  {peer.name}: " + "; ".join(f"{name} {', '.join(map(str, v))}" for name, v in peer.grid.items()))


def _wanted():
    wanted = [name for name in os.environ.get("BENCH_SCENES", "").split(",") if name] or list(CASES)
    assert set(wanted) <= set(CASES), f"BENCH_SCENES: {', '.join(CASES)} expected, got {wanted}"
    return wanted


@pytest.mark.parametrize("name", _wanted())
def test_ours_beside_every_peer_at_its_best_for_each_measure(name):
    print(f"\n{versions()}; {default_threads()} threads")
    try:
        import cv2

        cv2.setNumThreads(default_threads())
    except ImportError as cause:
        print(f"  cv2: {cause}")
    case = CASES[name]()
    ranges(case)
    rows = [
        once(case, "input", lambda z: z),
        once(case, "ours, default", lambda z: ours(case, z)),
        once(case, "ours, search=True", lambda z: ours(case, z, search=True)),
        once(case, "ours, domain=length", lambda z: ours(case, z, domain="length")),
        best_of(case, our_peer(case)),
        best_of(case, our_disparity_peer(case)),
    ]
    others = list(peers_of(case, Cache()))
    table(case, rows + others)
    for k, column in enumerate(case.columns):
        best = min(others, key=lambda row: row.values[k], default=None)
        if best is not None:
            own = min(row.values[k] for row in rows[1:])
            behind = "" if own <= best.values[k] else "  <- ours at best is behind"
            print(f"{column.name}: default {rows[1].values[k]:.3f}, our best {own:.3f}, "
                  f"{best.name} {best.values[k]:.3f}{behind}", flush=True)  # fmt: skip
    assert rows[1].values[0] < rows[0].values[0]
