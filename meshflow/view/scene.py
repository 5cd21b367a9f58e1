"""What is to be seen of one thing or two: nouns, bodies, colours, decided once for pictures, windows and notebooks."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, real
from meshflow.surfaces.lift import Mesh, Noun
from meshflow.view.appearance import taken
from meshflow.view.geometry import Body, raised
from meshflow.view.look import Look
from meshflow.view.page import Foot
from meshflow.view.pair import paired
from meshflow.view.quantity import Quantity, measured
from meshflow.view.renderer import How, Stage, staged
from meshflow.view.scale import Scale, ranging, showing, showing_both, together
from meshflow.view.scale_bar import Ground, grounded, ruled

__all__ = ["Arrange", "Removed", "Shown", "Sight", "of_one", "of_two"]

Arrange = Literal["beside", "wipe", "blink"]
Removed = Literal["removed"]


@dataclass(frozen=True, eq=False)
class Shown:
    """One panel.

    :ivar label: above it.
    :ivar scale: the colours that it wears instead of its own, thinned as the body is.
    """

    label: str
    noun: Noun
    body: Body
    scale: Scale | None


@dataclass(frozen=True, eq=False)
class Sight:
    """All panels of a picture or a window.

    :ivar ground: the unit of lengths, and whether it is the raster of a map.
    :ivar counted: names and scales of what a histogram counts, from all of the data; none where colours stand for no values.
    :ivar notes: sentences for the user.
    """

    look: Look
    stage: Stage
    shown: tuple[Shown, ...]
    counted: tuple[tuple[str, Scale], ...]
    notes: tuple[str, ...]
    ground: Ground = Ground()

    def foot(self, size: tuple[int, int], unit: float) -> Foot:
        """What stands below a page whose panels have that size in pixels.

        :param unit: pixels of this page for one of a page of 1600 x 1200.
        """
        one = self.shown[0]
        length = self.stage.length(one.noun, one.body, size)
        mapped = self.stage.how == "relief" or self.look.seen == "front"
        return Foot(self.stage.foot(), ruled(length, self.ground.unit, unit, self.ground.north and mapped))

    def picture(self, panel: int, size: tuple[int, int]) -> Array:
        """A panel as a picture (h, w, 3) in uint8: of that size from VTK, a pixel for each sample as a relief."""
        one = self.shown[panel]
        return self.stage.panel(one.noun, one.body, size, one.scale)

    @property
    def aspect(self) -> float:
        """Width over height of what a panel is to hold."""
        return self.stage.aspect(self.shown[0].body, self.shown[0].noun)

    @property
    def pixel(self) -> float:
        """Height over width of a pixel of a panel."""
        return self.stage.pixel(self.shown[0].noun)


def of_two(
    before: Any,
    after: Any,
    look: Look,
    how: How | None,
    window: bool,
    arrange: Arrange,
    unit: str | None,
    quantity: Quantity | Removed,
    contrast: float,
    labels: tuple[str, str] = ("before", "after"),
) -> Sight:
    """A thing before and after, and beside them what was removed; or both in the colours of a quantity.

    :raises InputError: for two things that cannot be compared, nothing to draw, or a word that is unknown.
    :raises MissingPackage: where only VTK would do and it cannot draw.
    """
    if arrange not in get_args(Arrange):
        raise InputError(f"arrange: one of {', '.join(get_args(Arrange))} expected, got {arrange!r}")
    pair = paired(before, after, unit, look.own_colours)
    nouns = (pair.before, pair.after)
    scales: tuple[Scale | None, Scale | None] = None, None
    counted: tuple[tuple[str, Scale], ...] = ()
    if quantity != "removed":
        one, other = (measured(noun, quantity, contrast).wearing(look.colours) for noun in nouns)
        scales = one, other = (showing_both if quantity == "curvature" else together)(one, other)
        counted = (labels[0], one), (labels[1], other)
    elif pair.worn is not None:
        one, other = pair.worn
        scales = one.wearing(look.colours), other.wearing(look.colours)
        before_label, after_label = (f"{label}: {one.what}, {one.low:.3g} to {one.high:.3g}" for label in labels)
        labels = before_label, after_label  # their colours are not those of the bar
    seen = raised(pair.before, look.seen), raised(pair.after, look.seen)
    stage = staged(seen, look, _how(seen[0], how, quantity, window), window)
    bodies = stage.bodies(*seen)
    panels = tuple(
        Shown(label, noun, body, None if scale is None else scale.thinned(stage.step))
        for label, noun, body, scale in zip(labels, seen, bodies, scales, strict=True)
    )
    if quantity == "removed" and arrange == "beside":
        removed = pair.removed.wearing(look.colours)
        panels = (*panels, Shown("removed", seen[1], bodies[1], removed.thinned(stage.step)))
        counted = (("", removed),)
    return Sight(look, stage, panels, counted, (*pair.notes, *stage.notes), grounded(before, pair.before))


def of_one(
    thing: Any,
    look: Look,
    how: How | None,
    window: bool,
    unit: str | None,
    scalars: ArrayLike | None,
    quantity: Quantity | None,
    contrast: float,
) -> Sight:
    """One thing, in colours that stand for numbers of the caller's or for a quantity, where there are some.

    :raises InputError: for nothing to draw, numbers that do not fit, or a word that is unknown.
    :raises MissingPackage: where only VTK would do and it cannot draw.
    """
    if scalars is not None and quantity is not None:
        raise InputError(f"scalars and quantity={quantity!r}: a thing wears one of them at a time; leave one out")
    plain = scalars is None and quantity is None
    if plain and look.colours is not None:
        raise InputError(f"colours {look.colours!r}: nothing is shown as colour; say what, by quantity or scalars")
    if look.own_colours and not plain:
        raise InputError("own_colours: a thing wears its own colours or those of numbers; leave one out")
    noun, notes = taken(thing, look.own_colours)
    scale = None if scalars is None else _scale(noun, scalars, unit)
    scale = showing(measured(noun, quantity, contrast)) if quantity is not None else scale
    scale = None if scale is None else scale.wearing(look.colours)
    seen = raised(noun, look.seen)
    stage = staged((seen,), look, _how(seen, how, quantity, window), window)
    (body,) = stage.bodies(seen)
    shown = Shown("", seen, body, None if scale is None else scale.thinned(stage.step))
    counted = () if scale is None else (("", scale),)
    return Sight(look, stage, (shown,), counted, (*notes, *stage.notes), grounded(thing, noun))


def _how(noun: Noun, how: How | None, quantity: Quantity | Removed | None, window: bool) -> How | None:
    """What is missing has no place in space: grids show it from above, or through their camera."""
    if quantity != "samples" or how is not None or isinstance(noun, Mesh) or window:
        return how
    return "relief"


def _scale(noun: Noun, scalars: ArrayLike, unit: str | None) -> Scale:
    """Numbers of the caller's, one per sample or vertex, as colours from the least to the greatest.

    :raises InputError: when they do not fit the noun, or none is finite.
    """
    values = real(scalars, "scalars")
    shape = noun.points.shape[:1] if isinstance(noun, Mesh) else noun.missing.shape
    if values.shape != shape:
        raise InputError(f"scalars: one number per sample or vertex expected, of shape {shape}; got {values.shape}")
    gone = ~np.isfinite(values) if isinstance(noun, Mesh) else ~np.isfinite(values) | noun.missing
    values = np.where(gone, np.nan, values)
    if np.isnan(values).all():
        raise InputError("scalars: at least one finite number expected where a sample is, got none")
    return ranging(values, "", unit or "")
