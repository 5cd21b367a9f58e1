"""The contents of a report: pictures, charts and tables. Their layout is in report.py."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from meshflow.errors import InputError, MissingPackage
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view.charts import Chart, Curve, course, histogram, risks
from meshflow.view.look import Look
from meshflow.view.pair import Pair, paired
from meshflow.view.renderer import renderer_for
from meshflow.view.scale import Scale

__all__ = ["Findings", "Panel", "Run", "found"]

_WIDE, _TALLEST = 720, 900  # pixels of a panel that VTK draws


class Named(Protocol):
    """A parameter: value, unit, origin and reason."""

    @property
    def value(self) -> float | str:
        """A number or a word."""
        ...

    @property
    def unit(self) -> str:
        """The unit of a number."""
        ...

    @property
    def origin(self) -> str:
        """``given | estimated | default``."""
        ...

    @property
    def why(self) -> str:
        """The reason, in a few words."""
        ...


class Run(Protocol):
    """What a report needs of a result, such as :class:`meshflow.results.result.Result`, which this package does not import.

    ``noise`` has sigma, channels, quantum and how, or is None. ``candidates``, the chosen one first, have times and risks.
    ``history`` has the arrays time, area, change and largest. ``parts`` are runs by name, usually none. ``removed`` is an array,
    ``correlation`` a number or None.
    """

    @property
    def before(self) -> Data:
        """The data before."""
        ...

    @property
    def after(self) -> Data:
        """The data after."""
        ...

    @property
    def parameters(self) -> Mapping[str, Named]:
        """By name."""
        ...

    @property
    def noise(self) -> Any:
        """The noise found in the data."""
        ...

    @property
    def candidates(self) -> Sequence[Any]:
        """The candidates of the search, the chosen one first."""
        ...

    @property
    def history(self) -> Any:
        """The run in arrays."""
        ...

    @property
    def removed(self) -> Any:
        """Before minus after."""
        ...

    @property
    def correlation(self) -> Any:
        """The autocorrelation of what was removed; None where it is not known."""
        ...

    @property
    def stopped_because(self) -> str:
        """Why the run ended, a sentence."""
        ...

    @property
    def warnings(self) -> Sequence[str]:
        """Sentences."""
        ...

    @property
    def version(self) -> str:
        """The version of meshflow."""
        ...

    @property
    def parts(self) -> Mapping[str, "Run"]:
        """The runs of the parts, by name."""
        ...


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture.

    :ivar label: above the picture.
    :ivar picture: (h, w, 3) in uint8.
    :ivar pixel: height over width of a pixel.
    """

    label: str
    picture: Array
    pixel: float

    @property
    def aspect(self) -> float:
        """Width over height."""
        h, w = self.picture.shape[:2]
        return w / h / self.pixel


@dataclass(frozen=True, eq=False)
class Findings:
    """The contents of a report.

    :ivar panels: before, after, removed; none where they cannot be drawn.
    :ivar scale: colours of what was removed.
    :ivar foot: a line below the panels.
    :ivar facts: names and sentences, including warnings.
    :ivar table: the parameters: name, value, unit, origin, reason.
    :ivar notes: sentences on the pictures, or why there are none.
    """

    title: str
    panels: tuple[Panel, ...]
    scale: Scale
    foot: str
    charts: tuple[Chart, ...]
    facts: tuple[tuple[str, str], ...]
    table: tuple[tuple[str, str, str, str, str], ...]
    notes: tuple[str, ...]


def found(run: Run, title: str) -> Findings:
    """The contents of the report of a run."""
    unit = run.before.unit if isinstance(run.before, (HeightField, RangeImage)) else ""
    before, channel = _shown(run.before)
    pair = paired(before, _shown(run.after)[0], unit)
    scale = pair.removed if channel is None else replace(pair.removed, what=f"{channel}, {pair.removed.what}")
    panels, foot, notes = _panels(pair, scale)
    caption = () if channel is None else (f"pictures: {channel}, of {_channels(run.before)}",)
    rows = tuple((n, _number(p.value), p.unit, p.origin, p.why) for n, p in run.parameters.items())
    return Findings(
        title or _name(run.before, bool(run.removed.any())),
        panels,
        scale,
        foot,
        _charts(run, pair, unit),
        _facts(run, pair, unit),
        rows,
        caption + notes,
    )


def _name(data: Data, changed: bool) -> str:
    """A short description of what was smoothed."""
    done = "smoothed" if changed else "unchanged"
    if isinstance(data, Mesh):
        return f"Mesh of {len(data.points)} points and {len(data.faces)} triangles, {done}"
    h, w = data.missing.shape
    what = {HeightField: "Height field", Image: "Image"}.get(type(data), "Range image")
    return f"{what} of {h} × {w} samples, {done}"


def _channels(data: Data) -> int:
    return data.values.shape[2] if isinstance(data, Image) and data.values.ndim == 3 else 1


def _shown(data: Data) -> tuple[Data, str | None]:
    """What can be shown of a data object; for channels that are no colours the first channel, and its name."""
    if isinstance(data, Image) and _channels(data) not in (1, 3, 4):
        return replace(data, values=data.values[..., 0]), "channel 1"
    return data, None


def _panels(pair: Pair, scale: Scale) -> tuple[tuple[Panel, ...], str, tuple[str, ...]]:
    """Pictures of before, after and removed, the line below, and notes. Grids are drawn sample by sample, from the front."""
    look = Look(renderer=None if isinstance(pair.before, Mesh) else "hillshade")
    try:
        renderer = renderer_for((pair.before, pair.after), look, window=False)
        geometries = renderer.geometries(pair.before, pair.after)
    except (InputError, MissingPackage) as cause:
        return (), "", (f"no pictures: {cause}",)
    aspect = renderer.aspect(geometries[0], pair.before)
    size = _WIDE, round(min(max(_WIDE / aspect, _WIDE / 2), _TALLEST))
    pixel = renderer.pixel(pair.before)
    shown = (("before", pair.before, geometries[0], None), ("after", pair.after, geometries[1], None))
    shown = (*shown, ("removed", pair.after, geometries[1], scale.thinned(renderer.step)))
    panels = tuple(
        Panel(label, renderer.panel(data, geometry, size, hue), pixel) for label, data, geometry, hue in shown
    )
    return panels, renderer.foot(), renderer.notes


def _charts(run: Run, pair: Pair, unit: str) -> tuple[Chart, ...]:
    """Histogram, area, change, and the curves of the search, as far as they exist."""
    sigma = 0.0 if run.noise is None else float(run.noise.sigma)
    charts, samples = [], _samples(run, pair)
    if samples.any():
        charts.append(histogram(samples, sigma, unit))
    time = run.parameters["time"].unit if "time" in run.parameters else ""
    went = run.history
    if len(went) > 1:
        times, areas, changes, largest = went.time, went.area, went.change, went.largest
        charts.append(course("area", {"area": areas}, times, (time, "squared length")))
        # The change is that of all channels of a sample together, the noise that of each channel.
        k = samples.shape[-1] if samples.ndim == 2 else 1
        level = (sigma * np.sqrt(k), f"σ{f' √{k}' if k > 1 else ''} = {sigma * np.sqrt(k):.4g}")
        charts.append(course("change", {"rms": changes, "largest": largest}, times, (time, unit), level))
    if run.candidates:
        curves = tuple(Curve(tuple(candidate.times), tuple(candidate.risks)) for candidate in run.candidates)
        charts.append(risks(curves, float(went.time[-1]), (time, unit)))
    return tuple(charts)


def _samples(run: Run, pair: Pair) -> Array:
    """What was removed, measured as the noise: (n,), or (n, k) for channels; along the normals where points of a mesh move."""
    if isinstance(run.before, Mesh):
        return pair.removed.values if _moved(run.before) else run.removed
    return run.removed[~run.before.missing]


def _moved(data: Data) -> bool:
    """Whether only the points of a mesh were moved."""
    return isinstance(data, Mesh) and data.moves == "points"


def _facts(run: Run, pair: Pair, unit: str) -> tuple[tuple[str, str], ...]:
    """Why the run ended, the noise, what was removed, warnings."""
    after = f" {unit}" if unit else ""
    there = _samples(run, pair)
    rms, most = float(np.sqrt(np.mean(there**2))), float(np.abs(there).max())
    each = ", along the normals" if _moved(run.before) else "" if there.ndim == 1 else ", of each channel"
    removed = f"rms {rms:.4g}{after}, largest {most:.4g}{after}{each}" if most > 0 else "nothing was removed"
    if run.correlation is not None:
        removed += f"; correlation with its neighbours {run.correlation:.3f} (0: white noise, 1: all structure)"
    facts = [("ended", run.stopped_because)]
    if run.parts:
        facts += [(name, f"{one.stopped_because}; noise {_noise(one.noise, after)}") for name, one in run.parts.items()]
        facts += [("warning", f"{name}: {word}") for name, one in run.parts.items() for word in one.warnings]
    else:
        facts.append(("noise found", _noise(run.noise, after)))
    facts += [("removed", removed), *(("warning", warning) for warning in run.warnings)]
    return (*facts, ("version", f"meshflow {run.version}"))


def _noise(noise: Any, after: str) -> str:
    """The noise of the data, in words."""
    if noise is None:
        return "not looked for"
    how = {"given": "given", "nothing": "too few samples to tell"}.get(noise.how, f"found from {noise.how}")
    words = f"σ = {noise.sigma:.4g}{after}, {how}"
    if len(noise.channels) > 1:
        words += f"; of the channels {', '.join(f'{sigma:.4g}' for sigma in noise.channels)}"
    return words + (f"; data in steps of {noise.quantum:.4g}{after}" if noise.quantum > 0 else "; no quantum")


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}".replace("-", "−")
