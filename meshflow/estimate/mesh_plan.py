"""The way and the time of a mesh whose points move: as given, or of least estimated risk; each says where it came from."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any, get_args

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.grid_plan import HARM, bare, given_time, no_noise
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Origin, Parameter, Plan, expected_error, squared_unit, value_unit
from meshflow.estimate.risk import PROBE, Trial, ranked
from meshflow.estimate.settings import Settings
from meshflow.flow.conservation import Keep
from meshflow.flow.controls import Until
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.methods.beltrami import Member
from meshflow.flow.methods.fairing import is_short
from meshflow.flow.methods.motion import Motion, MotionName
from meshflow.flow.methods.normal_filter import Facets
from meshflow.flow.mobility import slowed
from meshflow.geometry.connectivity import boundary_edges
from meshflow.geometry.delaunay import is_thin
from meshflow.geometry.normals import beyond, measured
from meshflow.geometry.operator import cotangents, total_area
from meshflow.geometry.validation import Array
from meshflow.geometry.volume import is_closed, volume
from meshflow.surfaces.lift import Lift, Mesh
from meshflow.surfaces.surface import Surface

__all__ = ["candidates", "moving", "searched"]

# Ways of facets that are looked at: contrast and sharpness, the sampling as it is or evened over so many squared edges.
CREASES, EVENED = ((2.0, 8.0), (8.0, 2.0), (1.0, 4.0)), (0.0, 0.3)
# Rounds of facets, and times of fairings, in squared edges, at which the risk is looked at.
LONG = (10.0, 20.0, 30.0, 50.0, 100.0, 200.0, 300.0)
# All ways are looked at up to this, the best so many of them go on.
FIRST, BEST = 50.0, 2
SHORT = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 23.0, 32.0)
FAIRINGS = ((2, "uniform"), (4, "uniform"), (10, "uniform"), (2, "cotangent"))
# The one way where no search is wanted.
FIXED, FAIRED = Motion("facets"), Motion("fairing")
# The one order of a fairing by which no value leaves its range, weights of zero and above.
RANGED = 1
# Vertices below which what differs from neighbour to neighbour may well be the shape.
FEW = 100
FIXED_TIME = {"facets": 100.0, "fairing": 1.0}
# Contrast of normal channels in edges; the threshold of principal directions, (BENT + BENDS sigma / h) / h, which of cubes and
# cylinders with noise of 0.03 to 0.3 edges is the best within a fifth; and times in squared edges.
CHANNELS, BENT, BENDS, LONGER = 8.0, 0.05, 0.3, {"normal-channels": 5.0, "principal": 5.0}
# The volume of a closed mesh, over its area to the power 3/2, below which it holds none.
HOLLOW = 1e-6
# What says how values stand above a base, and nothing where all coordinates are free.
EXPONENTS = ("gamma", "sharpness", "patch")
# Vertices that the search looks at, in so many pieces, and how many rings at their cuts are not counted.
ENOUGH, PIECES, RINGS = 12_000, 4, 3
# A triangle whose normal has turned this far (cosine) from the mean of its own and its neighbours' has folded; a share of them
# weighs as so many sigma squared: a fold is no surface, however near its points may be.
FOLDED, WEIGHT = 0.3, 10.0
# A run is given up when its risk has grown so often since its least.
PATIENCE = 2


def candidates(step: float) -> tuple[Motion, ...]:
    """Ways to look at.

    :param step: h, the mean edge.
    """
    made = [
        Motion("facets", facets=Facets(contrast, sharpness, evened * step**2))
        for evened, (contrast, sharpness) in product(EVENED, CREASES)
    ]
    made += [Motion("fairing", order, weights) for order, weights in FAIRINGS]  # type: ignore[arg-type]
    return tuple(made)


def _times(motion: Motion, step: float) -> tuple[float, ...]:
    """Times at which the risk of a way is looked at, squared length."""
    return tuple(time * step**2 for time in (LONG if motion.kind == "facets" else SHORT))


def searched(
    noun: Mesh, lift: Lift, ways: tuple[Motion, ...], sigma: float, end: float | None, speed: Array | None = None
) -> tuple[Trial, ...]:
    """The trials of a search, the best first: mean square error along the normals, by Monte Carlo SURE.

    ((x - x0) . n)^2 - sigma^2 + 2 sigma^2 of what a second run, beside the first by random signs along the normals, has of them
    left: the noise across the surface is what is seen; along it a surface looks the same.

    :param sigma: the noise along the normals, unit of the points.
    :param end: the time that is given; None: it is searched for, too.
    :param speed: (n, 1), of each vertex.
    """
    step, whole = noun.step, noun
    noun, counted, kept = _pieces(noun)
    slow = None if speed is None else speed[kept]
    normals = noun.normals
    assert normals is not None
    signs = np.random.default_rng(0).choice(np.array([-1.0, 1.0]), size=(len(normals), 1))
    start = noun.lifted(lift)
    twin = start.moved(start.points + PROBE * sigma * signs * normals)
    across = beyond(noun.faces)

    def risk(one: Array, other: Array) -> float:
        change = np.einsum("ij,ij->i", one - start.points, normals)[counted]
        left = (signs[:, 0] * np.einsum("ij,ij->i", other - one, normals))[counted] / (PROBE * sigma)
        square = float(np.mean(change * change)) + sigma**2 * (2.0 * float(np.mean(left)) - 1.0)
        return square + WEIGHT * sigma**2 * folded(one, noun.faces, across)

    def tried(way: Motion, times: tuple[float, ...]) -> list[Trial]:
        risks = [sigma**2 * (1.0 + WEIGHT * folded(start.points, noun.faces, across))]
        for pair in _pairs(way, (start, twin), times, slow):
            risks.append(risk(*pair))
            if len(risks) - 1 - int(np.argmin(risks)) > PATIENCE:
                break
        if len(risks) == 1:
            return []
        first = 0 if end is None else 1  # a time that is given is compared alone
        return [Trial(way, (0.0, *times)[first : len(risks)], tuple(risks[first:]))]

    def looked_at(way: Motion, most: float) -> tuple[float, ...]:
        times = (end,) if end is not None else tuple(t for t in _times(way, step) if way.once or t <= most)
        if len(ways) == 1 or way.kind != "fairing" or way.weights == "uniform":
            return times
        return tuple(t for t in times if all(is_short(generator, t, way.order) for generator in generators))

    flows = [MeshFlow(surface) for surface in (whole.lifted(lift), start, twin)]
    generators = [flow.generator(flow.start(), "cotangent") for flow in flows]
    if end is not None:
        return ranked(trial for way in ways for trial in tried(way, looked_at(way, end)))
    first = ranked(trial for way in ways for trial in tried(way, looked_at(way, FIRST * step**2)))
    going = [t.candidate for t in first[:BEST] if t.squares[-1] == min(t.squares) and not t.candidate.once]
    longer = [trial for way in going for trial in tried(way, looked_at(way, np.inf))]
    return ranked((*longer, *(t for t in first if t.candidate not in going)))


def _pairs(
    way: Motion, pair: tuple[Surface, Surface], times: tuple[float, ...], speed: Array | None
) -> Iterator[tuple[Array, Array]]:
    """The points of a run and of its twin at each time; none where slivers do not let it be run."""
    flows = [slowed(way.engine(surface, Member()), speed) for surface in pair]
    try:
        yield from zip(*(way.states(flow, flow.start(), times) for flow in flows), strict=True)
    except NotConverged:
        return


def folded(points: Array, faces: Array, across: Array) -> float:
    """The share of triangles whose normal has turned from the mean of its own and its neighbours'."""
    normals, areas = measured(points, faces)
    mean = areas[:, None] * normals
    for side in across.T:
        mean = mean + np.where(side[:, None] >= 0, areas[side, None] * normals[side], 0.0)
    lengths = np.linalg.norm(mean, axis=1)
    cosine = np.divide(
        np.einsum("ij,ij->i", normals, mean), lengths, out=np.ones_like(lengths), where=(lengths > 0) & (areas > 0)
    )
    return float(np.mean(cosine < FOLDED))


def _pieces(noun: Mesh) -> tuple[Mesh, Array, Array]:
    """A mesh that is not too large: the whole, or pieces of it, which of its vertices are counted, and which of the whole they
    are.
    """
    if len(noun.points) <= ENOUGH:
        return noun, ~noun.fixed, np.arange(len(noun.points))
    across, m = beyond(noun.faces), len(noun.faces)
    taken, seeds = np.zeros(m, bool), np.linspace(0, m - 1, PIECES + 2).astype(int)[1:-1]
    for seed in seeds:
        front, size = np.array([seed]), 0
        while len(front) and size < 2 * ENOUGH // PIECES:
            front = front[~taken[front]]
            taken[front] = True
            size += len(front)
            front = np.unique(across[front][across[front] >= 0])
    faces = noun.faces[taken]
    kept, inverse = np.unique(faces, return_inverse=True)
    cut = np.isin(kept, noun.faces[~taken])
    faces = inverse.reshape(-1, 3)
    for _ in range(RINGS):
        cut[faces[cut[faces].any(axis=1)]] = True
    piece = replace(noun, points=noun.points[kept], faces=faces, channels=None, moves="points", fixed=noun.fixed[kept])
    counted = ~(cut | noun.fixed[kept])
    return piece, counted if counted.any() else ~noun.fixed[kept], kept


def moving(noun: Mesh, settings: Settings, noise: Noise, speed: Array | None = None) -> Plan:
    """How the points of a mesh move, and how long: as given, by rule, or of least estimated risk.

    :param speed: (n, 1), of each vertex.
    :raises InputError: for what such a mesh does not know.
    """
    kind: Any = settings.method if settings.method in get_args(MotionName) else None
    if settings.order is not None or settings.weights is not None:
        kind = _same(kind, "fairing", "order and weights")
    if settings.evened is not None:
        kind = _same(kind, "facets", "evened")
    if kind == "facets" and settings.triangles == "clamped":
        raise InputError("triangles='clamped': normals flow between facets, without cotangents; leave it out")
    whole = noun.moves == "points" and noun.points.shape[1] == 3
    if kind not in (None, "curvature") and not whole:
        raise InputError(
            f"method={kind!r}: of points in R^3 that move alone, got moves={noun.moves!r} in R^{noun.points.shape[1]}"
        )
    if kind in ("facets", "fairing") or (kind is None and whole and not _told_otherwise(settings)):
        return _shaped(noun, settings, noise, kind, speed)
    named = settings.method if kind is None else None  # a member of those whose values stand above a base
    motion, featured = _curved(noun, settings, noise, kind or "curvature")
    keep = settings.keep or _holding(noun, settings, motion)
    plain = replace(settings, method=None) if kind else settings
    plan = bare(noun, replace(plain, contrast=None) if featured else plain, noise)
    told = {
        **plan.parameters,
        **_named(motion, settings, noun),
        **_kept(settings, keep),
        **({} if motion.kind == "principal" else _triangulated(noun, settings)),
    }
    if motion.curve:
        told["boundary"] = Parameter("curve", "", "given")
    if featured and given_time(noun, settings) is None:
        much = LONGER[motion.kind]
        told["time"] = Parameter(much * noun.step**2, squared_unit(noun), "default", f"{much:g} squared edges")
    useless = [name for name in EXPONENTS if getattr(settings, name) is not None]
    for name in (*EXPONENTS, "indicator", *(("contrast",) if noun.moves == "points" else ())):
        told.pop(name, None)
    warnings = plan.warnings
    if useless or named:
        words = [*useless, *([f"method {named}"] if named else [])]
        warnings += (
            f"{', '.join(words)}: no effect where points move; this was mean curvature flow, method curvature",
        )
    return replace(plan, motion=motion, keep=keep, parameters={**told, **featured}, warnings=warnings)


def _holding(noun: Mesh, settings: Settings, motion: Motion) -> Keep | None:
    """What is kept where nobody says: of a conformalised flow the volume by scaling, of an open mesh the area, where all points
    are free; the volume of normal channels, which shrink balls.
    """
    filled = (
        is_closed(noun.faces)
        and noun.points.shape[1] == 3
        and abs(volume(noun.points, noun.faces)) > HOLLOW * total_area(noun.points, noun.faces) ** 1.5
    )
    if motion.kind == "conformal":
        free = settings.along == "all" and settings.speed is None and not noun.fixed.any()
        rim = settings.boundary == "fixed" and len(boundary_edges(noun.faces)) > 0
        # Noise is area that is not there without it: where the area is kept, what is noisy swells.
        return ("scale" if filled else "area") if free and not rim else None
    return "volume" if motion.kind == "normal-channels" and filled else None


def _curved(noun: Mesh, settings: Settings, noise: Noise, kind: MotionName) -> tuple[Motion, dict[str, Parameter]]:
    """A way of mean curvature, and the contrast of one that keeps features."""
    motion = Motion(kind, along=settings.along, triangles=settings.triangles, curve=settings.boundary == "curve")
    if kind not in ("principal", "normal-channels"):
        return motion, {}
    sigma = noise.sigma * settings.strength
    if settings.contrast is not None:
        contrast = Parameter(float(settings.contrast), "length", "given")
    elif kind == "normal-channels":
        contrast = Parameter(CHANNELS * noun.step, "length", "default", f"{CHANNELS:g} edges")
    else:
        edges = 1.0 / (BENT + BENDS * sigma / noun.step)
        contrast = Parameter(
            edges * noun.step, "length", "estimated", f"{edges:.3g} edges, h / ({BENT:g} + {BENDS:g} sigma / h)"
        )
    return replace(motion, contrast=float(contrast.value)), {"contrast": contrast}


def _same(kind: str | None, own: str, words: str) -> str:
    if kind not in (None, own):
        raise InputError(f"{words}: of method {own}, got method={kind!r}")
    return own


def _told_otherwise(settings: Settings) -> bool:
    """Whether the caller asks for what only the curvature flow knows: a time or steps of it, an exponent, a stepper."""
    plain = Settings()
    names = (
        "time",
        "scale",
        "steps",
        "dt",
        "control",
        "stepper",
        "confidence",
        "contrast",
        *(("twice",) if settings.triangles != "clamped" else ()),  # of which it is zero, whoever asks
        "mass",
        "indicator",
        "method",
    )
    return settings.named or settings.stopping or any(getattr(settings, n) is not getattr(plain, n) for n in names)


def _shaped(noun: Mesh, settings: Settings, noise: Noise, kind: str | None, speed: Array | None) -> Plan:
    """Facets or a fairing."""
    lift, timed = Lift(1.0, settings.diagonals, settings.rim), given_time(noun, settings)
    if settings.confidence is not None:
        raise InputError(
            "confidence: weights pull at the curvature flow of a mesh only; give method='curvature', or fixed and limit"
        )
    plan = Plan(noun, Member(mass=settings.mass), lift, Until(0.0), {}, noise, keep=settings.keep)
    asked = timed is not None or settings.steps is not None or settings.stopping
    ways = _open(noun, settings, kind)
    way, told, origin = ways[0], {}, "default"
    if noise.sigma == 0 and not asked:
        plan, timed = (
            replace(plan, idle=no_noise(noise)),
            Parameter(0.0, squared_unit(noun), "default", "nothing to remove"),
        )
    elif noise.sigma > 0 and settings.search is not False and settings.steps is None and not settings.stopping:
        trials = searched(noun, lift, ways, noise.sigma * settings.strength, timed and float(timed.value), speed)
        if trials:
            way, origin, (time, _) = trials[0].candidate, "estimated", trials[0].least
            told["risk"] = expected_error(trials[0], value_unit(noun), "along the normals")
            timed = timed or Parameter(time, squared_unit(noun), "estimated", "least estimated risk")
            plan = replace(plan, trials=trials, idle=HARM if timed.value == 0 else None)
    found = timed is not None and timed.origin == "estimated" and float(timed.value) > 0
    if found and noise.how != "given" and len(noun.points) < FEW:
        few = f"noise and way were found from {len(noun.points)} vertices, whose shape looks like noise: give sigma, or a time"
        plan = replace(plan, warnings=(*plan.warnings, few))
    much = FIXED_TIME[way.kind]
    timed = timed or Parameter(much * noun.step**2, squared_unit(noun), "default", f"{much:g} squared edges")
    told |= {"time": timed, **_named(way, settings, noun, origin), **_kept(settings, settings.keep)}
    if kind is None and settings.triangles == "clamped":
        told["order"] = Parameter(RANGED, "", "default", "no value leaves its range")
    how = {"given": "", "nothing": "too few samples"}.get(noise.how, f"from {noise.how}, along the normals")
    sigma = Parameter(noise.sigma, value_unit(noun), "given" if noise.how == "given" else "estimated", how)
    strength = Parameter(settings.strength, "", "default" if settings.strength == 1.0 else "given")
    boundary = Parameter(settings.boundary or noun.boundary, "", "given" if settings.boundary else "default")
    return replace(plan, motion=way, parameters={"sigma": sigma, "strength": strength, "boundary": boundary, **told})


def _open(noun: Mesh, settings: Settings, kind: str | None) -> tuple[Motion, ...]:
    """The ways that the caller leaves open; the first is the one where nothing is searched for."""
    held, made = settings, []
    curve = held.boundary == "curve"
    ranged = kind is None and held.triangles == "clamped"
    if (curve or ranged) and kind is None:
        kind = "fairing"
    for way in (FIXED, *candidates(noun.step)) if kind != "fairing" else (FAIRED, *candidates(noun.step)):
        if kind not in (None, way.kind):
            continue
        given = {"contrast": held.contrast, "sharpness": held.sharpness, "evened": held.evened}
        facets = replace(way.facets, **{name: float(x) for name, x in given.items() if x is not None})
        if held.along == "normals":
            facets = replace(facets, evened=0.0)
        order = RANGED if ranged else way.order if held.order is None else held.order
        made.append(
            replace(
                way,
                facets=facets,
                order=order,
                weights="cotangent" if ranged else held.weights or way.weights,
                along=held.along,
                triangles=held.triangles,
                curve=curve,
            )
        )
    return tuple(dict.fromkeys(made))


def _named(way: Motion, settings: Settings, noun: Mesh, origin: Origin = "default") -> dict[str, Parameter]:
    """The words of a way as parameters."""
    units = {"evened": squared_unit(noun)}
    found = {}
    for name, value in way.words.items():
        given = getattr(settings, name) is not None and (name != "along" or settings.along != "all")
        found[name] = Parameter(value, units.get(name, ""), "given" if given else origin)
    return found


def _kept(settings: Settings, keep: str | None) -> dict[str, Parameter]:
    return {} if keep is None else {"keep": Parameter(keep, "", "given" if settings.keep else "default")}


def _triangulated(noun: Mesh, settings: Settings) -> dict[str, Parameter]:
    """Whose cotangents are taken."""
    if settings.triangles != "auto":
        return {"triangles": Parameter(settings.triangles, "", "given")}
    if is_thin(cotangents(noun.points.astype(np.float64), noun.faces)[0]):
        return {"triangles": Parameter("delaunay", "", "estimated", "intrinsic: some triangles are all but flat")}
    return {"triangles": Parameter("given", "", "default")}
