"""Checks of input arrays and numbers."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshflow.errors import InputError, NothingThere

Array = NDArray[Any]
Spacing = tuple[Array | float, float]
# The fourth power of this number still fits into double precision.
LARGEST = 1e75
# Points whose extent suffices to say that those of all is large enough.
MANY = 1000

__all__ = [
    "NOWHERE",
    "Array",
    "Spacing",
    "brief",
    "false_on",
    "indices_of",
    "mask_of",
    "missing_among",
    "must_be_truth",
    "must_be_vertices",
    "must_be_real",
    "must_have_areas",
    "must_have_squares",
    "noise_of_samples",
    "nowhere",
    "number",
    "positive",
    "real",
    "samples",
    "shown",
    "slim",
    "spacing_of",
    "triangles_of",
    "truth_of",
    "whole",
]


def shown(value: object) -> str:
    """A value that came, for a message: text as text, an array by its shape, and no long lists of numbers."""
    if isinstance(value, str):
        return f"the text {value!r:.60}"
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return f"an array {shape}"
    words = " ".join(repr(value).split())
    return words if len(words) <= 80 else f"{words[:77]}..."


def real(values: ArrayLike, name: str) -> Array:
    """An array of float32 or float64 in native byte order; integers become the float type that holds them.

    Integers of up to 16 bit become float32, others float64. Arrays are copied only if necessary; the input is not changed.

    :raises InputError: for complex numbers, objects, text, or an empty array.
    """
    array = np.asarray(values)
    must_be_real(array, name)
    if array.size == 0:
        raise InputError(f"{name}: nothing to smooth or to draw, the array of shape {array.shape} is empty")
    if array.dtype.kind == "f":
        kind = np.float32 if array.dtype.itemsize <= 4 else np.float64
    else:
        kind = np.float32 if array.dtype.itemsize <= 2 else np.float64
    return array.astype(kind, copy=False)


def must_be_real(array: Array, name: str) -> None:
    """Refuse complex numbers, objects, text and dates.

    :raises InputError: with the way out.
    """
    if array.dtype.kind not in "fiub":
        way = "; take the real part" if array.dtype.kind == "c" else "; convert it first: array.astype(float)"
        raise InputError(f"{name}: real numbers expected, got dtype {array.dtype}{way}")


def must_have_squares(values: Array, name: str) -> None:
    """Refuse numbers whose squares, which occur in lengths and areas, do not fit into double precision.

    A few of them, which mark something, are no reason.

    :raises InputError: with their size.
    """
    if (
        values.dtype != np.float64
        or not max(-np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)) > LARGEST
    ):
        return
    typical = float(np.median(np.abs(values[np.isfinite(values)]))) if np.isfinite(values).any() else 0.0
    if typical > LARGEST:
        raise InputError(
            f"{name}: numbers up to {LARGEST:g} expected, got {typical:.3g} as a typical one; scale the data"
        )


def must_have_areas(points: Array, name: str) -> None:
    """Refuse points so close together that the areas between them, and the squares of these, are zero in double precision.

    Points at one place are no reason.

    :param points: (n, d), finite.
    :raises InputError: with their size.
    """
    size = 0.0
    for some in (points[:MANY], points):
        size = float(np.ptp(some, axis=0).max(initial=0.0)) if len(some) else 0.0
        if size >= 1.0 / LARGEST:
            return
    if size > 0.0:
        raise InputError(f"{name}: a size of {1.0 / LARGEST:g} or more expected, got {size:.3g}; scale the data")


def missing_among(values: ArrayLike, array: Array, missing: ArrayLike | None, axes: int) -> Array:
    """The mask of missing samples: masked (numpy.ma), NaN or infinite in any channel, or marked in ``missing``.

    :param values: as given; ``array``: their numbers, whose first ``axes`` axes are those of the samples, channels after them.
    :raises InputError: for a mask of another shape.
    """
    gone = np.asarray(~np.isfinite(array))
    if isinstance(values, np.ma.MaskedArray):
        gone |= np.ma.getmaskarray(values)
    gone = gone if gone.ndim == axes else np.asarray(gone.any(axis=axes))
    gone |= mask_of(missing, gone.shape, "missing")
    return gone


def samples(values: ArrayLike, missing: ArrayLike | None, ndim: tuple[int, ...], name: str) -> tuple[Array, Array]:
    """Values of a grid and the mask (h, w) of missing samples.

    Samples are missing if they are masked (numpy.ma), NaN or infinite in any channel, or marked in ``missing``.

    :raises InputError: for a grid of fewer than 2 x 2 samples, of wrong dimension, or without any sample that is present.
    """
    array = real(np.ma.getdata(values), name)
    if array.ndim not in ndim:
        raise InputError(
            f"{name}: an array of {' or '.join(map(str, ndim))} dimensions expected, got shape {array.shape}"
        )
    if array.ndim == 3 and array.shape[2] == 0:
        raise InputError(f"{name}: at least one channel expected, got shape {array.shape}")
    if min(array.shape[:2]) < 2:
        raise InputError(f"{name}: at least 2 x 2 samples are needed to span a triangle, got {array.shape}")
    must_have_squares(array, name)
    gone = missing_among(values, array, missing, 2)
    if gone.all():
        raise NothingThere(
            f"{name}: all {gone.size} samples are missing (NaN, infinite or masked); nothing to smooth or to draw"
        )
    return array, slim(gone)


def brief(data: object, values: Array, missing: Array | None, *words: str) -> str:
    """One line on a data object on a grid, with its size."""
    h, w, *channels = values.shape
    size = f"{w} x {h}{''.join(f' x {k}' for k in channels)} {values.dtype}"
    gone = 0 if missing is None else int(missing.sum())
    return f"{type(data).__name__}({', '.join(filter(None, (size, *words, f'{gone} missing')))})"


def indices_of(faces: Array) -> Array:
    """Triangles (m, 3) as int32, contiguous: half the memory of int64; no mesh has 2^31 / 3 triangles.

    :raises InputError: for numbers that int32 cannot hold.
    """
    faces = np.asarray(faces)
    if faces.dtype != np.int32 and faces.size and (faces.min() < 0 or faces.max() > np.iinfo(np.int32).max):
        raise InputError(f"faces: numbers of vertices expected, got {faces.min()} to {faces.max()}")
    return np.ascontiguousarray(faces, np.int32)


def must_be_truth(value: object, name: str, optional: bool = False) -> None:
    """Refuse anything but True and False.

    :param optional: None is possible, too; for the message.
    :raises InputError: with the value.
    """
    if not isinstance(value, (bool, np.bool_)):
        words = "True, False or None" if optional else "True or False"
        raise InputError(f"{name}: {words} expected, got {shown(value)}")


def triangles_of(faces: ArrayLike) -> Array:
    """Triangles (m, 3) as integers; whole numbers of floating point become int64.

    :raises InputError: for another shape, and for anything but whole numbers.
    """
    array = np.asarray(faces)
    if array.size == 0:
        return np.zeros((0, 3), np.int64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"faces: triangles of shape (m, 3) expected, got {array.shape}; triangulate polygons first")
    if array.dtype.kind in "iu":
        return array
    if array.dtype.kind != "f":
        raise InputError(f"faces: whole numbers expected, got dtype {array.dtype}")
    whole = np.isfinite(array) & (np.abs(array) < 2.0**53) & (array == np.rint(array))
    if not whole.all():
        raise InputError(f"faces: whole numbers expected, got {array[~whole].flat[0]:g} ({array.dtype})")
    return array.astype(np.int64)


def must_be_vertices(faces: Array, n: int) -> None:
    """Refuse triangles of other vertices than 0 to n - 1.

    :raises InputError: with the first number that is none of them.
    """
    if not faces.size:
        return
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= n:
        ones = "; they count from 1, as in an OBJ: give faces - 1" if low > 0 and high == n else ""
        raise InputError(f"faces: vertices 0 to {n - 1} expected, got {low if low < 0 else high}{ones}")


# A mask that is false everywhere, for any shape.
NOWHERE: Array = np.zeros(0, bool)


def nowhere(mask: Array | None = None) -> Array:
    """The mask, or :data:`NOWHERE` for None: the default of fields that hold masks."""
    return NOWHERE if mask is None else mask


def false_on(shape: tuple[int, ...]) -> Array:
    """A mask that is false everywhere, read-only; it takes no memory."""
    return np.broadcast_to(np.False_, shape)


def slim(mask: Array) -> Array:
    """The same mask, in no memory where it is false everywhere."""
    return mask if mask.any() else false_on(mask.shape)


def mask_of(mask: ArrayLike | None, shape: tuple[int, ...], name: str) -> Array:
    """A boolean mask of a given shape; numbers are true where they are not zero. :data:`NOWHERE` and None are false everywhere.

    :raises InputError: when the shape or the type does not fit.
    """
    if mask is None or mask is NOWHERE:
        return false_on(shape)
    array = np.asarray(mask)
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name}: a mask of booleans, or of numbers, expected, got dtype {array.dtype}")
    if array.shape != shape:
        raise InputError(f"{name}: a mask of shape {shape} expected, got {array.shape}")
    return truth_of(array)


def truth_of(values: Array) -> Array:
    """Numbers as a mask: true where they are not zero and not NaN. Files have no booleans, so this holds for every mask."""
    return values if values.dtype == bool else np.nan_to_num(values) != 0


def noise_of_samples(sigma: ArrayLike, missing: Array, of: str) -> Array | float:
    """The noise of samples (h, w), or one number for all.

    :param missing: (h, w).
    :param of: what the samples are, in the plural.
    :raises InputError: for another shape, or noise that is not above zero where a sample is.
    """
    if isinstance(sigma, (int, float)) or np.ndim(sigma) == 0:
        return positive(float(np.asarray(sigma)), "sigma", f"the unit of the {of}")
    sigma, (h, w) = real(sigma, "sigma"), missing.shape
    if sigma.shape != missing.shape or not (sigma[~missing] > 0).all():
        raise InputError(
            f"sigma: a positive number or one for each of {w} x {h} {of} expected, got shape {sigma.shape}"
        )
    return sigma


def positive(value: float, name: str, unit: str = "") -> float:
    """A positive finite number.

    :raises InputError: otherwise, and for text, truth values and arrays.
    """
    found = _plain(value)
    if found is None or not (np.isfinite(found) and found > 0):
        raise InputError(
            f"{name}: a positive finite number{' of ' + unit if unit else ''} expected, got {shown(value)}"
        )
    return found


def number(value: Any, name: str) -> float:
    """A finite number.

    :raises InputError: otherwise, and for text, truth values and arrays.
    """
    found = _plain(value)
    if found is None or not np.isfinite(found):
        raise InputError(f"{name}: a finite number expected, got {shown(value)}")
    return found


def whole(value: Any, name: str, least: int) -> int:
    """A whole number of at least ``least``.

    :raises InputError: otherwise, and for text, truth values and arrays.
    """
    found = _plain(value)
    if found is None or not np.isfinite(found) or found != int(found) or found < least:
        raise InputError(f"{name}: a whole number, {least} or more, expected, got {shown(value)}")
    return int(value)


def _plain(value: Any) -> float | None:
    """One number as a float; None for text, a truth value, an array, and anything else that is no number."""
    if isinstance(value, (str, bytes, bool, np.bool_)) or np.ndim(value) != 0:
        return None
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def spacing_of(spacing: Any, rows: int) -> Spacing:
    """(dx, dy) with dx a number or one per row; a single number is both.

    :raises InputError: otherwise.
    """
    if isinstance(spacing, np.ndarray) and spacing.shape == (2,):
        spacing = tuple(spacing)
    pair = spacing if isinstance(spacing, (tuple, list)) else (spacing, spacing)
    if len(pair) != 2:
        raise InputError(f"spacing: one number or a pair (dx, dy) expected, got {shown(spacing)}")
    one = not isinstance(spacing, (tuple, list))
    dy = _length(pair[1], "spacing" if one else "spacing dy")
    if np.ndim(pair[0]) == 0:
        return _length(pair[0], "spacing dx"), dy
    widths = np.asarray(pair[0], dtype=np.float64)
    if widths.shape != (rows,) or not ((widths >= 1.0 / LARGEST) & (widths <= LARGEST)).all():
        raise InputError(
            f"spacing dx: a positive number or {rows} of them, one per row, expected; got shape {widths.shape}"
        )
    return widths, dy


def _length(value: Any, name: str) -> float:
    """A positive number whose fourth power, which occurs in squared areas, is a number of double precision."""
    found = positive(value, name)
    if not 1.0 / LARGEST <= found <= LARGEST:
        raise InputError(
            f"{name}: a length from {1.0 / LARGEST:g} to {LARGEST:g} expected, got {found:g}; scale the data"
        )
    return found
