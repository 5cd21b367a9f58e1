"""Parameters found with the truth in hand: a peer, the ranges of what it can be told, and the best of them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array

__all__ = ["Choice", "Peer", "Tuned", "tuned"]

Value = float | str
Choice = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Peer:
    """A denoiser of somebody else.

    :ivar name: as the benchmark prints it.
    :ivar package: the distribution that brings it.
    :ivar run: ``run(z, sigma, **choice)``.
    :ivar grid: the values over which each parameter is searched, numbers ascending, words in any order.
    :ivar ends: ``(parameter, value)`` of first and last numbers beyond which the tool does not go, or nothing changes.
    :ivar channels: whether it takes (h, w, k).
    """

    name: str
    package: str
    run: Callable[..., Array]
    grid: Mapping[str, tuple[Value, ...]]
    ends: frozenset[tuple[str, Value]] = field(default=frozenset())
    channels: bool = True

    def on_the_edge(self, choice: Choice) -> tuple[str, ...]:
        """The parameters of a choice that lie on an end of their range although the tool would go on."""
        return tuple(
            name
            for name, values in self.grid.items()
            if not isinstance(values[0], str)
            and len(values) > 1
            and choice[name] in (values[0], values[-1])
            and (name, choice[name]) not in self.ends
        )


@dataclass(frozen=True, eq=False)
class Tuned:
    """The best that a search over the parameters of a peer came upon.

    :ivar error: the least.
    :ivar choice: the parameters that gave it.
    :ivar result: the values that gave it.
    :ivar edge: parameters that lie on the edge of their range, see :meth:`Peer.on_the_edge`.
    :ivar runs: how many choices were run.
    """

    error: float
    choice: Choice
    result: Array
    edge: tuple[str, ...]
    runs: int


def tuned(peer: Peer, z: Array, sigma: float, error: Callable[[Array], float]) -> Tuned:
    """Search the parameters of a peer with the truth in hand.

    Every second number of each range, and every word, in all combinations; then from the best of those to the best of its
    neighbours (one number or two at a time, by one place each), until none is better.

    :param z: (h, w) or (h, w, k), noisy.
    :param sigma: standard deviation of the noise.
    :param error: of a result, the less the better.
    :raises InputError: for channels where the peer takes none, or no choice with a finite error.
    :raises MissingPackage: when the peer is not installed.
    """
    if z.ndim == 3 and not peer.channels:
        raise InputError(f"{peer.name}: one value per sample expected, got shape {z.shape}")
    errors: dict[tuple[int, ...], float] = {}
    best, kept = np.inf, None

    def ask(places: Iterator[tuple[int, ...]]) -> None:
        nonlocal best, kept
        for place in places:
            if place in errors:
                continue
            result = peer.run(z, sigma, **_choice(peer, place))
            found = error(result)
            errors[place] = found if np.isfinite(found) else np.inf
            if errors[place] < best:
                best, kept = errors[place], (place, result)

    ask(product(*(range(0, len(v), 1 if isinstance(v[0], str) else 2) for v in peer.grid.values())))
    seen = None
    while kept is not None and kept[0] != seen:
        seen = kept[0]
        ask(_neighbours(peer, seen))
    if kept is None:
        raise InputError(f"{peer.name}: no choice of its parameters gave a finite error for shape {z.shape}")
    choice = _choice(peer, kept[0])
    return Tuned(best, choice, kept[1], peer.on_the_edge(choice), len(errors))


def _choice(peer: Peer, place: tuple[int, ...]) -> Choice:
    return {name: values[i] for (name, values), i in zip(peer.grid.items(), place, strict=True)}


def _neighbours(peer: Peer, place: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Places beside one: one or two numbers by one place up or down; words stay."""
    numbers = [(i, len(values)) for i, values in enumerate(peer.grid.values()) if not isinstance(values[0], str)]
    for some in (pair for count in (1, 2) for pair in combinations(numbers, count)):
        for moves in product((-1, 1), repeat=len(some)):
            there = list(place)
            for (i, _), move in zip(some, moves, strict=True):
                there[i] += move
            if all(0 <= there[i] < size for i, size in some):
                yield tuple(there)
