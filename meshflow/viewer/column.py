"""The column beside the surface in a window of VTK: text on the state, curves of the run, controls, and a progress bar."""

from collections.abc import Callable
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from meshflow.view.numbers import plain, rounded
from meshflow.view.vtk_scene import COLUMN
from meshflow.viewer.choices import Choices
from meshflow.viewer.curves import across, measures
from meshflow.viewer.timeline import Timeline

if TYPE_CHECKING:
    import pyvista as pv

__all__ = ["Column"]

_INK, _PALE, _BUSY = "#26282b", "#b9bfc5", "#2b6cb0"
_LETTERS = 6  # pyvista counts half pixels
_LETTER = 6.8  # pixels of width, about
_PLOT = (0.42, 0.34)  # the curves: bottom and height
_BAR = 0.4  # the height of the progress bar
_CONTROLS = 0.34  # the uppermost control
_BELOW = 0.05  # the room for the label of a slider below a list


@dataclass(frozen=True)
class _Track:
    """The position of a slider, as shares of the window from the start of its renderer.

    :ivar wide: the share of the window that its renderer has; lengths are shares of it.
    """

    left: float
    right: float
    height: float
    wide: float = COLUMN


class Column:
    """The column of a window, and the slider over its states below the geometry.

    :ivar mark: the position of the current state on the axis of the curves, 0 to 1.
    :param plotter: one that :func:`meshflow.view.vtk_scene.single` made with a column.
    """

    def __init__(self, plotter: "pv.Plotter") -> None:
        self.plotter: Any = plotter
        self.mark = 1.0
        self.controls: dict[str, Any] = {}
        self._chart: Any = None
        self._marker: Any = None
        self._bar = _Progress()
        with _Within(self.plotter):
            self.plotter.renderer.InteractiveOff()
            self.plotter.renderer.AddViewProp(self._bar.actor)

    def say(self, *lines: str) -> None:
        """Write text at the top."""
        fit = max(int(0.92 * COLUMN * self.plotter.window_size[0] / _LETTER), 12)
        rows = [row for line in lines if line for row in wrap(line, fit, break_on_hyphens=False)]
        with _Within(self.plotter):
            self._write("\n".join(rows), 0.985, _INK, "summary").prop.SetVerticalJustificationToTop()

    def busy(self, share: float | None) -> None:
        """Show the progress of a run, 0 to 1; None: no run."""
        self._bar.show(share)

    def plot(self, timeline: Timeline) -> None:
        """Show the curves of a run instead of the old ones."""
        import pyvista as pv

        with _Within(self.plotter):
            if self._chart is not None:
                self.plotter.remove_chart(self._chart)
            self._chart = chart = pv.Chart2D(size=(1.0, _PLOT[1]), loc=(0.0, _PLOT[0]), grid=False)
            chart.background_color, chart.border_color = "white", "white"
            places, times = across(timeline), [measurement.time for measurement in timeline.history]
            for curve in measures(timeline):
                chart.line(places, curve.shares, color=curve.colour, width=2.0, label=curve.words)
            self._marker = chart.line([0.0, 0.0], [0.0, 1.05], color=_INK, width=1.0, style="--")
            chart.x_range, chart.y_range = [0.0, 1.0], [0.0, 1.05]
            ticks = _ticks(times[-1])
            chart.x_axis.tick_locations = [float(np.sqrt(tick / (times[-1] or 1.0))) for tick in ticks]
            chart.x_axis.tick_labels = [plain(tick, digits=1) for tick in ticks]
            unit = f" [{timeline.unit}]" if timeline.unit else ""
            chart.x_axis.label, chart.y_axis.label = f"time{unit}", ""
            chart.x_axis.label_size = chart.x_axis.tick_label_size = 2 * _LETTERS
            chart.y_axis.ticks_visible = chart.y_axis.tick_labels_visible = chart.legend_visible = False
            self.plotter.add_chart(chart)
            for k, curve in enumerate(measures(timeline)):
                self._write(curve.words, _PLOT[0] + _PLOT[1] + 0.022 * (1 - k), curve.colour, f"curve {k}")

    def mark_at(self, share: float) -> None:
        """Mark the current state."""
        self.mark = share
        if self._marker is not None:
            self._marker.update([share, share], [0.0, 1.05])

    def slide_states(self, last: int, at: int, moved: Callable[[float], None]) -> Any:
        """Add the slider over the states, below the geometry."""
        track = _Track(0.04, 0.96 - COLUMN, 0.04, wide=1.0 - COLUMN)
        return self._slider(moved, track, (0, last), at, "state", fmt="%.0f", interaction_event="always")

    def show_controls(self, controls: list[dict[str, Any]], turned: Callable[[str, Any], None]) -> None:
        """Show the controls of a flow instead of the old ones; a choice is a list, the others are sliders."""
        for widget in self.controls.values():
            widget.Off()
        self.controls = {}
        top = _CONTROLS
        for control in controls:
            if "items" in control:
                name, place = control["name"], (0.02, COLUMN - 0.01, top)
                self.controls[name] = Choices(
                    self.plotter, control["items"], control["value"], place, lambda word, name=name: turned(name, word)
                )
                top -= Choices.height(len(control["items"])) + _BELOW
        sliders = [control for control in controls if "items" not in control]
        with _Within(self.plotter):
            for k, control in enumerate(sliders):
                height = top - k * (top - 0.04) / max(len(sliders) - 1, 3 if top == _CONTROLS else 2)
                track, name = _Track(0.02, COLUMN - 0.02, height), control["name"]
                self.controls[name] = self._slider(
                    lambda value, name=name: turned(name, value),
                    track,
                    (control["low"], control["high"]),
                    control["value"],
                    control["label"],
                    fmt="%.3g",
                    interaction_event="end",
                )

    def _slider(
        self,
        moved: Callable[..., None],
        track: _Track,
        span: tuple[float, float],
        value: float,
        title: str,
        **options: Any,
    ) -> Any:
        """A compact slider."""
        widget = self.plotter.add_slider_widget(
            moved, rng=span, value=value, title=title, color=_INK, slider_width=0.016, tube_width=0.002, **options
        )
        shown = widget.GetRepresentation()
        shown.GetPoint1Coordinate().SetValue(track.left, track.height)
        shown.GetPoint2Coordinate().SetValue(track.right, track.height)
        shown.SetSliderLength(0.009 / track.wide)
        shown.SetEndCapLength(0.002 / track.wide)
        shown.SetEndCapWidth(0.012)
        shown.SetLabelHeight(0.014)
        shown.SetTitleHeight(0.014)
        return widget

    def _write(self, words: str, height: float, colour: str, name: str) -> Any:
        place = (0.04, height)
        return self.plotter.add_text(
            words, position=place, viewport=True, font_size=_LETTERS, color=colour, name=name, render=False
        )


class _Within:
    """A context in which the column is the active renderer; afterwards it is that of the geometry."""

    def __init__(self, plotter: Any) -> None:
        self.plotter = plotter

    def __enter__(self) -> None:
        self.plotter.subplot(0, 0)

    def __exit__(self, *_: object) -> None:
        self.plotter.subplot(0, 1)


class _Progress:
    """A progress bar across the column."""

    def __init__(self) -> None:
        import vtk

        self._points: Any = vtk.vtkPoints()
        for x, y in ((0.06, 0), (0.06, 1), (0.94, 1), (0.94, 0)):
            self._points.InsertNextPoint(x, _BAR + 0.008 * y, 0.0)
        cells = vtk.vtkCellArray()
        cells.InsertNextCell(4, (0, 1, 2, 3))
        self._shape: Any = vtk.vtkPolyData()
        self._shape.SetPoints(self._points)
        self._shape.SetPolys(cells)
        place = vtk.vtkCoordinate()
        place.SetCoordinateSystemToNormalizedViewport()
        mapper = vtk.vtkPolyDataMapper2D()
        mapper.SetInputData(self._shape)
        mapper.SetTransformCoordinate(place)
        self.actor: Any = vtk.vtkActor2D()
        self.actor.SetMapper(mapper)
        self.actor.GetProperty().SetColor(*(int(_BUSY[k : k + 2], 16) / 255 for k in (1, 3, 5)))
        self.show(None)

    def show(self, share: float | None) -> None:
        """Draw the bar up to a share; None hides it."""
        self.actor.SetVisibility(share is not None)
        right = 0.06 + 0.88 * max(share or 0.0, 0.01)  # a started run is visible
        for corner, y in ((2, 1), (3, 0)):
            self._points.SetPoint(corner, right, _BAR + 0.008 * y, 0.0)
        self._points.Modified()
        self._shape.Modified()


def _ticks(end: float) -> list[float]:
    """0, a round time near the middle of the square-root axis, and one near its end."""
    if end <= 0:
        return [0.0]
    return [0.0, rounded(0.2 * end), rounded(end)]
