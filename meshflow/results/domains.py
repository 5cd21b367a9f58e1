"""Runs in another domain: inverse depths, and colours in a space that is closer to what the eye sees."""

from dataclasses import replace
from typing import get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter
from meshflow.estimate.planner import noise_in
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import Array
from meshflow.results.inverse_depths import in_inverse_depths, smoothed_in_disparity
from meshflow.results.result import Result
from meshflow.results.run import run
from meshflow.surfaces.colour_space import COLOUR_SPACES, ColourSpace, ColourWord
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

__all__ = ["run_in_domain"]

# The values of white: of floating point, 8 and 16 bit; noise may exceed the first by this factor.
WHITES, ABOVE = (1.0, 255.0, 65535.0), 1.5
# Half the difference with which a noise in values is brought into a colour space, a share of white.
DIFFERENCE = 1e-3


def run_in_domain(data: Data, request: Request, progress: Progress = None, *, record: bool | None = True) -> Result:
    """:func:`meshflow.results.run.run` in the domain of the request.

    :raises InputError: for a domain that does not suit the data.
    """
    if isinstance(data, RangeImage) and smoothed_in_disparity(data, request):
        return in_inverse_depths(data, request, progress, record)
    for word in get_args(ColourWord):
        if request.domain == word:
            return _in_colours(data, word, request, progress, record)
    return run(data, request, progress, record=record)


def _in_colours(data: Data, word: ColourWord, request: Request, progress: Progress, record: bool | None) -> Result:
    """Smooth colours in another space; samples that did not change keep their bits, and alpha is not touched."""
    colours = _colours_of(data, word)
    space, white = COLOUR_SPACES[word], _white(colours, word)
    gone = ~_there(data)[..., None]
    inside = space.of(np.where(gone, 0.0, colours).astype(np.float64) / white).astype(colours.dtype)
    within = _with_colours(data, inside)
    given = request.noise
    if given is not None:
        request = replace(request, noise=given * _growth(colours[_there(data)] / white, space) / white)
    found = run(within, replace(request, domain="length"), progress, record=record)
    smooth = array_of(found.after)
    same = gone | (smooth == inside).all(axis=-1, keepdims=True)
    back = np.where(same, colours, white * space.back(smooth.astype(np.float64))).astype(colours.dtype)
    done = _with_colours(found.after, np.concatenate([back, array_of(data)[..., 3:]], axis=-1))
    parameters = _of_colours(found, space, word, white)
    below = int((colours[_there(data)] < 0).sum())
    taken = "they were taken for zero" if space.positive else "they were smoothed with their sign"
    warnings = (f"{below} values below zero are no colours: {taken}",) if below else ()
    noise = noise_in(data) if given is None else Noise(given, 0.0, how="given")
    return replace(
        found, data=done, after=done, before=data, parameters=parameters, noise=noise,
        warnings=(*warnings, *found.warnings), plan=None,
    )  # fmt: skip


def _colours_of(data: Data, word: str) -> Array:
    """Red, green and blue (..., 3) of an image, or of a mesh whose colours move, without alpha.

    :raises InputError: for data without colours.
    """
    colours = array_of(data) if isinstance(data, (Image, Mesh)) else np.empty(0)
    if isinstance(data, Mesh) and (data.channels is None or data.moves == "points"):
        colours = np.empty(0)
    if not colours.ndim or colours.shape[-1] not in (3, 4) or (isinstance(data, Image) and colours.ndim != 3):
        raise InputError(
            f"domain={word!r}: of three colours, or of four channels of which the last is alpha, of an image or of the vertices "
            f"of a mesh; got {data!r}; leave the domain out"
        )
    return colours[..., :3]


def _there(data: Data) -> Array:
    """Which samples, or vertices, are not missing."""
    return np.ones(len(data.points), bool) if isinstance(data, Mesh) else ~np.asarray(data.missing)


def _with_colours(data: Data, colours: Array) -> Data:
    """The data with other colours (..., 3); a run moves these alone, and alpha stays with the result."""
    if isinstance(data, Mesh):
        return replace(data, channels=colours)
    return replace(data, values=colours) if isinstance(data, Image) else data


def _white(colours: Array, word: str) -> float:
    """The value of white: 1, 255 or 65535, by the brightest samples.

    :raises InputError: for values above those of 16 bit.
    """
    brightest = float(np.nanquantile(colours, 0.999))
    for white in WHITES:
        if brightest <= white * (ABOVE if white == 1.0 else 1.25):
            return white
    raise InputError(
        f"domain={word!r}: colours up to 1, 255 or 65535 expected, got {brightest:.6g}; divide by the value of white, or "
        "leave the domain out"
    )


def _growth(colours: Array, space: ColourSpace) -> float:
    """By what an error of the values grows in the space: the median over colours (n, 3), shares of white."""
    squares = np.zeros(len(colours))
    for step in DIFFERENCE * np.eye(3):
        change = (space.of(colours + step) - space.of(colours - step)) / (2.0 * DIFFERENCE)
        squares += np.square(change).mean(axis=-1)
    return float(np.sqrt(np.median(squares)))


def _of_colours(found: Result, space: ColourSpace, word: str, white: float) -> dict[str, Parameter]:
    """The parameters of a run in a colour space, with the noise of each of its channels."""
    reported = dict(found.parameters)
    contrast = reported.get("contrast")
    if contrast is not None:
        reported["contrast"] = replace(contrast, unit=f"{contrast.unit} of {space.name}")
    for name, sigma in zip(space.channels, found.noise.channels, strict=False):
        reported[f"noise {name}"] = Parameter(float(sigma), "", "estimated", f"in {space.name}")
    reported["domain"] = Parameter(word, "", "given", f"{space.name}; noise and contrast are in its units")
    reported["white"] = Parameter(white, "", "estimated", "from the brightest samples")
    return reported
