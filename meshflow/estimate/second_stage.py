"""The choice of a second stage, filtering of groups of similar patches after the flow, by the errors estimated on a few tiles."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import overload

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.choices import channels_of
from meshflow.estimate.noise import Noise
from meshflow.estimate.plan import Decided, Plan, size_of
from meshflow.estimate.probes import probes
from meshflow.estimate.risk import PROBE
from meshflow.estimate.spread import spread_tiles
from meshflow.estimate.volume_pieces import cubes
from meshflow.flow.constraints import Limit
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.march import march
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.patch_groups import PatchGroups
from meshflow.flow.pools import Pool
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Grid
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Block, Volume, WholeVolume

__all__ = ["after_the_flow", "cut_out", "groups_of", "is_considered", "with_second_stage"]

Window = tuple[slice, ...]

# Grids of up to WHOLE samples are looked at whole; of larger ones the middle and the corners of TILES by TILES tiles with ENOUGH
# samples in total. CUT samples at a cut are not counted. On 66 crops of photographs and terrains the answers are those of all
# tiles but on three, where the gain is within 2.6 of its standard errors.
WHOLE, ENOUGH, TILES, CUT = 11_600, 20_736, 3, 4
# Likewise of volumes, and the number of cubes of larger ones; FIRST of them are enough where they say the same by CLEAR standard
# errors.
WHOLE_VOLUME, CUBES, FIRST, CLEAR = 70_000, 8, 3, 8.0
# The largest number of values for which it is considered by default, of grids and of volumes: it takes 5 to 17 microseconds of
# CPU per value, many times as long as a flow.
LARGEST, LARGEST_VOLUME = 2**20, 2**23
# The second stage must lower the error by this many standard errors of the difference.
SURE = 1.0


def groups_of(noise: Noise, strength: float, channels: int) -> PatchGroups:
    """The second stage for a noise.

    :param strength: the noise times this is removed.
    :param channels: k, the number of channels of the data.
    """
    known = len(noise.channels) == channels and any(noise.channels)
    sigmas = np.array(noise.channels if known else (noise.sigma,) * channels)
    whole = float(np.sqrt(np.mean(sigmas**2)))
    if whole > 0:  # the given noise is the root mean square
        sigmas = sigmas * (noise.sigma * strength / whole)
    return PatchGroups.of(sigmas, noise.between, noise.correlation)


def with_second_stage(plan: Plan) -> Plan:
    """A plan with the second stage if it is requested, or by default if the expected error is lower with it.

    :raises InputError: if it is requested but not possible.
    """
    data, request, asked = plan.data, plan.request, plan.request.heights.second_stage
    on_grid = isinstance(data, (HeightField, Image, Volume))
    if asked and not on_grid:
        raise InputError(f"second_stage: only for height fields, images and volumes, got {type(data).__name__}")
    if asked and (plan.mobility is not None or plan.pull is not None):
        raise InputError("second_stage: not possible with mobility or data weights; leave it out")
    if (
        not on_grid
        or not isinstance(plan.method, HeightMethod)
        or plan.idle is not None
        or asked is False
        or plan.noise.sigma <= 0
    ):
        return plan if asked is None else plan.with_({"second_stage": Decided("given")})
    if asked:
        return plan.with_({"second_stage": Decided("given")}, groups=_groups_for(plan))
    large = not is_considered(type(data), array_of(data).size)
    bound = large or request.named or request.asked or not plan.candidates or plan.noise.is_rounded
    if bound or plan.mobility is not None or plan.pull is not None:
        return plan
    groups = _groups_for(plan)
    gain, error = _gain(plan, groups)
    if gain <= SURE * error:
        return plan
    why = f"the mean square error falls by {gain:.3g}, standard error {error:.2g}"
    return plan.with_({"second_stage": Decided("estimated", why)}, groups=groups)


def _groups_for(plan: Plan) -> PatchGroups:
    """The second stage for the noise and the channels of a plan."""
    grid = plan.grid
    groups = groups_of(plan.noise, plan.request.strength, channels_of(plan.data))
    return groups.along(grid.planes, grid.missing)


def is_considered(kind: type[Data], values: int) -> bool:
    """Whether a second stage is considered by default for a grid of so many values."""
    return values <= (LARGEST_VOLUME if kind is Volume else LARGEST)


def _gain(plan: Plan, groups: PatchGroups) -> tuple[float, float]:
    """The decrease of the mean square error by the second stage, and its standard error."""
    whole, workers, of_volume = plan.grid, plan.request.compute.workers, isinstance(plan.data, Volume)
    windows = [*enumerate(_looked_at(whole))]
    in_turn = of_volume or len(windows) == 1  # large ones, each by all threads; others are jobs of one thread each
    gain_in = partial(_gain_in, plan, groups, whole, workers if in_turn else 1)
    if in_turn:
        return _told(map(gain_in, windows), early=of_volume)
    with Pool(workers) as pool:
        return _told(pool.map(gain_in, windows), early=False)


def _told(gains: Iterable[Array], early: bool) -> tuple[float, float]:
    """The mean of the gains of the samples of several windows, and its standard error.

    :param early: whether further windows are left out where the first ones are clear.
    """
    parts, gain, error = [np.zeros(0)], 0.0, 0.0
    for part in gains:
        parts.append(part)
        found = np.concatenate(parts)
        if found.size >= 2:
            gain, error = float(found.mean()), float(found.std() / np.sqrt(found.size))
        if early and len(parts) > FIRST and abs(gain) > CLEAR * error:
            break
    return gain, error


def _gain_in(plan: Plan, groups: PatchGroups, whole: Grid | Block, threads: int, of: tuple[int, Window]) -> Array:
    """The estimated gain of the samples of a window, none where none is counted.

    It is the difference of Monte Carlo SURE (Ramani, Blu, Unser 2008) for both results, from one run and one twin. The probe
    has the covariance of the noise, and the twin has its own groups.

    :param of: the seed of the probe, and the window.
    """
    seed, window = of
    deviations = np.sqrt(np.diag(groups.channels))
    power = int(np.frexp(deviations.max())[1])
    between = None if len(deviations) == 1 else plan.noise.between
    part = cut_out(whole, window)
    k, shape = len(part.planes), part.shape
    counted = ~(part.missing | part.fixed) & _inside(shape, whole.shape)
    if not counted.any() or min(shape) < 2:
        return np.zeros(0)
    probe = probes((k, *shape), 1, groups.correlation, between, seed)[0] * deviations.reshape(-1, *(1,) * len(shape))
    probe = probe.astype(part.planes.dtype)
    twin = replace(part, planes=part.planes + part.planes.dtype.type(PROBE) * probe)
    most = _limit(plan, window)
    squares, kept = [], []
    runs = [_two_stages(plan, one, groups, most, threads) for one in (part, twin)]
    for one, two in zip(*runs, strict=True):
        squares.append((one - part.planes)[:, counted].astype(np.float64) ** 2)
        # In a unit near the noise: squares of large or small numbers do not fit into single precision.
        product = np.ldexp(probe, -power) * np.ldexp(two - one, -power)
        kept.append(np.ldexp(product[:, counted].astype(np.float64) * (2.0 / PROBE), 2 * power))
    return np.mean(squares[0] + kept[0] - squares[1] - kept[1], axis=0)


def _looked_at(grid: Grid | Block) -> list[Window]:
    """The windows of a grid that are used: every other tile, which are the middle and the corners; or cubes of a volume."""
    size = grid.missing.size
    if isinstance(grid, Block):
        whole: list[Window] = [tuple(slice(0, side) for side in grid.shape)]
        parts = cubes(grid, CUBES)
        return whole if size <= WHOLE_VOLUME else [*parts[::FIRST], *parts[1::FIRST], *parts[2::FIRST]]
    return [*spread_tiles(grid.shape, WHOLE if size <= WHOLE else min(ENOUGH, size - 1), TILES)[::2]]


def _inside(shape: tuple[int, ...], whole: tuple[int, ...]) -> Array:
    """The samples of a window away from its cuts, which are along the axes where it is smaller than the whole."""
    inner = np.zeros(shape, bool)
    inner[tuple(slice(CUT, -CUT) if side < size else slice(None) for side, size in zip(shape, whole, strict=True))] = (
        True
    )
    return inner


def after_the_flow(plan: Plan, grid: Grid | Block, most: object, threads: int | None) -> tuple[Array, Limit | None]:
    """The planes (k, ...) of a window after the flow, and the limit of its changes.

    :param most: the largest change in the window, as the caller gives it; None: none.
    """
    variant = plan.variant
    flow = VolumeFlow(grid, variant, threads) if isinstance(grid, Block) else GridFlow(grid, variant, threads)
    shape = (*grid.shape, *size_of(plan.data)[0][len(grid.shape) :])
    limit = None if most is None else Limit.of(flow.start(), most, shape)
    until, twicing = plan.until, plan.twicing
    marked = replace(until, time=2 * plan.time, marks=(plan.time,)) if twicing > 0 else until
    u, kept = flow.start(), None
    for state in march(flow, marked, "auto", limit=limit):
        u = state.u
        if twicing > 0 and kept is None and state.time >= plan.time * (1 - 1e-12):
            kept = u
    if kept is not None:
        u = kept + kept.dtype.type(twicing) * (kept - u)
    if limit is not None:
        u = limit.hold(u.copy(order="K"))
    return np.ascontiguousarray(u.T).reshape(grid.planes.shape).astype(grid.planes.dtype), limit


def _two_stages(plan: Plan, grid: Grid | Block, groups: PatchGroups, most: object, threads: int) -> tuple[Array, Array]:
    """The planes (k, ...) after the flow, and after the second stage."""
    first, limit = after_the_flow(plan, grid, most, threads)
    second = groups.filtered(grid.planes, first, grid.missing, threads)
    second[:, grid.fixed] = first[:, grid.fixed]
    if limit is not None:
        columns = second.reshape(len(second), -1).T.astype(limit.start.dtype)
        second = np.ascontiguousarray(limit.hold(columns).T).reshape(second.shape)
    return first, second


def _limit(plan: Plan, window: Window) -> object:
    """The largest change in a window: a number, or an array with one number per sample."""
    if plan.max_change is None or np.ndim(plan.max_change) == 0:
        return plan.max_change
    shape, axes = size_of(plan.data)[0], len(window)
    held = np.asarray(plan.max_change)
    if held.shape == shape[:axes] and len(shape) == axes + 1:
        held = held[..., None]
    return np.broadcast_to(held, shape)[window]


@overload
def cut_out(grid: Grid, window: Window) -> Grid: ...
@overload
def cut_out(grid: Block, window: Window) -> Block: ...
def cut_out(grid: Grid | Block, window: Window) -> Grid | Block:
    """A window of a grid or a volume."""
    planes = np.ascontiguousarray(grid.planes[(slice(None), *window)])
    missing, fixed = grid.missing[window], grid.fixed[window]
    if isinstance(grid, Block):
        whole = WholeVolume(grid.ends, tuple(first for first, _ in grid.spans), grid.ragged)
        alternate = grid.diagonals == "alternate"
        return replace(grid, planes=planes, missing=missing, fixed=fixed, whole=whole if alternate else None)
    rows, columns = window
    widths, cuts = grid.spacing[0], None
    if np.ndim(widths):
        widths = np.asarray(widths)[rows]
    if grid.cuts is not None:
        right = slice(columns.start, columns.stop - 1)
        cuts = Cuts(grid.cuts.right[rows, right], grid.cuts.down[rows.start : rows.stop - 1, columns])
    return replace(grid, planes=planes, missing=missing, fixed=fixed, spacing=(widths, grid.spacing[1]), cuts=cuts)
