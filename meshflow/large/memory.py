"""How large the windows of a grid may be in a given memory."""

import os
import re
from dataclasses import dataclass
from math import isqrt
from pathlib import Path

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.large.source import Form
from meshflow.surfaces.volume import Volume

__all__ = ["Budget", "Room", "bytes_in", "free_memory", "needed"]

# Bytes of the command for each value of a grid that is smoothed in memory, and of a window, by bytes of a number.
IN_MEMORY, IN_WINDOW = 13.0, 14.0
# The share of the free memory that a run in memory may take.
SHARE = 0.5
# More numbers of a window for each array of a state between two legs.
IN_STATE = 3.0
# Bytes for libraries, and for decoded blocks of a file; and the share of what is then left that a sample may take.
LIBRARIES, OF_SAMPLE = 250e6, 0.5
# Windows are multiples of this many samples, as the tiles of files are; the largest one has this many values.
MULTIPLE, LARGEST = 256, 1 << 25
# A band of whole rows is taken where its halo is a smaller share of it. The least side of a block of a volume.
BANDS, LEAST_BLOCK = 4, 8
_SIZE = re.compile(r"\s*([0-9.]+)\s*([kmgt]?)i?b?\s*", re.IGNORECASE)
# Bytes below which a number was meant in another unit.
LEAST = 1e6
_FACTORS = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


def bytes_in(words: str) -> float:
    """Bytes of a size such as ``2GB``, ``500 MB`` or ``1.5g``.

    :raises InputError: for other words.
    """
    found = _SIZE.fullmatch(words)
    try:
        size = float(found[1]) * _FACTORS[found[2].lower()] if found else 0.0
    except ValueError:
        size = 0.0
    if size <= 0:
        raise InputError(f"memory: a size such as 2GB or 500MB expected, got {words!r}")
    if size < LEAST:
        raise InputError(f"memory: {size:g} bytes are too few; a size such as 2GB or 500MB expected")
    return size


def free_memory() -> float:
    """Bytes of memory that are free; infinite where the system does not say."""
    known = Path("/proc/meminfo")
    if known.exists():
        for line in known.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * float(line.split()[1])
    if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES"))
    return float("inf")


def needed(form: Form) -> float:
    """Bytes that a run in memory takes."""
    return LIBRARIES + IN_MEMORY * form.dtype.itemsize * form.values


@dataclass(frozen=True)
class Budget:
    """The memory that a run by windows may take.

    :ivar memory: bytes of the process.
    """

    memory: float

    @property
    def room(self) -> float:
        """Bytes beside libraries."""
        return max(self.memory - LIBRARIES, 0.0)

    def must_hold(self, form: Form) -> None:
        """Refuse, before anything is read, a memory in which no window fits, however narrow its halo turns out.

        :raises InputError: it names a memory that may do.
        """
        try:
            self.sides(form, 1)
        except InputError as why:
            raise InputError(f"{why}, and more where the halo is wider") from None

    def sample(self, form: Form, most: int) -> int:
        """The number of values of the sample of a grid.

        :param most: more are of no use.
        """
        return min(most, int(OF_SAMPLE * self.room / (IN_MEMORY * form.dtype.itemsize)))

    def counted(self, form: Form) -> int:
        """The number of values that are counted at a time."""
        least = 1 if form.kind is Volume else form.shape[1]
        return max(least, min(1 << 22, int(self.room / (4.0 * form.dtype.itemsize))))

    def sides(self, form: Form, halo: int, held: int = 0) -> tuple[int, ...]:
        """The sides of the windows: bands of whole rows where their halo is a small part of them, else squares.

        Of a volume they are blocks, those of which the samples with all halos are fewest.

        :param held: how many arrays of a state are read or written with each window.
        :raises InputError: where no window with its halo fits; the least memory that works is named.
        """
        each = (IN_WINDOW + IN_STATE * held) * form.dtype.itemsize * (form.channels or 1)
        if form.kind is Volume:
            return self._blocks(form, halo, each)
        (h, w), fits = form.shape, min(int(self.room / each), LARGEST)
        high = fits // w - 2 * halo
        if high >= min(h, max(MULTIPLE, BANDS * halo)):
            return (high // MULTIPLE * MULTIPLE if high < h else h), w
        side = (isqrt(fits) - 2 * halo) // MULTIPLE * MULTIPLE
        if side >= MULTIPLE:
            return side, side
        raise self._too_little(f"a window of {MULTIPLE} samples", halo, each * (MULTIPLE + 2 * halo) ** 2)

    def _blocks(self, form: Form, halo: int, each: float) -> tuple[int, ...]:
        """The sides of the blocks of a volume.

        :param each: bytes of a sample.
        """
        counts = [np.arange(1, max(1, size // LEAST_BLOCK) + 1) for size in form.shape]
        sides = [-(-size // count) for size, count in zip(form.shape, counts, strict=True)]
        wide = [np.minimum(side + 2 * halo, size) for side, size in zip(sides, form.shape, strict=True)]
        samples = _products(wide)
        fits = each * samples <= self.room
        if not fits.any():
            raise self._too_little(f"a block of {LEAST_BLOCK} samples", halo, each * float(samples.min()))
        work = np.where(fits, samples * _products(counts), np.inf)
        best = np.unravel_index(int(np.argmin(work)), work.shape)
        return tuple(int(side[i]) for side, i in zip(sides, best, strict=True))

    def _too_little(self, what: str, halo: int, bytes_: float) -> InputError:
        """The refusal of a memory in which not one window fits."""
        return InputError(
            f"memory of {self.memory / 1e6:.0f} MB: too little for {what} with its halo of {halo}, beside the "
            f"{LIBRARIES / 1e6:.0f} MB of libraries; {np.ceil((LIBRARIES + bytes_) / 1e6):.0f} MB is the least"
        )


@dataclass(frozen=True)
class Room:
    """What a run by windows may take.

    :ivar folder: where its state lies between legs.
    :ivar alone: all is done in one leg.
    :ivar tile: the sides of the tiles of which windows of the last leg hold some whole; None: it has any windows.
    """

    budget: Budget
    folder: Path
    alone: bool = False
    tile: tuple[int, ...] | None = None


def _products(sides: list[Array]) -> Array:
    """The products of one number of each of three lists, as floating point."""
    first, second, third = np.ix_(*sides)
    return first * second.astype(float) * third
