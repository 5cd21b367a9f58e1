"""The plan for quantised heights whose noise is rounding: the surface of least bending that rounds to these steps."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.heights import as_they_are, by_rule
from meshflow.estimate.noise import Noise
from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.preparation import level_said
from meshflow.estimate.request import Request
from meshflow.estimate.spread import Tile
from meshflow.estimate.unrounding import Unrounded, rival_risks, unrounded
from meshflow.flow.constraints import Limit
from meshflow.flow.controls import Until
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.march import march
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.geometry.options import option
from meshflow.geometry.validation import Array
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["LeastBending", "quantized"]

# Noise above this multiple of the rounding error makes that error independent of the data, so the risk of a flow can be
# estimated.
LEAST, MOSTLY = 0.98, 1.8
# A flow that preserves edges is chosen if the ratio of its risk to that of least bending is between these: with important edges
# the two are similar, otherwise least bending is much better. A risk far below it is not credible.
CREDIBLE, AS_GOOD = 0.6, 1.2
UNCHANGED = "data left unchanged: rounding is the noise, and no smoothing was estimated to lower its error"


@dataclass(frozen=True, kw_only=True)
class LeastBending(HeightMethod):
    """The surface of least bending within the steps of quantised data. It is chosen from the data, not by name."""

    word: ClassVar[str] = "least-bending"

    length: float | None = option(None, "Over how many samples it smooths.", "samples", "-")


def quantized(data: HeightField | Image, request: Request, noise: Noise) -> Plan | None:
    """A plan whose result is the surface of least bending within the steps, without a flow.

    :returns: None if rounding is not most of the noise, if the caller asks for something else, and for several channels.
    """
    heights = data.z if isinstance(data, HeightField) else data.values
    if heights.ndim != 2 or not _suits(data, request) or not _mostly_rounded(noise):
        return None
    aspect = float(np.mean(data.spacing[0]) / data.spacing[1])
    beside = float(np.sqrt(max(noise.sigma**2 - noise.quantum**2 / 12.0, 0.0)))
    found = unrounded(heights, data.missing, data.fixed, noise.quantum, beside, aspect)
    if found.length > 0 and noise.is_rounded:
        flow = by_rule(replace(data, fixed=data.fixed | found.plateaus), request, noise)
        other, own = rival_risks(_Flowed(flow), heights, data.missing, noise.quantum, aspect)
        if CREDIBLE * own <= other <= AS_GOOD * own:
            return replace(flow, warnings=_of_plateaus(found))
    plan = as_they_are(data, request, noise)
    plan = plan.with_({"time": Decided("default", "no flow"), "method": Decided("estimated", "rounding is the noise")})
    if found.length == 0:
        return replace(plan, method=LeastBending(), idle=UNCHANGED, time=0.0)
    done = replace(data, z=found.values) if isinstance(data, HeightField) else replace(data, values=found.values)
    step = f"half the quantum{', rounding is the noise' if found.most <= 0.5 * noise.quantum else ', plus additional noise'}"
    decided = {"length": Decided("estimated", "least estimated risk"), "max_change": Decided("estimated", step)}
    plan = plan.with_(decided, method=LeastBending(length=found.length), max_change=found.most)
    return replace(plan, data=done, idle=_in_words(found), time=0.0, warnings=_of_plateaus(found))


@dataclass(frozen=True, eq=False)
class _Flowed:
    """Runs the flow of a plan on the heights of a tile, within half a quantum."""

    plan: Plan

    def __call__(self, z: Array, tile: Tile) -> Array:
        data = self.plan.data
        if not isinstance(data, (HeightField, Image)):
            raise InputError(f"quantized: heights on a grid expected, got {type(data).__name__}")
        rows, columns = tile
        width, height = data.spacing
        spacing = (np.asarray(width)[rows] if np.ndim(width) else width, height)
        part = HeightField(z, spacing, data.missing[rows, columns], data.fixed[rows, columns])
        boundary = self.plan.lift.boundary or data.boundary
        flow = GridFlow(part.gridded(replace(self.plan.lift, boundary=boundary)), self.plan.variant)
        limit = Limit.of(flow.start(), self.plan.noise.quantum / 2.0, z.shape)
        *_, end = march(flow, Until(time=self.plan.time), "auto", limit=limit)
        return end.u.reshape(z.shape)


def _suits(data: HeightField | Image, request: Request) -> bool:
    """Whether the caller leaves the method and the largest change open, and the data is suitable."""
    held = request.constraints
    asked = (
        request.asked
        or request.strength != 1.0
        or request.insisting
        or request.method is not None
        or request.boundary is not None
    )
    bound = any(given is not None for given in (held.max_change, held.mobility))
    cut = isinstance(data, HeightField) and data.cuts is not None
    return request.searching and not (asked or bound or cut) and min(data.missing.shape) >= 8


def _mostly_rounded(noise: Noise) -> bool:
    """Whether the error of rounding is most of the noise, and not more than it: levels of a drawing were not rounded."""
    return LEAST <= noise.sigma / (noise.quantum / np.sqrt(12.0)) <= MOSTLY if noise.quantum > 0 else False


def _in_words(found: Unrounded) -> str:
    return (
        f"rounding is the noise: replaced by the surface of least bending that rounds to these steps, smoothed over "
        f"{found.length:.2g} samples, expected error {found.risk:.3g}"
    )


def _of_plateaus(found: Unrounded) -> tuple[str, ...]:
    count = int(found.plateaus.sum())
    return (level_said(count),) if count else ()
