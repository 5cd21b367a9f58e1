"""The default on meshes beside the best tuned peer and our own best options, in one table: normals, distances, volume.

``python -m pytest -m bench -s tests/bench_mesh_table.py`` takes eight minutes of CPU: shapes of 500 to 2000 vertices,
and coarse ranges of the parameters. Those of the peers that come near the best of :mod:`bench_meshes` are searched with the truth
in hand, guided and bilateral normals among them; MeshLib where it is installed. A result that is further from the surface than
what came in does not count. From the environment:

- ``BENCH_SHAPES=cube,torus`` and ``BENCH_NOISE=iso-0.2,impulses-0.3``: these rows alone; rows of a run are kept in no file;
- ``BENCH_SEED=8``: of the noise;
- ``BENCH_PEERS=VTK,guided``: peers whose names begin so alone; ``BENCH_PEERS=none``: none, and no ratios to them.
"""

import os
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from time import process_time

import numpy as np
import pytest
from bench_meshes import SEED, Case, ours
from peers.meshes import mesh_peers
from peers.search import Peer, tuned

from meshflow.errors import MissingPackage
from meshflow.evaluate.meshes import MeshQuality
from meshflow.geometry.laplacians import neighbour_means
from meshflow.synthetic import shapes
from meshflow.synthetic.shapes import Shape

pytestmark = [pytest.mark.bench, pytest.mark.timeout(2 * 3600), pytest.mark.filterwarnings("ignore")]

MADE = {
    "cube": partial(shapes.cube, 12),
    "irregular cube": partial(shapes.cube, 12, True),
    "CAD part": partial(shapes.part, 0.05),
    "plate": partial(shapes.plate, 24),
    "sphere": partial(shapes.sphere, 3),
    "torus": partial(shapes.ring, 60, 24),
    "dome": partial(shapes.dome, 1000),
    "blob": partial(shapes.blob, 26),
}
# Noise of all shapes, and of some alone; standard deviations in mean edges, of impulses the share of the vertices.
COMMON = (("iso", 0.2), ("nrm", 0.3))
OTHER = (("nrm", 0.1), ("nrm", 0.7), ("impulses", 0.3), ("correlated", 0.15))
OF_SOME = ("cube", "CAD part", "torus")
# The ranges of the parameters of the peers.
RANGES = {
    "VTK windowed sinc": {"band": (0.003, 0.01, 0.03, 0.05, 0.1, 0.2, 0.4), "steps": (20, 40, 80)},
    "VTK features after sinc": {
        "band": (0.02, 0.05, 0.1, 0.3, 2.0),
        "feature": (20.0, 25.0, 30.0, 37.0, 45.0, 60.0, 90.0),
        "bend": (30.0, 120.0),
        "weight": (0.1, 0.6),
        "steps": (20, 80, 300),
        "then": ("laplacian", "sinc"),
    },
    "MeshLab two-step": {
        "rounds": (1, 4, 16, 64, 150),
        "angle": (15.0, 25.0, 37.0, 52.0, 75.0),
        "normals": (2, 5, 20),
        "fits": (2, 5, 20),
    },
    "bilateral normals": {"width": (0.2, 0.3, 0.45, 0.7, 1.0), "rounds": (5, 10, 20, 40, 80), "fits": (20, 80)},
    "guided normals": {"width": (0.15, 0.25, 0.35, 0.5, 0.7), "rounds": (2, 4, 8, 12, 20), "normal_rounds": (5, 10)},
    "MeshLib denoise": {
        "rounds": (1, 2, 4, 8, 16),
        "beta": (0.0025, 0.005, 0.01),
        "gamma": (3.0, 5.0, 10.0, 15.0, 20.0),
        "normals": (5,),
        "fits": (20,),
        "guide": (0.3, 1.0),
    },
}
OURS: list[dict] = [
    *(
        {"method": "normal-filter", "crease_contrast": c, "crease_sharpness": q, "regularize": r, "time": t}
        for c, q in ((2.0, 8.0), (4.0, 4.0), (8.0, 4.0))
        for r, t in product((0.0, 0.2, 0.5), (20.0, 100.0, 300.0))
    ),
    *(
        {"method": "fairing", "order": order, "weights": weights, "time": time}
        for order, weights, time in product((2, 10), ("uniform", "cotangent"), (1.0, 2.0, 4.0, 8.0, 16.0))
    ),
]


@dataclass(frozen=True)
class Row:
    """What the table says of one case: ours by default, at its best, and the best peer of all."""

    case: Case
    default: MeshQuality
    seconds: float
    best: MeshQuality
    peer: MeshQuality | None
    name: str

    def __str__(self):
        ours, peer = self.default, self.peer
        own = ours.normal_error / self.best.normal_error
        said = f"{self.case.name:26s} {ours.normal_error:6.2f} {self.best.normal_error:6.2f} {own:6.2f}"
        drift = f" {100 * ours.drift:+7.2f}"
        if peer is None:
            return f"{said}{'':16s} {ours.rms:6.3f}{drift} {self.seconds:5.2f}"
        beside = f" {peer.normal_error:6.2f} {ours.normal_error / peer.normal_error:6.2f}"
        return f"{said}{beside} {ours.rms:6.3f} {peer.rms:6.3f}{drift} {self.seconds:5.2f}  {self.name}"


def noisy(shape: Shape, kind: str, level: float, seed: int):
    """The points of a shape with noise; impulses are of half a mean edge, correlated is over three rounds of neighbours."""
    if kind in ("iso", "nrm"):
        return shape.noisy(kind, level, seed)  # type: ignore[arg-type]
    draw = np.random.default_rng(seed)
    off = draw.normal(size=len(shape.points))
    if kind == "impulses":
        off = 0.5 * off * (draw.random(len(off)) < level)
    else:
        mean = neighbour_means(shape.faces, len(off), "free")
        for _ in range(3):
            off = 0.5 * (off + mean @ off)
        off *= level / off.std()
    return shape.points + (shape.edge * off)[:, None] * shape.normals()


def cases():
    """The rows that the environment asks for."""
    wanted = [name for name in os.environ.get("BENCH_SHAPES", "").split(",") if name] or list(MADE)
    kinds = [name for name in os.environ.get("BENCH_NOISE", "").split(",") if name]
    seed = int(os.environ.get("BENCH_SEED", SEED))
    for name in wanted:
        shape = MADE[name]()
        for kind, level in COMMON + OTHER:
            said = f"{kind}-{level:g}"
            if said in kinds or (not kinds and ((kind, level) in COMMON or name in OF_SOME)):
                yield Case(shape, kind, level, noisy(shape, kind, level, seed))


def peers(faces) -> list[Peer]:
    """The peers of the table with their ranges."""
    wanted = tuple(name for name in os.environ.get("BENCH_PEERS", "").split(",") if name) or ("",)
    found = [peer for peer in mesh_peers(faces) if peer.name in RANGES and peer.name.startswith(wanted)]
    return [replace(peer, grid=RANGES[peer.name]) for peer in found]


def row_of(case: Case, absent: set[str]) -> Row:
    """The row of a case; ``absent`` gains the names of peers that are not installed."""
    begun = process_time()
    default = case.quality(ours(case))
    seconds = process_time() - begun
    judge = case.judge()
    best = min((ours(case, search=False, **words) for words in OURS), key=judge)
    found = []
    for peer in peers(case.shape.faces):
        try:
            one = tuned(peer, case.noisy, case.level * case.shape.edge, case.judge())
        except MissingPackage:
            absent.add(peer.name)
            continue
        found.append((one.error, peer.name, case.quality(one.result)))
    first = min(found, key=lambda one: one[0], default=(0.0, "", None))
    return Row(case, default, seconds, case.quality(best), first[2], first[1])


def _spread(name: str, ratios: list[float]) -> str:
    """The geometric mean and the worst of ratios."""
    return f"{name:58s} {np.exp(np.mean(np.log(ratios))):6.3f} {max(ratios):6.2f}"


def test_the_default_beside_the_best_tuned_peer_and_our_own_best():
    print(
        "\nmean angle of normals, degrees: default, own best, ratio, best peer, ratio; distance to the surface, rms in mean"
    )
    print("edges: default, best peer; volume, %; CPU seconds of the default; the best peer")
    rows, absent = [], set()
    for case in cases():
        rows.append(row_of(case, absent))
        print(rows[-1], flush=True)
    beside = [(row, row.peer) for row in rows if row.peer is not None]
    print(f"\n{len(rows)} cases{'; not installed: ' + ', '.join(sorted(absent)) if absent else '':44s} mean  worst")
    print(_spread("angle by default / own best", [r.default.normal_error / r.best.normal_error for r in rows]))
    if beside:
        print(_spread("angle by default / best peer", [r.default.normal_error / p.normal_error for r, p in beside]))
        print(_spread("distance by default / that of this peer", [r.default.rms / p.rms for r, p in beside]))
    drifts = [100 * abs(r.default.drift) for r in rows if np.isfinite(r.default.drift)]
    print(f"{'volume by default, %: mean and largest':58s} {np.mean(drifts):6.3f} {max(drifts):6.2f}")
    assert all(row.default.normal_error < row.case.quality(row.case.noisy).normal_error for row in rows)
