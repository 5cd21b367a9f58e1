"""Depth frames of a view that stays, as one weighted problem."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.frames import averaged
from meshflow.geometry.gates import Array
from meshflow.geometry.ranges import RangeImage
from meshflow.io.adopt import adopt
from meshflow.result import Result
from meshflow.smoothing import HINTS, smooth

__all__ = ["fuse"]


def fuse(frames: Iterable[Any], *, full: bool = False, **options: Any) -> Any:
    """Smooth the mean of depth frames of a view that stays, each pixel by how far it can be trusted.

    Data is the mean of each pixel over the frames that have it; its noise is the spread of those over the root of their number,
    and sets how far the pixel is smoothed: what flickers, or was seen once, more than what all frames agree on.

    :param frames: two or more of what :func:`smooth` takes as depths: arrays (h, w) with ``camera=``, range images, depth images
        of open3d; the result is of the kind of the first. A generator is read one by one.
    :param full: return a :class:`Result`.
    :param options: of :func:`smooth`.
    :raises InputError: for fewer than two frames, other sizes, or things that are no depths.
    """
    hints = {name: options.pop(name) for name in list(options) if name in HINTS}
    first, told = None, None

    def depths() -> Iterable[Array]:
        nonlocal first, told
        for frame in frames:
            taken = adopt(frame, **{**({} if isinstance(frame, RangeImage) else {"kind": "depth"}), **hints})
            if not isinstance(taken.noun, RangeImage):
                raise InputError(f"frames: depth images expected, got {type(frame).__name__}")
            first, told = (first, told) if first is not None else (taken.noun, taken)
            assert taken.noun.missing is not None
            yield np.where(taken.noun.missing, np.nan, taken.noun.depth)

    one = averaged(depths())
    assert first is not None
    assert told is not None
    gone = one.count == 0
    sigma = np.where(gone, 1.0, np.maximum(one.sigma, np.finfo(np.float32).tiny))
    depth = np.where(gone, 0.0, one.mean).astype(first.depth.dtype)
    still = bool((one.sigma[~gone] == 0).all())
    noun = replace(first, depth=depth, missing=gone, sigma=None if still else sigma)
    found: Result = smooth(noun, full=True, **options)
    back = told.restore(replace(found.noun, sigma=first.sigma))
    seen = f"{int(one.count.max())} frames, {float(one.count[~gone].mean()):.3g} of them at a pixel in the mean"
    return replace(found, thing=back, warnings=(seen, *found.warnings)) if full else back
