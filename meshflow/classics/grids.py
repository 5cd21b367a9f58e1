"""Classic schemes on grids: the four neighbours of Perona and Malik, and the Beltrami flow by finite differences."""

from typing import Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.conductances import conductance_of
from meshflow.geometry.validation import Array, positive, whole

__all__ = ["beltrami", "perona_malik"]


def perona_malik(
    image: Array,
    contrast: float,
    conductance: Literal["rational", "exponential", "tukey"] = "rational",
    dt: float = 0.25,
    steps: int = 20,
) -> Array:
    """The scheme of Perona and Malik [PM90]: u += dt sum g(contrast |D|) D over the differences D to the four neighbours.

    P. Perona, J. Malik, IEEE Trans. Pattern Analysis and Machine Intelligence 12 (1990), 629-639: each difference has a
    conductance of its own, and there is no flux across the border. The method ``perona-malik`` has one conductance per triangle
    instead.

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import mesas, noisy
        >>> truth = mesas(64)
        >>> found = perona_malik(noisy(truth, 2.0), contrast=1.0)
        >>> bool(np.std(found - truth) < 1.2)  # of 2.0
        True

    :param image: (h, w), or (h, w, k), whose channels are smoothed one by one; lengths in samples.
    :param contrast: 1 / K, per unit of the values.
    :param conductance: g(s): 1 / (1 + s^2), exp(-s^2), or (1 - s^2)^2 up to s = 1.
    :param dt: of a step, up to 1/4, up to which no value leaves its range.
    :param steps: number of steps, 0 or more.
    :returns: a new array.
    :raises InputError: for invalid arrays or parameters.
    """
    u, g = _ready(image, "perona_malik"), conductance_of(conductance)
    positive(contrast, "contrast")
    if not 0 < dt <= 0.25:
        raise InputError(f"perona_malik: dt above 0 and up to 1/4 expected, got {dt}")
    for _ in range(whole(steps, "steps", 0)):
        rate = np.zeros_like(u)
        for axis in (0, 1):
            difference = np.diff(u, axis=axis)
            flux = g.of((contrast * difference) ** 2) * difference
            rate += _divergence(flux, axis)
        u += dt * rate
    return u


def beltrami(image: Array, contrast: float = 1.0, dt: float = 0.2, steps: int = 20) -> Array:
    """The Beltrami flow by finite differences [KMS97], [SKM98], grey or in colours.

    I^a_t = 1/sqrt(g) d_mu (sqrt(g) g^mu nu d_nu I^a), g_mu nu = delta_mu nu + contrast^2 sum_a d_mu I^a d_nu I^a: forward
    differences for the gradient and the metric, backward ones for the divergence, no flux across the border. R. Kimmel, R.
    Malladi, N. Sochen, CVPR 1997, 350-355; N. Sochen, R. Kimmel, R. Malladi, IEEE Trans. Image Process. 7 (1998), 310-318 (the
    equation is also that of section 2.2 of the paper; their differences could not be checked). First order in space; the method
    ``beltrami`` has triangles instead, and converges at second order.

    Example:

        >>> from meshflow.synthetic import mesas, noisy
        >>> beltrami(noisy(mesas(32), 2.0), contrast=1.0, steps=5).shape
        (32, 32)

    :param image: (h, w) or (h, w, k), channels coupled; lengths in samples.
    :param contrast: beta, length per unit of the values.
    :param dt: of a step, up to 1/4.
    :param steps: number of steps, 0 or more.
    :returns: a new array.
    :raises InputError: for invalid arrays or parameters.
    """
    u = _ready(image, "beltrami")
    positive(contrast, "contrast")
    if not 0 < dt <= 0.25:
        raise InputError(f"beltrami: dt above 0 and up to 1/4 expected, got {dt}")
    flat = u.reshape(*u.shape[:2], -1)
    for _ in range(whole(steps, "steps", 0)):
        flat += dt * _beltrami_rate(flat, contrast)
    return u


def _beltrami_rate(u: Array, contrast: float) -> Array:
    """The rate (h, w, k) of :func:`beltrami`."""
    x, y = (_padded(np.diff(u, axis=axis), axis) for axis in (1, 0))
    xx, xy, yy = (contrast**2 * np.einsum("hwk,hwk->hw", *pair) for pair in ((x, x), (x, y), (y, y)))
    e, g = 1.0 + xx, 1.0 + yy
    root = np.sqrt(e * g - xy**2)
    along = (g[..., None] * x - xy[..., None] * y) / root[..., None]
    down = (e[..., None] * y - xy[..., None] * x) / root[..., None]
    total = _divergence(along[:, :-1], 1) + _divergence(down[:-1], 0)
    return total / root[..., None]


def _padded(difference: Array, axis: int) -> Array:
    """A forward difference with a zero at the end, where there is no neighbour."""
    shape = list(difference.shape)
    shape[axis] = 1
    return np.concatenate([difference, np.zeros(shape)], axis=axis)


def _divergence(flux: Array, axis: int) -> Array:
    """What flows in minus what flows out, of fluxes between neighbours along an axis."""
    edge = [(0, 0)] * flux.ndim
    edge[axis] = (1, 1)
    return np.diff(np.pad(flux, edge), axis=axis)


def _ready(image: Array, name: str) -> Array:
    """A copy of an image in double precision.

    :raises InputError: for anything else.
    """
    u = np.array(image, dtype=np.float64)
    if u.ndim not in (2, 3) or min(u.shape[:2]) < 2 or not np.isfinite(u).all():
        raise InputError(
            f"{name}: finite values (h, w) or (h, w, k), two samples or more on each side, expected, got shape {u.shape}"
        )
    return u
