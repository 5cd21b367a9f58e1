"""Whether a picture is smoothed in values whose noise is the same at every intensity."""

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.noise import ENOUGH, noise_of
from meshflow.estimate.noise_by_intensity import ByIntensity, noise_by_intensity
from meshflow.estimate.preparation import OnGrid, Preparation, stabilized_by
from meshflow.estimate.quantization import quantum_of
from meshflow.estimate.request import Request
from meshflow.estimate.spread import spread_tiles
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import array_of
from meshflow.surfaces.image import Image
from meshflow.surfaces.orientation import orientation_of

__all__ = ["with_constant_noise"]

# The noise of stabilized values is near that of the flat blocks, unless these show texture.
ALIKE = (0.6, 1.5)
# How far a multiple of the quantum may be from a whole number.
EXACT = 1e-3


def with_constant_noise(data: OnGrid, how: Preparation, request: Request) -> tuple[OnGrid, Preparation]:
    """Prepared data in which the noise does not depend on the intensity, and its preparation; the same where it does not.

    By default this is done for images whose noise is white and clearly depends on the intensity, if the caller gives
    nothing that is in the unit of the values.

    :raises InputError: if it is asked for and not possible.
    """
    asked = request.domain == "stabilized"
    if not asked and not (request.domain == "auto" and isinstance(data, Image) and data.intensity and _open(request)):
        return data, how
    values, unseen = how.above_zero(array_of(data)), data.missing | how.unseen
    way = orientation_of(values, data.missing, data.spacing)  # the same blocks however the data lies
    stabilizer = Stabilizer.of(_of_channels(np.ascontiguousarray(way.of(values)), way.of(unseen)))
    if stabilizer is None:
        if asked:
            raise InputError(
                "domain='stabilized': the noise does not clearly depend on the intensity; leave the domain out"
            )
        return data, how
    stable, made = stabilized_by(data, how, stabilizer)
    return (stable, made) if asked or _as_expected(stable, made, stabilizer) else (data, how)


def _open(request: Request) -> bool:
    """Whether the caller gives nothing in the unit of the values, nor a method that should run as it is."""
    held = request.constraints
    bound = any(given is not None for given in (held.max_change, held.data_weights))
    return not (request.named or request.timed or bound or request.noise is not None)


def _of_channels(values: Array, missing: Array) -> tuple[ByIntensity | None, ...]:
    """The noise of each channel by intensity."""
    tiles = spread_tiles(missing.shape, ENOUGH)
    stack = values.reshape(*missing.shape, -1)
    found = []
    for channel in np.moveaxis(stack, 2, 0):
        parts = [(channel[tile].astype(np.float64), ~missing[tile]) for tile in tiles]
        found.append(noise_by_intensity(parts, _counted_in(np.concatenate([z[there] for z, there in parts]))))
    return tuple(found)


def _counted_in(values: Array) -> float:
    """The quantum of values (n,) that are multiples of it from zero on; 0 for others."""
    if values.size == 0 or values.min() < 0:
        return 0.0
    quantum, _ = quantum_of(values)
    off = quantum and np.abs(values.min() / quantum - np.rint(values.min() / quantum))
    return quantum if off < EXACT else 0.0


def _as_expected(data: OnGrid, how: Preparation, stabilizer: Stabilizer) -> bool:
    """Whether the noise of stabilized data is white, and as large as that of the blocks."""
    noise = noise_of(array_of(data), data.missing | how.unseen)
    if noise.correlation is not None:
        return False
    return all(
        one is None or one.photons or ALIKE[0] < sigma / one.usual < ALIKE[1]
        for one, sigma in zip(stabilizer.noise, noise.channels, strict=True)
    )
