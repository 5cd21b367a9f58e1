"""Impulses: samples that differ from all their neighbours, as hot pixels and salt and pepper do."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter

from meshflow.estimate.impulse_values import impulse_values
from meshflow.estimate.noise_growth import MAD
from meshflow.estimate.quantization import steps_of
from meshflow.estimate.ring_fill import neighbours_of
from meshflow.geometry.validation import Array

__all__ = ["ImpulseRule", "impulses_by", "impulses_of"]

# Samples of which the usual deviation is the median.
ENOUGH = 200_000
# An impulse differs from the median around it by this many deviations of its neighbourhood; by fewer where impulses are dense,
# and where it has the same value as many of them.
IMPULSE, IMPULSE_AMONG_MANY, IMPULSE_OF_A_VALUE = 6.0, 4.0, 2.0
# A value is one of impulses if this share of them has it.
OFTEN = 0.1
# Impulses are dense if they are this share of the samples, and this share of them is unlike all neighbours, which hardly any
# sample of thin lines is. Then samples that are like a few of their neighbours are also impulses.
DENSE, ISOLATED, LIKE = 2e-3, 0.3, 3
# Impulses that have one of two values differ by this many deviations of the others around them in the median; not more of the
# samples around one have its value than are likely by so many standard deviations.
CLEAR, LIKELY = 3.0, 3.0
# The number of repetitions without the impulses found so far, where they are dense.
ROUNDS = 3
# Samples that are processed at a time.
CHUNK = 200_000
# The neighbourhood of a sample reaches so far along rows and columns; the eight nearest in the order of its samples.
REACH = 2
NEAR = np.array(
    [max(abs(r), abs(c)) == 1 for r in range(-REACH, REACH + 1) for c in range(-REACH, REACH + 1) if r or c]
)
DIRECT = np.array([abs(r) + abs(c) == 1 for r in range(-REACH, REACH + 1) for c in range(-REACH, REACH + 1) if r or c])
# A point of light is blurred: three of its four direct neighbours at least are lifted by this share of its own height, and by so
# many deviations.
BLURRED, LIFTED = 0.1, 1.5


@dataclass(frozen=True)
class ImpulseRule:
    """What an impulse is in a channel. Found on the whole, it tells of any part which samples are.

    :ivar least: the least deviation, the step of quantized data.
    :ivar most: deviations by which an impulse differs.
    :ivar usual: the usual deviation of a sample from its neighbours; None: the grid is too small for impulses.
    :ivar salted: the values that impulses may have, the share of each, and whether they are impulses.
    :ivar dense: whether impulses are so many that they come from the sensor.
    :ivar often: values that many of them have; ``others``: deviations by which those without such a value differ.
    :ivar rounds: the usual deviation without the impulses found so far, of each repetition.
    """

    least: float = 0.0
    most: float = 0.0
    usual: float | None = None
    salted: tuple[tuple[float, float, bool], ...] = ()
    dense: bool = False
    often: tuple[float, ...] = ()
    others: float = 0.0
    rounds: tuple[float, ...] = ()

    @property
    def by_value(self) -> bool:
        """Whether impulses have the least or the greatest value."""
        return any(accepted for *_, accepted in self.salted)

    @property
    def reach(self) -> int:
        """How far away a sample decides whether another one is an impulse."""
        return 0 if self.usual is None else REACH * (1 + len(self.rounds))

    def limit(self, z: Array) -> tuple[float, Array]:
        """The deviations by which samples (h, w) may differ in the repetitions; the least of the whole, and that of each."""
        if not self.often:
            return self.others, np.broadcast_to(self.others, z.shape)
        own = np.where(np.isin(z, np.array(self.often, z.dtype)), IMPULSE_OF_A_VALUE, self.others)
        return min(IMPULSE_OF_A_VALUE, self.others), own


def impulses_of(z: Array, there: Array, by_value: bool) -> tuple[ImpulseRule, Array]:
    """The rule of a channel (h, w), and its impulses (h, w).

    :param by_value: whether to look for impulses of the least and the greatest value first.
    """
    if min(z.shape) < 5:
        return ImpulseRule(), np.zeros(z.shape, bool)
    steps, count = steps_of(z[there]), float(there.sum())
    least = 0.0 if steps is None else float(np.median(steps.sizes))
    # The largest of n Gaussian samples is near sqrt(2 log n) deviations; it is no impulse.
    most = max(IMPULSE, float(np.sqrt(2.0 * np.log(max(1.0, count)))) + 1.0)
    rule, found = _salted(z, there, least, most) if by_value else (None, np.zeros(z.shape, bool))
    if rule is None:
        rule = ImpulseRule(least, most, _usual(z, there), others=most)
        found, alone = _unlike(z, there, rule.usual or 0.0, least, (most, np.broadcast_to(most, z.shape)))
        total, single = int(found.sum()), int(alone.sum())
        if total < max(8.0, DENSE * count) or single < ISOLATED * total:
            return rule, alone
        values, counts = np.unique(z[found], return_counts=True)
        often = tuple(values[counts >= OFTEN * total].tolist())
        rule = replace(rule, dense=True, often=often, others=IMPULSE_AMONG_MANY)
    limit = rule.limit(z)
    for _ in range(ROUNDS):
        usual = _usual(z, there & ~found)
        more, _ = _unlike(z, there & ~found, usual, least, limit)
        if not more.any():
            break
        found |= more
        rule = replace(rule, rounds=(*rule.rounds, usual))
    return rule, found


def impulses_by(rule: ImpulseRule, z: Array, there: Array) -> Array:
    """The impulses (h, w) of a part of a channel by the rule of the whole."""
    if rule.usual is None:
        return np.zeros(z.shape, bool)
    if rule.by_value:
        found = np.zeros(z.shape, bool)
        known = there & ~np.isin(z, np.array([value for value, *_ in rule.salted], z.dtype))
        for value, share, accepted in rule.salted:
            if accepted:
                _taken(found, *_of_value(z, there, known, (value, share, rule.usual)))
    else:
        limit = rule.most, np.broadcast_to(rule.most, z.shape)
        found, alone = _unlike(z, there, rule.usual, rule.least, limit)
        if not rule.dense:
            return alone
    limit = rule.limit(z)
    for usual in rule.rounds:
        found |= _unlike(z, there & ~found, usual, rule.least, limit)[0]
    return found


def _salted(z: Array, there: Array, least: float, most: float) -> tuple[ImpulseRule | None, Array]:
    """The rule of impulses that have the least or the greatest value, and them (h, w); None where they have not.

    They may be as many as the other samples, which alone say what is usual.
    """
    found, salted = np.zeros(z.shape, bool), impulse_values(z, there)
    if not salted:
        return None, found
    known = there & ~np.isin(z, [value for value, _ in salted])
    usual, said = max(_usual(z, known), least), []
    for value, share in salted:
        places, off = _of_value(z, there, known, (value, share, usual))
        accepted = bool(off.size and np.nanmedian(off) > CLEAR)
        said.append((value, share, accepted))
        if accepted:
            _taken(found, places, off)
    often = tuple(value for value, _, accepted in said if accepted)
    if not often:
        return None, found
    return ImpulseRule(least, most, usual, tuple(said), True, often, most), found


def _of_value(z: Array, there: Array, known: Array, salt: tuple[float, float, float]) -> tuple[Array, Array]:
    """The places (m, 2) of samples of a value that are no part of a region of it, and how many deviations each is off.

    :param known: (h, w), the samples without such a value.
    :param salt: the value, its share of all samples, and the usual deviation.
    """
    value, share, usual = salt
    at = there & (z == value)
    around = np.rint((2 * REACH + 1) ** 2 * uniform_filter(at.astype(np.float64), 2 * REACH + 1, mode="constant")) - 1.0
    count = (2 * REACH + 1) ** 2 - 1
    places = np.argwhere(at & (around <= count * share + LIKELY * np.sqrt(count * share * (1.0 - share)) + 0.5))
    return places, np.concatenate([np.zeros(0), *(_off(z, known, usual, part) for part in _portions(places))])


def _taken(found: Array, places: Array, off: Array) -> None:
    """Mark the places (m, 2) that are off by enough."""
    out = places[off > IMPULSE_OF_A_VALUE]
    found[out[:, 0], out[:, 1]] = True


def _portions(places: Array) -> list[Array]:
    """Places (m, 2) in portions that are processed at a time."""
    return [places[start : start + CHUNK] for start in range(0, len(places), CHUNK)]


def _off(z: Array, known: Array, usual: float, places: Array) -> Array:
    """How many deviations samples (m, 2) differ from the median of the known ones around them; NaN for fewer than three.

    :param usual: the least deviation.
    """
    rows, columns, inside = neighbours_of(places, z.shape, REACH)
    around = np.where(inside & known[rows, columns], z[rows, columns].astype(np.float64), np.nan)
    off = np.full(len(places), np.nan)
    enough = np.isfinite(around).sum(axis=1) >= 3
    around, own = around[enough], z[places[enough, 0], places[enough, 1]].astype(np.float64)
    if own.size:
        median = np.nanmedian(around, axis=1)
        scale = np.maximum(MAD * np.nanmedian(np.abs(around - median[:, None]), axis=1), usual)
        # Among equal samples each difference is infinitely many deviations.
        off[enough] = np.divide(np.abs(own - median), scale, out=np.where(own == median, 0.0, np.inf), where=scale > 0)
    return off


def _unlike(z: Array, there: Array, usual: float, least: float, limit: tuple[float, Array]) -> tuple[Array, Array]:
    """Samples that differ from the median around them and are like at most three neighbours; and those that are like none and
    lift none, as a blurred point does.

    :param usual: the usual deviation; ``least``: the least one, the step of quantized data.
    :param limit: the least difference, in deviations, of an impulse of the whole, and that of each sample (h, w).
    """
    places = _suspects(z, there, 0.5 * limit[0] * usual)
    usual = max(usual, least)
    found, alone = np.zeros(z.shape, bool), np.zeros(z.shape, bool)
    for part in _portions(places):
        rows, columns, inside = neighbours_of(part, z.shape, REACH)
        around = np.where(inside & there[rows, columns], z[rows, columns].astype(np.float64), np.nan)
        enough = np.isfinite(around[:, NEAR]).sum(axis=1) >= 3
        (row, column), around = part[enough].T, around[enough]
        if row.size == 0:
            continue
        own, median = z[row, column].astype(np.float64), np.nanmedian(around, axis=1)
        scale = np.maximum(MAD * np.nanmedian(np.abs(around - median[:, None]), axis=1), usual)
        off = np.abs(own - median)
        like = (np.abs(around[:, NEAR] - own[:, None]) < 0.5 * off[:, None]).sum(axis=1)
        out = (off > limit[1][row, column] * scale) & (like <= LIKE)
        found[row[out], column[out]] = True
        height = np.sign(own - median) * (around[:, DIRECT].T - median)
        alone[row, column] = (
            out & (like == 0) & ~(np.sort(height, axis=0)[1] > np.maximum(BLURRED * off, LIFTED * scale))
        )
    return found, alone


def _suspects(z: Array, there: Array, least: float) -> Array:
    """The places (m, 2) that differ from the mean of their neighbours by more, along rows and along columns."""
    places = [np.zeros((0, 2), np.int64)]
    for top, bottom in _bands(z.shape):
        across, down = _departures(z, there, top, bottom)
        off = ~(across <= least) & ~(down <= least) & there[top:bottom]
        places.append(np.argwhere(off) + (top, 0))
    return np.concatenate(places)


def _usual(z: Array, there: Array) -> float:
    """The usual deviation of a sample from its neighbours; 0 where no sample is known with both of them."""
    count = int((there[:, :-2] & there[:, 1:-1] & there[:, 2:]).sum())
    stride, seen, some = max(1, count // ENOUGH), 0, [np.zeros(0)]
    for band in _bands(z.shape):
        known = _departures(z, there, *band)[0]
        known = known[np.isfinite(known)]
        some.append(known[-seen % stride :: stride].copy())  # a view would keep the whole band
        seen += known.size
    return MAD / np.sqrt(1.5) * float(np.median(np.concatenate(some))) if count else 0.0


def _bands(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Bands of rows, first and after the last: a large grid needs no more memory than a band."""
    height = max(1, CHUNK // shape[1])
    return [(top, min(top + height, shape[0])) for top in range(0, shape[0], height)]


def _departures(z: Array, there: Array, top: int, bottom: int) -> tuple[Array, Array]:
    """How far samples are from the mean of their two neighbours in the row, and in the column; NaN where one is unknown.

    :param top: the first row; ``bottom``: the row after the last.
    """
    low, high = max(top - 1, 0), min(bottom + 1, len(z))
    field = np.full((bottom - top + 2, z.shape[1] + 2), np.nan)
    field[low - top + 1 : high - top + 1, 1:-1] = np.where(there[low:high], z[low:high], np.nan)
    inner = field[1:-1, 1:-1]
    across = np.abs(inner - 0.5 * (field[1:-1, :-2] + field[1:-1, 2:]))
    down = np.abs(inner - 0.5 * (field[:-2, 1:-1] + field[2:, 1:-1]))
    return across, down
