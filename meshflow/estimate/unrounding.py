"""Quantised heights: the surface of least bending that rounds to the given steps.

The rounding error is bounded by half a step, but it is not white noise: on gentle slopes it is the staircase itself. Its risk is
therefore not estimated as for noise. Instead a smooth surface that fits the data is rounded again. The simulated error e gives
the risk mean |u - z|^2 + mean |e|^2 + 2 mean e (u - z), whose last term is the correlation of the error with the smoothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import dctn, idctn, next_fast_len
from scipy.ndimage import binary_dilation, distance_transform_edt

from meshflow.estimate.plateaus import plateaus_of
from meshflow.estimate.spread import Tile, spread_tiles
from meshflow.geometry.validation import Array

__all__ = ["Unrounded", "rival_risks", "unrounded"]

# Stiffness lambda against bending, per sample: from almost no smoothing to a plane over hundreds of samples.
STIFFNESSES = (np.inf, *(2.0**power for power in range(8, -26, -2)))
# The grid is continued by at least this many samples beyond its rim by odd reflection, which continues planes as planes.
RIM = 24
# The number of iterations of the continuation by a smoothed surface.
TURNS = 4
# A sample further off than EDGE half widths of its box is an edge; samples within NEAR of it do not change.
EDGE, NEAR = 1.5, 2
# A surface with a larger share of edges is not used to simulate the rounding.
EDGES = 0.7
# The box is wider than the half step by this many deviations of the noise.
WIDER = 2.0
# Risks that differ by at most this share of the squared rounding error count as equal.
CAUTION = 0.01
# The surface is rough if the index of its stiffness is at most this.
ROUGH = 3
# The number of samples of the tiles for a fit.
ENOUGH = 160_000
# The number of repeated estimates of noise in addition to rounding, and the share of the quantum below which it is ignored.
AGAIN, LITTLE = 2, 0.04
# The largest ratio of the new root mean square error to the old one for which the data is changed.
GAIN = 0.97
# Iterations for the box (alternating directions), which end early if less than the share SETTLED of its half width changes; and
# iterations for the filling of missing samples.
MEETING, SETTLED, FILLING = 100, 3e-4, 8

# Smoothed heights within their box, the same with unchanged edges, and the share of edges.
_Held = tuple[Array, Array, float]


@dataclass(frozen=True, eq=False)
class Unrounded:
    """A surface that rounds to the given steps.

    :ivar values: (h, w).
    :ivar length: the length of the smoothing in samples; 0 if nothing is gained.
    :ivar plateaus: (h, w), mask of level samples that do not change.
    :ivar most: bound of the change of a sample, unit of the values.
    :ivar risk: expected root mean square error, unit of the values.
    """

    values: Array
    length: float
    most: float
    plateaus: Array
    risk: float


@dataclass(frozen=True, eq=False)
class _Plate:
    """Minimizes bending on a grid (h, w) that is continued beyond its rim.

    :ivar shape: (h, w).
    :ivar aspect: width over height of a cell.
    :ivar rim: stiffness of the smoothed surface whose odd reflection continues the heights; infinite: that of the heights.
    """

    shape: tuple[int, int]
    aspect: float
    rim: float = np.inf

    @cached_property
    def pads(self) -> tuple[tuple[int, int], ...]:
        """The number of samples by which each side is continued."""
        rims = []
        for n in self.shape:
            fast = (r for r in range(RIM, 2 * RIM) if next_fast_len(n + 2 * r, real=True) == n + 2 * r)
            rims.append(min(next(fast, RIM), n - 1))
        return tuple((rim, rim) for rim in rims)

    @cached_property
    def bending(self) -> Array:
        """The eigenvalues of the squared Laplacian in the cosine basis."""
        sizes = [n + sum(pad) for n, pad in zip(self.shape, self.pads, strict=True)]
        down, across = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in sizes)
        return np.square(down[:, None] * self.aspect + across[None, :] / self.aspect)

    def inner(self, continued: Array) -> Array:
        """The heights (h, w) within continued ones."""
        (top, _), (left, _) = self.pads
        return continued[top : top + self.shape[0], left : left + self.shape[1]]

    def continued(self, z: Array) -> Array:
        """Heights (h, w) with their continuation beyond the rim."""
        down, across = self.pads
        around = np.pad(z, (down, across), mode="reflect", reflect_type="odd")
        for _ in range(TURNS if np.isfinite(self.rim) else 0):
            turned = self.smooth(cosines(around), self.rim)
            around = np.pad(turned, (down, across), mode="reflect", reflect_type="odd")
            self.inner(around)[...] = z
        return around

    def smooth(self, spectrum: Array, stiffness: float) -> Array:
        """The minimizer u (h, w) of |bending u|^2 + stiffness |u - z|^2, from the cosine transform of continued heights z."""
        return self.inner(heights(spectrum * (stiffness / (stiffness + self.bending))))


def cosines(z: Array) -> Array:
    """The cosine transform of continued heights."""
    return np.asarray(dctn(z, norm="ortho"))


def heights(spectrum: Array) -> Array:
    """The continued heights from their cosine transform."""
    return np.asarray(idctn(spectrum, norm="ortho"))


@dataclass(frozen=True, eq=False)
class _Box:
    """The interval of each sample: z +- half."""

    z: Array
    half: float

    def held(self, u: Array) -> Array:
        """u, clipped to the box."""
        return np.clip(u, self.z - self.half, self.z + self.half)

    def edges(self, u: Array) -> Array:
        """Mask (h, w) of the samples near an edge, where u leaves the box by far."""
        return binary_dilation(np.abs(u - self.z) > EDGE * self.half, np.ones((3, 3), bool), iterations=NEAR)


def unrounded(
    values: Array, missing: Array, fixed: Array, quantum: float, noise: float = 0.0, aspect: float = 1.0
) -> Unrounded:
    """The surface of least bending that rounds to the given steps.

    :param values: (h, w).
    :param missing: (h, w); values there are ignored.
    :param fixed: (h, w), samples that stay.
    :param quantum: the step, unit of the values.
    :param noise: deviation of the noise beside the error of rounding, as far as it is known, likewise.
    :param aspect: width over height of a cell.
    """
    base = float(values[~missing].flat[0])  # steps are counted from a value that is there
    z = _filled(values.astype(np.float64) - base, missing, aspect)
    plateaus = plateaus_of(values, missing, quantum)
    counted = ~(missing | plateaus)
    tiles = spread_tiles(missing.shape, ENOUGH, 2)
    noise = noise if noise > LITTLE * quantum else 0.0
    fits = sorted(_fitted(z[tile], counted[tile], quantum, aspect, noise) for tile in tiles)
    fit = fits[len(fits) // 2]
    if fit.place == 0:
        return Unrounded(values, 0.0, fit.half, plateaus, fit.risk)
    stiffness, box = STIFFNESSES[fit.place], _Box(z, fit.half)
    plate = _Plate(_size(z), aspect, stiffness)
    half, u = np.full(z.shape, box.half), plate.smooth(cosines(plate.continued(z)), stiffness)
    if fit.edged:
        half[box.edges(u)] = 0.0
    half[plateaus | fixed] = 0.0
    half[missing] = np.inf
    met = _met(plate, z, half, stiffness) + base
    done = np.where(missing | (half == 0.0), values, met).astype(values.dtype)
    return Unrounded(done, stiffness**-0.25, fit.half, plateaus, fit.risk)


@dataclass(frozen=True, order=True)
class _Fit:
    """The fit of a tile.

    :ivar place: index of the stiffness; 0: nothing is gained.
    :ivar edged: whether samples near edges do not change.
    :ivar half: half width of the box.
    :ivar risk: expected root mean square error.
    """

    place: int
    edged: bool
    half: float
    risk: float


def _fitted(z: Array, counted: Array, quantum: float, aspect: float, noise: float, again: int = AGAIN) -> _Fit:
    """The fit of a tile, with an estimate of the noise in addition to rounding.

    :param noise: its known deviation; ``again``: the number of repeated estimates.
    """
    plate, box = _Plate(_size(z), aspect), _Box(z, quantum / 2.0 + WIDER * noise)
    place, edged, risk = _chosen(plate, box, counted, quantum, noise)
    if place > 0 and again > 0:
        more = _noise_beyond(plate, box, STIFFNESSES[place], counted, quantum)
        if more > max(1.25 * noise, LITTLE * quantum):
            return _fitted(z, counted, quantum, aspect, more, again - 1)
    return _Fit(place, edged, box.half, risk)


def _size(z: Array) -> tuple[int, int]:
    h, w = z.shape
    return h, w


def _filled(z: Array, missing: Array, aspect: float) -> Array:
    """Heights with missing samples filled smoothly."""
    if not missing.any():
        return z
    z = z[tuple(np.asarray(distance_transform_edt(missing, return_distances=False, return_indices=True)))]
    plate = _Plate(_size(z), aspect)
    for power in range(FILLING):
        z = np.where(missing, plate.smooth(cosines(plate.continued(z)), 2.0 ** -(2 + power)), z)
    return z


def _chosen(plate: _Plate, box: _Box, counted: Array, quantum: float, noise: float) -> tuple[int, bool, float]:
    """The index of the stiffness of least risk, whether edges are unchanged, and that risk as a root mean square."""
    z, total = box.z, float(np.sqrt(quantum**2 / 12.0 + noise**2))
    if not counted.any():
        return 0, False, total
    made = [_both(box, smoothed) for smoothed in _smoothed(plate, z)]
    smoothest, pilots = _pilots(made, z, counted, total)
    worst = np.zeros((len(made), 2))
    for pilot in pilots:
        worst = np.maximum(worst, _risks(plate, box, made, pilot, counted, (quantum, noise)))
    i, k = _next_to_least(worst)
    if 0 < i <= ROUGH:  # the surface is as rough as its steps: the true one may be even rougher
        rougher = made[max(smoothest - 1, 1)][0]
        worst = np.maximum(worst, _risks(plate, box, made, rougher, counted, (quantum, noise)))
        i, k = _next_to_least(worst)
    if i == 0 or worst[i, k] > GAIN**2:
        return 0, False, total
    return i, k == 1, total * float(np.sqrt(max(worst[i, k], 0.0)))


def _pilots(made: list[_Held], z: Array, counted: Array, total: float) -> tuple[int, list[Array]]:
    """The index of the stiffness whose distance from the data is that of rounding, and its surfaces as possible true ones."""
    off = np.array([np.sqrt(np.mean(np.square(clipped - z)[counted])) for clipped, _, _ in made])
    smoothest = max(int(np.sum(off <= total)) - 1, 1)
    clipped, edged, share = made[smoothest]
    return smoothest, [clipped, *([edged] if 0 < share <= EDGES else [])]


def rival_risks(
    rival: Callable[[Array, Tile], Array], values: Array, missing: Array, quantum: float, aspect: float
) -> tuple[float, float]:
    """The expected mean square errors of another method and of least bending, relative to that of rounding, on one tile.

    :param rival: returns the smoothed heights of a tile, given heights and position.
    :param values: (h, w), rounded and without noise.
    """
    tiles = spread_tiles(missing.shape, ENOUGH, 2)
    tile = tiles[len(tiles) // 2]
    z = _filled(values[tile].astype(np.float64) - float(values[~missing].flat[0]), missing[tile], aspect)
    plate, box, counted = _Plate(_size(z), aspect), _Box(z, quantum / 2.0), ~missing[tile]
    if not counted.any():
        return np.inf, 0.0
    made = [_both(box, smoothed) for smoothed in _smoothed(plate, z)]
    worst, other, one = np.zeros((len(made), 2)), 0.0, rival(z, tile)
    for pilot in _pilots(made, z, counted, quantum / np.sqrt(12.0))[1]:
        worst = np.maximum(worst, _risks(plate, box, made, pilot, counted, (quantum, 0.0)))
        again = np.rint(pilot / quantum) * quantum
        off = (again - pilot)[counted]
        power = max(float(np.mean(off**2)), 0.25 * quantum**2 / 12.0)
        cross = float(np.mean(off * (rival(again, tile) - again)[counted]))
        other = max(other, (float(np.mean(np.square(one - z)[counted])) + power + 2.0 * cross) / power)
    return other, float(worst[_next_to_least(worst)])


def _risks(
    plate: _Plate, box: _Box, made: list[_Held], pilot: Array, counted: Array, error: tuple[float, float]
) -> Array:
    """The expected mean square errors of each stiffness, with smoothed and unchanged edges, relative to that of rounding.

    :param made: the heights smoothed with each stiffness.
    :param pilot: a possible true surface.
    :param error: the quantum, and the deviation of the noise in addition to rounding.
    """
    quantum, noise = error
    z, found = box.z, np.zeros((len(made), 2))
    again = np.rint((pilot + noise * np.random.default_rng(0).normal(size=z.shape)) / quantum) * quantum
    off = (again - pilot)[counted]
    power = max(float(np.mean(off**2)), 0.25 * (quantum**2 / 12.0 + noise**2))
    twin = _Box(again, box.half)
    for i, smoothed in enumerate(_smoothed(plate, again)):
        for k, (one, two) in enumerate(zip(made[i][:2], _both(twin, smoothed)[:2], strict=True)):
            cross = float(np.mean(off * (two - again)[counted]))
            found[i, k] = (float(np.mean(np.square(one - z)[counted])) + power + 2.0 * cross) / power
    return found


def _next_to_least(risks: Array) -> tuple[int, int]:
    """The index of the stiffness, and of the treatment of edges, among those of about the least risk.

    It is the stiffest of them for a rough surface, else the softest, whose slopes are better.
    """
    enough = risks <= float(risks.min()) + CAUTION
    places = np.flatnonzero(enough.any(axis=1))
    i = int(places[0] if places[0] <= ROUGH else places[-1])
    return i, int(np.argmax(enough[i]))


def _noise_beyond(plate: _Plate, box: _Box, stiffness: float, counted: Array, quantum: float) -> float:
    """The deviation of noise in addition to rounding, from the share of samples further than half a step from a smooth surface.

    Samples near edges are ignored. Rounding alone moves none so far; with additional noise s the share is 0.8 s / quantum.
    """
    u = plate.smooth(cosines(plate.continued(box.z)), stiffness)
    seen = counted & ~box.edges(u)
    if not seen.any():
        return 0.0
    return float((np.abs(u - box.z) > 0.5 * quantum)[seen].mean()) * quantum / 0.8


def _smoothed(plate: _Plate, z: Array) -> list[Array]:
    """The heights smoothed with each of the stiffnesses; unchanged for the first."""
    spectrum = cosines(plate.continued(z))
    return [z if not np.isfinite(s) else plate.smooth(spectrum, s) for s in STIFFNESSES]


def _both(box: _Box, u: Array) -> _Held:
    """Smoothed heights within the box; the same with unchanged edges; and the share of edges."""
    clipped, edges = box.held(u), box.edges(u)
    return clipped, np.where(edges, box.z, clipped), float(edges.mean())


def _met(plate: _Plate, z: Array, half: Array, stiffness: float) -> Array:
    """The minimizer u of |bending u|^2 + stiffness |u - z|^2 with u in z +- half, by the alternating direction method of
    multipliers (Boyd and others 2011).
    """
    z, half = plate.continued(z), np.pad(half, plate.pads, constant_values=np.inf)
    low, high = z - half, z + half
    u = heights(cosines(z) * (stiffness / (stiffness + plate.bending)))
    held, gap, rho = np.clip(u, low, high), np.zeros_like(z), max(stiffness, 1e-3)
    least = float(half[half > 0].min(initial=np.inf))
    factor = 1.0 / (plate.bending + stiffness + rho)
    for _ in range(MEETING):
        u = heights(cosines(stiffness * z + rho * (held - gap)) * factor)
        before, held = held, np.clip(u + gap, low, high)
        gap += u - held
        if float(np.sqrt(np.mean(np.square(held - before)))) < SETTLED * least:
            break
    return plate.inner(held)
