"""The states of a flow, kept within a memory limit and computed again beyond it, and their measurements."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry import operator
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, array_of, on_surface
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view.pair import paired

__all__ = ["MEMORY", "Measurement", "Timeline", "recorded"]

MEMORY = 1 << 30  # bytes of states that are kept


@dataclass(frozen=True)
class Measurement:
    """The measurements of a state.

    :ivar time: squared length.
    :ivar area: of the surface, as a share of that at the start.
    :ivar change: root mean square of what was removed, unit of the values, per channel; for points along their normals.
    :ivar residual: the change as a share of the noise; NaN where none was found.
    """

    time: float
    area: float
    change: float
    residual: float


@dataclass(frozen=True, eq=False)
class Timeline:
    """The states of a flow.

    :ivar history: of each state, the start first.
    :ivar unit: of time.
    """

    history: tuple[Measurement, ...]
    unit: str
    _kept: dict[int, Data] = field(repr=False)
    _again: Callable[[float], Data] = field(repr=False)

    def __len__(self) -> int:
        """The number of states."""
        return len(self.history)

    def at(self, index: int) -> Data:
        """A state: from memory, or computed again."""
        if not 0 <= index < len(self):
            raise InputError(f"state {index}: 0 to {len(self) - 1} expected")
        return self._kept[index] if index in self._kept else self._again(self.history[index].time)

    @property
    def kept(self) -> tuple[int, ...]:
        """The states in memory."""
        return tuple(sorted(self._kept))


def recorded(
    states: Iterable[tuple[float, Data]],
    again: Callable[[float], Data],
    sigma: float,
    unit: str = "",
    memory: int = MEMORY,
) -> Timeline:
    """Measure states one by one, and keep as many as fit in memory.

    Where they do not all fit, every other state is dropped, repeatedly; the first and the last are kept.

    :param states: times and data objects, the start first; data objects share arrays that do not change.
    :param again: computes the state at a time, for dropped states.
    :param sigma: the noise, in the unit of the values; 0: not known.
    :param memory: bytes.
    :raises InputError: where there is no state.
    """
    history: list[Measurement] = []
    kept: dict[int, Data] = {}
    stride, last = 1, -1
    first: Data | None = None
    whole = 0.0
    for index, (time, data) in enumerate(states):
        if first is None:
            first, whole = data, _area(data)
        change = _change(first, data)
        residual = change / sigma if sigma > 0 else float("nan")
        history.append(Measurement(time, _area(data) / whole if whole > 0 else 1.0, change, residual))
        if last > 0 and last % stride:
            del kept[last]
        kept[index], last = data, index
        while len(kept) > 2 and sum(map(_bytes, kept.values())) > memory:
            stride *= 2
            for k in [k for k in kept if k % stride and k != index]:
                del kept[k]
            if stride > index:
                break
    if not history:
        raise InputError("states: those of a flow expected, got none")
    return Timeline(tuple(history), unit, kept, again)


def _bytes(data: Data) -> int:
    extra = data.points.nbytes if isinstance(data, Mesh) and data.channels is not None else 0
    return array_of(data).nbytes + extra


def _area(data: Data) -> float:
    surface = on_surface(data, "the area").lifted(Lift(diagonals="forward"))  # each triangle once
    return operator.total_area(surface.points, surface.triangulations[0])


def _change(before: Data, after: Data) -> float:
    """Root mean square of what was removed, as the noise is counted: per channel; of points along their normals."""
    if isinstance(before, Mesh) or isinstance(after, Mesh):
        before, after = cast(Mesh, before), cast(Mesh, after)  # they are of one kind
        if before.moves == "channels" and before.channels is not None and after.channels is not None:
            return _rms(np.square(before.channels.astype(np.float64) - after.channels))
        return _rms(np.square(paired(before, after, None).removed.values))
    missing = before.missing
    if isinstance(before, RangeImage) and isinstance(after, RangeImage):
        squares = np.square(before.depth.astype(np.float64) - after.depth)
    else:
        squares = np.square(array_of(before).astype(np.float64) - array_of(after))
        squares = squares.reshape(*missing.shape, -1).mean(axis=2)
    return _rms(squares[~missing])


def _rms(squares: Array) -> float:
    return float(np.sqrt(squares.mean())) if squares.size else 0.0
