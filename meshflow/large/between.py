"""The state of a run between two legs, in temporary files beside the output: the legs before the last one run windows into it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.large.legs import Leg
from meshflow.large.source import Window

__all__ = ["Between", "carried"]

# Runs the window of a leg: what it holds then, by name, of the state before it.
Moved = Callable[[Leg, Window, "Between"], dict[str, Array]]


@dataclass(eq=False)
class Between:
    """Arrays of one vector per sample, in files without a name, which vanish with the process whatever ends it.

    What was not written is zero and takes no room, where the file system knows how.

    :ivar folder: where the files lie; ``shape``: of the grid, (h, w) or (d, h, w).
    """

    folder: Path
    shape: tuple[int, ...]
    _stack: ExitStack = field(default_factory=ExitStack)
    _files: dict[str, tuple[BinaryIO, np.dtype, int]] = field(default_factory=dict)

    def write(self, window: Window, held: dict[str, Array]) -> None:
        """Write what a window holds, (r, c, k) or (s, r, c, k) each, by name.

        :raises FormatError: where there is no room.
        """
        for name, array in held.items():
            try:
                if name not in self._files:
                    file = self._stack.enter_context(TemporaryFile(dir=self.folder, prefix=".meshflow-", buffering=0))  # noqa: SIM115 - closed with the others
                    self._files[name] = file, array.dtype, array.shape[-1]
                file, dtype, _ = self._files[name]
                packed = np.ascontiguousarray(array, dtype)
                for begin, part in self._runs(window, packed):
                    _put(file, begin, part.data.cast("B"))
            except OSError as cause:
                raise FormatError(
                    f"{self.folder}: the state between two legs of the run was not written ({cause.strerror or cause}); nothing "
                    "is left of it. Make room, or give more memory (--memory), with which fewer legs are needed"
                ) from cause

    def read(self, window: Window) -> dict[str, Array]:
        """What a window holds, by name."""
        found = {}
        for name, (file, dtype, k) in self._files.items():
            array = np.zeros((*(part.stop - part.start for part in window), k), dtype)
            for begin, part in self._runs(window, array):
                _get(file, begin, part.data.cast("B"))
            found[name] = array
        return found

    def close(self) -> None:
        """Remove the files."""
        self._files.clear()
        self._stack.close()

    def _runs(self, window: Window, array: Array) -> Iterator[tuple[int, Array]]:
        """The parts of an array of a window that lie in one piece of the file, each with the byte where it begins."""
        sizes, axis = array.shape[:-1], len(self.shape) - 1
        while axis > 0 and sizes[axis] == self.shape[axis]:
            axis -= 1
        each = array.itemsize * array.shape[-1]
        for at in np.ndindex(sizes[:axis]):
            place = [part.start + i for part, i in zip(window, at, strict=False)]
            first = [*place, *(part.start for part in window[axis:])]
            begin = sum(one * prod(self.shape[i + 1 :]) for i, one in enumerate(first))
            yield begin * each, array[at]


def carried(
    legs: Sequence[Leg],
    windows: Callable[[Leg], Sequence[Window]],
    moved: Moved,
    between: Between,
    report: Callable[[float], object],
) -> Between:
    """Run all legs but the last one, and return the state before that, which the caller closes; on a failure nothing is left.

    :param windows: of a leg, which cover the grid.
    :param moved: runs one.
    :param between: empty; it says where the files lie.
    :param report: takes the share done, of the work of these legs.
    """
    old, done, work = between, 0.0, sum(leg.work for leg in legs[:-1])
    try:
        for leg in legs[:-1]:
            new, parts = Between(between.folder, between.shape), windows(leg)
            try:
                for window in parts:
                    new.write(window, moved(leg, window, old))
                    done += leg.work / len(parts)
                    report(min(done / max(work, 1.0), 1.0))
            except BaseException:
                new.close()
                raise
            old.close()
            old = new
    except BaseException:
        old.close()
        raise
    return old


def _put(file: BinaryIO, begin: int, data: memoryview) -> None:
    """Write all bytes at a place."""
    file.seek(begin)
    while data:
        data = data[file.write(data) :]


def _get(file: BinaryIO, begin: int, data: memoryview) -> None:
    """Read bytes from a place, up to the end of the file."""
    file.seek(begin)
    while data:
        count = file.readinto(data)  # type: ignore[attr-defined]
        if not count:
            return
        data = data[count:]
