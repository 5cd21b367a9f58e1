"""Prepares the samples of a grid for the flow, and restores them: outliers, level regions, offsets of lines, a far datum, noise
that depends on the intensity.
"""

from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np

from meshflow.estimate.far_values import PIECE
from meshflow.estimate.jpeg import Jpeg, jpeg_of
from meshflow.estimate.outliers import OutlierRule, Outliers, large_pieces, outliers_by, rule_of
from meshflow.estimate.plateaus import Level as LevelRule
from meshflow.estimate.plateaus import level_of, level_rule
from meshflow.estimate.ring_fill import RINGS, filled_from_ring
from meshflow.estimate.stabilizer import Stabilizer
from meshflow.estimate.stripes import Level, offsets_to_level
from meshflow.geometry.validation import Array, false_on, nowhere
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume

__all__ = [
    "AS_DATA", "Cleaning", "OutlierWord", "Preparation", "datum_between", "level_said", "lowered_by", "prepared",
    "stabilized_by", "stabilized_volume",
]  # fmt: skip

OutlierWord = Literal["keep", "repair", "include"]
# The ratio of level to range at which a datum is subtracted; differences are exact, but single precision would lose them.
DISTANT = 4.0

OnGrid = HeightField | Image
Prepared = TypeVar("Prepared", bound=HeightField | Image | Volume)


@dataclass(frozen=True)
class Cleaning:
    """What is done about the outliers of a grid, the same for a window of it.

    :ivar rule: of the whole; None: they are taken as data.
    :ivar word: as the caller says.
    """

    rule: OutlierRule | None = None
    word: OutlierWord | None = None

    @property
    def insists(self) -> bool:
        """Whether replaced samples stay replaced where no noise is found."""
        return self.rule is not None and (self.word == "repair" or self.rule.dense)

    @property
    def reach(self) -> int:
        """How far away a sample decides what becomes of another one; far samples in large pieces are not replaced."""
        return 0 if self.rule is None else self.rule.reach + PIECE + RINGS


# Outliers are taken as data.
AS_DATA = Cleaning()


@dataclass(frozen=True, eq=False)
class Preparation:
    """The preparation of a grid for the flow.

    :ivar source: the original data.
    :ivar outliers: of the data; None: there are none, or they were not looked for.
    :ivar repaired: (h, w), outliers that were replaced from their neighbours.
    :ivar datum: subtracted from all values of a channel, () or (k,).
    :ivar levelled: whether offsets of lines were removed.
    :ivar cleaning: what is done about outliers.
    :ivar level: (h, w), samples of level regions beside noise, which do not move; None: there are none.
    :ivar stabilizer: makes values with the same noise at every intensity of ``plain``, (h, w) or (h, w, k), those without it;
        None: the flow has the values as they are.
    :ivar doubt: why the noise is not the same at every intensity, a sentence; empty: it is, or nothing is known.
    """

    source: OnGrid | Volume
    outliers: Outliers | None
    repaired: Array
    datum: Array
    levelled: bool = False
    cleaning: Cleaning = AS_DATA
    level: Array | None = None
    stabilizer: Stabilizer | None = None
    plain: Array = field(default_factory=nowhere)
    doubt: str = ""

    @property
    def unseen(self) -> Array:
        """The samples (h, w) that are not used for the noise: level regions, and replaced samples, if they are few."""
        few = self.outliers is not None and not self.outliers.dense
        unseen = self.repaired if few else false_on(self.repaired.shape)
        return unseen if self.level is None else unseen | self.level

    @property
    def compression(self) -> Jpeg | None:
        """What JPEG has done to a picture; None where it has not."""
        return jpeg_of(self.source.values, self.source.missing) if isinstance(self.source, Image) else None

    @property
    def rounding(self) -> float:
        """Half the rounding step of the source, where a datum was subtracted; smaller values are no noise."""
        if not self.datum.any():
            return 0.0
        values = array_of(self.source)
        return 0.5 * float(np.spacing(np.abs(self.datum).max().astype(values.dtype)))

    def seen(self, values: Array) -> Array:
        """Values of the flow as those of the source."""
        return self.above_zero(values) if self.stabilizer is None else self.stabilizer.back(values)

    def above_zero(self, values: Array) -> Array:
        """Values above the datum as values above zero."""
        return (values + self.datum).astype(values.dtype) if self.datum.any() else values

    def replaced(self, idle: bool) -> Array:
        """The samples (h, w) that the result has from their neighbours.

        :param idle: whether nothing was smoothed.
        """
        return self.repaired if self.cleaning.insists or not idle else false_on(self.repaired.shape)

    def warnings(self, idle: bool) -> tuple[str, ...]:
        """Sentences about outliers and level regions, and what became of them."""
        said = [] if self.outliers is None else _said(self.outliers, self.replaced(idle))
        count = 0 if self.level is None or idle else int(self.level.sum())
        return (*said, *([level_said(count)] if count else []), *([self.doubt] if self.doubt and not idle else []))

    def beside(self, idle: str) -> str:
        """The reason why nothing was smoothed, with what was changed all the same."""
        count = int(self.replaced(True).sum())
        done = [f"{count} outlier{'s were' if count > 1 else ' was'} replaced"] * (count > 0)
        done += ["the lines were levelled"] * self.levelled
        if not done:
            return idle
        idle = idle.replace("nothing was changed", "nothing else was changed").replace("data left", "all else left")
        return f"{' and '.join(done)}; {idle}"

    def restored(self, done: Prepared, idle: bool) -> Prepared:
        """The result for the caller: with the datum, and with samples that were left out unchanged to the bit.

        :param idle: whether nothing was smoothed.
        """
        stable = self.stabilizer
        if self.outliers is None and not self.levelled and not self.datum.any() and stable is None:
            return done  # a flow leaves missing samples as they are
        source, values = array_of(self.source), array_of(done)
        if stable is not None:  # the mean of a value that kept its noise is not that value
            values = np.where(values == stable.stabilized(self.plain), self.plain, stable.back(values))
        if self.datum.any():
            values = (values.astype(np.float64) + self.datum).astype(source.dtype)
        made = self.replaced(idle)
        out = self.source.missing if self.outliers is None else self.source.missing | self.outliers.mask & ~made
        values = np.where(out if values.ndim == out.ndim else out[..., None], source, values)
        return _with(done, values, self.source.missing)


def prepared(
    data: OnGrid, outliers: OutlierWord | None = None, level: Level | None = None, *, still: bool = True
) -> tuple[OnGrid, Preparation]:
    """The data for the flow, and its preparation.

    Outliers become missing or are replaced from their neighbours; offsets of lines are removed on request; a datum is
    subtracted from values far from zero in single precision, so that no digits of their differences are lost. Regions that are
    exactly level beside noise, such as lakes, stay fixed.

    :param outliers: ``keep``: left out and unchanged; ``repair``: replaced; ``include``: taken as data. None: single ones of
        images are repaired, others kept.
    :param level: ``rows`` or ``columns``; None: none, but a warning where they are shifted against each other.
    :param still: whether level regions stay.
    """
    # Sums depend on the order of memory; the result must not.
    values, missing = np.ascontiguousarray(array_of(data)), data.missing
    flat = _level(data, values, missing) if still else None
    rule, found = (None, None) if outliers == "include" else rule_of(values, missing, flat)
    cleaning = Cleaning(rule, outliers)
    cleaned = _cleaned(data, values, found, cleaning)
    if cleaned.missing.all():
        return prepared(data, "include", level, still=still)
    values, missing = cleaned.values, cleaned.missing
    if level is not None:
        values = (values - offsets_to_level(values, missing, level)).astype(values.dtype)
    flat = None if flat is None else flat & ~missing
    datum = _datum(values, missing)
    values = _above(values, missing, datum)
    how = Preparation(data, found, cleaned.repaired, datum, level is not None, cleaning, flat)
    data = data if flat is None else replace(data, fixed=data.fixed | flat)
    return (data if values is array_of(data) else _with(data, values, missing)), how


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A grid without its outliers.

    :ivar values: with those that are replaced; ``missing``: (h, w), with those that are not.
    :ivar repaired: (h, w), those that were replaced.
    """

    values: Array
    missing: Array
    repaired: Array


def _cleaned(data: OnGrid, values: Array, found: Outliers | None, how: Cleaning) -> Cleaned:
    """A grid whose outliers were found, without them."""
    missing, repaired = data.missing, false_on(data.missing.shape)
    if found is None:
        return Cleaned(values, missing, repaired)
    wanted = found.mask & ~_kept(data, found, how.word) & ~data.fixed
    values, repaired = filled_from_ring(values, wanted, missing | (found.mask & ~wanted))
    return Cleaned(values, missing | (found.mask & ~repaired), repaired)


def _level(data: OnGrid, values: Array, missing: Array) -> Array | None:
    """The level regions (h, w) beside noise; None where there are none, and where nothing is beside them."""
    rule = level_rule(values, missing, narrow=isinstance(data, HeightField))
    level = level_of(values, missing, rule) if rule else None
    return level if level is not None and level.any() and not (level | missing).all() else None


def stabilized_volume(data: Volume, stabilizer: Stabilizer | None) -> tuple[Volume, Preparation | None]:
    """A volume with the same noise at every intensity, and its preparation; the same and None where there is no stabilizer."""
    if stabilizer is None:
        return data, None
    none = np.zeros(data.missing.shape, bool)
    how = Preparation(data, None, none, np.zeros(data.values.shape[3:]), stabilizer=stabilizer, plain=data.values)
    return replace(data, values=stabilizer.stabilized(data.values)), how


def stabilized_by(data: OnGrid, how: Preparation, stabilizer: Stabilizer | None) -> tuple[OnGrid, Preparation]:
    """Prepared data with the same noise at every intensity, and its preparation; the same where there is no stabilizer.

    It needs no datum: stabilized values are near zero.
    """
    if stabilizer is None:
        return data, how
    values = how.above_zero(array_of(data))
    how = replace(how, stabilizer=stabilizer, plain=values, datum=np.zeros_like(how.datum))
    return _with(data, stabilizer.stabilized(values), data.missing), how


def lowered_by(
    data: OnGrid, datum: Array, still: LevelRule = "", cleaning: Cleaning = AS_DATA
) -> tuple[OnGrid | None, Preparation]:
    """A window of a grid for the flow, and its preparation, as :func:`prepared` does it with the whole.

    :param datum: of the whole grid, () or (k,).
    :param still: what is level in the whole grid.
    :param cleaning: what is done about outliers.
    :returns: None in place of the window where no sample is left.
    """
    values = np.ascontiguousarray(array_of(data))
    flat = level_of(values, data.missing, still) if still else None
    found = None if cleaning.rule is None else outliers_by(cleaning.rule, values, data.missing, flat)
    cleaned = _cleaned(data, values, found, cleaning)
    flat = None if flat is None else flat & ~cleaned.missing
    lowered = _above(cleaned.values, cleaned.missing, datum)
    how = Preparation(data, found, cleaned.repaired, datum, cleaning=cleaning, level=flat)
    if cleaned.missing.all():
        return None, how
    data = data if flat is None else replace(data, fixed=data.fixed | flat)
    return (data if lowered is array_of(data) else _with(data, lowered, cleaned.missing)), how


def _above(values: Array, missing: Array, datum: Array) -> Array:
    """Values above a datum, zero where missing; the same array where the datum is zero."""
    if not datum.any():
        return values
    return np.where(missing if values.ndim == 2 else missing[..., None], 0, values - datum.astype(values.dtype))


def _with(data: Prepared, values: Array, missing: Array) -> Prepared:
    """Data with other values and other missing samples."""
    if isinstance(data, HeightField):
        return replace(data, z=values, missing=missing)
    return replace(data, values=values, missing=missing)


def _kept(data: Data, found: Outliers, word: OutlierWord | None) -> Array:
    """The outliers (h, w) that are not replaced."""
    if word is not None:
        return np.full(found.far.shape, word == "keep")
    if isinstance(data, HeightField):
        return np.ones(found.far.shape, bool)
    return large_pieces(found.far)  # whole regions mark missing samples


def _datum(values: Array, missing: Array) -> Array:
    """The datum of each channel in single precision, () or (k,); zero where its values are not far from zero."""
    none = np.zeros(values.shape[2:])
    there = values[~missing].reshape(-1, *values.shape[2:])
    if values.dtype != np.float32 or there.size == 0:
        return none
    return datum_between(there.min(axis=0), there.max(axis=0))


def datum_between(least: Array, greatest: Array) -> Array:
    """The datum of each channel whose single-precision values lie between these, () or (k,)."""
    low, high = least.astype(np.float64), greatest.astype(np.float64)
    middle = (0.5 * (low + high)).astype(np.float32).astype(np.float64)
    return np.where(np.abs(middle) > DISTANT * (high - low), middle, 0.0)


def level_said(count: int) -> str:
    """A sentence about level regions that stay."""
    return f"{count} samples of level regions, such as lakes, were left unchanged"


def _said(found: Outliers, repaired: Array) -> list[str]:
    """Warnings about outliers: their kind, number and treatment, and the options that change it."""
    words = []
    low, high = found.span
    for mask, what in ((found.far, "far"), (found.impulses & ~found.far, "impulses")):
        count = int(mask.sum())
        if count == 0:
            continue
        made = int((mask & repaired).sum())
        left = "excluded and left unchanged"
        done = (
            left
            if made == 0
            else "replaced from their neighbours"
            if made == count
            else f"{made} replaced, the others {left}"
        )
        if what == "far":
            value = "" if found.value is None else f" of the value {found.value:.9g}"
            say = "nodata" if found.value is None else f"nodata={found.value:.9g}"
            words.append(
                f"{count} sample{'s' * (count > 1)}{value} far outside of all others ({low:.6g} to {high:.6g}): {done}; declare "
                f"what is missing ({say}, or missing=), or give outliers='repair', 'keep' or 'include'"
            )
        else:
            share = 100.0 * count / mask.size
            other = "'keep' leaves them" if made == count else "'repair' replaces them"
            words.append(
                f"{count} sample{'s' * (count > 1)} ({share:.2g} %) unlike all neighbours, as impulses are: {done}; "
                f"outliers={other}, 'include' treats them as data"
            )
    return words
