"""The choice of variant, contrast and time: a search for the least estimated risk, on tiles where the data is large."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.families import Family
from meshflow.estimate.noise import spread_tiles
from meshflow.estimate.risk import PROBE, Candidate, Configuration, first_of, ranked, refined, risk_curves, searched
from meshflow.flow.constraints import Limit
from meshflow.flow.engines.grid import GridFlow
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.flow.mobility import slowed
from meshflow.geometry.validation import Array
from meshflow.surfaces.discontinuities import Cuts
from meshflow.surfaces.grid import Grid, Lift
from meshflow.surfaces.mesh import Mesh

__all__ = ["LOOKED_AT", "MESH_ENOUGH", "TIMES", "Search", "configurations", "searched_on_grid", "searched_on_mesh"]

# Times at which the risk is looked at, in squared sample distances: each twice the one two places before it.
TIMES = tuple(2.0**power * part for power in range(-3, 7) for part in (1.0, 1.5))
# Samples that the search looks at, on so many tiles by side: all configurations on few of them, the best on more; and how many
# samples at a cut are not counted.
FEW, FEW_SIDE = 60_000, 4
ENOUGH, SIDE, CUT = 270_000, 6, 4
# On meshes, whose rate costs thirty times as much, up to so many vertices and squared sample distances.
MESH_ENOUGH, LOOKED_AT = 20_000, 16.0
# Members that are looked at on more samples, each with its best contrast.
BEST = 3
# How often the contrast is refined while that lowers the risk.
FINE = 3


# A grid of tiles, the samples that are not counted, the limit (k, h, w) and the speeds (n, 1).
_Tiles = tuple[Grid, Array, Array | None, Array | None]


@dataclass(frozen=True)
class Search:
    """What a search looks at.

    :ivar configurations: variants with their contrasts.
    :ivar times: squared length, growing.
    :ivar free: whether contrasts between those of the configurations may be tried.
    :ivar sigma: the noise, unit of the values; along rays one for each sample (h, w).
    :ivar end: the time that is given, at which variants are compared; None: the time is searched for, too.
    :ivar twices: weights of twicing to look at.
    :ivar speed: of each sample (n, 1); None: all go freely.
    """

    configurations: tuple[Configuration, ...]
    times: tuple[float, ...]
    free: bool
    sigma: float | Array
    end: float | None = None
    twices: tuple[float, ...] = (0.0,)
    speed: Array | None = None

    def candidates(
        self, configuration: Configuration, curves: dict[float, tuple[float, ...]], unit: float = 1.0
    ) -> list[Candidate]:
        """The candidates of a configuration from its mean square errors, in the unit of the values times ``unit``."""
        made = []
        for twice, squares in curves.items():
            times, back = (0.0, *self.times[: len(squares) - 1]), tuple(square / unit**2 for square in squares)
            if self.end is not None:
                at = self.times.index(self.end) + 1
                times, back = times[at : at + 1], back[at : at + 1]
            if times:
                made.append(Candidate(replace(configuration, twice=twice), times, back))
        return made


def searched_on_grid(
    grid: Grid, search: Search, limit: float | Array | None = None, threads: int | None = None, free: bool = False
) -> tuple[tuple[Candidate, ...], Grid]:
    """The candidates of a search on a grid, the best first, and the grid with the boundary that it was won with.

    :param grid: of which the contrast is left aside.
    :param limit: what no sample leaves, a number or an array as the caller's data; unit of the values.
    :param free: whether the other boundary, ``neumann``, may be tried, too.
    """
    most = None if limit is None else _in_planes(limit, grid)
    if grid.lines is not None:  # what a camera saw is not large, and lines are not cut into tiles
        alone = tried_on_grid((grid, np.zeros(grid.shape, bool), most, search.speed), search, threads)
        return searched(search.configurations, alone), grid
    few = _tiles_of(grid, most, search.speed, FEW, FEW_SIDE)
    candidates = searched(search.configurations, tried_on_grid(few, search, threads))
    whole = few if grid.missing.size <= FEW else _tiles_of(grid, most, search.speed, ENOUGH, SIDE)
    fine = tried_on_grid(whole, search, threads)
    candidates = _refined(searched(first_of(candidates, BEST), fine), fine, search.free)
    if candidates and free and whole[0].missing.size == grid.missing.size:
        other = (replace(whole[0], boundary="neumann"), *whole[1:])
        again = searched(
            (replace(candidates[0].configuration, boundary="neumann"),), tried_on_grid(other, search, threads)
        )
        if again[0].least[1] < candidates[0].least[1]:
            return (again[0], *candidates), replace(grid, boundary="neumann")
    return candidates, grid


def searched_on_mesh(data: Mesh, lift: Lift, search: Search) -> tuple[Candidate, ...]:
    """The candidates of a search on the channels of a mesh, the best first."""
    tried = tried_on_mesh(data, lift, search)
    candidates = searched(search.configurations, tried)
    return _refined(candidates, tried, search.free)


def _refined(
    candidates: tuple[Candidate, ...], tried: Callable[[Configuration], list[Candidate]], free: bool
) -> tuple[Candidate, ...]:
    """With more and with less contrast than the best, as long as that lowers the risk."""
    steps = refined(candidates[0].configuration) if candidates else ()
    for _ in range(FINE if free and candidates else 0):
        best = candidates[0]
        candidates = ranked(candidates + searched(steps, tried))
        if candidates[0] is best or candidates[0].configuration.variant != best.configuration.variant:
            return candidates
        grows = candidates[0].configuration.contrast > best.configuration.contrast
        steps = refined(candidates[0].configuration)[:1] if grows else refined(candidates[0].configuration)[1:]
    return candidates


def tried_on_grid(
    tiled: _Tiles, search: Search, threads: int | None = None
) -> Callable[[Configuration], list[Candidate]]:
    """Candidates on a grid of tiles: the grid, the samples that are not counted, the limit and the speeds."""
    tiles, edge, near, speed = tiled
    step, h = PROBE * search.sigma, tiles.planes.dtype.type
    probe = np.random.default_rng(0).choice(np.array([-1.0, 1.0]), size=tiles.planes.shape).astype(tiles.planes.dtype)
    twins = replace(tiles, planes=tiles.planes + np.asarray(step, h) * probe)
    counted = ~(tiles.missing | tiles.fixed | edge).ravel()
    if not counted.any():
        counted = ~tiles.missing.ravel()
    columns = probe.reshape(len(probe), -1).T
    sigma = search.sigma if not isinstance(search.sigma, np.ndarray) else search.sigma.reshape(-1, 1)

    def tried(configuration: Configuration) -> list[Candidate]:
        """The candidates of a configuration, one for each weight of twicing."""
        pair = (
            GridFlow(replace(tiles, contrast=configuration.contrast), configuration.variant, threads),
            GridFlow(replace(twins, contrast=configuration.contrast), configuration.variant, threads),
        )
        limits = None
        if near is not None:
            most = near.reshape(len(near), -1).T.astype(tiles.planes.dtype)
            limits = Limit(pair[0].start(), most), Limit(pair[1].start(), most)
        patient = search.end is not None
        runs = slowed(pair[0], speed), slowed(pair[1], speed)
        curves = risk_curves(runs, columns, sigma, search.times, counted, search.twices, limits, patient)
        return search.candidates(configuration, curves)

    return tried


def tried_on_mesh(data: Mesh, lift: Lift, search: Search) -> Callable[[Configuration], list[Candidate]]:
    """Candidates on the channels of a mesh."""
    assert data.channels is not None
    probe = np.random.default_rng(0).choice(np.array([-1.0, 1.0]), size=data.channels.shape)
    twin = replace(data, channels=data.channels + PROBE * search.sigma * probe)
    counted = ~data.fixed

    def tried(configuration: Configuration) -> list[Candidate]:
        """The candidates of a configuration, one for each weight of twicing."""
        one, two = (
            MeshFlow(part.lifted(replace(lift, contrast=configuration.contrast)), configuration.variant)
            for part in (data, twin)
        )
        pair = slowed(one, search.speed), slowed(two, search.speed)
        curves = risk_curves(
            pair, probe, search.sigma, search.times, counted, search.twices, patient=search.end is not None
        )
        return search.candidates(configuration, curves)

    return tried


def _in_planes(limit: float | Array, grid: Grid) -> Array:
    """A limit of the caller's as planes (k, h, w)."""
    k = len(grid.planes)
    shape = grid.shape if k == 1 else (*grid.shape, k)
    columns = Limit.of(np.zeros((grid.missing.size, 1)), limit, shape).most
    most = np.broadcast_to(columns, (grid.missing.size, k))
    return most.T.reshape(grid.planes.shape)


def configurations(family: Family, unit: float, like: Variant, contrast: float | None) -> tuple[Configuration, ...]:
    """Members of a family with their contrasts.

    :param unit: h / sigma, what contrasts are counted in.
    :param like: indicator, mass and floor.
    :param contrast: given; None: those of the family.
    """
    made = [
        Configuration(replace(like, **exponents), contrast or edge * unit)
        for exponents, edges in family
        for edge in edges
    ]
    return tuple(dict.fromkeys(made))


def _tiles_of(grid: Grid, limit: Array | None, speed: Array | None, enough: int, side: int) -> _Tiles:
    """A grid of tiles (:func:`_tiled`) with the speeds (n, 1) of its samples."""
    tiles, edge, near = _tiled(grid, limit, enough, side)
    if speed is None:
        return tiles, edge, near, None
    cut = _tiled(grid, speed.reshape(1, *grid.shape), enough, side)[2]
    assert cut is not None
    return tiles, edge, near, cut[0].reshape(-1, 1)


def _tiled(grid: Grid, limit: Array | None, enough: int, side: int) -> tuple[Grid, Array, Array | None]:
    """A grid of tiles one below the other, a row of nothing between them; which samples lie at their cuts; the limit.

    :param limit: (k, h, w).
    """
    h, w = grid.shape
    if h * w <= enough:
        return grid, np.zeros((h, w), bool), limit
    tiles = spread_tiles((h, w), enough, side)
    wide = max(tile[1].stop - tile[1].start for tile in tiles)
    high = sum(tile[0].stop - tile[0].start for tile in tiles) + len(tiles) - 1
    planes = np.zeros((len(grid.planes), high, wide), grid.planes.dtype)
    near = None if limit is None else np.zeros(planes.shape)
    missing, fixed, cut = np.ones((high, wide), bool), np.zeros((high, wide), bool), np.ones((high, wide), bool)
    spacings = np.broadcast_to(np.asarray(grid.spacing[0], np.float64), (h,))
    widths, top = np.full(high, spacings[0]), 0
    cuts = None if grid.cuts is None else Cuts(np.zeros((high, wide - 1), bool), np.zeros((high - 1, wide), bool))
    for rows, columns in tiles:
        to = slice(top, top + rows.stop - rows.start), slice(0, columns.stop - columns.start)
        planes[:, *to], missing[to], fixed[to] = (
            grid.planes[:, rows, columns], grid.missing[rows, columns], grid.fixed[rows, columns],
        )  # fmt: skip
        if near is not None and limit is not None:
            near[:, *to] = limit[:, rows, columns]
        if cuts is not None and grid.cuts is not None:
            tall, broad = to[0].stop - top - 1, to[1].stop - 1
            cuts.right[top : to[0].stop, :broad] = grid.cuts.right[rows, columns.start : columns.start + broad]
            cuts.down[top : top + tall, : broad + 1] = grid.cuts.down[rows.start : rows.start + tall, columns]
        widths[to[0]] = spacings[rows]
        cut[to[0], to[1]][CUT:-CUT, CUT:-CUT] = False
        top = to[0].stop + 1
    spacing = (widths if np.ndim(grid.spacing[0]) else float(widths[0]), grid.spacing[1])
    return replace(grid, planes=planes, missing=missing, fixed=fixed, spacing=spacing, cuts=cuts), cut, near
