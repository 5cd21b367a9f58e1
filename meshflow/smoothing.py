"""The front door: any supported thing in, the same kind of thing out."""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.control import AreaChange, Control, Embedded, Fixed, Until
from meshflow.flow.march import State, march
from meshflow.flow.noise import noise_of, noise_on
from meshflow.flow.progress import Progress
from meshflow.flow.rate import MeshFlow
from meshflow.flow.step import Stepper, StepperName
from meshflow.geometry.gates import positive, whole
from meshflow.geometry.lift import HeightField, Image, Lift, Mesh, Noun, RangeImage
from meshflow.geometry.member import Indicator, Member
from meshflow.geometry.surface import Boundary
from meshflow.geometry.triangulate import Diagonals
from meshflow.grid.rate import GridFlow
from meshflow.io.adopt import adopt

__all__ = ["Outcome", "Settings", "noise", "smooth", "smooth_noun"]

# Times in squared sample distances where nobody names one: the paper's own member (DESIGN.md, section 2), and half a squared
# edge where the points of a mesh move, which smooths over one edge and shrinks little.
GRID_TIME, MESH_TIME = 5.0, 0.5
# Contrast in sample distances over noise. Without patch channels 1.5 comes within 12 % of the best contrast and time on four of
# five scenes and 23 % on the fifth, where 2, as the paper's member has it, is up to 88 % off (tests/bench_show.py).
CONTRAST = 1.5


@dataclass(frozen=True)
class Settings:
    """The words of the front door, checked once, each handed to the part that it steers.

    :param time: how far to smooth, in squared length (horizontal unit of a grid, unit of a mesh; pixel footprints of a range
        image). On flat data the flow is the heat equation.
    :param scale: instead of ``time``: the standard deviation of the Gaussian that the flow equals on flat data, a length; time
        is scale^2 / 2.
    :param steps: instead of, or beside ``time``: the number of steps.
    :param gamma: exponent of the edge indicator; 0 is the Beltrami flow, above 0 keeps edges more. See :class:`Member`.
    :param sharpness: above 1 keeps edges more by the flux across them; 2 with gamma -1 is Perona and Malik. See :class:`Member`.
    :param contrast: length per unit of the value; by default 1.5 h / sigma, h the sample distance, sigma the noise found, and 1
        for range images and where the points of a mesh move alone.
    :param indicator: ``metric | projection``.
    :param mass: ``barycentric | voronoi | ring``.
    :param boundary: ``natural | linear | fixed``; by default linear for height fields, range images and meshes, natural for
        images.
    :param diagonals: of a grid's cells, ``forward | backward | both | alternate``.
    :param stepper: ``auto | explicit | super-time | semi-implicit``, or a stepper with options of its own.
    :param dt: length of a step, squared length; by default what suits the stepper.
    :param control: :class:`Fixed`, :class:`AreaChange` or :class:`Embedded`, instead of ``dt``.
    :param threads: for grids; by default as many as numba uses.
    :raises InputError: for options that exclude each other or make no sense.
    """

    time: float | None = None
    scale: float | None = None
    steps: int | None = None
    gamma: float = 0.0
    sharpness: float = 1.0
    contrast: float | None = None
    indicator: Indicator = "metric"
    mass: Literal["barycentric", "voronoi", "ring"] = "barycentric"
    boundary: Boundary | None = None
    diagonals: Diagonals = "alternate"
    stepper: Stepper | StepperName = "auto"
    dt: float | None = None
    control: Fixed | AreaChange | Embedded | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.time is not None and self.scale is not None:
            raise InputError(f"time {self.time} and scale {self.scale}: one of them expected (time is scale^2 / 2)")
        if self.dt is not None and self.control is not None:
            raise InputError(f"dt {self.dt} and a control: one of them expected; give dt to the control")
        if self.threads is not None:
            whole(self.threads, "threads", 1)
        if self.scale is not None and not (np.isfinite(self.scale) and self.scale >= 0):
            raise InputError(f"scale: a finite length, zero or more, expected, got {self.scale}")

    def member(self) -> Member:
        """The member of the family."""
        return Member(gamma=self.gamma, sharpness=self.sharpness, indicator=self.indicator, mass=self.mass)

    def lift(self, noun: Noun) -> Lift:
        """How the noun becomes a surface; the contrast from its noise where none is given."""
        contrast = _contrast(noun) if self.contrast is None else positive(self.contrast, "contrast")
        return Lift(contrast, self.diagonals, self.boundary)

    def until(self, noun: Noun) -> Until:
        """When to stop; by default at 5 squared sample distances, half a squared edge for a mesh."""
        time = self.scale**2 / 2 if self.scale is not None else self.time
        if time is None and self.steps is None:
            shrinks = isinstance(noun, Mesh) and noun.moves != "channels"
            time = (MESH_TIME if shrinks else GRID_TIME) * noun.step**2
        return Until(time, self.steps)


def _contrast(noun: Noun) -> float:
    """1.5 h / sigma: noise has slopes of about 1, what is steeper is an edge; 1 where no noise is found or looked for."""
    if isinstance(noun, RangeImage) or (isinstance(noun, Mesh) and noun.moves == "points"):
        return 1.0
    sigma = noise(noun)["noise"]
    return CONTRAST * noun.step / sigma if sigma > 0 else 1.0


def noise(noun: Noun) -> dict[str, float]:
    """What a thing says of its own noise, in the unit of its values: standard deviation and quantum; {} for bare points."""
    if isinstance(noun, Mesh):
        found = None if noun.channels is None else noise_on(noun.channels, noun.faces)
    else:
        assert noun.missing is not None
        values = {HeightField: "z", Image: "values", RangeImage: "depth"}[type(noun)]
        found = noise_of(getattr(noun, values), noun.missing)
    return {} if found is None else {"noise": found.sigma, "quantum": found.quantum}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a run did.

    :ivar noun: the data, smoothed.
    :ivar start: the state before the first step.
    :ivar end: the last state, with the reason why it is the last.
    :ivar facts: parameters as they were used, words to words: for tags and reports.
    """

    noun: Noun
    start: State
    end: State
    facts: dict[str, str]


def smooth_noun(noun: Noun, settings: Settings, progress: Progress = None) -> Outcome:
    """Smooth a noun of ``meshflow.geometry.lift``; a new one comes back, with what was done."""
    lift, until = settings.lift(noun), settings.until(noun)
    if isinstance(noun, Mesh):
        flow = MeshFlow(noun.lifted(lift), settings.member())
    else:
        flow = GridFlow(noun.gridded(lift), settings.member(), settings.threads)
    control: Control | None = settings.control or (None if settings.dt is None else Fixed(settings.dt))
    start = end = None
    for end in march(flow, until, settings.stepper, control, progress, recycle=True):
        start = start or end
    assert start is not None
    assert end is not None
    facts = _facts(noun, settings, lift, end)
    if isinstance(noun, Mesh):
        return Outcome(noun.lowered(end.u, lift), start, end, facts)
    assert isinstance(flow, GridFlow)
    flow.release()
    return Outcome(noun.holding(flow.planes(end.u)), start, end, facts)


def _facts(noun: Noun, settings: Settings, lift: Lift, end: State) -> dict[str, str]:
    """Parameters of a run as they were used."""
    try:
        release = version("meshflow")
    except PackageNotFoundError:  # run from a checkout that is not installed
        release = "unknown"
    facts = {
        "version": release,
        "gamma": f"{settings.gamma:g}",
        "sharpness": f"{settings.sharpness:g}",
        "indicator": settings.indicator,
        "mass": settings.mass,
        "contrast": f"{lift.contrast:.6g}",
        "boundary": lift.boundary or noun.boundary,
        "time": f"{end.time:.6g}",
        "steps": str(end.step),
        "stepper": end.stepper,
        "ended": end.reason or "",
    }
    if isinstance(noun, (HeightField, Image, RangeImage)):
        facts["diagonals"] = lift.diagonals
    return facts


def smooth(
    thing: Any,
    *,
    time: float | None = None,
    scale: float | None = None,
    steps: int | None = None,
    gamma: float = 0.0,
    contrast: float | None = None,
    progress: Progress = None,
    settings: dict[str, Any] | None = None,
    **more: Any,
) -> Any:
    """Smooth anything that lives on a triangulated surface; the same kind of thing comes back, a new one.

    :param thing: numpy array (h, w): a height field, (h, w, k): an image of k channels, masked arrays and NaN as missing;
        ``(points, faces)``: a mesh; ``trimesh.Trimesh``, ``pyvista`` PolyData, ImageData, StructuredGrid, ``open3d`` triangle
        meshes, ``xarray.DataArray``; a noun of meshflow. Files: :func:`meshflow.read`, or the command ``meshflow smooth``.
    :param time: how far, in squared length; default 5 squared sample distances, for meshes half a squared mean edge.
    :param scale: instead of ``time``, the standard deviation of the equal Gaussian on flat data, a length.
    :param steps: instead of, or beside ``time``, the number of steps.
    :param gamma: 0: Beltrami flow; above: edges kept more; -1, -2: mean curvature diffusion, graph flow.
    :param sharpness: above 1 keeps edges more by the flux across them; 2 with gamma -1 is Perona and Malik. See :class:`Member`.
    :param contrast: length per unit of the value; default 1.5 h / noise.
    :param progress: None, True (a bar on stderr) or a callable ``(done, total)``.
    :param settings: further fields of :class:`Settings` by name (also accepted as keywords): ``indicator, mass, boundary,
        diagonals, stepper, dt, control, sharpness, threads``.
    :param more: those, and what the thing itself does not say: ``kind`` (``terrain | image | depth | mesh``), ``spacing``,
        ``camera``, ``missing``, ``fixed``, ``channels``, ``moves``.
    :returns: the same kind of thing, smoothed; integers come back as floating point, since rounding would undo the smoothing.
    :raises InputError: for what cannot be smoothed or an option that does not exist; the message says what to do.
    :raises NotConverged: when a solver fails.
    """
    known = {**(settings or {}), "time": time, "scale": scale, "steps": steps, "gamma": gamma, "contrast": contrast}
    known |= {name: more.pop(name) for name in list(more) if name in Settings.__dataclass_fields__}
    adopted = adopt(thing, **more)
    return adopted.restore(smooth_noun(adopted.noun, Settings(**known), progress).noun)
