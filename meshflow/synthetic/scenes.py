"""Scenes with a known truth and levels of noise, for the benchmark of quality, each given by a seed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, positive, whole
from meshflow.synthetic.samples import fractal

__all__ = [
    "SCENES",
    "Kind",
    "Subject",
    "fractal_terrain",
    "jacksboro",
    "mesas",
    "noisy",
    "quantised",
    "ramps",
    "steps",
]

Kind = Literal["terrain", "image"]


@dataclass(frozen=True)
class Subject:
    """A scene and how it is measured: with white noise of several levels, or rounded to a quantum without noise.

    :ivar name: a short name.
    :ivar truth: makes the true values, (h, w) or (h, w, k), float64; deterministic.
    :ivar levels: standard deviations of the noise, in the unit of the values; empty with a ``quantum``.
    :ivar kind: ``terrain``: heights over a grid; ``image``: grey levels or colours.
    :ivar unit: of the values.
    :ivar spacing: of the samples, (dx, dy), in the unit of the heights; it affects slopes and normals only.
    :ivar peak: of an image, the range of possible values; None: the range of the truth.
    :ivar quantum: values are rounded to its multiples; 0: no rounding.
    """

    name: str
    truth: Callable[[], Array]
    levels: tuple[float, ...]
    kind: Kind = "terrain"
    unit: str = "m"
    spacing: tuple[float, float] = (1.0, 1.0)
    peak: float | None = None
    quantum: float = 0.0

    def measured(self, truth: Array, level: float, seed: int = 7) -> Array:
        """The measurement of the truth: rounded to the quantum ``level``, or with noise of that level."""
        return quantised(truth, level) if self.quantum else noisy(truth, level, seed)


def noisy(truth: ArrayLike, sigma: float, seed: int = 7) -> Array:
    """The truth with white Gaussian noise, independent for each value.

    Example:

        >>> import numpy as np
        >>> round(float(np.std(noisy(np.zeros((64, 64)), 3.0))))
        3

    :param truth: of any shape.
    :param sigma: standard deviation, in the unit of the truth.
    :param seed: of the noise.
    :raises InputError: for a sigma that is negative or not finite.
    """
    if not (np.isfinite(sigma) and sigma >= 0):
        raise InputError(f"sigma: a finite number, zero or more, expected, got {sigma}")
    values = np.asarray(truth, dtype=np.float64)
    return values + sigma * np.random.default_rng(seed).normal(size=values.shape)


def quantised(truth: ArrayLike, quantum: float) -> Array:
    """The truth rounded to multiples of a quantum, in the unit of the truth, without noise.

    Example:

        >>> quantised([0.4, 1.7], 1.0)
        array([0., 2.])

    :param truth: of any shape.
    :param quantum: the step, above 0.
    :raises InputError: for a quantum that is not positive.
    """
    return positive(quantum, "quantum") * np.rint(np.asarray(truth, dtype=np.float64) / quantum)


def steps(n: int = 128, seed: int = 0) -> Array:
    """Heights (n, n): 8 x 8 flat blocks of 0, 12, ... 84.

    Example:

        >>> steps(32).shape
        (32, 32)

    :param n: number of samples along each side, a multiple of 8.
    :param seed: of all random numbers.
    :raises InputError: for a side that is no multiple of 8.
    """
    if whole(n, "steps: side", 8) % 8:
        raise InputError(f"steps: a side that is a multiple of 8 expected, got {n}; {n - n % 8} is one")
    blocks = np.random.default_rng(seed).integers(0, 8, (8, 8)) * 12.0
    return np.kron(blocks, np.ones((n // 8, n // 8)))


def mesas(n: int = 512, seed: int = 0) -> Array:
    """Heights (n, n) of 0 to about 75: twelve round mesas, some upon others, a cone of height 40, bumps on the right half.

    Example:

        >>> mesas(32).shape
        (32, 32)

    :param n: number of samples along each side.
    :param seed: of all random numbers.
    """
    rng, (rows, columns) = np.random.default_rng(seed), _unit(n)
    heights = np.zeros((n, n))
    for _ in range(12):
        x, y = rng.random(2)
        radius, height = 0.04 + 0.1 * rng.random(), 10.0 + 20.0 * rng.random()
        heights[np.hypot(rows - x, columns - y) < radius] += height
    heights += np.maximum(0.0, 40.0 - 200.0 * np.hypot(rows - 0.3, columns - 0.7))
    return heights + 6.0 * np.sin(20.0 * rows) * np.cos(25.0 * columns) * (columns > 0.5)


def ramps(n: int = 512) -> Array:
    """Heights (n, n) of 0 to about 50: two steps on the left, a ramp between two plains, a cone of height 35, bumps below it.

    Example:

        >>> ramps(32).shape
        (32, 32)

    :param n: number of samples along each side.
    """
    rows, columns = _unit(n)
    heights = 20.0 * ((columns > 0.1) & (columns < 0.25) & (rows > 0.1) & (rows < 0.4))
    heights += 10.0 * ((columns > 0.05) & (columns < 0.35) & (rows > 0.5) & (rows < 0.9))
    heights += 60.0 * np.clip(columns - 0.4, 0.0, 0.25)
    heights += np.maximum(0.0, 35.0 - 180.0 * np.hypot(rows - 0.3, columns - 0.8))
    return heights + 5.0 * np.sin(40.0 * rows) * np.sin(33.0 * columns) * ((rows > 0.6) & (columns > 0.5))


def _unit(n: int) -> tuple[Array, Array]:
    """Rows and columns (n, n) of a square of side 1."""
    rows, columns = np.mgrid[0 : whole(n, "scene: side", 8), 0:n] / n
    return rows, columns


def fractal_terrain(n: int = 512, seed: int = 2) -> Array:
    """Elevations (n, n) in metres, as rough as mountains: spectrum k^-2, standard deviation 60 m, no cliffs.

    Example:

        >>> fractal_terrain(32).shape
        (32, 32)

    :param n: number of samples along each side.
    :param seed: of all random numbers.
    """
    return 60.0 * fractal(whole(n, "fractal terrain: side", 8), 2.0, np.random.default_rng(seed))


def jacksboro() -> Array:
    """Elevations (344, 403) in whole metres, 236 to 1076, three arc seconds apart: the Jacksboro fault, from matplotlib."""
    from matplotlib.cbook import get_sample_data

    path = str(get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    with np.load(path) as archive:
        return archive["elevation"].astype(np.float64)


# Three arc seconds at 36.4 degrees north, metres.
_JACKSBORO = (74.6, 92.5)
# About 1 to 10 % of the range; otherwise the interesting levels.
SCENES: Mapping[str, Subject] = MappingProxyType(
    {
        subject.name: subject
        for subject in (
            Subject("steps", steps, (0.5, 2.0, 5.0)),
            Subject("mesas", mesas, (0.5, 2.0, 8.0)),
            Subject("ramps", ramps, (0.5, 2.0, 5.0)),
            Subject("fractal", fractal_terrain, (1.0, 3.0, 10.0), spacing=(10.0, 10.0)),
            Subject("jacksboro", jacksboro, (5.0, 15.0, 40.0), spacing=_JACKSBORO),
            Subject("quantised", fractal_terrain, (), spacing=(10.0, 10.0), quantum=4.0),
        )
    }
)
