"""The hierarchy of low curvature image simplifiers, and the compression of contrast by it [TT99]."""

from collections.abc import Sequence

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.controls import Until
from meshflow.flow.engines.samples import SampleFlow
from meshflow.flow.march import march
from meshflow.flow.methods.lcis import LowCurvatureScheme
from meshflow.geometry.validation import Array, positive, real
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.image import Image

__all__ = ["compressed", "hierarchy"]


def hierarchy(image: Array, contrasts: Sequence[float] | float, time: float = 20.0) -> tuple[Array, ...]:
    """The base of an image, and its details from coarse to fine; together they are the image.

    Each level is the low curvature image simplifier of the image (method ``low-curvature``) with one of the contrasts; the
    details are the differences of neighbouring levels. J. Tumblin, G. Turk, SIGGRAPH 1999, section 4.

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import mesas
        >>> base, *details = hierarchy(mesas(32), (0.01, 0.1), time=2.0)
        >>> bool(np.allclose(base + sum(details), mesas(32)))
        True

    :param image: (h, w), for example logarithms of luminance.
    :param contrasts: rising, per unit of the values: the lower one leaves less in its level. The first is that of the base.
        One alone gives a base and one detail.
    :param time: of each simplifier, squared samples.
    :raises InputError: for contrasts that do not rise, or another image.
    """
    u, numbers = real(image, "image").astype(np.float64), np.atleast_1d(np.asarray(contrasts))
    rising = [positive(c, "contrast") for c in numbers.ravel().tolist()]
    if u.ndim != 2 or not rising or sorted(rising) != rising:
        raise InputError(f"hierarchy: an image (h, w) and rising contrasts expected, got shape {u.shape} and {rising}")
    positive(time, "time", "squared samples")
    levels = []
    for contrast in rising:
        flow = SampleFlow(Image(u).gridded(Lift(contrast)), LowCurvatureScheme(contrast), "low-curvature")
        *_, end = march(flow, Until(time=time), "auto")
        levels.append(np.asarray(end.u, dtype=np.float64).reshape(u.shape))
    levels.append(u)
    return (levels[0], *(fine - coarse for coarse, fine in zip(levels[:-1], levels[1:], strict=True)))


def compressed(image: Array, contrasts: Sequence[float] | float, base: float = 0.3, time: float = 20.0) -> Array:
    """An image with the contrast of its base multiplied by ``base``, and its details as they are (detail-preserving reduction).

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import mesas
        >>> bool(np.ptp(compressed(mesas(32), (0.01, 0.1), time=2.0)) < np.ptp(mesas(32)))
        True

    :param image: (h, w), logarithms of luminance; a displayable picture is the exponential of the result.
    :param contrasts: as in :func:`hierarchy`.
    :param base: factor on the deviation of the base from its mean, in (0, 1].
    :param time: as in :func:`hierarchy`.
    """
    if not positive(base, "base") <= 1:
        raise InputError(f"base: a factor above 0, at most 1, expected, got {base}")
    coarse, *details = hierarchy(image, contrasts, time)
    middle = float(coarse.mean())
    return middle + base * (coarse - middle) + sum(details)
