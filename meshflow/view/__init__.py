"""Looking: a thing before and after, and what lies between. What draws is imported when something is to be drawn."""

from meshflow.view.panels import flows
from meshflow.view.picture import Pictured, compare, show
from meshflow.view.probe import Rendering, rendering

__all__ = ["Pictured", "Rendering", "compare", "flows", "rendering", "show"]
