"""The expected error of each sample of a result: the spread of runs on the result with noise of the estimated kind added."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.base_surface import base_of
from meshflow.estimate.noise_fields import NoiseFields
from meshflow.estimate.plan import Plan
from meshflow.estimate.preparation import lowered_by, stabilized_by
from meshflow.estimate.quantized import LeastBending
from meshflow.geometry.validation import Array, whole
from meshflow.results.result import Result
from meshflow.results.run import end_of
from meshflow.surfaces.data import Data, array_of, must_be
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["RUNS", "Again", "expected_error", "must_have_error", "spread_around"]

# Rows and columns of a window in its surroundings, and of these in the whole grid.
Rows = tuple[tuple[slice, slice], tuple[slice, slice]]
# The runs of an estimate: its deviation is a quarter of it.
RUNS = 8


class Again(Protocol):
    """Makes of other values on the same grid what the plan makes of them."""

    def __call__(self, values: Array) -> Array:
        """The smoothed values.

        :param values: (r, c) or (r, c, k), in the orientation of the caller.
        """
        ...


def spread_around(smoothed: Array, inner: Rows, again: Again, fields: NoiseFields, runs: int = RUNS) -> Array:
    """The root mean square of what runs on a result with noise added depart from it; both its bias and its variance.

    :param smoothed: (r, c) or (r, c, k), the result in a window with a halo.
    :param inner: rows and columns of the window in it, and of ``smoothed`` in the whole grid.
    :param again: takes such values and returns those of the window.
    """
    at, around = inner
    kept = smoothed[at]
    squares = np.zeros(kept.shape)
    for run in range(runs):
        noisy = (smoothed + fields.noise.relative(smoothed) * fields.at(run, around)).astype(smoothed.dtype)
        squares += np.square(again(noisy).astype(np.float64) - kept)
    return np.sqrt(squares / runs).astype(smoothed.dtype)


def must_have_error(plan: Plan | None) -> tuple[Plan, HeightField | Image]:
    """A plan and its data; results whose error is not estimated so are refused.

    :raises InputError: it says why.
    """
    if plan is None or not isinstance(plan.data, (HeightField, Image)):
        raise InputError("expected error: only for height fields and images that were smoothed as a whole")
    if isinstance(plan.method, LeastBending):
        raise InputError(
            "expected error: not for quantized data, whose noise is rounding; the error is at most half a step"
        )
    return plan, plan.data


def expected_error(result: Result, runs: int = RUNS) -> Array:
    """The expected error of each sample of a result, a standard deviation in the unit of the values.

    The result gets new noise, with the estimated deviation and correlation, and is smoothed again with the same parameters,
    several times. The root mean square difference of these runs from the result includes variance and bias. Where detail
    weaker than the noise is lost, as on rough terrain, the true error is larger by a quarter or more, because no run can show
    such detail.

    Example:

        >>> from meshflow import smooth
        >>> from meshflow.synthetic import mesas, noisy
        >>> result = smooth(noisy(mesas(48), 2.0), method="quick", result=True)
        >>> expected_error(result, runs=2).shape
        (48, 48)

    :param result: of :func:`meshflow.smooth` with ``result=True``.
    :param runs: two or more; the estimate of a sample has a relative deviation of 0.7 / sqrt(runs).
    :returns: (h, w) or (h, w, k); NaN where samples are missing, or were left out.
    :raises InputError: for other data than height fields and images, quantized data, and other domains.
    """
    must_be(result, (Result,), "expected_error")
    plan, after = result.plan, result.after
    plan, data = must_have_error(plan)
    whole(runs, "runs", 2)
    smoothed = array_of(after)
    noise = plan.noise.oriented(plan.orientation.inverse)
    fields = NoiseFields(noise, smoothed.shape[2] if smoothed.ndim == 3 else None)
    out = plan.orientation.inverse.of(data.missing)
    if plan.idle is not None:
        found = np.full_like(smoothed, noise.sigma)
    else:
        h, w = smoothed.shape[:2]
        window = slice(0, h), slice(0, w)
        with plan.request.compute.running():
            found = spread_around(smoothed, (window, window), _Rerun(plan, data, after, out), fields, runs)
    found[out] = np.nan
    return found


@dataclass(frozen=True, eq=False)
class _Rerun:
    """Runs a plan on other values.

    :ivar data: of the plan.
    :ivar after: a data object of the same grid; ``out``: (h, w), samples that are missing or were left out.
    """

    plan: Plan
    data: HeightField | Image
    after: Data
    out: Array

    def __call__(self, values: Array) -> Array:
        """The smoothed values."""
        plan, after = self.plan, self.after
        if plan.preparation is None or not isinstance(after, (HeightField, Image)):
            raise InputError("expected error: only for height fields and images")
        if plan.preparation.level is not None:  # they have no noise
            level = plan.preparation.level
            values = np.where(level if values.ndim == 2 else level[..., None], array_of(after), values)
        made = (
            replace(after, z=values, missing=self.out)
            if isinstance(after, HeightField)
            else replace(after, values=values, missing=self.out)
        )
        lowered, how = lowered_by(made, plan.preparation.datum)
        if lowered is None:
            return values
        lowered, how = stabilized_by(lowered, how, plan.preparation.stabilizer)
        turned = replace(lowered.oriented(plan.orientation), fixed=self.data.fixed)
        known = array_of(self.data)[~self.data.missing]
        ends = Whole(turned.spacing, (float(known.min()), float(known.max())), turned.gridded(plan.lift).ragged)
        again = replace(plan, data=turned, preparation=how, whole=ends)
        if plan.base is not None:
            grid = replace(turned.gridded(plan.lift), whole=ends)
            sigma = plan.noise.sigma * plan.request.strength
            again = replace(again, base=base_of(grid, sigma, plan.request.compute.threads))
        return array_of(again.result(end_of(again).u))
