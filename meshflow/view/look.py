"""The look of a picture: light, size, arrangement, and position of the viewer."""

from dataclasses import dataclass, fields, replace
from typing import Literal, TypedDict, Unpack, get_args

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array, positive
from meshflow.view.scale import known_colours

__all__ = [
    "Arrange",
    "Look",
    "Looks",
    "OF_PAIRS",
    "RendererName",
    "Seen",
    "Up",
    "View",
    "camera_view",
    "looking",
    "mesh_view",
    "picture_view",
    "side_view",
    "terrain_view",
]

Up = Literal["y", "z"]
Seen = Literal["front", "side"]
RendererName = Literal["pyvista", "hillshade"]
Arrange = Literal["beside", "wipe", "blink"]
OF_PAIRS = ("arrange", "at", "labels")
"""Options for two surfaces only."""


class Looks(TypedDict, total=False):
    """The options of :class:`Look` as keywords."""

    exaggeration: float | None
    azimuth: float
    altitude: float
    up: Up | None
    size: tuple[int, int]
    title: str
    seen: Seen | None
    colours: str | None
    own_colours: bool
    renderer: RendererName | None
    contrast: float
    unit: str | None
    arrange: Arrange
    at: float
    labels: tuple[str, str]


@dataclass(frozen=True)
class Look:
    """How data is shown.

    :param exaggeration: factor on the heights of a height field; None: one that makes the relief visible.
    :param azimuth: direction of the light, degrees clockwise from north; for meshes and range images, which have no north,
        from the top of the picture.
    :param altitude: height of the light above the ground, or above the plane of the picture, 0 to 90 degrees.
    :param up: the axis of a mesh that points up; None: guessed from its shape.
    :param size: of the picture or window, pixels.
    :param title: a line above it.
    :param seen: ``front``: as a map, as an image, through its camera; ``side``: as a surface seen obliquely, with the brightness
        of an image as its height (Figure 10 of the paper). By default terrains from the side, all else from the front.
    :param colours: the name of a colour map of matplotlib for quantities; by default a diverging one about 0, or a
        perceptually uniform one.
    :param own_colours: draw meshes in the colours of their vertices, or with their texture, instead of a stone colour.
    :param renderer: ``pyvista`` (VTK, in space) or ``hillshade`` (a grid from above or from its camera, without OpenGL). By
        default VTK where it can draw; images are always drawn as images.
    :param contrast: length per unit of the values, for the quantity ``edges``.
    :param unit: of what was removed, or of the scalars; by default the one of the data.
    :param arrange: ``beside``: before and after side by side; ``wipe``: one view, before to the left of a divider (which can be
        dragged in a window) and after to its right; ``blink``: one after the other (in a window with the space bar).
    :param at: the position of the divider, a share of the width from the left.
    :param labels: labels of the two surfaces, if they are not before and after.
    :raises InputError: for an invalid value, or an unknown colour map; the message says what is expected.
    """

    exaggeration: float | None = None
    azimuth: float = 315.0
    altitude: float = 30.0
    up: Up | None = None
    size: tuple[int, int] = (1600, 1200)
    title: str = ""
    seen: Seen | None = None
    colours: str | None = None
    own_colours: bool = False
    renderer: RendererName | None = None
    contrast: float = 1.0
    unit: str | None = None
    arrange: Arrange = "beside"
    at: float = 0.5
    labels: tuple[str, str] = ("before", "after")

    def __post_init__(self) -> None:
        if self.exaggeration is not None:
            positive(self.exaggeration, "exaggeration")
        if self.up not in (None, "y", "z"):
            raise InputError(f"up: y or z expected, got {self.up!r}")
        if self.seen is not None and self.seen not in get_args(Seen):
            raise InputError(f"seen: front or side expected, got {self.seen!r}")
        if self.colours is not None:
            known_colours(self.colours)
        if self.renderer is not None and self.renderer not in get_args(RendererName):
            raise InputError(f"renderer: pyvista or hillshade expected, got {self.renderer!r}")
        if self.arrange not in get_args(Arrange):
            raise InputError(f"arrange: one of {', '.join(get_args(Arrange))} expected, got {self.arrange!r}")
        if not 0.0 <= self.at <= 1.0:
            raise InputError(f"at: the place of the divider, 0 (left) to 1 (right), expected, got {self.at}")
        if not (np.isfinite(self.azimuth) and 0 < self.altitude <= 90):
            raise InputError(
                f"light: an azimuth in degrees and an altitude above 0 and up to 90 expected, "
                f"got {self.azimuth} and {self.altitude}"
            )
        if len(self.size) != 2 or any(int(side) != side or not 240 <= side <= 16000 for side in self.size):
            raise InputError(f"size: a width and a height of 240 to 16000 whole pixels expected, got {self.size}")

    @property
    def light(self) -> Array:
        """The unit vector towards the light, (east, north, up)."""
        turn, lift = np.radians((self.azimuth, self.altitude))
        return np.array([np.sin(turn) * np.cos(lift), np.cos(turn) * np.cos(lift), np.sin(lift)])


def looking(without: tuple[str, ...] = (), **options: Unpack[Looks]) -> Look:
    """Make a look of options.

    :param without: options that do not apply to what is drawn, and are refused.
    :raises InputError: as :class:`Look`, and for an unknown option.
    """
    there = [field.name for field in fields(Look) if field.name not in without]
    strange = sorted(set(options) - set(there))
    if strange:
        raise InputError(f"{', '.join(strange)}: no such option of a picture; there are {', '.join(there)}")
    return Look(**options)


@dataclass(frozen=True, eq=False)
class View:
    """The position of the viewer, and the axes of the light.

    :param toward: unit vector from the geometry to the viewer.
    :param up: unit vector that points up in the picture, perpendicular to it.
    :param ground: (3, 3), rows east, north and up of the light; without a north, the axes of the picture.
    :param pinhole: seen in perspective from the origin, as by a camera, instead of from infinity.
    :param frame: the visible part: lower left and upper right corner in the plane of :meth:`flat`.
    :param axis: unit vector about which the viewer moves around the geometry; None: ``up``.
    """

    toward: Array
    up: Array
    ground: Array
    pinhole: bool = False
    frame: tuple[tuple[float, float], tuple[float, float]] = ((-1.0, -1.0), (1.0, 1.0))
    axis: Array | None = None

    @property
    def right(self) -> Array:
        """Unit vector to the right in the picture."""
        return np.cross(self.up, self.toward)

    def flat(self, points: Array) -> Array:
        """Points (n, 3) as (n, 2) on the plane of the picture, right and up; for a pinhole at distance 1."""
        flat = points @ np.stack([self.right, self.up], axis=1)
        return flat / -(points @ self.toward)[:, None] if self.pinhole else flat

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height of the frame."""
        (left, low), (right, high) = self.frame
        return right - left, high - low

    def framing(self, *point_sets: Array) -> "View":
        """The same view, framed to these points, each array (n, 3)."""
        corners = np.array([corner for points in point_sets for corner in self._corners(points)])
        (left, low), (right, high) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return replace(self, frame=((left, low), (right, high)))

    def turned(self, degrees: float) -> "View":
        """The view after moving around the surface counter-clockwise, as seen from above; without perspective."""
        axis, angle = self.up if self.axis is None else self.axis, np.radians(degrees)

        def around(vector: Array) -> Array:
            """Rodrigues' rotation."""
            level = axis * np.dot(axis, vector)
            return level + (vector - level) * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)

        return replace(self, toward=around(self.toward), up=around(self.up), pinhole=False)

    def _corners(self, points: Array) -> tuple[Array, Array]:
        flat = self.flat(points)
        return flat.min(axis=0), flat.max(axis=0)


def picture_view() -> View:
    """The view of a picture: x to the right, y up."""
    return View(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.eye(3))


def terrain_view() -> View:
    """The view of a terrain from the south-south-west and above; north points away from the viewer."""
    turn, lift = np.radians((196.0, 48.0))
    toward = (float(np.sin(turn) * np.cos(lift)), float(np.cos(turn) * np.cos(lift)), float(np.sin(lift)))
    return View(*_picture(toward, (0.0, 0.0, 1.0)), np.eye(3), axis=np.array([0.0, 0.0, 1.0]))


def side_view() -> View:
    """The view of a range image from beside and above its camera: y down, z forward, the light as for the camera."""
    toward, up = _picture((0.64, -0.45, -0.62), (0.0, -1.0, 0.0))
    return View(toward, up, camera_view().ground, axis=np.array([0.0, -1.0, 0.0]))


def camera_view() -> View:
    """The view from the camera: y down, z forward."""
    toward, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])
    return View(toward, up, np.stack([np.cross(up, toward), up, toward]), pinhole=True)


def mesh_view(points: Array, up: Up | None, seen: Seen | None = None) -> View:
    """The view of a mesh: its broader side, slightly rotated and from above; a flat mesh from its front.

    From the side, it is rotated by 90 degrees. By default z is up, as in surveying and printing; or y, as in most scans, where z
    is the smallest extent (as the depth of a bust) but not a thin one (as the relief of a terrain).
    """
    x, y, z = (float(extent) for extent in np.ptp(points, axis=0))
    axis = (0.0, 0.0, 1.0)
    if z <= 1e-6 * max(x, y):
        toward, axis = (0.0, 0.0, 1.0) if seen != "side" else (0.9, 0.0, 0.6), (0.0, 1.0, 0.0)
    elif up == "y" or (up is None and 0.35 * max(x, y) <= z <= min(x, y / 1.1)):
        toward, axis = (0.55, 0.4, 1.0) if x >= z else (1.0, 0.4, 0.55), (0.0, 1.0, 0.0)
    else:
        toward = (0.55, -1.0, 0.4) if x >= y else (1.0, 0.55, 0.4)
    view = View(*_picture(toward, axis), np.eye(3), axis=np.array(axis))
    view = view.turned(90.0) if seen == "side" and z > 1e-6 * max(x, y) else view
    return replace(view, ground=np.stack([view.right, view.up, view.toward]))


def _picture(toward: tuple[float, float, float], up: tuple[float, float, float]) -> tuple[Array, Array]:
    """Two directions as perpendicular unit vectors."""
    towards = np.asarray(toward, dtype=np.float64) / np.linalg.norm(toward)
    upright = np.asarray(up, dtype=np.float64) - np.dot(up, towards) * towards
    return towards, upright / np.linalg.norm(upright)
