"""Values that mark missing samples without being declared in the file: -9999, -3.4e38 and the like."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["Mark", "mark_in", "may_mark"]

# Values that programs write where nothing was measured, and a bound above which there are no measurements.
_USUAL = (
    -9999.0, -99999.0, -999999.0, -9999999.0, -32768.0, -32767.0, 32767.0, -999.0, -2147483648.0, 9999.0, 99999.0, 999999.0,
    1e20, -1e20,
)  # fmt: skip
_BEYOND = 1e30
# The least number of marked samples, and the least distance to all other samples, as a multiple of their range.
_OFTEN, _FAR = 2, 1.0


@dataclass(frozen=True)
class Mark:
    """A value that marks missing samples.

    :param value: as it is stored.
    :param count: the number of samples with it.
    :param others: the minimum and maximum of all other samples.
    """

    value: float
    count: int
    others: tuple[float, float]

    @property
    def sentence(self) -> str:
        """A sentence for the user."""
        low, high = self.others
        return (
            f"{self.count} samples are {self.value:.9g}, far from all others ({low:.6g} to {high:.6g}), and nothing declares it: "
            f"taken as missing (nodata={self.value:.9g} declares it; nodata=nan takes it as data)"
        )


def mark_in(values: Array, gone: Array) -> Mark | None:
    """The undeclared value, the minimum or maximum, that marks missing samples; None if there is none.

    It is beyond 1e30 in absolute value, or it is a usual one of programs, occurs more than once, and is further from all other
    samples than the width of their range.

    :param values: as they are stored, any shape.
    :param gone: of the same shape, samples that are known to be missing.
    """
    known = ~gone & np.isfinite(values)
    if not known.any():
        return None
    there = values[known]
    for end in (there.min(), there.max()):
        if not may_mark(float(end), values.dtype):
            continue
        beyond = abs(float(end)) >= _BEYOND
        at_end = there == end
        rest, count = there[~at_end], int(at_end.sum())
        if not rest.size:
            continue
        low, high = float(rest.min()), float(rest.max())
        gap = low - float(end) if end < rest[0] else float(end) - high
        if beyond or (count >= _OFTEN and gap > _FAR * (high - low)):
            return Mark(float(end), count, (low, high))
    return None


def may_mark(end: float, dtype: np.dtype) -> bool:
    """Whether the least or the greatest value is one that programs write where nothing was measured.

    :param dtype: in which it is stored.
    """
    return abs(end) >= _BEYOND or any(end == float(dtype.type(word)) for word in _USUAL if _holds(dtype, word))


def _holds(dtype: np.dtype, word: float) -> bool:
    if dtype.kind == "f":
        return True
    return bool(np.iinfo(dtype).min <= word <= np.iinfo(dtype).max)
