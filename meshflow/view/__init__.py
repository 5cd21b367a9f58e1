"""Looking: a thing before and after, and what lies between. What draws is imported when something is to be drawn."""

from meshflow.view.look import Look
from meshflow.view.panels import flows
from meshflow.view.pictures import Pictured, compare, plotter, show
from meshflow.view.probe import Rendering, rendering
from meshflow.view.quantity import measured

__all__ = ["Look", "Pictured", "Rendering", "compare", "flows", "measured", "plotter", "rendering", "show"]
