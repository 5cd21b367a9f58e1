"""Scenes of one object or two: data, geometries and colours, decided once for pictures, windows and notebooks."""

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
from meshflow.view.page import Foot
from meshflow.view.pair import paired
from meshflow.view.quantity import Quantity, measured
from meshflow.view.renderer import Renderer, renderer_for
from meshflow.view.scale import Scale, ranging, showing, showing_both, together
from meshflow.view.scale_bar import Ground, ground_of, scale_bar_of

__all__ = ["Removed", "Shown", "Scene", "of_one", "of_two"]

Removed = Literal["removed"]


@dataclass(frozen=True, eq=False)
class Shown:
    """One panel.

    :ivar label: above it.
    :ivar scale: the colours that it wears instead of its own, thinned as the geometry is.
    """

    label: str
    data: Data
    geometry: Geometry
    scale: Scale | None


@dataclass(frozen=True, eq=False)
class Scene:
    """All panels of a picture or a window.

    :ivar ground: the unit of lengths, and whether it is the raster of a map.
    :ivar counted: names and scales of what a histogram counts, from all of the data; none where colours stand for no values.
    :ivar notes: sentences for the user.
    """

    look: Look
    renderer: Renderer
    shown: tuple[Shown, ...]
    counted: tuple[tuple[str, Scale], ...]
    notes: tuple[str, ...]
    ground: Ground = Ground()

    def foot(self, size: tuple[int, int], unit: float) -> Foot:
        """What stands below a page whose panels have that size in pixels.

        :param unit: pixels of this page for one of a page of 1600 x 1200.
        """
        one = self.shown[0]
        length = self.renderer.length(one.data, one.geometry, size)
        mapped = self.renderer.name == "hillshade" or self.look.seen == "front"
        return Foot(self.renderer.foot(), scale_bar_of(length, self.ground.unit, unit, self.ground.north and mapped))

    def picture(self, panel: int, size: tuple[int, int]) -> Array:
        """A panel as a picture (h, w, 3) in uint8: of that size from VTK, a pixel for each sample as a relief."""
        one = self.shown[panel]
        return self.renderer.panel(one.data, one.geometry, size, one.scale)

    @property
    def aspect(self) -> float:
        """Width over height of what a panel is to hold."""
        return self.renderer.aspect(self.shown[0].geometry, self.shown[0].data)

    @property
    def pixel(self) -> float:
        """Height over width of a pixel of a panel."""
        return self.renderer.pixel(self.shown[0].data)


def of_two(before: object, after: object, look: Look, quantity: Quantity | Removed, window: bool) -> Scene:
    """Data before and after, and beside them what was removed; or both in the colours of a quantity.

    :param before: what :func:`meshflow.view.appearance.taken` recognises.
    :param after: the same kind of data on the same samples.
    :param quantity: what colour stands for.
    :param window: it is to be a window, or a plotter.
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
        before_label, after_label = (f"{label}: {one.what}, {one.low:.3g} to {one.high:.3g}" for label in labels)
        labels = before_label, after_label  # their colours are not those of the bar
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
    """One thing, in colours that stand for numbers of the caller's or for a quantity, where there are some.

    :param data: what :func:`meshflow.view.appearance.taken` recognises.
    :param quantity: what colour stands for; None: the surface as it is.
    :param scalars: instead: a number for each sample (h, w) or vertex (n,).
    :param window: it is to be a window, or a plotter.
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
    surface, notes = taken(data, look.own_colours)
    scale = None if scalars is None else _scale(surface, scalars, look.unit)
    scale = showing(measured(surface, quantity, look.contrast)) if quantity is not None else scale
    scale = None if scale is None else scale.wearing(look.colours)
    seen = raised(surface, look.seen)
    renderer = renderer_for((seen,), _look(seen, look, quantity, window), window)
    (geometry,) = renderer.geometries(seen)
    shown = Shown("", seen, geometry, None if scale is None else scale.thinned(renderer.step))
    counted = () if scale is None else (("", scale),)
    return Scene(look, renderer, (shown,), counted, (*notes, *renderer.notes), ground_of(data, surface))


def _look(data: Data, look: Look, quantity: Quantity | Removed | None, window: bool) -> Look:
    """What is missing has no place in space: grids show it from above, or through their camera."""
    if quantity != "samples" or look.renderer is not None or isinstance(data, Mesh) or window:
        return look
    return replace(look, renderer="hillshade")


def _scale(data: Data, scalars: ArrayLike, unit: str | None) -> Scale:
    """The caller's numbers, one per sample or vertex, as colours from the least to the greatest.

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
