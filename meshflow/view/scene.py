"""Scenes of one or two surfaces: data, geometries and colours, for pictures, windows and notebooks."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, real
from meshflow.surfaces.data import Data
from meshflow.surfaces.mesh import Mesh
from meshflow.view.appearance import taken
from meshflow.view.geometry import Geometry, raised
from meshflow.view.look import Look
from meshflow.view.numbers import brief
from meshflow.view.page import Foot
from meshflow.view.pair import paired, values_on
from meshflow.view.quantity import Quantity, measured
from meshflow.view.renderer import Renderer, renderer_for
from meshflow.view.scale import Scale, ranging, showing, showing_both, together
from meshflow.view.scale_bar import Ground, ground_of, scale_bar_of

__all__ = ["Removed", "Shown", "Scene", "foot_of", "of_one", "of_two"]

Removed = Literal["removed"]


@dataclass(frozen=True, eq=False)
class Shown:
    """One panel.

    :ivar label: above the panel.
    :ivar scale: colours instead of its own, thinned like the geometry.
    """

    label: str
    data: Data
    geometry: Geometry
    scale: Scale | None


@dataclass(frozen=True, eq=False)
class Scene:
    """All panels of a picture or a window.

    :ivar ground: the unit of lengths, and whether it is a map.
    :ivar counted: names and scales for the histogram, from all data; none where colours show no values.
    :ivar notes: sentences for the user.
    """

    look: Look
    renderer: Renderer
    shown: tuple[Shown, ...]
    counted: tuple[tuple[str, Scale], ...]
    notes: tuple[str, ...]
    ground: Ground = Ground()

    def foot(self, size: tuple[int, int], unit: float) -> Foot:
        """The foot of a page whose panels have a size in pixels.

        :param unit: pixels of this page per pixel of a page of 1600 x 1200.
        """
        one = self.shown[0]
        return foot_of(self.renderer, self.ground, self.renderer.length(one.data, one.geometry, size), unit)

    def picture(self, panel: int, size: tuple[int, int]) -> Array:
        """A panel as a picture (h, w, 3) in uint8: of the given size from VTK, or one pixel per sample as a relief."""
        one = self.shown[panel]
        return self.renderer.panel(one.data, one.geometry, size, one.scale)

    @property
    def aspect(self) -> float:
        """Width over height of the contents of a panel."""
        return self.renderer.aspect(self.shown[0].geometry, self.shown[0].data)

    @property
    def pixel(self) -> float:
        """Height over width of a pixel of a panel."""
        return self.renderer.pixel(self.shown[0].data)


def foot_of(renderer: Renderer, ground: Ground, length: float | None, unit: float) -> Foot:
    """The foot of a page: how it is drawn, the scale bar, and north on a map seen from above.

    :param length: of a pixel, in the unit of the surface; None: it depends on the place.
    :param unit: pixels of this page per pixel of a page of 1600 x 1200.
    """
    mapped = renderer.name == "hillshade" or renderer.look.seen == "front"
    return Foot(renderer.foot(), scale_bar_of(length, ground.unit, unit, ground.north and mapped))


def of_two(before: object, after: object, look: Look, quantity: Quantity | Removed, window: bool) -> Scene:
    """Data before and after with what was removed; or both coloured by a quantity.

    :param before: data that :func:`meshflow.view.appearance.taken` recognizes.
    :param after: the same kind of data on the same samples.
    :param quantity: what colour shows.
    :param window: whether a window or a plotter is needed.
    :raises InputError: for two things that cannot be compared, nothing to draw, or a word that is unknown.
    :raises MissingPackage: where only VTK would do and it cannot draw.
    """
    labels = look.labels
    pair = paired(before, after, look.unit, look.own_colours)
    surfaces = (pair.before, pair.after)
    scales: tuple[Scale | None, Scale | None] = None, None
    counted: tuple[tuple[str, Scale], ...] = ()
    if quantity != "removed":
        one, other = (measured(data, quantity, look.contrast).wearing(look.colours) for data in surfaces)
        scales = one, other = (showing_both if quantity == "curvature" else together)(one, other)
        counted = (labels[0], one), (labels[1], other)
    elif pair.worn is not None:
        one, other = pair.worn
        scales = one.wearing(look.colours), other.wearing(look.colours)
        before_label, after_label = (f"{label}: {one.what}, {brief(one.low)} to {brief(one.high)}" for label in labels)
        labels = before_label, after_label  # these panels are not coloured by the bar
    seen = raised(pair.before, look.seen), raised(pair.after, look.seen)
    renderer = renderer_for(seen, _look(seen[0], look, quantity, window), window)
    geometries = renderer.geometries(*seen)
    panels = tuple(
        Shown(label, data, geometry, None if scale is None else scale.thinned(renderer.step))
        for label, data, geometry, scale in zip(labels, seen, geometries, scales, strict=True)
    )
    if quantity == "removed" and look.arrange == "beside":
        removed = pair.removed.wearing(look.colours)
        panels = (*panels, Shown("removed", seen[1], geometries[1], removed.thinned(renderer.step)))
        counted = (("", removed),)
    return Scene(look, renderer, panels, counted, (*pair.notes, *renderer.notes), ground_of(before, pair.before))


def of_one(
    data: object, look: Look, quantity: Quantity | None = None, scalars: ArrayLike | None = None, window: bool = False
) -> Scene:
    """One surface, plain, or coloured by numbers of the caller or a quantity.

    :param data: data that :func:`meshflow.view.appearance.taken` recognizes.
    :param quantity: what colour shows; None: the plain surface.
    :param scalars: instead: one number per sample (h, w) or vertex (n,).
    :param window: whether a window or a plotter is needed.
    :raises InputError: for nothing to draw, numbers that do not fit, or a word that is unknown.
    :raises MissingPackage: where only VTK would do and it cannot draw.
    """
    if scalars is not None and quantity is not None:
        raise InputError(f"scalars and quantity={quantity!r}: only one of them can be shown as colours; leave one out")
    plain = scalars is None and quantity is None
    if plain and look.colours is not None:
        raise InputError(f"colours {look.colours!r}: nothing is shown as colour; say what, by quantity or scalars")
    if look.own_colours and not plain:
        raise InputError("own_colours: own colours cannot be shown together with numbers as colours; leave one out")
    surface, notes = taken(data, look.own_colours)
    scale = None if scalars is None else _scale(surface, scalars, look.unit)
    scale = showing(measured(surface, quantity, look.contrast)) if quantity is not None else scale
    if plain and isinstance(surface, Mesh) and not look.own_colours:
        scale = values_on(surface)
    scale = None if scale is None else scale.wearing(look.colours)
    seen = raised(surface, look.seen)
    renderer = renderer_for((seen,), _look(seen, look, quantity, window), window)
    (geometry,) = renderer.geometries(seen)
    shown = Shown("", seen, geometry, None if scale is None else scale.thinned(renderer.step))
    counted = () if scale is None else (("", scale),)
    return Scene(look, renderer, (shown,), counted, (*notes, *renderer.notes), ground_of(data, surface))


def _look(data: Data, look: Look, quantity: Quantity | Removed | None, window: bool) -> Look:
    """The look for a quantity; missing samples have no place in space, so that grids show them from the front."""
    if quantity != "samples" or look.renderer is not None or isinstance(data, Mesh) or window:
        return look
    return replace(look, renderer="hillshade")


def _scale(data: Data, scalars: ArrayLike, unit: str | None) -> Scale:
    """Numbers of the caller, one per sample or vertex, with colours from the least to the largest.

    :raises InputError: when they do not fit the data object, or none is finite.
    """
    values = real(scalars, "scalars")
    shape = data.points.shape[:1] if isinstance(data, Mesh) else data.missing.shape
    if values.shape != shape:
        raise InputError(f"scalars: one number per sample or vertex expected, of shape {shape}; got {values.shape}")
    gone = ~np.isfinite(values) if isinstance(data, Mesh) else ~np.isfinite(values) | data.missing
    values = np.where(gone, np.nan, values)
    if np.isnan(values).all():
        raise InputError("scalars: at least one finite number expected where a sample is, got none")
    return ranging(values, "", unit or "")
