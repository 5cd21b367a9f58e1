"""Runs a grid by windows: with a plan of which every number is fixed, and a halo of as many samples as its rates reach."""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.base import base_of, base_reach
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.heights import limit_of
from meshflow.estimate.plan import Plan
from meshflow.estimate.planner import constrained, oriented, plan_of_flow, staying
from meshflow.estimate.preparation import lowered_by
from meshflow.estimate.request import Request
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.methods.beltrami import Patches
from meshflow.geometry.validation import Array
from meshflow.large.census import Census
from meshflow.large.sample import Sample, part_of
from meshflow.large.source import OnGrid, Window, within
from meshflow.results.run import end_of, engine_of, with_given_steps
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["Windowed", "must_be_local", "windowed"]

# The values along a side of the data that a plan keeps for its windows, which bring their own.
FEW = 2


@dataclass(frozen=True, eq=False)
class Windowed:
    """A plan for the windows of a grid.

    :ivar found: the plan of the sample, for reports.
    :ivar plan: what each window runs; its data is replaced by the window's.
    :ivar census: of the whole grid.
    :ivar constraints: of the whole grid, in its order.
    :ivar halo: how many samples around a window decide what it becomes.
    :ivar warnings: sentences on what was left out, beside those of the plan.
    """

    found: Plan
    plan: Plan
    census: Census
    constraints: Constraints
    halo: int
    warnings: tuple[str, ...] = ()

    def moved(self, inner: Window, outer: Window, values: Array, missing: Array) -> Array:
        """The smoothed values of a window: the same bits as those of the whole.

        :param inner: the window whose values are returned.
        :param outer: it and its halo (:func:`.source.grown`), as far as the grid reaches.
        :param values: (r, c) or (r, c, k), of the outer window; ``missing``: (r, c).
        """
        at = within(inner, outer)
        if self.plan.idle is not None or missing[at].all():
            return values[at]
        data = self.census.form.data(values, missing, outer[0])
        plan = self._plan(data, outer)
        done = plan.result(end_of(plan).u)
        return array_of(done)[at]

    def _plan(self, data: OnGrid, window: Window) -> Plan:
        """The plan of a window."""
        constraints = part_of(self.constraints, self.census.form.shape, window)
        request = replace(self.plan.request, constraints=constraints)
        held, request, mobility = constrained(data, request, staying(data, request))
        lowered, how = lowered_by(on_grid(held), self.census.datum)
        way = self.plan.orientation
        turned, request, mobility = oriented(lowered, request, mobility, way)
        plan = replace(
            self.plan,
            data=turned,
            request=request,
            mobility=mobility,
            preparation=how,
            max_change=limit_of(turned, request, self.plan.noise)[0],
            base=None,
        )
        if self.found.base is None:
            return plan
        grid = replace(turned.gridded(plan.lift), whole=plan.whole)
        sigma = plan.noise.sigma * request.strength
        return replace(plan, base=base_of(grid, sigma, request.compute.threads))


def on_grid(data: object) -> OnGrid:
    """A height field or an image as such.

    :raises InputError: for anything else.
    """
    if not isinstance(data, (HeightField, Image)):
        raise InputError(f"windows: a height field or an image expected, got {type(data).__name__}")
    return data


def must_be_local(request: Request) -> None:
    """Refuse what no window can know of the whole.

    :raises InputError: it names the option, and says why.
    """
    held = request.constraints
    asked = {
        "stop": (bool(request.stops), "it is met by the whole at once; give a time"),
        "second_stage": (bool(request.heights.second_stage), "its groups of patches are sought around each sample"),
        "level": (request.level is not None, "an offset is that of a whole line"),
        f"outliers={request.outliers!r}": (
            request.outliers in ("keep", "repair"),
            "they are found by all samples; declare what is missing (nodata)",
        ),
        "data_weights": (
            np.ndim(held.data_weights) > 0,
            "the largest of them shortens all steps; give one for all samples",
        ),
        "max_change='step'": (isinstance(held.max_change, str), "steps are found by all samples; give a number"),
        "domain": (request.domain != "length", "of range images"),
    }
    for word, (given, why) in asked.items():
        if given:
            raise InputError(f"{word}: not by windows, {why}")


def windowed(census: Census, sample: Sample, request: Request) -> Windowed:
    """The plan for the windows of a grid, found on a sample of it.

    :param request: of the caller, with constraints of the whole grid.
    :raises InputError: for what cannot be done by windows.
    """
    must_be_local(request)
    constraints = request.constraints
    asked = replace(request, constraints=sample.of(constraints, census.form.shape))
    found, warnings = _found(sample.data, asked)
    if not sample.is_whole:
        share = sample.data.missing.size / (census.form.shape[0] * census.form.shape[1])
        warnings += (f"noise and choice are from tiles spread over the whole, {share:.1%} of it",)
    whole = census.whole
    there = replace(whole, spacing=found.orientation.of_spacing(whole.spacing))
    fixed, rates = with_given_steps(replace(found, whole=there, preparation=None))
    way = census.orientation(request.compute)
    plan = replace(
        fixed,
        orientation=way,
        whole=replace(whole, spacing=way.of_spacing(whole.spacing)),
        noise=found.noise.oriented(found.orientation.inverse),
        data=_few(sample.data),
        candidates=(),
        mobility=None,
        stays=None,
        request=replace(fixed.request, constraints=Constraints()),
    )
    runs = [fixed, *(fixed.only(part) for part in fixed.blend[1:])]
    halo = max(count * run.variant.reach for count, run in zip(rates, runs, strict=True))
    if found.base is not None:
        halo += base_reach(there)
    return Windowed(replace(found, noise=plan.noise), plan, census, constraints, halo, warnings)


def _few(data: OnGrid) -> OnGrid:
    """A few samples of data, to keep its kind."""
    some = np.zeros((FEW, FEW, *array_of(data).shape[2:]), array_of(data).dtype)
    if isinstance(data, HeightField):
        return HeightField(some, unit=data.unit)
    return Image(some)


def _found(data: OnGrid, request: Request) -> tuple[Plan, tuple[str, ...]]:
    """The plan of the sample, without what no window can do, and sentences on what was left out."""
    found, warnings = plan_of_flow(data, request), ()
    if not request.named and not all(_uniform(run) for run in (found, *map(found.only, found.blend))):
        found = plan_of_flow(data, replace(request, method=Patches()))
        warnings += ("methods whose steps depend on all samples were left out of the choice",)
    if found.groups is not None:
        found = replace(found, groups=None)
        warnings += ("a second stage would lower the error; it is not done by windows",)
    how = found.preparation
    if how is not None and how.outliers is not None and request.outliers is None:
        count = int(how.outliers.mask.sum())
        warnings += (
            f"{count} of {data.missing.size} samples looked at are outliers; by windows they are taken as data: declare what is "
            "missing (nodata)",
        )
        kept = tuple(word for word in found.warnings if word not in how.warnings)
        found = replace(found, warnings=kept)
    return found, warnings


def _uniform(plan: Plan) -> bool:
    """Whether the steps of a plan do not depend on the data."""
    engine = engine_of(plan)
    return isinstance(engine, GridFlow) and engine.uniform
