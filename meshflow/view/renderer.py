"""Which way things are drawn, decided once for all panels of a picture; then each panel."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from meshflow.errors import InputError, MissingPackage
from meshflow.geometry.validation import Array
from meshflow.surfaces.lift import HeightField, Image, Mesh, Noun, RangeImage
from meshflow.view import hillshade as relief
from meshflow.view import vtk_scene as scene
from meshflow.view.geometry import SAMPLES, Body, as_shown, drawable, embodied
from meshflow.view.look import Look, Seen
from meshflow.view.probe import rendering
from meshflow.view.scale import Scale

__all__ = ["How", "Stage", "must_open", "staged"]

How = Literal["pyvista", "relief"]


@dataclass(frozen=True, eq=False)
class Stage:
    """How the nouns of one picture are drawn.

    :param how: by VTK in space, or as a shaded relief.
    :param step: every which sample of a grid is drawn.
    :param exaggeration: factor on heights.
    :param shown: of images, channels to colours.
    :param notes: sentences for the user; those of ``caption`` stand below the picture.
    """

    look: Look
    how: How
    step: int
    exaggeration: float
    shown: Callable[[Array], Array] | None
    caption: tuple[str, ...]
    notes: tuple[str, ...]

    def bodies(self, *nouns: Noun) -> tuple[Body, ...]:
        """The bodies of nouns of one kind, seen from one side and framed alike."""
        look = self.look
        bodies = [
            embodied(noun, self.step, self.exaggeration, self.shown, look.up, look.seen, look.own_colours)
            for noun in nouns
        ]
        view = bodies[0].view.framing(*(body.points for body in bodies))
        return tuple(replace(body, view=view) for body in bodies)

    def panel(self, noun: Noun, body: Body, size: tuple[int, int], scale: Scale | None = None) -> Array:
        """One panel (height, width, 3) in uint8: of that size from VTK, a pixel per sample as a relief.

        :param scale: colours to show, thinned as the body is.
        """
        if self.how == "pyvista":
            return scene.drawn(body, self.look, size, scale)
        if scale is not None:
            return relief.coloured(scale)
        if isinstance(noun, Image):
            assert self.shown is not None
            return relief.imaged(noun, self.step, self.shown)
        return relief.pictured(body, self._grid(noun), self.look)

    def aspect(self, body: Body, noun: Noun) -> float:
        """Width over height of what a panel is to hold."""
        if self.how == "relief":
            h, w = self._grid(noun)
            return w / h / self.pixel(noun)
        wide, tall = body.view.extent
        return wide / tall if tall > 0 else 1.0

    def pixel(self, noun: Noun) -> float:
        """Height over width of a pixel of a panel."""
        if self.how == "relief" and isinstance(noun, (HeightField, Image)):
            return float(noun.spacing[1] / np.mean(noun.spacing[0]))
        return 1.0

    def length(self, noun: Noun, body: Body, size: tuple[int, int]) -> float | None:
        """What a pixel of a panel of that size is long across the view; None where that depends on the place, or is no length."""
        if isinstance(noun, Image) or body.view.pinhole:
            return None
        if self.how == "pyvista":
            return scene.length(body, size)
        assert isinstance(noun, HeightField)
        h, w = self._grid(noun)
        return float(np.mean(noun.spacing[0])) * self.step / min(size[0] / w, size[1] / (h * self.pixel(noun)))

    def foot(self) -> str:
        """The line below the picture."""
        return ",  ".join(self.caption)

    def _grid(self, noun: Noun) -> tuple[int, int]:
        """Rows and columns that are drawn."""
        assert not isinstance(noun, Mesh)
        h, w = noun.missing[:: self.step, :: self.step].shape
        return h, w


def staged(nouns: tuple[Noun, ...], look: Look, how: How | None, window: bool, most: int = SAMPLES) -> Stage:
    """Decide how these nouns, all of one kind, are drawn.

    :param how: what the caller asks for; None: VTK where it can draw, images as images.
    :param window: it is to be a window or a plotter, which only VTK can make.
    :param most: samples of a side of a grid that are drawn.
    :raises InputError: for a way that does not suit the noun.
    :raises MissingPackage: where only VTK would do and it cannot draw; the message says what would mend it.
    """
    noun = nouns[0]
    chosen, notes = _way(noun, how, window, look.seen)
    step, exaggeration, caption = drawable(noun, look, most)
    told = (*notes, *caption) if step > 1 else notes  # light and exaggeration stand in the picture
    images = [noun for noun in nouns if isinstance(noun, Image)]
    if not images:
        caption = (*caption, f"light from {look.azimuth:g}°, {look.altitude:g}° high")
    return Stage(look, chosen, step, exaggeration, as_shown(*images) if images else None, caption, told)


def must_open() -> None:
    """Refuse a window where VTK draws, but not on a display.

    :raises InputError: there.
    """
    answer = rendering()
    if answer.works and answer.window is not None:
        raise InputError(f"a window needs a display that VTK can draw on, and here {answer.why}; give a path")


def _way(noun: Noun, how: How | None, window: bool, seen: Seen | None) -> tuple[How, tuple[str, ...]]:
    """The way, and why, where it is not the one to be expected."""
    name = type(noun).__name__
    if how not in (None, "pyvista", "relief"):
        raise InputError(f"how: pyvista or relief expected, got {how!r}")
    if how == "relief" and isinstance(noun, Mesh):
        raise InputError("how='relief': a mesh has no grid to be shown as a relief; leave it out")
    if how == "relief" and seen == "side":
        raise InputError("how='relief' is seen from the front; leave seen='side' out, or how")
    if how == "relief" and window:
        raise InputError("how='relief' makes pictures, not windows; give a path")
    if how == "pyvista" and isinstance(noun, Image) and not window:
        raise InputError("how='pyvista': an image is written as the image it is; leave it out")
    if how == "relief" or (isinstance(noun, Image) and not window):
        return "relief", ()
    answer = rendering()
    if answer.works:
        answer.prepare()
        return "pyvista", ()
    if window or how == "pyvista" or seen == "side" or not isinstance(noun, (HeightField, RangeImage)):
        what = "a window" if window else f"a {name} in space"
        raise MissingPackage(f"{what} is drawn by VTK alone: {answer.why}")
    return "relief", (f"shown as a relief: {answer.why}",)
