"""Runs a grid, of two or three axes, by windows: with a plan of which every number is fixed, and a halo as wide as its rates
reach.
"""

from dataclasses import dataclass, replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.base_surface import base_of, base_reach
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.heights import limit_of
from meshflow.estimate.plan import Decided, Plan
from meshflow.estimate.planner import constrained, oriented, pull_of, staying
from meshflow.estimate.planning import plan_of_flow
from meshflow.estimate.plateaus import LEVEL_REACH, Level, level_rule
from meshflow.estimate.preparation import AS_DATA, Cleaning, lowered_by, stabilized_by, stabilized_volume
from meshflow.estimate.request import Request
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.flow.constraints import trust_of
from meshflow.flow.methods.beltrami import Patches
from meshflow.flow.stops import AreaLoss, Met, Residual
from meshflow.geometry.validation import Array
from meshflow.large.census import Census
from meshflow.large.sample import Sample
from meshflow.large.source import Form, OnGrid, Window, within
from meshflow.results.given_steps import is_uniform, with_given_steps
from meshflow.results.run import end_of, engine_of
from meshflow.surfaces.data import array_of
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume

__all__ = ["Bound", "Local", "Windowed", "must_be_local", "windowed"]

# The values along a side of the data that a plan keeps for its windows, which bring their own.
FEW = 2
FREE = Constraints()


@dataclass(frozen=True, eq=False)
class Local:
    """What every window of a grid runs, whatever the samples of the whole are; small, for other processes.

    :ivar form: of the whole grid.
    :ivar plan: its data is replaced by that of a window.
    :ivar halo: how many samples around a window decide what it becomes.
    :ivar based: whether it is smoothed above a base.
    :ivar still: what is level and stays.
    :ivar cleaning: what is done about outliers.
    :ivar stabilizer: makes values with the same noise at every intensity; None: they stay as they are.
    :ivar ragged: whether samples of the whole are missing, as far as its sample shows.
    """

    form: Form
    plan: Plan
    halo: int
    based: bool = False
    still: Level = ""
    cleaning: Cleaning = AS_DATA
    stabilizer: Stabilizer | None = None
    ragged: bool = False

    @property
    def reach(self) -> int:
        """How far away a sample decides whether another one is an outlier, and what it then becomes."""
        return self.cleaning.reach + (LEVEL_REACH if self.still else 0)

    def cleaned(self, values: Array, missing: Array, rows: slice, constraints: Constraints) -> tuple[Array, Array]:
        """The values of a window without outliers, and its missing samples with them, as the whole is counted.

        :param values: (r, c) or (r, c, k); ``missing``: (r, c).
        :param rows: of the grid; ``constraints``: of the window.
        """
        if self.cleaning.rule is None or missing.all():
            return values, missing
        data = self.form.data(values, missing, rows)
        request = replace(self.plan.request, constraints=constraints)
        held = constrained(data, request, staying(data, request))[0]
        if isinstance(held, Volume):
            return values, missing
        lowered, _ = lowered_by(held, np.zeros(self.form.tail), self.still, self.cleaning)
        return (values, np.ones_like(missing)) if lowered is None else (array_of(lowered), lowered.missing)

    def over(self, census: Census) -> "Bound":
        """The same with what a window must know of the samples of the whole."""
        census = replace(census, stabilizer=self.stabilizer)
        if self.form.kind is Volume:
            return Bound(self, replace(self.plan, whole=census.whole_volume), census.datum)
        way, whole = census.orientation(self.plan.request.compute), census.whole
        turned = replace(whole, spacing=way.of_spacing(whole.spacing), ragged=self.ragged)
        return Bound(self, replace(self.plan, orientation=way, whole=turned), census.datum)


@dataclass(frozen=True, eq=False)
class Bound:
    """What every window of a grid runs.

    :ivar plan: with the orientation and the ends of the whole.
    :ivar datum: of the whole, () or (k,).
    """

    local: Local
    plan: Plan
    datum: Array

    def moved(
        self, windows: tuple[Window, Window], values: Array, missing: Array, constraints: Constraints = FREE
    ) -> Array:
        """The smoothed values of a window: the same bits as those of the whole.

        :param windows: the one whose values are returned, and it with its halo (:func:`.source.grown`).
        :param values: (r, c) or (r, c, k), of the window with its halo; ``missing``: (r, c); of a volume with one axis more.
        :param constraints: likewise.
        """
        inner, outer = windows
        at, idle = within(inner, outer), self.plan.idle is not None
        if missing[at].all() or (idle and not self.local.cleaning.insists):
            return values[at]
        plan = self._plan(self.local.form.data(values, missing, outer[0]), constraints)
        if plan is None:
            return values[at]
        return array_of(plan.result(None if idle else end_of(plan).u))[at]

    def _plan(self, data: OnGrid, constraints: Constraints) -> Plan | None:
        """The plan of a window; None where no sample of it is left to be moved."""
        request = replace(self.plan.request, constraints=constraints)
        held, request, mobility = constrained(data, request, staying(data, request))
        if isinstance(held, Volume):
            most = limit_of(held, request, self.plan.noise)[0]
            held, how = stabilized_volume(held, self.local.stabilizer)
            return self._pulled(
                replace(self.plan, data=held, request=request, mobility=mobility, preparation=how, max_change=most)
            )
        lowered, how = lowered_by(held, self.datum, self.local.still, self.local.cleaning)
        if lowered is None:
            return None
        lowered, how = stabilized_by(lowered, how, self.local.stabilizer)
        turned, request, mobility = oriented(lowered, request, mobility, self.plan.orientation)
        most = limit_of(turned, request, self.plan.noise)[0]
        plan = self._pulled(
            replace(
                self.plan, data=turned, request=request, mobility=mobility, preparation=how, max_change=most, base=None
            )
        )
        if not self.local.based or not isinstance(plan.whole, Whole):
            return plan
        grid = replace(turned.gridded(plan.lift), whole=plan.whole)
        sigma = plan.noise.sigma * request.strength
        return replace(plan, base=base_of(grid, sigma, request.compute.threads))

    def _pulled(self, plan: Plan) -> Plan:
        """The plan of a window with the data weights of its samples."""
        return plan if plan.request.constraints.data_weights is None else replace(plan, pull=pull_of(plan))


@dataclass(frozen=True, eq=False)
class Windowed:
    """A plan for the windows of a grid.

    :ivar found: the plan of the sample, for reports.
    :ivar local: what each window runs.
    :ivar warnings: sentences on what was left out, beside those of the plan.
    """

    found: Plan
    local: Local
    warnings: tuple[str, ...] = ()

    @property
    def halo(self) -> int:
        """How many samples around a window decide what it becomes."""
        return self.local.halo


def on_grid(data: object) -> OnGrid:
    """A height field, an image or a volume as such.

    :raises InputError: for anything else.
    """
    if not isinstance(data, (HeightField, Image, Volume)):
        raise InputError(f"windows: a height field, an image or a volume expected, got {type(data).__name__}")
    return data


def must_be_local(request: Request) -> None:
    """Refuse what no window can know of the whole.

    :raises InputError: it names the option, and says why.
    """
    held = request.constraints
    asked = {
        "stop": (
            not all(isinstance(stop, (Residual, AreaLoss)) for stop in request.stops),
            "it is met by a single sample of the whole; take a residual, a loss of area, or a time",
        ),
        "twicing": (bool(request.stops) and bool(request.twicing), "with a stop it needs the whole; give a time"),
        "second_stage": (bool(request.heights.second_stage), "its groups of patches are sought around each sample"),
        "level": (request.level is not None, "an offset is that of a whole line"),
        "max_change='step'": (isinstance(held.max_change, str), "steps are found by all samples; give a number"),
        "domain": (
            request.domain not in ("auto", "length", "stabilized", "magnitudes"),
            "of range images, and of pictures in memory",
        ),
    }
    for word, (given, why) in asked.items():
        if given:
            raise InputError(f"{word}: not by windows, {why}")


def windowed(form: Form, sample: Sample, request: Request, most_weight: float | None = None) -> Windowed:
    """The plan for the windows of a grid, found on a sample of it.

    :param request: of the caller, with constraints of the whole grid.
    :param most_weight: the largest data weight of the whole; None: that of the request.
    :raises InputError: for what cannot be done by windows.
    """
    must_be_local(request)
    _must_be_of_the_family(request, form.channels or 1)
    found, warnings = _found(sample.data, replace(request, constraints=sample.of(request.constraints, form.shape)))
    if not sample.is_whole:
        share = sample.data.missing.size / form.samples
        found = replace(found, warnings=_of_tiles(found))
        warnings += (f"noise and choice are from tiles spread over the whole, {share:.1%} of it",)
    whole, cleaning = _whole_of(form, found), AS_DATA if found.preparation is None else found.preparation.cleaning
    found = replace(found, most_pull=_most_pull(found, request, most_weight))
    fixed, rates = with_given_steps(replace(found, whole=whole, preparation=None))
    found = replace(found, noise=found.noise.oriented(found.orientation.inverse))
    for met in fixed.request.stops:
        if isinstance(met, Met):
            found = found.with_({"time": Decided("estimated", met.said)}, time=met.time)
    plan = replace(
        fixed,
        noise=found.noise,
        data=_few(sample.data),
        candidates=(),
        mobility=None,
        stays=None,
        pull=None,
        max_change=None,
        base=None,
        request=replace(fixed.request, constraints=FREE),
    )
    runs = [fixed, *(fixed.only(part) for part in fixed.blend[1:])]
    halo = max(count * run.variant.reach for count, run in zip(rates, runs, strict=True))
    halo += 0 if found.base is None or whole is None else base_reach(whole)
    stabilizer = None if found.preparation is None else found.preparation.stabilizer
    bare = request.named or request.timed or (stabilizer is not None and stabilizer.photons)
    still = "" if bare else _level_in(sample.data)
    local = Local(form, plan, halo, found.base is not None, still, cleaning, stabilizer, _is_ragged(found))
    return Windowed(found, replace(local, halo=halo + local.reach), warnings)


def _most_pull(found: Plan, request: Request, most: float | None) -> float | None:
    """The largest data weight of the whole, per time: it shortens all steps."""
    weights = request.constraints.data_weights
    if weights is None:
        return None
    return float(trust_of(np.max(weights) if most is None else most, (), 1, found.lift.contrast).max())


def _whole_of(form: Form, found: Plan) -> Whole | None:
    """What the sample of a grid takes from the whole; None of a volume, whose sample is run as if it were one."""
    if form.kind is Volume:
        return None
    known = array_of(found.data)[~on_grid(found.data).missing]
    return Whole(found.orientation.of_spacing(form.plane), (float(known.min()), float(known.max())), _is_ragged(found))


def _is_ragged(found: Plan) -> bool:
    """Whether samples of the sample are missing."""
    return bool(on_grid(found.data).missing.any())


def _level_in(data: OnGrid) -> Level:
    """The rule of what is level in a grid and stays; there is none of volumes."""
    if isinstance(data, Volume):
        return ""
    return level_rule(array_of(data), data.missing, narrow=isinstance(data, HeightField))


def _must_be_of_the_family(request: Request, channels: int) -> None:
    """Refuse methods whose rates or steps no window can have as the whole has them.

    :param channels: their number.
    :raises InputError: it names the method.
    """
    asked = request.heights
    if request.named and not asked.searches_for(channels):
        raise InputError(
            f"method={asked.word!r}: not by windows, it is a scheme of its own; take a method of the family, such as beltrami or "
            "perona-malik"
        )
    if asked.control(None) is not None:
        raise InputError(
            f"method={asked.word!r}: not by windows, its steps follow the area of the whole; leave area_steps out"
        )


def _few(data: OnGrid) -> OnGrid:
    """A few samples of data, to keep its kind."""
    axes = data.missing.ndim
    some = np.zeros((*(FEW,) * axes, *array_of(data).shape[axes:]), array_of(data).dtype)
    if isinstance(data, Volume):
        return Volume(some, unit=data.unit)
    return HeightField(some, unit=data.unit) if isinstance(data, HeightField) else Image(some)


def _found(data: OnGrid, request: Request) -> tuple[Plan, tuple[str, ...]]:
    """The plan of the sample, without what no window can do, and sentences on what was left out."""
    found, warnings = plan_of_flow(data, request), ()
    if not request.named and not all(_uniform(run) for run in (found, *map(found.only, found.blend))):
        found = plan_of_flow(data, replace(request, method=Patches()))
        warnings += ("methods whose steps depend on all samples were left out of the choice",)
    if found.groups is not None:
        found = replace(found, groups=None)
        warnings += ("a second stage would lower the error; it is not done by windows",)
    return found, warnings


def _of_tiles(found: Plan) -> tuple[str, ...]:
    """The warnings of a plan; those on outliers and level regions count what is in the tiles."""
    counted = () if found.preparation is None else found.preparation.warnings(found.idle is not None)
    return tuple(f"of the tiles looked at: {word}" if word in counted else word for word in found.warnings)


def _uniform(plan: Plan) -> bool:
    """Whether the steps of a plan do not depend on the data."""
    return is_uniform(engine_of(plan))
