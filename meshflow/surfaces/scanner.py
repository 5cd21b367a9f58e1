"""Scanners: the regular sweep of a lidar, and arbitrary rays."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, number
from meshflow.surfaces.camera import Measure, known
from meshflow.surfaces.grid import Lines

__all__ = ["Scanner", "Spherical"]


@named_fields
@dataclass(frozen=True)
class Spherical:
    """A lidar sweep: the point of range u is u (cos e cos a, cos e sin a, sin e); x forward, y left, z up.

    :param azimuth: a of the centres of the first and the last column, degrees; columns are evenly spaced between them.
    :param elevation: e of the centres of the first and the last row, degrees, or one number for each row; it falls or rises
        from row to row.
    :raises InputError: for angles that are not finite, elevations beyond 90 degrees or out of order, or a sweep of more than
        360 degrees.
    """

    azimuth: tuple[float, float]
    elevation: tuple[float, ...]
    usual: ClassVar[Measure] = "range"
    most: ClassVar[float] = 360.0

    def __post_init__(self) -> None:
        for name in ("azimuth", "elevation"):
            values = tuple(number(x, f"camera {name}") for x in np.ravel(getattr(self, name)))
            object.__setattr__(self, name, values)
        if len(self.azimuth) != 2 or not 0 < abs(self.azimuth[1] - self.azimuth[0]) <= self.most:
            raise InputError(
                "camera azimuth: degrees of the first and the last column, at most a turn apart, expected, got "
                f"{_few(self.azimuth)}"
            )
        steps = np.diff(self.elevation)
        if len(steps) == 0 or not (np.all(steps > 0) or np.all(steps < 0)):
            raise InputError(
                "camera elevation: degrees of the first and the last row, or of every row, all falling or all rising, "
                f"expected, got {self._rows}; sort the rows of the image by their elevation"
            )
        if max(map(abs, self.elevation)) > 90:
            raise InputError(f"camera elevation: -90 to 90 degrees expected, got {self._rows}")

    @property
    def _rows(self) -> str:
        return _few(self.elevation)

    def __repr__(self) -> str:
        return f"Spherical({self.summary})"

    @property
    def signed(self) -> bool:
        """Ranges count from the origin."""
        return False

    @property
    def summary(self) -> str:
        """The sweep."""
        first, last = self.azimuth
        return f"spherical, azimuth {first:g} to {last:g}, elevation {self.elevation[0]:g} to {self.elevation[-1]:g} degrees"

    def check(self, shape: tuple[int, int], measure: Measure, missing: Array | None = None) -> None:
        """Refuse a number of rows that differs from that of elevations, and depths, since there is no optical axis."""
        if known(measure) != "range":
            raise InputError("measure='depth': a spherical camera has no optical axis, range expected; leave it out")
        if len(self.elevation) not in (2, shape[0]):
            raise InputError(
                f"camera elevation: 2 or {shape[0]} numbers, one for each row of the image, expected, got {len(self.elevation)}"
            )

    def lines(self, shape: tuple[int, int], measure: Measure) -> Lines:
        """The lines through the origin."""
        a, e = self._angles(shape)
        still = np.zeros((1, 1))
        return Lines((still, still, still), (np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)))

    def footprint(self, u: Array, measure: Measure) -> Array:
        """u sqrt(cos e da de), where da and de are the steps of the angles."""
        a, e = self._angles((u.shape[0], u.shape[1]))
        da = abs(self.azimuth[1] - self.azimuth[0]) / (u.shape[1] - 1)
        return u * np.sqrt(np.radians(da) * np.abs(np.gradient(e, axis=0)) * np.cos(e))

    def project(self, points: Array, shape: tuple[int, int] | None = None) -> Array:
        """Pixel coordinates (n, 2), NaN outside the sweep.

        :param shape: (h, w) of the image, since the sweep does not define the number of columns.
        :raises InputError: without the shape.
        """
        if shape is None:
            raise InputError("project: the shape (h, w) of the image expected for a spherical camera, got None")
        x, y, z = np.asarray(points, dtype=np.float64).T
        length = np.sqrt(x * x + y * y + z * z)
        a, e = np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(np.divide(z, np.where(length > 0, length, np.nan))))
        first, last = self.azimuth
        middle, da = (first + last) / 2, (last - first) / (shape[1] - 1)
        column = ((a - middle + 180) % 360 - 180) / da + (shape[1] - 1) / 2
        rows = np.degrees(self._angles(shape)[1][:, 0])
        up = 1 if rows[-1] > rows[0] else -1
        rows = np.concatenate(
            [[1.5 * rows[0] - 0.5 * rows[1]], rows, [1.5 * rows[-1] - 0.5 * rows[-2]]]
        )  # with their edges
        places = np.clip(np.arange(-1.0, shape[0] + 1), -0.5, shape[0] - 0.5)
        row = np.interp(up * e, up * rows, places, left=np.nan, right=np.nan)
        column = np.where((column >= -0.5) & (column <= shape[1] - 0.5), column, np.nan)
        return np.stack([column, row], axis=-1)

    def thinned(self, step: int, shape: tuple[int, int]) -> "Spherical":
        """The camera of every ``step``-th row and column."""
        a, e = (np.degrees(angle).ravel()[::step] for angle in self._angles(shape))
        return Spherical((float(a[0]), float(a[-1])), tuple(map(float, e)))

    def period(self, width: int) -> int:
        """The number of columns of a full turn, after which rows repeat: all, or all but the last; 0: the sweep has two ends.

        :param width: the number of columns.
        """
        columns = self.columns_of_a_turn(width)
        return columns if width - columns in (0, 1) and columns > 2 else 0

    def columns_of_a_turn(self, width: int) -> int:
        """The number of columns of 360 degrees; 0: it is not whole.

        :param width: the number of columns.
        """
        columns = 360.0 * (width - 1) / abs(self.azimuth[1] - self.azimuth[0])
        return round(columns) if abs(columns - round(columns)) < 0.1 else 0

    def wound(self, columns: int, width: int) -> "Spherical":
        """The camera of a sweep that goes on for so many columns beyond each end."""
        first, last = self.azimuth
        more = columns * (last - first) / (width - 1)
        return _Wound((first - more, last + more), self.elevation)

    def _angles(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """Azimuths (1, w) and elevations (h, 1), radians."""
        e = np.array(self.elevation)
        e = np.linspace(e[0], e[-1], shape[0]) if len(e) != shape[0] else e
        return np.radians(np.linspace(*self.azimuth, shape[1]))[None, :], np.radians(e)[:, None]


class _Wound(Spherical):
    """A sweep of more than a turn: one that is unrolled beyond its ends."""

    most = 1080.0


@named_fields
@dataclass(frozen=True, eq=False)
class Scanner:
    """Arbitrary rays: the point of value u is o + u d.

    With one origin for all rays, values are ranges, and 0 marks a missing one. With one origin per sample, values are relative to
    it and may be 0 or negative; samples are then missing where they are NaN or marked.

    :param directions: d, (h, w, 3), of any length: they are scaled to length 1 for ``range``, and to z = 1 for ``depth``. NaN
        or zero where a sample is missing.
    :param origins: o, (3,) or (h, w, 3).
    :raises InputError: for other shapes, or when no ray is finite and longer than zero.
    """

    directions: Array
    origins: ArrayLike = (0.0, 0.0, 0.0)
    usual: ClassVar[Measure] = "range"

    def __post_init__(self) -> None:
        d, o = (np.array(part, dtype=np.float64) for part in (self.directions, self.origins))
        if d.ndim != 3 or d.shape[2] != 3 or d.size == 0:
            raise InputError(f"camera directions: shape (h, w, 3) expected, got {d.shape}")
        if o.shape not in ((3,), d.shape):
            raise InputError(f"camera origins: shape (3,) or {d.shape}, as the directions, expected, got {o.shape}")
        if o.ndim == 1 and not np.isfinite(o).all():
            raise InputError(f"camera origins: finite numbers expected, got {o}")
        d.flags.writeable = o.flags.writeable = False
        object.__setattr__(self, "directions", d)
        object.__setattr__(self, "origins", o)
        if self._lost.all():
            raise InputError(
                f"camera directions: rays longer than zero expected, all {d.shape[0] * d.shape[1]} are zero or NaN"
            )

    def __eq__(self, other: object) -> bool:
        """Whether the lines are the same, up to the rounding of files in single precision."""
        if not isinstance(other, Scanner) or self.directions.shape != other.directions.shape:
            return NotImplemented if not isinstance(other, Scanner) else False
        mine, theirs = (np.broadcast_to(x.origins, x.directions.shape) for x in (self, other))
        near = 1e-5 * float(np.nanmax(np.abs(mine), initial=0.0))
        return np.allclose(mine, theirs, rtol=0, atol=near, equal_nan=True) and np.allclose(
            self.directions, other.directions, rtol=0, atol=1e-5, equal_nan=True
        )

    def __repr__(self) -> str:
        return f"Scanner({self.summary})"

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    @property
    def signed(self) -> bool:
        """Whether each sample has its own origin."""
        return np.ndim(self.origins) == 3

    @property
    def summary(self) -> str:
        """The number of rays, and their origin."""
        h, w, _ = self.directions.shape
        whence = "origins of their own" if self.signed else "from ({:g}, {:g}, {:g})".format(*np.asarray(self.origins))
        return f"scanner, {h} x {w} rays {whence}"

    @property
    def _lost(self) -> Array:
        """(h, w), where there is no ray."""
        squares = (self.directions**2).sum(axis=2)
        lost = ~(np.isfinite(squares) & (squares > 0))
        return lost | ~np.isfinite(self.origins).all(axis=2) if self.signed else lost

    def check(self, shape: tuple[int, int], measure: Measure, missing: Array | None = None) -> None:
        """Refuse another size, and rays that are zero or not finite where a sample is present."""
        d = self.directions
        if d.shape[:2] != tuple(shape):
            raise InputError(
                f"camera directions: shape ({shape[0]}, {shape[1]}, 3), as the image, expected, got {d.shape}"
            )
        lost = self._lost if missing is None else self._lost & ~missing
        if lost.any():
            r, c = np.argwhere(lost)[0]
            raise InputError(
                f"camera directions: finite rays longer than zero expected, {int(lost.sum())} are not, the first in row {r}, "
                f"column {c}: {d[r, c]}; mark such samples as missing"
            )
        if known(measure) == "depth" and (d[..., 2][~self._lost] <= 0).any():
            raise InputError("measure='depth': rays with z above zero expected, got others; give measure='range'")

    def lines(self, shape: tuple[int, int], measure: Measure) -> Lines:
        """The lines; a point where there is no ray."""
        lost = self._lost[..., None]
        d = np.where(lost, 1.0, self.directions)
        d = np.where(lost, 0.0, d / (np.linalg.norm(d, axis=2, keepdims=True) if measure == "range" else d[..., 2:]))
        o = np.where(lost, 0.0, self.origins) if self.signed else np.reshape(self.origins, (1, 1, 3))
        return Lines(_parts(o), _parts(d))

    def footprint(self, u: Array, measure: Measure) -> Array:
        """With one origin: u times the mean angle to the neighbouring rays. Else the distance of the neighbouring points.

        It is the geometric mean along rows and along columns; where there are no neighbours, the median of the image.
        """
        lines = self.lines((u.shape[0], u.shape[1]), measure)
        d = np.where(self._lost[..., None], np.nan, np.stack(np.broadcast_arrays(*lines.directions), axis=-1))
        unit = d / np.linalg.norm(d, axis=2, keepdims=True)
        if self.signed:
            points = np.where(np.isnan(u)[..., None], np.nan, lines.at(u))
            return _filled(_beside(points, unit), u)
        return _filled(_beside(unit, unit), u) * np.linalg.norm(d, axis=2) * u

    def project(self, points: Array, shape: tuple[int, int] | None = None) -> Array:
        """Pixel coordinates (n, 2): those of the nearest ray, extrapolated linearly with its neighbouring rays.

        :raises InputError: when the rays share neither an origin nor a direction.
        """
        from scipy.spatial import KDTree

        points = np.asarray(points, dtype=np.float64)
        lost = self._lost
        d = np.where(lost[..., None], np.nan, self.directions)
        d = d / np.linalg.norm(d, axis=2, keepdims=True)
        if self.signed:
            axis = d[~lost][0]
            if np.nanmax(np.abs(d - axis)) > 1e-6:
                raise InputError("project: rays from one origin, or parallel, expected; these have no inverse")
            places = self.origins - (self.origins @ axis)[..., None] * axis
            sought = points - (points @ axis)[:, None] * axis
        else:
            places, sought = d, points - np.asarray(self.origins)
            sought = sought / np.linalg.norm(sought, axis=1, keepdims=True)
        rows, columns = np.nonzero(~lost)
        there = np.isfinite(sought).all(axis=1)
        found = np.full((len(points), 2), np.nan)
        _, nearest = KDTree(places[rows, columns]).query(sought[there])
        r, c = rows[nearest], columns[nearest]
        along = [_slope(places, axis)[r, c] for axis in (1, 0)]
        gap = sought[there] - places[r, c]
        aa, ab, bb = ((x * y).sum(1) for x, y in ((along[0], along[0]), (along[0], along[1]), (along[1], along[1])))
        a, b = ((gap * x).sum(1) for x in along)
        area = aa * bb - ab * ab
        found[there] = np.stack([c + (bb * a - ab * b) / area, r + (aa * b - ab * a) / area], axis=-1)
        return found

    def thinned(self, step: int, shape: tuple[int, int]) -> "Scanner":
        """The camera of every ``step``-th row and column."""
        o: Any = self.origins
        return Scanner(self.directions[::step, ::step], o[::step, ::step] if self.signed else o)


def _few(angles: tuple[float, ...]) -> str:
    """Some of the angles, and their number."""
    more = f", ... ({len(angles)} numbers)" if len(angles) > 4 else ""
    return f"{', '.join(f'{angle:g}' for angle in angles[:4])}{more}"


def _parts(vectors: Array) -> tuple[Array, Array, Array]:
    return vectors[..., 0], vectors[..., 1], vectors[..., 2]


def _slope(places: Array, axis: int) -> Array:
    """Differences (h, w, 3) per sample along an axis: central where both neighbours exist, NaN where none does."""
    step = np.diff(places, axis=axis)
    none = np.full_like(np.take(places, [0], axis=axis), np.nan)
    return _mean(np.concatenate([none, step], axis=axis), np.concatenate([step, none], axis=axis))


def _beside(places: Array, unit: Array) -> Array:
    """Distance (h, w) of neighbouring points (h, w, 3) across the unit rays, the geometric mean along rows and columns."""
    widths = []
    for axis in (0, 1):
        step = np.diff(places, axis=axis)
        none = np.full_like(np.take(places, [0], axis=axis), np.nan)
        both = (np.concatenate(pair, axis=axis) for pair in ((none, step), (step, none)))
        widths.append(_mean(*(np.linalg.norm(np.cross(part, unit), axis=2) for part in both)))
    return np.sqrt(widths[0] * widths[1])


def _mean(one: Array, other: Array) -> Array:
    """The mean of the values that are not NaN."""
    return np.where(np.isnan(one), other, np.where(np.isnan(other), one, (one + other) / 2))


def _filled(widths: Array, u: Array) -> Array:
    """The widths, with the median where there are no neighbours; NaN where u is NaN."""
    known = widths[np.isfinite(widths)]
    median = np.median(known) if known.size else 1.0
    return np.where(np.isnan(u), np.nan, np.where(np.isnan(widths), median, widths))
