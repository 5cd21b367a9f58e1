"""Runs a grid, of two or three axes, by windows: with a plan of which every number is fixed, and a halo as wide as its rates
reach.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

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
from meshflow.estimate.second_stage import is_considered
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.flow.constraints import trust_of
from meshflow.flow.methods.beltrami import Patches
from meshflow.flow.patch_groups import Place
from meshflow.flow.stops import Met
from meshflow.geometry.validation import Array
from meshflow.large.census import Census
from meshflow.large.legs import Leg, Legs
from meshflow.large.possible import must_be_local, must_be_of_the_family
from meshflow.large.sample import Sample
from meshflow.large.source import Form, OnGrid, Window, within
from meshflow.results.given_steps import Track, is_uniform, tracks_of
from meshflow.results.run import engine_of
from meshflow.results.stretches import Seen, advanced
from meshflow.surfaces.data import array_of
from meshflow.surfaces.grid import Whole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume

__all__ = ["Begun", "Bound", "Local", "Windowed", "windowed"]

# Makes what is told of each step of the plan of a window, which lies at a window of it.
Watch = Callable[[Plan, Window], Seen]
# The steps are known from tiles up to so many times the time at which these meet a stop.
BEYOND = 3.0
FREE = Constraints()


@dataclass(frozen=True, eq=False)
class Local:
    """What every window of a grid runs, whatever the samples of the whole are; small, for other processes.

    :ivar form: of the whole grid.
    :ivar plan: its data is replaced by that of a window.
    :ivar legs: the work of the plan.
    :ivar met: where its run meets a stop; None: at no stop.
    :ivar based: whether it is smoothed above a base.
    :ivar still: what is level and stays.
    :ivar cleaning: what is done about outliers.
    :ivar stabilizer: makes values with the same noise at every intensity; None: they stay as they are.
    :ivar ragged: whether samples of the whole are missing, as far as its sample shows.
    """

    form: Form
    plan: Plan
    legs: Legs
    met: Met | None = None
    based: bool = False
    still: Level = ""
    cleaning: Cleaning = AS_DATA
    stabilizer: Stabilizer | None = None
    ragged: bool = False

    @property
    def halo(self) -> int:
        """How many samples around a window decide what it becomes."""
        return self.legs.halo

    @property
    def reach(self) -> int:
        """How far away a sample decides whether another one is an outlier, and what it then becomes."""
        return _reach(self.cleaning, self.still)

    def ended(self, track: Track, found: tuple[int, Met] | None) -> "Local":
        """The same with the end of its run where a stop is met.

        :param track: the steps to beyond it.
        :param found: the step within which it is met, counted from 0, and where; None: the run takes all steps.
        """
        last = track if found is None else track.until(found[0] + 1, found[1].share)
        legs = replace(self.legs, tracks=(last, *self.legs.tracks[1:]))
        return replace(self, legs=legs, met=None if found is None else found[1])

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
        groups = None if self.plan.groups is None else self.plan.groups.oriented(way)
        return Bound(self, replace(self.plan, orientation=way, whole=turned, groups=groups), census.datum)


@dataclass(frozen=True, eq=False)
class Begun:
    """What a window has still to do.

    :ivar leg: of the work.
    :ivar held: the state before it in the window with its halo, (r, c, k) or (s, r, c, k) each, by name; empty at the beginning.
    """

    leg: Leg
    held: Mapping[str, Array] = field(default_factory=dict)


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
        self,
        windows: tuple[Window, Window],
        values: Array,
        missing: Array,
        constraints: Constraints = FREE,
        begun: Begun | None = None,
    ) -> Array:
        """The smoothed values of a window: the same bits as those of the whole.

        :param windows: the one whose values are returned, and it with its halo (:func:`.source.grown`).
        :param values: (r, c) or (r, c, k), of the window with its halo; ``missing``: (r, c); of a volume with one axis more.
        :param constraints: likewise.
        :param begun: its last leg; None: the whole work in one.
        """
        inner, outer = windows
        at, idle = within(inner, outer), self.plan.idle is not None
        if missing[at].all() or (idle and not self.local.cleaning.insists):
            return values[at]
        plan = self._plan(self.local.form.data(values, missing, outer[0]), constraints)
        if plan is None:
            return values[at]
        u = None if idle else self._advanced(plan, outer, begun or Begun(self.local.legs.one))["u"]
        return array_of(plan.result(u))[at]

    def held(
        self,
        windows: tuple[Window, Window],
        values: Array,
        missing: Array,
        constraints: Constraints,
        begun: Begun,
        watch: Watch | None = None,
    ) -> dict[str, Array]:
        """The state of a window after a leg that is not its last one, (r, c, k) or (s, r, c, k) each, by name; empty where no
        sample of it is moved. Parameters of :meth:`moved`.

        :param watch: makes what is told of each step.
        """
        inner, outer = windows
        at = within(inner, outer)
        if missing[at].all() or self.plan.idle is not None:
            return {}
        plan = self._plan(self.local.form.data(values, missing, outer[0]), constraints)
        if plan is None:
            return {}
        way, shape = plan.orientation, plan.grid.missing.shape
        seen = None if watch is None else watch(plan, way.of_window(at, missing.shape))
        found = self._advanced(plan, outer, begun, seen)
        return {name: way.inverse.of(u.reshape(*shape, -1))[at] for name, u in found.items()}

    def _advanced(self, plan: Plan, outer: Window, begun: Begun, seen: Seen | None = None) -> Mapping[str, Array]:
        """What the run of a window holds after a leg.

        :param plan: of the window; ``outer``: the window with its halo.
        """
        way = plan.orientation
        if plan.groups is not None:
            begin = tuple(part.start for part in way.of_window(outer, self.local.form.shape))
            place = Place(begin, way.of_shape(self.local.form.shape))
            plan = replace(plan, groups=replace(plan.groups, place=place))
        held: Mapping[str, Array] = {name: _columns(way.of(array)) for name, array in begun.held.items()}
        tracks = self.local.legs.tracks
        for stretch in begun.leg.stretches:
            if stretch.number < len(tracks):  # where a stop was met, its end may lie before that of the leg
                count = len(tracks[stretch.number].lengths)
                if stretch.begin >= count > 0:
                    continue
                stretch = replace(stretch, end=min(stretch.end, count))
            held = advanced(plan, tracks, stretch, held, seen)
        return held

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
    :ivar longer: the steps to beyond the stop that tiles meet; None: there is no stop, or the tiles are the whole.
    :ivar unsteady: whether the lengths of its steps are still to be found, on all samples.
    """

    found: Plan
    local: Local
    warnings: tuple[str, ...] = ()
    longer: Track | None = None
    unsteady: bool = False

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


def windowed(form: Form, sample: Sample, request: Request, most_weight: float | None = None) -> Windowed:
    """The plan for the windows of a grid, found on a sample of it.

    :param request: of the caller, with constraints of the whole grid.
    :param most_weight: the largest data weight of the whole; None: that of the request.
    :raises InputError: for what cannot be done by windows.
    """
    must_be_local(request)
    must_be_of_the_family(request, form.channels or 1)
    found, warnings = _found(
        form, sample.data, replace(request, constraints=sample.of(request.constraints, form.shape))
    )
    if not sample.is_whole:
        share = sample.data.missing.size / form.samples
        found = replace(found, warnings=_of_tiles(found))
        warnings += (f"noise and method were found on tiles spread over the whole, {share:.1%} of it",)
    whole, cleaning = _whole_of(form, found), AS_DATA if found.preparation is None else found.preparation.cleaning
    found = replace(found, most_pull=_most_pull(found, request, most_weight))
    bare = replace(found, whole=whole, preparation=None)
    steps = tracks_of(bare, None if sample.is_whole else BEYOND)
    tracks, met = steps.tracks, steps.met
    found = replace(found, noise=found.noise.oriented(found.orientation.inverse))
    if met is not None:
        found = found.with_({"time": Decided("estimated", met.said)}, time=met.time)
    groups = None if found.groups is None else found.groups.oriented(found.orientation.inverse)
    plan = replace(
        bare,
        noise=found.noise,
        groups=groups,
        data=form.few(),
        candidates=(),
        mobility=None,
        stays=None,
        pull=None,
        max_change=None,
        base=None,
        request=replace(bare.request, constraints=FREE, stops=()),
    )
    stabilizer = None if found.preparation is None else found.preparation.stabilizer
    plain = request.named or request.timed or (stabilizer is not None and stabilizer.photons)
    still: Level = "" if plain else _level_in(sample.data)
    beside = _reach(cleaning, still) + (0 if found.base is None or whole is None else base_reach(whole))
    runs = (bare, *(bare.only(part) for part in bare.blend[1:]))
    passes = () if groups is None else groups.reaches(len(form.shape))
    legs = Legs(tracks, tuple(run.variant.reach for run in runs), passes, beside)
    local = Local(form, plan, legs, met, found.base is not None, still, cleaning, stabilizer, _is_ragged(found))
    return Windowed(found, local, warnings, None if sample.is_whole else steps.longer, steps.unsteady)


def _reach(cleaning: Cleaning, still: Level) -> int:
    """How far away a sample decides whether another one is an outlier, or level, and what it then becomes."""
    return cleaning.reach + (LEVEL_REACH if still else 0)


def _columns(array: Array) -> Array:
    """(r, c, k) or (s, r, c, k) as (n, k), whose columns lie in a row."""
    planes = np.ascontiguousarray(np.moveaxis(array, -1, 0))
    return planes.reshape(len(planes), -1).T


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
    ends = float(known.min()), float(known.max())
    return Whole(found.orientation.of_spacing(form.plane), ends, _is_ragged(found))


def _is_ragged(found: Plan) -> bool:
    """Whether samples of the sample are missing."""
    return bool(on_grid(found.data).missing.any())


def _level_in(data: OnGrid) -> Level:
    """The rule of what is level in a grid and stays; there is none of volumes."""
    if isinstance(data, Volume):
        return ""
    return level_rule(array_of(data), data.missing, narrow=isinstance(data, HeightField))


def _found(form: Form, data: OnGrid, request: Request) -> tuple[Plan, tuple[str, ...]]:
    """The plan of the sample, without what no window can do, and sentences on what was left out."""
    found, warnings = plan_of_flow(data, request), ()
    if not request.named and not all(_uniform(run) for run in (found, *map(found.only, found.blend))):
        found = plan_of_flow(data, replace(request, method=Patches()))
        warnings += ("methods whose steps depend on all samples were left out of the choice",)
    large = not is_considered(form.kind, form.values)
    if found.groups is not None and large and not request.heights.second_stage:  # as the whole does
        rest = {name: how for name, how in found.decided.items() if name != "second_stage"}
        found = replace(found, groups=None, decided=rest)
    return found, warnings


def _of_tiles(found: Plan) -> tuple[str, ...]:
    """The warnings of a plan; those on outliers and level regions count what is in the tiles."""
    counted = () if found.preparation is None else found.preparation.warnings(found.idle is not None)
    return tuple(f"in the tiles that were used: {word}" if word in counted else word for word in found.warnings)


def _uniform(plan: Plan) -> bool:
    """Whether the steps of a plan do not depend on the data."""
    return is_uniform(engine_of(plan))
