"""Finds outliers: values far from all others, and impulses that differ from all their neighbours."""

from dataclasses import dataclass

import numpy as np

from meshflow.estimate.far_values import FarRule, far_by, far_of, large_pieces
from meshflow.estimate.impulses import ImpulseRule, impulses_by, impulses_of
from meshflow.geometry.validation import Array

__all__ = ["OutlierRule", "Outliers", "large_pieces", "outliers_by", "outliers_of", "rule_of"]

# More than this share of all samples, as where each channel has impulses of its own, cannot be replaced from the few others.
FILLED = 0.55


@dataclass(frozen=True)
class OutlierRule:
    """What an outlier is in a grid. Found on the whole, it tells of any part which samples are.

    :ivar channels: of each one what is far outside, and what is an impulse.
    :ivar span: least and largest value of the samples that are none.
    """

    channels: tuple[tuple[FarRule, ImpulseRule], ...]
    span: tuple[float, float]

    @property
    def dense(self) -> bool:
        """Whether impulses are so many that they come from the sensor, and not from the scene."""
        return any(impulses.dense for _, impulses in self.channels)

    @property
    def reach(self) -> int:
        """How far away a sample decides whether another one is an outlier."""
        far = max(far.reach for far, _ in self.channels)
        return far + max(impulses.reach for _, impulses in self.channels)


@dataclass(frozen=True, eq=False)
class Outliers:
    """Outliers of a grid.

    :ivar far: (h, w), values far from all others: undeclared missing samples, overflows.
    :ivar impulses: (h, w), samples that differ from all their neighbours: hot pixels, salt and pepper.
    :ivar value: of the far samples, if they are all equal; else None.
    :ivar span: least and largest value of the others.
    :ivar dense: whether the impulses are so many that they come from the sensor, and not from the scene.
    """

    far: Array
    impulses: Array
    value: float | None
    span: tuple[float, float]
    dense: bool = False

    @property
    def mask(self) -> Array:
        """All outliers (h, w)."""
        return self.far | self.impulses


def outliers_of(values: Array, missing: Array, level: Array | None = None) -> Outliers | None:
    """The outliers of a grid; None where there are none.

    A sample is an outlier if one of its channels is. Far values are farther from the median than ten times the range of the
    middle 98 %, have one value or form pieces of few samples, and are separated from their neighbours by a cliff. Impulses
    differ from the median of the 5 x 5 samples around them by six robust deviations, and from each neighbour (as in Garnett and
    others 2005).

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w).
    :param level: (h, w), exactly level regions, beside which noise is no impulse; None: there are none.
    """
    return rule_of(values, missing, level)[1]


def rule_of(values: Array, missing: Array, level: Array | None = None) -> tuple[OutlierRule | None, Outliers | None]:
    """The rule of what an outlier is in a grid, and :func:`outliers_of` it; None where no sample is there that tells."""
    channels = list(np.moveaxis(values.reshape(*missing.shape, -1), 2, 0))
    far_rules, far = [], np.zeros(missing.shape, bool)
    for channel in channels:
        rule, found = far_of(channel, ~missing)
        far_rules.append(rule)
        far |= found
    there = _there(missing, far, level)
    if not there.any():
        return None, None
    rules: list[ImpulseRule] = []
    impulses = np.zeros(missing.shape, bool)
    for by_value in (True, False):
        rules, impulses = [], np.zeros(missing.shape, bool)
        for channel in channels:
            own, found = impulses_of(channel, there, by_value)
            rules.append(own)
            impulses |= found
        if impulses.sum() <= FILLED * there.sum():
            break
    left = there & ~impulses if (there & ~impulses).any() else there
    span = min(float(z[left].min()) for z in channels), max(float(z[left].max()) for z in channels)
    made = OutlierRule(tuple(zip(far_rules, rules, strict=True)), span)
    return made, _outliers(values, far, impulses, made)


def outliers_by(rule: OutlierRule, values: Array, missing: Array, level: Array | None = None) -> Outliers | None:
    """The outliers of a part of a grid by the rule of the whole; None where there are none.

    :param values: (r, c) or (r, c, k); ``missing``, ``level``: (r, c).
    """
    channels = list(np.moveaxis(values.reshape(*missing.shape, -1), 2, 0))
    far, impulses = np.zeros(missing.shape, bool), np.zeros(missing.shape, bool)
    for channel, (of_far, _) in zip(channels, rule.channels, strict=True):
        far |= far_by(of_far, channel, ~missing)
    there = _there(missing, far, level)
    for channel, (_, of_impulses) in zip(channels, rule.channels, strict=True):
        impulses |= impulses_by(of_impulses, channel, there)
    return _outliers(values, far, impulses, rule)


def _there(missing: Array, far: Array, level: Array | None) -> Array:
    """The samples (h, w) among which impulses are sought."""
    return ~(missing | far) if level is None else ~(missing | far | level)


def _outliers(values: Array, far: Array, impulses: Array, rule: OutlierRule) -> Outliers | None:
    """Far samples and impulses (h, w) as outliers; None where there are none."""
    if not (far.any() or impulses.any()):
        return None
    alone = np.unique(values[far]) if far.any() else np.zeros(0)
    return Outliers(far, impulses, float(alone[0]) if len(alone) == 1 else None, rule.span, rule.dense)
