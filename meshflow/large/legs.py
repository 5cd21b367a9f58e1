"""Cuts the run of a plan into legs: windows exchange the state between them where one halo for all steps would be too wide."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod

from meshflow.errors import InputError
from meshflow.results.given_steps import Track
from meshflow.results.stretches import Stretch

__all__ = ["Leg", "Legs"]

# What a pass over a sample costs, in rates of a sample: a pass of the second stage, and reading, preparing and writing it.
PASS, BETWEEN = 500.0, 40.0
# Into how many legs of even reach a run is cut at most, for a start; they are doubled.
MOST_LEGS = 1 << 12


@dataclass(frozen=True)
class Leg:
    """What windows run between two exchanges of the state.

    :ivar stretches: of the plan.
    :ivar halo: how many samples around a window decide what it becomes.
    :ivar work: the rates of a sample.
    :ivar held: the number of arrays of the state before or after it; 0 of the only leg.
    :ivar ends: whether it is the last one.
    """

    stretches: tuple[Stretch, ...]
    halo: int
    work: float
    held: int = 0
    ends: bool = False


# Sides of the windows of a leg.
Sides = Callable[[Leg], tuple[int, ...]]


@dataclass(frozen=True)
class Legs:
    """The work of a plan, which can be cut.

    :ivar tracks: of its runs.
    :ivar reaches: how far a rate of each run reaches, samples.
    :ivar passes: how far each pass of the second stage reaches.
    :ivar beside: how many samples more decide what is smoothed: the base, outliers, level regions.
    """

    tracks: tuple[Track, ...]
    reaches: tuple[int, ...]
    passes: tuple[int, ...] = ()
    beside: int = 0

    @property
    def halo(self) -> int:
        """That of the whole work as one leg."""
        runs = (sum(track.rates) * reach for track, reach in zip(self.tracks, self.reaches, strict=True))
        return self.beside + max(runs) + sum(self.passes)

    @property
    def one(self) -> Leg:
        """The whole work as one leg."""
        return self.cut(self.halo)[0]

    def cut(self, most: float) -> tuple[Leg, ...]:
        """Legs whose halo is at most ``most``, where a single step or pass does not reach further.

        :param most: samples.
        """
        legs, current = [], _Open(self.beside, len(self.tracks))
        for number, at, reach, cost in self._pieces():
            longer = current.with_(number, at, reach, cost)
            if longer.halo > most and reach and current.stretches:
                legs.append(current.leg)
                longer = _Open(self.beside, len(self.tracks)).with_(number, at, reach, cost)
            current = longer
        return self._closed((*legs, current.leg))

    def _closed(self, legs: tuple[Leg, ...]) -> tuple[Leg, ...]:
        """Legs that know what is held between them, and which one is the last."""
        arrays = 1 + any(track.kept for track in self.tracks) + 2 * (len(self.tracks) > 1)
        held = arrays if len(legs) > 1 else 0
        return tuple(replace(leg, held=held, ends=number == len(legs)) for number, leg in enumerate(legs, 1))

    def cheapest(self, sides: Sides, shape: Sequence[int]) -> tuple[Leg, ...]:
        """The legs by which windows have the least to compute.

        :param sides: of the windows of a leg that fit into memory.
        :param shape: of the grid.
        :raises InputError: where none fits; the least memory that works is named.
        """
        best, refusal, tried, count = None, None, set[int](), 1
        while count <= MOST_LEGS:
            legs = self.cut(self.beside + (self.halo - self.beside) / count)
            count *= 2
            if len(legs) in tried:
                continue
            tried.add(len(legs))
            try:
                price = sum(_price(leg, sides(leg), shape) for leg in legs)
            except InputError as why:
                refusal = why
                continue
            if best is None or price < best[0]:
                best = price, legs
        if best is None:
            raise refusal or InputError("memory: no window fits")
        return best[1]

    def names_after(self, leg: Leg) -> tuple[str, ...]:
        """The names of the arrays of the state after a leg that is not the last one (:func:`.stretches.advanced`)."""
        last, runs = leg.stretches[-1], len(self.tracks)
        if last.number == runs or (runs == 1 and last.end == len(self.tracks[0].lengths)):
            return ("u",)
        before = {0: (), 1: ("first",)}.get(last.number, ("first", "total"))
        track = self.tracks[last.number]
        if last.end < len(track.lengths):
            return ("u", *(("kept",) if 0 < track.kept <= last.end else ()), *before)
        return ("u",) if last.number + 1 == runs else ("first",) if last.number == 0 else ("first", "total")

    def _pieces(self) -> Iterator[tuple[int, int, int, float]]:
        """All steps and passes: the number of the run, that of the step in it, how far it reaches, and what it costs.

        A run without steps is one piece, whose number is -1.
        """
        for number, (track, reach) in enumerate(zip(self.tracks, self.reaches, strict=True)):
            if not track.rates:
                yield number, -1, 0, 0.0
            for at, rates in enumerate(track.rates):
                yield number, at, rates * reach, float(rates)
        for at, reach in enumerate(self.passes):
            yield len(self.tracks), at, reach, PASS


@dataclass(frozen=True)
class _Open:
    """A leg to which pieces are added.

    :ivar beside: see :class:`Legs`; ``runs``: the number of runs.
    :ivar reach: of the present run; ``widest``: of those before; ``passed``: of the second stage.
    """

    beside: int
    runs: int
    stretches: tuple[Stretch, ...] = ()
    widest: int = 0
    reach: int = 0
    passed: int = 0
    work: float = 0.0

    def with_(self, number: int, at: int, reach: int, cost: float) -> "_Open":
        """The leg with one more piece."""
        last = self.stretches[-1] if self.stretches else None
        if last is not None and last.number == number:
            stretches = (*self.stretches[:-1], Stretch(number, last.begin, at + 1))
        else:
            stretches = (*self.stretches, Stretch(number, max(at, 0), at + 1))
        work = self.work + cost
        if number == self.runs:
            return replace(self, stretches=stretches, passed=self.passed + reach, work=work)
        # Each run begins with the data, so that the reaches of several do not add up.
        run = reach if last is None or last.number != number else self.reach + reach
        return replace(self, stretches=stretches, widest=max(self.widest, run), reach=run, work=work)

    @property
    def halo(self) -> int:
        """How many samples around a window decide what it becomes."""
        return self.beside + self.widest + self.passed

    @property
    def leg(self) -> Leg:
        """The leg as it is."""
        return Leg(self.stretches, self.halo, self.work)


def _price(leg: Leg, sides: Sequence[int], shape: Sequence[int]) -> float:
    """What a leg costs for each sample, in rates."""
    wide = prod(min(side + 2 * leg.halo, size) / min(side, size) for side, size in zip(sides, shape, strict=True))
    return wide * (leg.work + BETWEEN)
