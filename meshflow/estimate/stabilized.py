"""Whether a picture or a volume is smoothed in values whose noise is the same at every intensity."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.magnitudes import Magnitudes
from meshflow.estimate.noise import ENOUGH, Noise, Window, noise_of
from meshflow.estimate.noise_by_intensity import ByIntensity, noise_by_intensity
from meshflow.estimate.preparation import OnGrid, Preparation, prepared, stabilized_by, stabilized_volume
from meshflow.estimate.quantization import quantum_of
from meshflow.estimate.request import Request
from meshflow.estimate.spread import spread_tiles
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.estimate.volume_noise import OF_MAGNITUDES, noise_of_volume, slices_of
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import array_of
from meshflow.surfaces.image import Image
from meshflow.surfaces.orientation import orientation_of
from meshflow.surfaces.volume import Volume

__all__ = ["bias_left", "one_number_for_all", "volume_of_constant_noise", "with_constant_noise"]

# The noise of stabilized values is near that of the flat blocks, unless these show texture.
ALIKE = (0.6, 1.5)
UNCLEAR = "domain='stabilized': the noise does not clearly depend on the intensity; leave the domain out"
# A noise that the caller gives is that of magnitudes if it is so near to that of their air.
GIVEN_ALIKE = (0.7, 1.4)
# How far a multiple of the quantum may be from a whole number.
EXACT = 1e-3


def with_constant_noise(data: OnGrid, how: Preparation, request: Request) -> tuple[OnGrid, Preparation]:
    """Prepared data in which the noise does not depend on the intensity, and its preparation; the same where it does not.

    By default this is done for images whose noise is white and clearly depends on the intensity, if the caller gives
    nothing that is in the unit of the values.

    :raises InputError: if it is asked for and not possible.
    """
    asked = _asked(request)
    if not asked and not (_intensities(data, request) and _open(request)):
        return data, how
    stabilizer = _stabilizer_of(data, how)
    if stabilizer is None:
        if asked:
            raise InputError(UNCLEAR)
        return data, how
    source = how.source
    if stabilizer.photons and how.level is not None and not isinstance(source, Volume):
        # Where there are no photons is no lake: a few of them come there, too.
        data, how = prepared(source, request.outliers, request.level, still=False)
    stable, made = stabilized_by(data, how, stabilizer)
    if asked:
        return stable, made
    noise = _noise_in(stable, made)
    if _as_expected(noise, stabilizer):
        return stable, made
    return data, replace(how, doubt=_correlated_too(stabilizer) if noise.correlation is not None else "")


def volume_of_constant_noise(data: Volume, request: Request, unseen: Array) -> tuple[Volume, Preparation | None, Noise]:
    """A volume in which the noise does not depend on the intensity, its preparation, and its noise; the same and None where it
    does not.

    By default this is done for numbers of photons, and for magnitudes, whose air says that they are.

    :param unseen: (d, h, w), samples that are not used for the noise.
    :raises InputError: if it is asked for and not possible.
    """
    if request.domain != "magnitudes":
        stable, how = _photons_stabilized(data, request)
        noise = noise_of_volume(stable.values, unseen, data.spacing)
        if how is not None and how.stabilizer is not None:
            return stable, how, noise.stabilized(how.stabilizer)
    else:
        noise = noise_of_volume(data.values, unseen, data.spacing)
    if not _of_magnitudes(data, request, noise):
        return data, None, noise
    sigmas = (request.noise,) * len(noise.channels) if request.noise else noise.channels
    stabilizer = Stabilizer.of(tuple(Magnitudes(float(sigma)) if sigma > 0 else None for sigma in sigmas))
    if stabilizer is None:
        return data, None, noise
    stable, how = stabilized_volume(data, stabilizer)
    return stable, how, replace(noise, by_intensity=stabilizer.noise)


def _of_magnitudes(data: Volume, request: Request, noise: Noise) -> bool:
    """Whether a volume is smoothed as magnitudes.

    :raises InputError: if it is asked for and not possible.
    """
    if request.domain != "magnitudes":
        if noise.how != OF_MAGNITUDES or request.domain != "auto" or not _open(request, noise=False):
            return False
        return request.noise is None or GIVEN_ALIKE[0] < request.noise / noise.sigma < GIVEN_ALIKE[1]
    if (least := float(data.values.min(where=~_each(data.missing, data.values), initial=0.0))) < 0:
        raise InputError(f"domain='magnitudes': values of 0 or more expected, got {least:.6g}; leave the domain out")
    _must_be_without(_in_their_unit(request, noise=False), request)  # the noise is that of the magnitudes
    return True


def bias_left(request: Request, noise: Noise, how: Preparation | None) -> tuple[str, ...]:
    """A warning where values are magnitudes by their air, and something that the caller gives leaves their bias.

    :param noise: as it is found.
    :param how: how the volume was prepared.
    """
    given = _in_their_unit(request)
    if how is not None or noise.how != OF_MAGNITUDES or request.domain != "auto" or not given:
        return ()
    if request.named or request.timed:
        return ()
    return (
        f"the air is that of magnitudes with noise {noise.sigma:.3g}; since {given} is given, weak signals keep their bias; "
        "give domain='magnitudes' without it, or domain='length' if they are none",
    )


def _each(missing: Array, values: Array) -> Array:
    """The missing samples (d, h, w) for each channel of values."""
    return missing if values.ndim == missing.ndim else np.broadcast_to(missing[..., None], values.shape)


def _photons_stabilized(data: Volume, request: Request) -> tuple[Volume, Preparation | None]:
    """A volume of numbers of photons whose noise does not depend on them, and its preparation; the same and None if it is none.

    :raises InputError: if it is asked for, for any dependence, and not possible.
    """
    asked = _asked(request)
    if not asked and not (request.domain == "auto" and _open(request)):
        return data, None
    found = _of_parts(data.values, data.missing, slices_of(data.missing.shape, data.spacing))
    if not asked and not all(one is not None and one.photons for one in found):
        return data, None
    stabilizer = Stabilizer.of(found)
    if stabilizer is None and asked:
        raise InputError(UNCLEAR)
    return stabilized_volume(data, stabilizer)


def one_number_for_all(data: OnGrid, how: Preparation, request: Request) -> tuple[str, ...]:
    """A warning where the noise depends on the intensity, and something that the caller gives keeps the values as they are."""
    given = _in_their_unit(request)
    if not given or not _intensities(data, request) or request.named or request.timed:
        return ()
    stabilizer = _stabilizer_of(data, how)
    found = None if stabilizer is None else next((one for one in stabilizer.noise if one is not None), None)
    if stabilizer is None or found is None:
        return ()
    if not _as_expected(_noise_in(*stabilized_by(data, how, stabilizer)), stabilizer):
        return ()
    return (
        f"noise that depends on the intensity ({found}) is taken as one number, since {given} is given; without, less is left",
    )


def _intensities(data: OnGrid, request: Request) -> bool:
    """Whether the values are intensities, and their domain is left open."""
    return request.domain == "auto" and isinstance(data, Image) and data.intensity


def _stabilizer_of(data: OnGrid, how: Preparation) -> Stabilizer | None:
    """What makes the noise of prepared data the same at every intensity; None where it is, or is not clear."""
    values, unseen = how.above_zero(array_of(data)), data.missing | how.unseen
    way = orientation_of(values, data.missing, data.spacing)  # the same blocks however the data lies
    values, unseen = np.ascontiguousarray(way.of(values)), way.of(unseen)
    return Stabilizer.of(_of_parts(values, unseen, spread_tiles(unseen.shape, ENOUGH)))


def _asked(request: Request) -> bool:
    """Whether values of constant noise are asked for.

    :raises InputError: if something else is given that is in the unit of the values.
    """
    if request.domain != "stabilized":
        return False
    _must_be_without(_in_their_unit(request), request)
    return True


def _must_be_without(given: str, request: Request) -> None:
    """Refuse what is given in the unit of the values beside a domain of other values.

    :raises InputError: with its name.
    """
    if given:
        raise InputError(
            f"domain={request.domain!r}: {given} is in the unit of the original values, which this domain transforms; leave "
            "one of them out"
        )


def _in_their_unit(request: Request, noise: bool = True) -> str:
    """What the caller gives in the unit of the values; empty if nothing.

    :param noise: whether the noise is among it.
    """
    held = request.constraints
    given = {"noise": request.noise if noise else None, "MaxChange": held.max_change, "DataWeights": held.data_weights}
    return " and ".join(word for word, value in given.items() if value is not None)


def _open(request: Request, noise: bool = True) -> bool:
    """Whether the caller gives nothing in the unit of the values, nor a method that should run as it is.

    :param noise: whether the noise is among what is in their unit.
    """
    return not (request.named or request.timed or _in_their_unit(request, noise))


def _of_parts(values: Array, missing: Array, windows: Sequence[Window]) -> tuple[ByIntensity | None, ...]:
    """The noise of each channel by intensity, from windows, each an index that gives a part (rows, columns)."""
    stack = values.reshape(*missing.shape, -1)
    found = []
    for channel in np.moveaxis(stack, -1, 0):
        parts = [(channel[window].astype(np.float64), ~missing[window]) for window in windows]
        found.append(noise_by_intensity(parts, _counted_in(np.concatenate([z[there] for z, there in parts]))))
    return tuple(found)


def _counted_in(values: Array) -> float:
    """The quantum of values (n,) that are multiples of it from zero on; 0 for others."""
    if values.size == 0 or values.min() < 0:
        return 0.0
    quantum, _ = quantum_of(values)
    off = quantum and np.abs(values.min() / quantum - np.rint(values.min() / quantum))
    return quantum if off < EXACT else 0.0


def _noise_in(data: OnGrid, how: Preparation) -> Noise:
    """The noise of prepared data."""
    return noise_of(array_of(data), data.missing | how.unseen)


def _correlated_too(stabilizer: Stabilizer) -> str:
    """A sentence on noise that depends on the intensity and is correlated, as a camera leaves it."""
    found = next(one for one in stabilizer.noise if one is not None)
    return (
        f"the noise is correlated, and seems to depend on the intensity ({found}): one number is taken for all, which may be too "
        "much for some and too little for others; noise= sets it"
    )


def _as_expected(noise: Noise, stabilizer: Stabilizer) -> bool:
    """Whether the noise of stabilized data is white, and as large as that of the blocks."""
    if noise.correlation is not None:
        return False
    return all(
        one is None or one.photons or ALIKE[0] < sigma / one.usual < ALIKE[1]
        for one, sigma in zip(stabilizer.noise, noise.channels, strict=True)
    )
