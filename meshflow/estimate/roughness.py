"""Chooses which parts of a grid or a volume a search looks at: those of every roughness in proportion."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["of_every_roughness"]

Part = TypeVar("Part")


def of_every_roughness(parts: Sequence[Part], count: int, of_part: Callable[[Part], tuple[Array, Array]]) -> list[Part]:
    """``count`` of the parts, at even steps of their order by roughness.

    Evenly spaced parts alone may all lie beside a front that crosses the data in a row of none of them.

    :param of_part: its values (k, ...) and the mask (...) of its missing samples.
    :returns: in the order in which they came; all of them if they are hardly more.
    """
    if len(parts) <= 1.5 * count:
        return list(parts)
    order = np.argsort([_roughness(*of_part(part)) for part in parts], kind="stable")
    return [parts[i] for i in np.sort(order[((np.arange(count) + 0.5) * len(parts) / count).astype(int)])]


def _roughness(values: Array, missing: Array) -> float:
    """The mean squared departure of values (k, ...) from a plane, over all channels; missing samples are taken as their mean."""
    values, axes = values.astype(np.float64), tuple(range(1, values.ndim))
    if missing.any():
        values = np.where(missing, np.mean(values, axis=axes, where=~missing, keepdims=True), values)
    rest = np.var(values, axis=axes)
    for axis in axes:
        along = np.arange(values.shape[axis]) - 0.5 * (values.shape[axis] - 1)
        slope = values.mean(axis=tuple(other for other in axes if other != axis)) @ along / max(along @ along, 1.0)
        rest = rest - np.square(slope) * np.mean(np.square(along))
    return float(rest.sum())
