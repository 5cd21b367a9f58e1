"""Estimates of the noise of data: deviation, correlation, quantum, and offsets of lines."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshflow.estimate.evenness import leaves_gaps
from meshflow.estimate.jpeg import Jpeg
from meshflow.estimate.magnitudes import Magnitudes
from meshflow.estimate.noise_by_intensity import ByIntensity
from meshflow.estimate.noise_channels import spectra_of
from meshflow.estimate.noise_growth import MAD, residuals
from meshflow.estimate.noise_lines import line_offsets
from meshflow.estimate.noise_spectrum import Found, correlation_of, length_of
from meshflow.estimate.outliers import large_pieces
from meshflow.estimate.patch_noise import patch_noise
from meshflow.estimate.quantization import quantum_of, terraced
from meshflow.estimate.ring_fill import filled_from_ring
from meshflow.estimate.spread import spread_tiles
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.surfaces.orientation import Orientation

__all__ = ["ENOUGH", "Lines", "Noise", "Window", "noise_in_windows", "noise_of"]

# The largest number of samples used, on tiles spread over the grid.
ENOUGH = 300_000
# Correlated noise and offsets of lines are at least this share of the range of the values; correlated noise is at least this
# multiple of the rounding error, because the rounding errors of a smooth surface are also correlated.
FAINT, ROUNDING = 1e-5, 1.25
# The largest difference of two estimates (log), the number of tiles below which they are few, and the squared relative error
# above which a spectrum fits badly.
APART, FEW, ROUGH = 0.15, 12, 0.1
# Noise larger than the quantum makes the rounding errors white; their deviation is then at least this share of it.
DITHERED = 0.1
# Below this share of the noise in patches, that on a rough surface is taken.
LOWER = 0.85

# The noise of rounding alone is up to this factor of quantum / sqrt 12.
ROUNDING_ALONE = 1.01

Part = tuple[Array, Array]
Window = tuple[slice | int, ...]


@dataclass(frozen=True)
class Lines:
    """Offsets of whole lines, as standard deviations in the unit of the values; 0 where none are found.

    :ivar rows: of rows; ``columns``: of columns.
    """

    rows: float = 0.0
    columns: float = 0.0


@named_fields
@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of samples, in the unit of the values.

    :ivar sigma: standard deviation; the root mean square over the channels; 0 where none is found.
    :ivar quantum: smallest step between values of quantized data; 0 for continuous values.
    :ivar channels: sigma of each channel.
    :ivar share: of the samples whose differences are multiples of the quantum; 0 without a quantum.
    :ivar how: the estimator: ``patches``, ``spectrum`` (correlated noise, and rough surfaces), ``differences``, ``intensity``
        (blocks of each intensity, where the noise depends on it), ``air`` (of magnitudes), the steps of a compression, or
        ``nothing`` for too few samples.
    :ivar correlation: (2 r + 1, 2 r + 1), correlation of samples by lag in rows and columns, 1 in the middle; None: the noise
        is white.
    :ivar length: standard deviation, in samples, of the Gaussian filter that gives white noise the same correlation of
        neighbours; 0: white.
    :ivar lengths: the same from row to row, and from column to column.
    :ivar between: (k, k), the correlation between channels; None for one channel, or if it cannot be estimated.
    :ivar lines: offsets of rows and columns.
    :ivar doubt: why the estimate is uncertain, in words; empty for a reliable one.
    :ivar by_intensity: of each channel the deviation by intensity, where that depends on it; the other numbers are then those at
        the median intensity. Empty: it does not.
    """

    sigma: float
    quantum: float
    channels: tuple[float, ...] = ()
    share: float = 0.0
    how: str = "nothing"
    correlation: Array | None = None
    length: float = 0.0
    lengths: tuple[float, float] = (0.0, 0.0)
    between: Array | None = None
    lines: Lines = field(default_factory=Lines)
    doubt: str = ""
    by_intensity: tuple[ByIntensity | Magnitudes | None, ...] = ()

    @property
    def is_rounded(self) -> bool:
        """Whether rounding is the only noise."""
        return 0 < self.sigma <= ROUNDING_ALONE * self.quantum / np.sqrt(12.0)

    def of_channels(self, count: int) -> tuple[float, ...]:
        """The standard deviation of each of ``count`` channels; a given noise is the same for all."""
        return self.channels if len(self.channels) == count and self.how != "given" else (self.sigma,) * count

    def known(self, each: Array) -> "Noise":
        """The noise with given standard deviations of the samples (n,), as one number: the root mean square."""
        mean = float(np.sqrt(np.mean(np.square(each, dtype=np.float64))))
        return replace(self, sigma=mean, channels=(mean,), how="given")

    def stabilized(self, by: Stabilizer) -> "Noise":
        """The noise of stabilized values, of at least the deviations that the stabilizer says, unless it is correlated."""
        known = replace(self, by_intensity=by.noise, doubt="")
        if self.correlation is not None:
            return known
        found = tuple(max(one, own) for one, own in zip(by.least, self.channels, strict=True))
        return replace(known, sigma=_mean_square(found), channels=found, how="intensity")

    def relative(self, values: Array) -> Array | float:
        """The deviation at values (h, w) or (h, w, k) over that at the median intensity; 1 where it does not depend on them."""
        if not self.by_intensity:
            return 1.0
        made = np.ones(values.shape)
        planes, stack = (a.reshape(*values.shape[:2], -1) for a in (made, values))
        for k, one in enumerate(self.by_intensity):
            if one is not None:
                planes[..., k] = one.at(stack[..., k]) / one.usual
        return made

    def of_compression(self, found: Jpeg | None) -> "Noise":
        """The noise of a picture with the error of its compression; the same where other noise is stronger."""
        if found is None or found.sigma <= self.sigma:
            return self
        how = f"the steps of JPEG compression, quality {found.quality}"
        return Noise(found.sigma, 0.0, (found.sigma,) * len(self.channels), 0.0, how)

    def oriented(self, orientation: Orientation) -> "Noise":
        """The noise of a grid that is turned or mirrored."""
        if not orientation.changes:
            return self
        lengths, lines = self.lengths, self.lines
        if orientation.transposed:
            lengths, lines = lengths[::-1], Lines(lines.columns, lines.rows)
        correlation = None if self.correlation is None else orientation.of(self.correlation)
        return replace(self, correlation=correlation, lengths=lengths, lines=lines)

    @property
    def warning(self) -> str:
        """A sentence on why the estimate is uncertain; empty for a reliable one."""
        return f"the estimate of the noise is uncertain: {self.doubt}; noise= sets it" if self.doubt else ""

    def sentences(self) -> tuple[str, ...]:
        """Sentences on the correlation of the noise and on doubts."""
        said = []
        if self.correlation is not None:
            rows, columns = self.lengths
            alike = max(rows, columns) < 1.3 * max(min(rows, columns), 0.1)
            each = f"{self.length:.2g} samples" if alike else f"{rows:.2g} rows and {columns:.2g} columns"
            said.append(f"the noise is correlated over about {each}")
        said += [f"the noise depends on the intensity: {one}" for one in self.by_intensity if one is not None]
        if self.doubt:
            said.append(self.warning)
        return tuple(said)

    def to_dict(self) -> dict[str, object]:
        """The noise as values for JSON."""
        return {
            "sigma": self.sigma,
            "channels": list(self.channels),
            "quantum": self.quantum,
            "on_quantum": self.share,
            "how": self.how,
            "correlation": None if self.correlation is None else self.correlation.tolist(),
            "lengths": list(self.lengths),
            "between": None if self.between is None else self.between.tolist(),
            "lines": {"rows": self.lines.rows, "columns": self.lines.columns},
            "by_intensity": [None if one is None else one.to_dict() for one in self.by_intensity],
            "doubt": self.doubt,
        }


@dataclass(frozen=True, eq=False)
class _Measured:
    """Measurements of one channel: its parts and number type, what of :class:`Noise` needs no decision.

    All are in a unit of 2^``power`` units of the values.
    """

    parts: list[Part]
    precision: np.dtype
    quantum: float
    share: float
    lines: Lines
    power: int


@dataclass(frozen=True, eq=False)
class _Channel:
    """The noise of one channel: the fields of :class:`Noise`, and the covariance of correlated noise."""

    sigma: float
    how: str
    covariance: Array | None
    lines: Lines
    doubt: str


def noise_of(values: Array, missing: Array) -> Noise:
    """Estimate the noise of a grid, robustly.

    White noise is estimated from the weakly textured patches of some hundred thousand samples (:func:`.patch_noise.patch_noise`),
    correlated noise, and white noise on a rough surface, from the spectrum of the flattest tiles
    (:func:`.noise_spectrum.spectral_noise`). For grids with too few of
    them it is the median absolute deviation of second differences (Immerkaer 1996). It is at least quantum / sqrt 12, the
    rounding error. A strong texture in all places counts as noise in part; it cannot be distinguished in one image.

    The values are measured in a unit of a power of two near the largest of them. Then no square of a value overflows or vanishes,
    and the noise of multiples of the values is the multiple of the noise.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    """
    return noise_in_windows(values, missing, spread_tiles(missing.shape, ENOUGH))


def noise_in_windows(values: Array, missing: Array, windows: Sequence[Window]) -> Noise:
    """:func:`noise_of` from windows, each an index of the samples that gives a part (rows, columns) of them.

    :param values: (h, w), of a volume (d, h, w), and with channels after that.
    :param missing: (h, w) or (d, h, w).
    """
    stack = values.reshape(*missing.shape, -1)
    power = _power(stack, missing, windows)
    seen = [_measured(channel, missing, windows, power) for channel in np.moveaxis(stack, -1, 0)]
    spectra = spectra_of([(one.parts, one.lines.rows > 0, one.lines.columns > 0) for one in seen])
    found = [_channel(*each) for each in zip(seen, spectra.found, spectra.of_each, strict=True)]
    covariances = [one.covariance for one in found if one.covariance is not None]
    correlation = correlation_of(np.sum(covariances, axis=0)) if covariances else None
    lengths = length_of(correlation)
    return Noise(
        _times(_mean_square([one.sigma for one in found]), power),
        _times(max(one.quantum for one in seen), power),
        tuple(_times(one.sigma, power) for one in found),
        max(one.share for one in seen),
        "spectrum" if covariances else found[0].how,
        correlation,
        _mean_square(lengths),
        lengths,
        spectra.between,
        Lines(
            _times(_mean_square([one.lines.rows for one in found]), power),
            _times(_mean_square([one.lines.columns for one in found]), power),
        ),
        next((one.doubt for one in found if one.doubt), spectra.doubt if covariances else ""),
    )


def _power(stack: Array, missing: Array, windows: Sequence[Window]) -> int:
    """The power of two just above the largest magnitude of the present values in windows of a stack of samples with channels."""
    largest = max(float(np.abs(stack[at][~missing[at]].astype(np.float64)).max(initial=0.0)) for at in windows)
    return int(np.frexp(largest)[1])


def _times(size: float, power: int) -> float:
    """A size times 2^power, which is exact."""
    return float(np.ldexp(size, power))


def _mean_square(values: Sequence[float]) -> float:
    """The root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _measured(channel: Array, missing: Array, windows: Sequence[Window], power: int) -> _Measured:
    """Measurements of one channel, from windows of it, in a unit of 2^power."""
    quantum, share = quantum_of(np.concatenate([channel[window][~missing[window]] for window in windows]))
    parts = [_patched(channel[window], ~missing[window], power) for window in windows]
    least, most = _range(parts)
    rows, columns = (size if size > FAINT * (most - least) else 0.0 for size in line_offsets(parts))
    return _Measured(parts, channel.dtype, _times(quantum, -power), share, Lines(rows, columns), power)


def _channel(seen: _Measured, spectrum: Found | None, correlated: bool) -> _Channel:
    """The noise of one channel.

    :param correlated: whether the channels show that its noise is correlated.
    """
    parts, quantum, lines = seen.parts, seen.quantum, seen.lines
    least, most = _range(parts)
    faint = max(FAINT * (most - least), ROUNDING * quantum / np.sqrt(12.0))
    covariance, doubt = _correlated(spectrum, faint, correlated)
    if covariance is not None and leaves_gaps(parts, covariance, _mean_square(length_of(correlation_of(covariance)))):
        covariance, doubt = None, ""
    if covariance is not None and quantum > 0 and _white(parts)[0] < DITHERED * quantum:
        covariance = (
            None  # these are the terraces of a smooth surface: noise would have made white noise of the rounding
        )
    sigma, how = _white(parts) if covariance is None else (float(np.sqrt(covariance[0, 0])), "spectrum")
    if how == "patches" and spectrum is not None and sigma > 0:
        doubt = _doubt(_times(sigma, seen.power), _times(float(np.sqrt(spectrum.plain.white)), seen.power))
        if spectrum.floor is not None and np.sqrt(spectrum.floor) < LOWER * sigma:
            sigma, how = max(float(np.sqrt(spectrum.floor)), quantum / np.sqrt(12.0)), "spectrum"
    if sigma <= 2.0 * np.finfo(seen.precision).eps * max(abs(least), abs(most)):
        sigma, covariance, lines, doubt = 0.0, None, Lines(), ""  # rounding of floating-point numbers is no noise
    if sigma > 0 or (quantum > 0 and terraced(parts, quantum)):
        sigma = max(sigma, quantum / np.sqrt(12.0))
    return _Channel(sigma, how, covariance, lines, doubt)


def _patched(z: Array, there: Array, power: int) -> Part:
    """A part in double precision, in a unit of 2^power; small groups of missing samples are filled from those around them."""
    z = z.astype(np.float64)
    np.ldexp(z, -power, out=z, where=there)  # missing samples may have any value, also one that would overflow
    if there.all():
        return z, there
    small = ~(there | large_pieces(~there))
    made, done = filled_from_ring(z, small, ~(there | small))
    return made, there | done


def _white(parts: list[Part]) -> tuple[float, str]:
    """Standard deviation of the white noise of a channel, and the estimator."""
    sigma = patch_noise(parts)
    if sigma is not None:
        return sigma, "patches"
    rest = np.concatenate([residual[there] for residual, there in map(residuals, parts)])
    if rest.size == 0:
        return 0.0, "nothing"
    return MAD * float(np.median(np.abs(rest))), "differences"


def _range(parts: list[Part]) -> tuple[float, float]:
    """The minimum and maximum of the present values; 0 and 0 if there are none."""
    known = [z if there.all() else z[there] for z, there in parts]
    known = [some for some in known if some.size]
    return (float(min(map(np.min, known))), float(max(map(np.max, known)))) if known else (0.0, 0.0)


def _correlated(found: Found | None, least: float, correlated: bool) -> tuple[Array | None, str]:
    """The covariance of correlated noise and the reason for doubt; None if the noise is white or at most ``least``."""
    if found is None or not correlated:
        return None, ""
    covariance = found.covariance()
    if np.sqrt(covariance[0, 0]) <= least:
        return None, ""
    if found.tiles < FEW:
        return covariance, f"only {found.tiles} of {len(found.chosen)} tiles are flat enough for it"
    return (
        covariance,
        "the spectrum is not that of noise alone; texture may be counted in part" if found.error > ROUGH else "",
    )


def _doubt(one: float, other: float) -> str:
    """The reason for doubt in two estimates of white noise; empty unless the one of weak patches is larger, as with texture."""
    if other > 0 and np.log(one / other) < APART:
        return ""
    return f"two estimates differ, {one:.3g} and {other:.3g}; texture may be counted in part"
