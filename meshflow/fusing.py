"""Depth frames of a view that stays, as one weighted problem."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from meshflow.errors import InputError, NothingThere
from meshflow.estimate.frames import Averaged, averaged
from meshflow.estimate.parameters import Parameter
from meshflow.geometry.validation import Array
from meshflow.io.metadata import ReadOptions
from meshflow.io.objects import Adopted, taken_in
from meshflow.results.result import Result
from meshflow.smoothing import HINTS, smooth
from meshflow.surfaces.range_image import RangeImage

__all__ = ["fuse"]

SPREAD = "spread of the frames"


def fuse(frames: Iterable[Any], *, full: bool = False, **options: Any) -> Any:
    """Smooth the mean of depth frames of a view that stays, each pixel by how far it can be trusted.

    Data is the mean of each pixel over the frames that have it; its noise is the spread of those over the root of their number,
    and sets how far the pixel is smoothed: what flickers, or was seen once, more than what all frames agree on.

    :param frames: two or more of what :func:`smooth` takes as depths: arrays (h, w) with ``camera=``, range images, depth images
        of open3d; the result is of the kind of the first. A generator is read one by one. A frame without a single depth, and
        None in its place, is left out, and the :class:`Result` says so.
    :param full: return a :class:`Result`.
    :param options: of :func:`smooth`.
    :raises InputError: for fewer than two frames that have depths, other sizes, or things that are no depths.
    """
    hints = {name: options.pop(name) for name in list(options) if name in HINTS}
    seen = _Seen(frames, hints)
    one = averaged(seen)
    assert seen.first is not None
    first, told = seen.first.noun, seen.first
    assert isinstance(first, RangeImage)
    gone = one.count == 0
    sigma = np.where(gone, 1.0, np.maximum(one.sigma, np.finfo(np.float32).tiny))
    depth = np.where(gone, 0.0, one.mean).astype(first.depth.dtype)
    still = bool((one.sigma[~gone] == 0).all())
    noun = replace(first, depth=depth, missing=gone, sigma=None if still else sigma)
    found: Result = smooth(noun, full=True, **options)
    back = told.to_object(replace(found.noun, sigma=first.sigma))
    if not full:
        return back
    spread = not still and options.get("sigma") is None
    return _told(replace(found, thing=back, warnings=(*seen.warnings, *told.notes, *found.warnings)), one, spread)


@dataclass(eq=False)
class _Seen:
    """Frames as depths (h, w), NaN where missing, read one by one; what was seen of them on the way.

    :ivar first: of those that have depths; ``empty``: the numbers, from 1, of those that have none.
    """

    frames: Iterable[Any]
    hints: dict[str, Any]
    first: Adopted | None = None
    empty: list[int] = field(default_factory=list)

    def __iter__(self) -> Iterator[Array]:
        used = 0
        for number, frame in enumerate(self.frames, 1):
            try:
                taken = None if frame is None else self._taken(frame)
            except NothingThere:
                taken = None
            if taken is None:
                self.empty.append(number)
                continue
            self.first, used = self.first or taken, used + 1
            assert isinstance(taken.noun, RangeImage)
            yield np.where(taken.noun.missing, np.nan, taken.noun.depth)
        if used < 2:
            raise InputError(f"frames: two or more with depths, of the same view, expected, got {used}{self._left_out}")

    def _taken(self, frame: Any) -> Adopted:
        taken = taken_in(
            frame, ReadOptions.of({**({} if isinstance(frame, RangeImage) else {"kind": "depth"}), **self.hints})
        )
        if not isinstance(taken.noun, RangeImage):
            raise InputError(f"frames: depth images expected, got {type(frame).__name__}")
        return taken

    @property
    def _left_out(self) -> str:
        return f", and {len(self.empty)} without a single depth" if self.empty else ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """A word on the frames that were left out."""
        if not self.empty:
            return ()
        some = ", ".join(map(str, self.empty[:5])) + (", ..." if len(self.empty) > 5 else "")
        return (f"{len(self.empty)} of the frames (number {some}) without a single depth, left out",)


def _told(found: Result, one: Averaged, spread: bool) -> Result:
    """With the frames among the parameters, and the noise as what it is: measured, where the frames differ."""
    seen = one.count > 0
    parameters = dict(found.parameters)
    each = f"{float(one.count[seen].mean()):.3g} of them at a pixel in the mean"
    parameters["frames"] = Parameter(float(one.count.max()), "", "given", each)
    noise = found.noise
    if spread:
        parameters["sigma"] = replace(parameters["sigma"], origin="estimated", why=SPREAD)
        noise = None if noise is None else replace(noise, how=SPREAD)
    return replace(found, parameters=parameters, noise=noise)
