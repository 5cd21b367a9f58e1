"""Range images: depths or ranges of a camera or a scanner, along rays."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from meshflow.errors import InputError, NothingThere
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, brief, mask_of, noise_of_samples, nowhere, positive, samples
from meshflow.surfaces.camera import Camera, Measure
from meshflow.surfaces.discontinuities import Cuts, cuts_by_noise, small_components
from meshflow.surfaces.grid import Grid, Lift, Lines, held
from meshflow.surfaces.surface import Boundary, Surface

__all__ = ["TimeUnit", "RangeImage"]

TimeUnit = Literal["footprint", "length", "noise"]
# The share of the nearest depth that is a jump where the noise is not known.
SHARE = 0.05
# The largest factor between sigma / h of a sample and its median where time follows it; stable steps shorten with the largest.
FASTEST = 6.0


@named_fields
@dataclass(frozen=True, eq=False)
class RangeImage:
    """Depths seen by a camera; each point may move along the ray of its pixel.

    By default the unit of time is the squared pixel footprint: the rate of a vertex is multiplied by h_i squared, h_i the width
    of its pixel on the surface at the start (z_i / f of a pinhole), so that near and far surfaces are smoothed over the same
    number of pixels.

    :param depth: (h, w), in the unit of the result (metres); 0, NaN, infinite and masked samples are missing. (For a
        :class:`Scanner` with one origin per sample, 0 and negative values are valid.)
    :param camera: :class:`Pinhole`, :class:`Orthographic`, :class:`Spherical` or :class:`Scanner`.
    :param missing: (h, w), further samples that are missing.
    :param fixed: (h, w), samples that stay.
    :param jump: where neighbouring samples belong to different surfaces and are not connected. ``noise``: a triangle is left out
        where its depths jump by more than noise and slope explain, or where it turns away from the ray
        (:func:`.discontinuities.cuts_by_noise`). A number: where depths differ by more than this share of the nearest; not
        defined where each sample has its own origin. None: nowhere.
    :param sigma: the standard deviation of the noise of the depths, a number or (h, w), in their unit. Where it is not given,
        :func:`meshflow.smooth` estimates it; without it, ``jump="noise"`` means a share of 5 %.
    :param measure: what the depths are, ``depth`` along the optical axis or ``range`` along the ray; by default the usual one of
        the camera.
    :param time_unit: ``footprint``: time is in squared footprints of each pixel; ``length``: in squared length, the same
        everywhere; ``noise``: in squared footprints where sigma / h is the median and in proportion to it elsewhere, so that
        noise is removed evenly.
    :param unit: the name of the unit of the depths, for reports and pictures; m for depths from a file.
    :raises InputError: for a camera that does not fit, negative depths, fewer than 2 x 2 samples, or no sample that is present.
    """

    depth: Array
    camera: Camera
    missing: Array = field(default_factory=nowhere)
    fixed: Array = field(default_factory=nowhere)
    jump: float | Literal["noise"] | None = "noise"
    measure: Measure | None = None
    time_unit: TimeUnit = "footprint"
    sigma: Array | float | None = None
    unit: str = ""
    boundary: Boundary = field(default="plane-preserving", init=False)

    def __post_init__(self) -> None:
        depth, missing = samples(self.depth, self.missing, (2,), "range image")
        if not isinstance(self.camera, Camera):
            raise InputError(
                f"camera: a Pinhole, Orthographic, Spherical or Scanner expected, got {type(self.camera).__name__}; "
                "meshflow.read_camera reads one from a file"
            )
        if not self.camera.signed:
            missing = missing | (depth == 0)
        if missing.all():
            raise NothingThere(
                f"range image: all {missing.size} depths are missing (0, NaN or masked); nothing to smooth or to draw"
            )
        if not self.camera.signed and (depth[~missing] < 0).any():
            raise InputError(
                f"range image: depths above zero expected, got {depth[~missing].min()}; 0 or NaN mark what is missing"
            )
        if isinstance(self.jump, str) and self.jump != "noise":
            raise InputError(f"jump: noise, a share of the depth or None expected, got {self.jump!r}")
        if self.jump is not None and not isinstance(self.jump, str):
            positive(self.jump, "jump")
        if self.sigma is not None:
            object.__setattr__(self, "sigma", noise_of_samples(self.sigma, missing, "depths"))
        self.camera.check((depth.shape[0], depth.shape[1]), self.counted, missing)
        object.__setattr__(self, "measure", self.counted)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "fixed", mask_of(self.fixed, depth.shape, "fixed"))

    def __repr__(self) -> str:
        return brief(self, self.depth, self.missing, self.camera.summary)

    def gridded(self, lift: Lift) -> Grid:
        """The grid for an engine; the depths are not copied.

        :raises InputError: for a contrast other than 1, which would only scale the scene.
        """
        if lift.contrast != 1.0:
            raise InputError(
                f"contrast: for range images only 1 has a meaning (a factor on all depths scales the scene), "
                f"got {lift.contrast}; use gamma to keep edges"
            )
        boundary, cuts = lift.boundary or self.boundary, self.cuts
        share = SHARE if self.jump == "noise" and cuts is None else self.jump
        return Grid(
            self.depth[None],
            self.missing,
            self.fixed,
            diagonals=lift.diagonals,
            boundary=boundary,
            lines=replace(self.lines, footprint=self.stride),
            jump=None if self.camera.signed or isinstance(share, str) else share,
            cuts=cuts,
        )

    @property
    def counted(self) -> Measure:
        """The measure of the depths: the given one, or the usual one of the camera."""
        return self.measure or self.camera.usual

    @property
    def cuts(self) -> Cuts | None:
        """Edges cut where the depth jumps, judged by its noise; None where the noise is not known or not used."""
        if self.jump != "noise" or self.sigma is None:
            return None
        return cuts_by_noise(self.along, self.missing, self.sigma, self.footprint)

    def cleared(self, least: int) -> "RangeImage":
        """A copy without components of fewer than ``least`` samples, which become missing with depth zero."""
        cuts, shape = self.cuts, self.depth.shape
        if cuts is None and self.jump is not None:
            near = np.where(self.missing, np.nan, self.depth)
            share = SHARE if isinstance(self.jump, str) else self.jump
            right, down = (
                np.abs(np.diff(near, axis=axis)) > share * np.fmin(near[first], near[second])
                for axis, first, second in ((1, np.s_[:, :-1], np.s_[:, 1:]), (0, np.s_[:-1], np.s_[1:]))
            )
            cuts = Cuts(right, down)
        gone = small_components(self.missing, cuts, least)
        if (gone | self.missing).all():
            raise InputError(
                f"min_component: all {shape[1]} x {shape[0]} pixels lie in components of fewer than {least} samples"
            )
        nothing = np.nan if self.camera.signed else 0.0
        return replace(self, depth=np.where(gone, nothing, self.depth), missing=self.missing | gone)

    @property
    def step(self) -> float:
        """h: 1 where the unit of time is the pixel footprint; else the median footprint, a length."""
        if self.time_unit != "length":
            return 1.0
        return float(np.median(self.footprint[~self.missing]))

    @property
    def stride(self) -> Array | None:
        """The length (h, w) whose square is the unit of time; None: the unit of the depths, everywhere."""
        if self.time_unit == "length":
            return None
        footprint = self.footprint
        if self.time_unit == "footprint" or self.sigma is None:
            return footprint
        there = ~self.missing & (footprint > 0)
        ratio = np.divide(self.sigma, footprint, out=np.ones_like(footprint), where=there)
        return footprint * np.sqrt(np.clip(ratio / np.median(ratio[there]), 1 / FASTEST, FASTEST))

    @property
    def along(self) -> Array:
        """The coordinate (h, w) of each point along its ray; NaN where missing.

        It is the value itself where all rays have one origin; with one origin per sample it is computed from the points.
        """
        if not self.camera.signed:
            return np.where(self.missing, np.nan, self.depth)
        rays = np.stack([np.broadcast_to(part, self.depth.shape) for part in self.lines.directions], axis=-1)
        return (self.cloud * rays).sum(axis=-1) / (rays * rays).sum(axis=-1)

    @property
    def cloud(self) -> Array:
        """The points (h, w, 3), NaN where missing."""
        return np.where(self.missing[..., None], np.nan, self.points_at(self.depth.astype(np.float64)))

    def points_at(self, depth: Array) -> Array:
        """The points (h, w, 3) at given depths (h, w) along the same rays."""
        return self.lines.at(depth)

    @property
    def lines(self) -> Lines:
        """The lines of the samples."""
        return self.camera.lines((self.depth.shape[0], self.depth.shape[1]), self.counted)

    @cached_property
    def footprint(self) -> Array:
        """The width (h, w) of each pixel on the surface, across its ray, in the unit of the depths; zero where missing."""
        there = np.where(self.missing, np.nan, self.depth).astype(np.float64)
        footprint = np.nan_to_num(self.camera.footprint(there, self.counted), nan=0.0)
        footprint.flags.writeable = False  # cached: used several times in a run
        return footprint

    def lifted(self, lift: Lift) -> Surface:
        """The surface of the points, each free along its ray.

        :raises InputError: for a contrast other than 1.
        """
        return self.gridded(lift).surface()

    def lowered(self, u: Array) -> "RangeImage":
        """A copy with depths u (h * w, 1); missing samples keep their bits."""
        return replace(self, depth=held(self.depth, u, self.missing))
