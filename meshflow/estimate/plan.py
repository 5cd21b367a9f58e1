"""From words and data to what is run: what was given is held, what was not is estimated, and each says where it came from."""

from dataclasses import replace
from typing import get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.grid_plan import along_rays, bare, given_time, limit_of, tuned
from meshflow.estimate.mesh_plan import moving
from meshflow.estimate.noise import Noise, noise_growth, noise_of, noise_on
from meshflow.estimate.parameters import Parameter, Plan, given_words, squared_unit, value_unit
from meshflow.estimate.quantization import steps_of
from meshflow.estimate.settings import Settings
from meshflow.flow.constraints import Limit, trust_of
from meshflow.flow.controls import Until
from meshflow.flow.methods.motion import MotionName
from meshflow.flow.mobility import speed_of
from meshflow.geometry.validation import Array, mask_of
from meshflow.surfaces.lift import HeightField, Image, Mesh, Noun, RangeImage, data_of

__all__ = ["noise_in", "planned"]

# Time at which a run ends that does not come to its stop, in squared sample distances.
PATIENT = 100.0
HELD = "no sample may move (only, fixed, speed): nothing was changed"
# Samples that the noise of a range image is looked for in.
RAYS_ENOUGH = 80_000
# Times in which a fidelity pulls back after which a run is at rest.
AT_REST = 10.0


def noise_in(noun: Noun, only: Array | None = None) -> Noise:
    """The noise of a noun, in the unit of its values; of bare points along their normals."""
    if isinstance(noun, Mesh):
        if noun.channels is None or noun.moves == "points":
            return noise_on(noun.points, noun.faces, noun.normals)
        return noise_on(noun.channels, noun.faces)
    missing = noun.missing if only is None else noun.missing | ~only
    missing = noun.missing if missing.all() else missing
    return _noise_along(noun, missing)[0] if isinstance(noun, RangeImage) else noise_of(data_of(noun), missing)


def _noise_along(noun: RangeImage, missing: Array) -> tuple[Noise, RangeImage, str]:
    """The noise along the rays at the median depth, the image with that of each depth, and how it grows, in words.

    Second differences by depth, and at least that of the sensor's steps.
    """
    values, there = noun.along, ~missing
    known = values[there]
    steps, growth = steps_of(known), noise_growth(values, missing, enough=RAYS_ENOUGH)
    quantum = 0.0 if steps is None else float(np.median(steps.at(known[:: max(1, known.size // 10_000)])))
    if noun.sigma is not None:
        sigma, how, why = noun.sigma, "given", ""
    elif growth is None:
        return Noise(0.0, quantum), noun, ""
    else:
        sigma, how = growth.at(values).astype(noun.depth.dtype), "differences"
        why = f"at the median depth; {growth.a:.3g} + {growth.b:.3g} z + {growth.c:.3g} z²"
        if steps is not None:
            least = (steps.at(values) / np.sqrt(12.0)).astype(sigma.dtype)
            why += ", at least step / sqrt 12" if (least > sigma)[there].mean() > 0.1 else ""
            sigma = np.maximum(sigma, least)
    typical = float(np.median(np.broadcast_to(sigma, there.shape)[there]))
    if typical <= 2.0 * np.finfo(noun.depth.dtype).eps * float(np.abs(known).max()):
        return Noise(0.0, quantum, how=how), noun, ""  # the rounding of numbers is no noise
    noun = replace(noun, sigma=np.where(missing, typical, sigma) if np.ndim(sigma) else sigma)
    return Noise(typical, quantum, (typical,), 0.0, how), noun, why


def planned(noun: Noun, settings: Settings) -> Plan:
    """What is run on a noun, as its caller wants it."""
    words, only = given_words(noun, settings), _mask(noun, settings)
    if only is not None:
        noun = replace(noun, fixed=noun.fixed | ~only)
    noun, speed = _slowed(noun, settings)
    if settings.sigma is not None and isinstance(noun, RangeImage):
        noun = replace(noun, sigma=float(settings.sigma))
    _must_be_seen(noun, settings)
    if isinstance(noun, RangeImage):
        unseen = noun.missing if only is None or not only.any() else noun.missing | ~only
        noise, noun, why = _noise_along(noun, noun.missing if unseen.all() else unseen)
        noun = noun if settings.islands is None else noun.cleared(settings.islands)
    else:
        noise, why = noise_in(noun, only), ""
    if settings.sigma is not None:
        noise = replace(noise, sigma=float(settings.sigma), how="given")
    shape, n = _free(noun)
    settings = _stepped(noun, settings)
    if settings.triangles == "clamped":
        settings = replace(settings, twice=0.0)
        words |= {
            "triangles": Parameter("clamped", "", "given"),
            "twice": Parameter(0.0, "", "default", "it overshoots"),
        }
        if settings.boundary is None:
            words["boundary"] = Parameter("natural", "", "default", "weights of zero and above")
    if settings.limit is not None:  # what makes no sense is refused now, not after the search
        Limit.of(np.zeros((n, 1)), settings.limit, shape)
    if settings.confidence is not None:
        trust_of(settings.confidence, shape, n, 1.0)
    if _still(noun):  # nothing to search for
        member = None if settings.method in get_args(MotionName) else settings.method
        plan = replace(bare(noun, replace(settings, contrast=None, method=member), noise), idle=HELD)
    elif isinstance(noun, RangeImage):
        plan = along_rays(noun, settings, noise, why, speed)
    elif isinstance(noun, Mesh) and noun.moves != "channels":
        plan = moving(noun, settings, noise, speed)
    else:
        plan = tuned(noun, settings, noise, speed)
    plan = _stopping(_held(replace(plan, speed=speed), settings), settings)
    if plan.idle == HELD:
        words["time"] = Parameter(0.0, squared_unit(noun), "default", "nothing may move")
    return replace(plan, parameters={**plan.parameters, **words})


def _must_be_seen(noun: Noun, settings: Settings) -> None:
    """Refuse words that only a range image knows, or a mesh whose points move."""
    for word, given in (("islands", settings.islands is not None), ("space", settings.space != "length")):
        if given and not isinstance(noun, RangeImage):
            raise InputError(f"{word}: of range images only, got {type(noun).__name__}")
    if settings.triangles == "clamped" and not isinstance(noun, Mesh):
        raise InputError(f"triangles: of meshes only, got {type(noun).__name__}")
    if settings.method == "patches" and isinstance(noun, Mesh):
        raise InputError("method='patches': of height fields and images, whose samples have patches; got a mesh")
    ways = {name: getattr(settings, name) is not None for name in ("order", "weights", "evened", "keep")}
    ways |= {
        "triangles": settings.triangles not in ("auto", "clamped"),
        "along": settings.along != "all",
        "boundary='curve'": settings.boundary == "curve",
        f"method={settings.method!r}": settings.method in get_args(MotionName),
    }
    for word, given in ways.items():
        if given and not _points(noun):
            what = "a mesh of which the channels move" if isinstance(noun, Mesh) else type(noun).__name__
            raise InputError(f"{word}: where the points of a mesh move only, got {what}")


def _stepped(noun: Noun, settings: Settings) -> Settings:
    """With half the step of quantised data where that is the limit.

    :raises InputError: where it is not quantised.
    """
    if not isinstance(settings.limit, str):
        return settings
    values = data_of(noun)
    there = np.isfinite(values) if isinstance(noun, Mesh) else np.broadcast_to(~_gone(noun, values.ndim), values.shape)
    steps = steps_of(values[there])
    if steps is None:
        raise InputError(
            "limit='step': the data is not quantised, there is no step; give a number, or one for each sample"
        )
    return replace(settings, limit=steps.at(values) / 2.0)


def _gone(noun: HeightField | Image | RangeImage, ndim: int) -> Array:
    return noun.missing if ndim == 2 else noun.missing[..., None]


def _mask(noun: Noun, settings: Settings) -> Array | None:
    if settings.only is None:
        return None
    return mask_of(settings.only, noun.fixed.shape, "only")


def _slowed(noun: Noun, settings: Settings) -> tuple[Noun, Array | None]:
    """The noun with what has no speed fixed, and the speeds (n, 1); None where all go freely."""
    if settings.speed is None:
        return noun, None
    speed = speed_of(settings.speed, noun.fixed.shape)
    return replace(noun, fixed=noun.fixed | (speed == 0)), speed.reshape(-1, 1)


def _still(noun: Noun) -> bool:
    """Whether no sample may move."""
    still = noun.fixed if isinstance(noun, Mesh) or noun.missing is None else noun.fixed | noun.missing
    return bool(still.all())


def _free(noun: Noun) -> tuple[tuple[int, ...], int]:
    """The shape of the coordinates that move, as the caller knows them, and how many samples they are of."""
    shape = data_of(noun).shape
    if isinstance(noun, Mesh) and noun.moves == "all":
        shape = (shape[0], noun.points.shape[1] + shape[1])
    return shape, noun.fixed.size


def _held(plan: Plan, settings: Settings) -> Plan:
    """With its limit and its fidelity."""
    noun, parameters = plan.noun, dict(plan.parameters)
    limit, origin = limit_of(noun, settings, plan.noise)
    shape, n = _free(noun)
    around = isinstance(noun, Mesh) and noun.moves == "points"
    if limit is not None:
        most = float(limit) if np.ndim(limit) == 0 else "one per sample"
        why = "half the quantum, rounding is the noise" if origin == "estimated" else ""
        parameters["limit"] = Parameter(most, value_unit(noun), origin, why)
        plan = replace(plan, limit=lambda start: Limit.of(start, limit, shape, around))
    if settings.confidence is not None:
        trust = trust_of(settings.confidence, shape, n, plan.lift.contrast)
        if isinstance(noun, RangeImage) and noun.stride is not None:
            trust = trust * noun.stride.reshape(-1, 1) ** 2  # per squared footprint, as time is
        parameters["confidence"] = Parameter("weights", "", "given", "1 / squared value")
        if given_time(noun, settings) is None and (trust > 0).any():
            rest = AT_REST / float(np.median(trust[trust > 0]))
            parameters["time"] = Parameter(rest, squared_unit(noun), "default", "at rest between smoothness and data")
        plan = replace(plan, trust=trust)
    return replace(plan, parameters=parameters)


def _stopping(plan: Plan, settings: Settings) -> Plan:
    """With when to stop."""
    noun, parameters = plan.noun, dict(plan.parameters)
    assert plan.noise is not None
    shape, n = _free(noun)
    k = int(np.prod(shape)) // n
    sigma = plan.noise.sigma * settings.strength * (np.sqrt(k) if not _points(noun) else 1.0)

    def seen(u: Array) -> Array:
        """The values (h, w), (h, w, k) or (n, k) of u."""
        values = np.asarray(u).reshape(shape).view()
        values.flags.writeable = False
        return values

    stops = settings.stops(sigma, plan.there, 1.0, seen)
    time = float(parameters["time"].value)
    if stops and given_time(noun, settings) is None:
        time = PATIENT * noun.step**2
        parameters["time"] = Parameter(time, squared_unit(noun), "default", "at most, where no stop is met")
    if settings.steps is not None:
        parameters["steps"] = Parameter(float(settings.steps), "", "given")
        until = Until(given_time(noun, settings) and time, settings.steps, stops)
    else:
        until = Until(time, None, stops)
    return replace(plan, until=until, parameters=parameters)


def _points(noun: Noun) -> bool:
    return isinstance(noun, Mesh) and noun.moves != "channels"
