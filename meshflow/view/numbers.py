"""Formats numbers for readers: in full, or with a power of ten; never as 1e-05."""

import numpy as np

__all__ = ["brief", "plain", "rounded"]

_POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_FULL = (1e-3, 1e6)  # numbers in between are written in full


def brief(value: float) -> str:
    """A number with three digits, without trailing zeros; with a power of ten where it would be long."""
    short = f"{value:.3g}"
    return plain(value) if "e" in short else short.replace("-", "−")


def plain(value: float, largest: float | None = None, digits: int = 3) -> str:
    """A number in full: 2540, not 2.54e+03; longer numbers as a multiple of a power of ten: 1.02 × 10⁻⁶.

    :param largest: of several numbers shown together, which all get its decimals; None: the number itself.
    :param digits: of the largest; a whole number has all its digits.
    """
    most = abs(value if largest is None else largest)
    if not np.isfinite(value) or not np.isfinite(most) or value == 0 or most == 0:
        return f"{value:g}"
    power = int(np.floor(np.log10(most) + 1e-12))
    factor = 0 if _FULL[0] <= most < _FULL[1] else 3 * (power // 3)
    decimals = max(digits - 1 - (power - factor), 0)
    shown = f"{value / 10.0**factor:.{decimals}f}".replace("-", "−")
    return f"{shown} × 10{str(factor).translate(_POWERS)}" if factor else shown


def rounded(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed a positive number."""
    slack = 1 + 1e-9
    power = 10.0 ** np.floor(np.log10(value * slack))
    return float(power * max(digit for digit in (1, 2, 5) if digit * power <= value * slack))
