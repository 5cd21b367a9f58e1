"""Rounds floating point to whole numbers, and chooses the value that marks missing samples."""

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.formats.raster_frame import Frame

__all__ = ["DTYPES", "mark", "mark_outside", "rounded"]

DTYPES = ("uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")


def rounded(values: Array, gone: Array, dtype: np.dtype) -> tuple[Array, tuple[str, ...]]:
    """The values in another dtype, rounded and clipped for integers, and a note on clipping; a copy where that changes them.

    :param values: any shape, floating point.
    :param gone: of the same shape: missing samples; where they do not fit they become 0 or the nearest value that fits.
    :param dtype: of up to 32 bits if an integer.
    """
    if dtype.kind == "f":
        return values.astype(dtype, copy=False), ()
    ends = np.iinfo(dtype)
    outside = int(((values < ends.min - 0.5) | (values > ends.max + 0.5))[~gone].sum())
    whole = np.clip(np.rint(np.nan_to_num(values.astype(np.float64))), ends.min, ends.max).astype(dtype)
    if outside:
        return whole, (f"{outside} samples were clipped to {ends.min} to {ends.max}, the range of {dtype}",)
    return whole, ()


def mark(samples: Array, frame: Frame, dtype: np.dtype) -> float | None:
    """A value for missing samples that no other sample has: that of the file, else -9999, else an end of the range, or NaN.

    None where the file declares no such value and nothing is missing, or where an alpha band marks missing samples (GDAL uses
    it for whole numbers only).

    :raises FormatError: when every value is used.
    """
    floating = dtype.kind == "f"
    if frame.nodata is None and (not frame.gone.any() or (frame.alpha is not None and not floating)):
        return None
    for candidate in _candidates(frame.nodata, dtype):
        if candidate is not None and _fits(candidate, dtype):
            value = dtype.type(candidate)
            if not (samples == value)[~frame.gone].any():
                return float(value)
    raise FormatError(
        f"{int(frame.gone.sum())} samples are missing and {dtype} has no value left to mark them; write dtype='float32'"
    )


def mark_outside(declared: float | None, ends: tuple[float, float], dtype: np.dtype) -> float:
    """A value for missing samples of data that is written by parts: that of the file, else the usual ones, where they lie beyond
    the other samples.

    :param declared: by the file.
    :param ends: the least and the greatest sample before they are smoothed.
    :raises FormatError: when there is none.
    """
    low, high = ends
    step = 0.0 if dtype.kind == "f" else 0.5  # samples between whole numbers come to those next to them
    # What the file does not ask for lies far outside if it can: smoothed samples may lie beyond the ends.
    for far in (high - low, step):
        for candidate in _candidates(declared, dtype):
            if candidate is None or not _fits(candidate, dtype):
                continue
            beyond = step if candidate == declared else far
            if not low - beyond <= candidate <= high + beyond:
                return float(dtype.type(candidate))
    raise FormatError(f"samples are missing and {dtype} has no value left to mark them; write dtype='float32'")


def _candidates(declared: float | None, dtype: np.dtype) -> tuple[float | None, ...]:
    """Values that may mark missing samples: of the file, the usual one, and those at the ends of a type."""
    ends = (np.nan,) if dtype.kind == "f" else (float(np.iinfo(dtype).min), float(np.iinfo(dtype).max))
    return (declared, -9999.0, *ends)


def _fits(value: float, dtype: np.dtype) -> bool:
    if dtype.kind == "f":
        return not np.isfinite(value) or abs(value) <= np.finfo(dtype).max
    return bool(np.isfinite(value)) and value == int(value) and np.iinfo(dtype).min <= value <= np.iinfo(dtype).max
