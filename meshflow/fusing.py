"""Several depth frames of the same view, fused and smoothed as one weighted problem."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from meshflow.errors import InputError, NothingThere, warn
from meshflow.estimate.frames import Averaged, averaged
from meshflow.estimate.parameters import Parameter
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import Array, shown
from meshflow.io.metadata import ReadOptions
from meshflow.io.objects import Imported, taken_in
from meshflow.results.inverse_depths import smoothed_in_disparity
from meshflow.results.keywords import must_be_keywords
from meshflow.results.result import Result
from meshflow.smoothing import Metadata, smooth, smooth_object
from meshflow.surfaces.range_image import RangeImage

__all__ = ["fuse", "fuse_frames"]

SPREAD = "spread of the frames"
# The noise of pixels is alike where the quantiles ENDS of their spreads, over that of their depth, differ by no more than ALIKE
# times what chance makes of frames. CLASSES: of depth.
ENDS, ALIKE, CLASSES = (0.02, 0.98), 1.5, 12


def fuse(frames: Iterable[Any], *, result: bool = False, progress: Progress = None, **options: Any) -> Any:
    """Fuse depth frames of the same view into their mean, and smooth it.

    The data is the mean of each pixel over the frames that have it. If the frames differ at some pixels more than at others, the
    noise of a pixel is the standard deviation over its frames divided by the square root of their number: pixels that flicker or
    were seen once are smoothed more than pixels on which all frames agree. If all differ alike, the noise is that of the mean.

    Example:

        >>> import numpy as np
        >>> from meshflow import Pinhole
        >>> camera = Pinhole(fx=50, fy=50, cx=23.5, cy=17.5)
        >>> draw = np.random.default_rng(0)
        >>> frames = [2 + 0.01 * draw.normal(size=(36, 48)) for _ in range(4)]  # a wall, 2 m away
        >>> bool(np.std(fuse(frames, camera=camera)) < 0.005)
        True

    :param frames: two or more depth images that :func:`smooth` takes: arrays (h, w) with ``camera=``, range images, depth images
        of open3d. The result is of the kind of the first. A generator is read frame by frame. None, and frames without any
        depth, are left out; a warning of the :class:`Result` says so.
    :param result: return a :class:`Result`.
    :param progress: as in :func:`smooth`.
    :param options: those of :func:`smooth`.
    :raises InputError: for fewer than two frames with depths, frames of different sizes, or data that is no depth image.
    """
    must_be_keywords(options, tuple(smooth.__kwdefaults__ or {}))
    metadata = {name: options.pop(name) for name in list(options) if name in Metadata.__annotations__}
    back, found = fuse_frames(frames, Request.of(**options), progress, metadata=metadata)
    if not result:
        warn(found.warnings)
    return found if result else back


def fuse_frames(
    frames: Iterable[Any], request: Request, progress: Progress = None, *, metadata: Mapping[str, Any] | None = None
) -> tuple[Any, Result]:
    """:func:`fuse` for a request object; returns the smoothed depths and the result."""
    if isinstance(frames, np.ndarray) and frames.ndim == 2:
        raise InputError("frames: two or more depth images expected, got one array; give a list of them")
    seen = _Seen(frames, dict(metadata or {}))
    one = averaged(seen)
    imported, first = seen.first
    gone = one.count == 0
    sigma = np.where(gone, 1.0, np.maximum(one.sigma, np.finfo(np.float32).tiny))
    depth = np.where(gone, 0.0, one.mean).astype(first.depth.dtype)
    mean = replace(first, depth=depth, missing=gone)
    # Frames that agree to the bit say nothing of their noise; where pixels are alike, their mean says it better than the spread.
    still = bool((one.sigma[~gone] == 0).all())
    still = still or (smoothed_in_disparity(mean, request) and _alike(mean, sigma, float(np.median(one.count[~gone]))))
    mean = mean if still else replace(mean, sigma=sigma)
    _, found = smooth_object(mean, request, progress)
    if not isinstance(found, Result):
        raise InputError("frames: depth images expected, each of one view")
    back = imported.to_object(replace(found.after, sigma=first.sigma))
    spread = not still and request.noise is None
    return back, _reported(
        replace(found, data=back, warnings=(*_of_moved(one), *seen.warnings, *imported.notes, *found.warnings)),
        one,
        spread,
    )


def _alike(mean: RangeImage, sigma: Array, frames: float) -> bool:
    """Whether the noise of pixels of one depth differs by chance alone.

    :param sigma: (h, w), the spread of each pixel over some frames.
    """
    from scipy.stats import chi2

    there = ~mean.missing
    depth, spread = mean.depth[there].astype(np.float64), sigma[there].astype(np.float64)
    parts = np.array_split(np.argsort(depth, kind="stable"), max(1, min(CLASSES, depth.size // 50)))
    at, typical = (np.array([np.median(values[part]) for part in parts]) for values in (depth, spread))
    low, high = np.quantile(spread / np.interp(depth, at, typical), ENDS)
    free = max(1.0, frames - 1.0)
    return bool(high <= ALIKE * np.sqrt(chi2.ppf(ENDS[1], free) / chi2.ppf(ENDS[0], free)) * low)


@dataclass(eq=False)
class _Seen:
    """Iterates over frames as depths (h, w), NaN where missing, and records which of them were empty.

    :ivar taken: the first frame that has depths; ``empty``: the numbers, from 1, of the frames without depths.
    """

    frames: Iterable[Any]
    metadata: dict[str, Any]
    taken: tuple[Imported, RangeImage] | None = None
    empty: list[int] = field(default_factory=list)

    def __iter__(self) -> Iterator[Array]:
        used = 0
        if not isinstance(self.frames, Iterable):
            raise InputError(f"frames: two or more of the same view, in a list, expected, got {shown(self.frames)}")
        for number, frame in enumerate(self.frames, 1):
            try:
                taken = None if frame is None else self._depths(frame)
            except NothingThere:
                taken = None
            if taken is None:
                self.empty.append(number)
                continue
            self.taken, used = self.taken or taken, used + 1
            image = taken[1]
            yield np.where(image.missing, np.nan, image.depth)
        if used < 2:
            raise InputError(f"frames: two or more with depths, of the same view, expected, got {used}{self._left_out}")

    @property
    def first(self) -> tuple[Imported, RangeImage]:
        """The first frame that has depths, as an object and as a range image.

        :raises InputError: where there is none.
        """
        if self.taken is None:
            raise InputError("frames: two or more with depths, of the same view, expected, got none")
        return self.taken

    def _depths(self, frame: Any) -> tuple[Imported, RangeImage]:
        kind = {} if isinstance(frame, RangeImage) else {"kind": "depth"}
        taken = taken_in(frame, ReadOptions.of({**kind, **self.metadata}))
        if not isinstance(taken.data, RangeImage):
            raise InputError(f"frames: depth images expected, got {type(frame).__name__}")
        return taken, taken.data

    @property
    def _left_out(self) -> str:
        return f", and {len(self.empty)} without a single depth" if self.empty else ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning that names the frames that were left out."""
        if not self.empty:
            return ()
        some = ", ".join(map(str, self.empty[:5])) + (", ..." if len(self.empty) > 5 else "")
        return (f"{len(self.empty)} of the frames (number {some}) without a single depth, left out",)


def _of_moved(one: Averaged) -> tuple[str, ...]:
    """A warning about the frames of a view that has moved."""
    if not one.moved:
        return ()
    some = ", ".join(map(str, one.moved[:5])) + (", ..." if len(one.moved) > 5 else "")
    return (
        f"{len(one.moved)} of the frames (number {some}) differ from the first by more than a quarter of their noise: the "
        "camera or the scene has moved; they were left out",
    )


def _reported(found: Result, one: Averaged, spread: bool) -> Result:
    """The result with the frames among its parameters, and the noise marked as measured where the frames differ."""
    seen = one.count > 0
    parameters = dict(found.parameters)
    each = f"{float(one.count[seen].mean()):.3g} of them at a pixel in the mean"
    parameters["frames"] = Parameter(float(one.count.max()), "", "given", each)
    noise = found.noise
    if spread:
        parameters["noise"] = replace(parameters["noise"], origin="estimated", why=SPREAD)
        noise = replace(noise, how=SPREAD)
    return replace(found, parameters=parameters, noise=noise)
