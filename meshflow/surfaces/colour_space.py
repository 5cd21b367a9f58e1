"""Colour spaces in which distances are closer to those that the eye sees: CIE L*u*v* and L*a*b*, and linear light.

Colours are sRGB (IEC 61966-2-1) of white (1, 1, 1) and D65. L*u*v* and L*a*b* are those of CIE 15.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["COLOUR_SPACES", "ColourSpace", "ColourWord"]

ColourWord = Literal["luv", "lab", "linear-rgb"]

# Linear RGB to XYZ, Y of white 1.
XYZ = np.array([[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]])
RGB = np.linalg.inv(XYZ)
WHITE = np.array([0.95047, 1.0, 1.08883])
# Where the curves of the CIE and of sRGB become straight, and their slopes there.
CIE, CIE_SLOPE = (6.0 / 29.0) ** 3, (29.0 / 3.0) ** 3
KNEE, KNEE_SLOPE = 0.04045, 12.92
# The least v': that of blue is 0.158, and no mixture of colours is below it.
LEAST_V = 0.05


@dataclass(frozen=True)
class ColourSpace:
    """A colour space.

    :ivar name: as the field has it; ``channels``: their names.
    :ivar of: (..., 3) of the space, from sRGB (..., 3); ``back``: the inverse.
    :ivar positive: whether it is defined for values of zero or more only.
    """

    name: str
    channels: tuple[str, str, str]
    of: Callable[[Array], Array]
    back: Callable[[Array], Array]
    positive: bool = False


def _linear(rgb: Array) -> Array:
    """Linear light from sRGB; negative values as positive ones, with their sign."""
    size = np.abs(rgb)
    return np.copysign(np.where(size <= KNEE, size / KNEE_SLOPE, ((size + 0.055) / 1.055) ** 2.4), rgb)


def _encoded(linear: Array) -> Array:
    """The inverse of :func:`_linear`."""
    size = np.abs(linear)
    curved = 1.055 * size ** (1.0 / 2.4) - 0.055
    return np.copysign(np.where(size <= KNEE / KNEE_SLOPE, size * KNEE_SLOPE, curved), linear)


def _lightness(share: Array) -> Array:
    """L* (0 to 100) from a share of white; (L* + 16) / 116 is f of L*a*b*."""
    return np.where(share > CIE, 116.0 * np.cbrt(share) - 16.0, CIE_SLOPE * share)


def _share(lightness: Array) -> Array:
    """The inverse of :func:`_lightness`."""
    return np.where(lightness > 8.0, ((lightness + 16.0) / 116.0) ** 3, lightness / CIE_SLOPE)


def _lab(rgb: Array) -> Array:
    f = (_lightness(_linear(rgb) @ XYZ.T / WHITE) + 16.0) / 116.0
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


def _from_lab(lab: Array) -> Array:
    lightness, a, b = np.moveaxis(lab, -1, 0)
    y = (lightness + 16.0) / 116.0
    f = np.stack([y + a / 500.0, y, y - b / 200.0], axis=-1)
    return _encoded(_share(116.0 * f - 16.0) * WHITE @ RGB.T)


def _chromaticity(xyz: Array) -> tuple[Array, Array]:
    """u' and v'; those of white for black, which has none."""
    x, y, z = np.moveaxis(xyz, -1, 0)
    total = x + 15.0 * y + 3.0 * z
    black = total <= 0.0
    of = np.where(black, 1.0, total)
    white = WHITE @ np.array([1.0, 15.0, 3.0])
    return np.where(black, 4.0 * WHITE[0] / white, 4.0 * x / of), np.where(black, 9.0 / white, 9.0 * y / of)


def _luv(rgb: Array) -> Array:
    xyz = _linear(np.maximum(rgb, 0.0)) @ XYZ.T
    lightness, (u, v), (u0, v0) = _lightness(xyz[..., 1]), _chromaticity(xyz), _chromaticity(WHITE)
    return np.stack([lightness, 13.0 * lightness * (u - u0), 13.0 * lightness * (v - v0)], axis=-1)


def _from_luv(luv: Array) -> Array:
    lightness, (u0, v0) = np.maximum(luv[..., 0], 0.0), _chromaticity(WHITE)
    over = np.divide(1.0, 13.0 * lightness, out=np.zeros_like(lightness), where=lightness > 0.0)
    u, v = luv[..., 1] * over + u0, np.maximum(luv[..., 2] * over + v0, LEAST_V)
    y = _share(lightness)
    xyz = np.stack([2.25 * y * u / v, y, y * (3.0 - 0.75 * u - 5.0 * v) / v], axis=-1)
    return _encoded(xyz @ RGB.T)


COLOUR_SPACES: Mapping[ColourWord, ColourSpace] = MappingProxyType(
    {
        "luv": ColourSpace("CIE L*u*v*", ("L*", "u*", "v*"), _luv, _from_luv, positive=True),
        "lab": ColourSpace("CIE L*a*b*", ("L*", "a*", "b*"), _lab, _from_lab),
        "linear-rgb": ColourSpace("linear light", ("red", "green", "blue"), _linear, _encoded),
    }
)
