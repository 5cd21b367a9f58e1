"""Pictures: of data, of data before and after, of what was removed, and of a comparison of flows.

**Write a picture, or open a window**: :func:`compare` before and after, :func:`show` data, :func:`flows`,
:func:`vectors`, :func:`isosurfaces`.

**In a notebook**: :func:`plotter`. **What colours stand for**: :func:`measured`. **Whether VTK can draw here**:
:func:`rendering`.

What draws is imported when something is to be drawn.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.view.contours import isosurfaces
    from meshflow.view.glyphs import vectors
    from meshflow.view.look import Look
    from meshflow.view.panels import flows
    from meshflow.view.pictures import Pictured, compare, plotter, show
    from meshflow.view.probe import Rendering, rendering
    from meshflow.view.quantity import measured

__all__ = [
    "Look",
    "Pictured",
    "Rendering",
    "compare",
    "flows",
    "isosurfaces",
    "measured",
    "plotter",
    "rendering",
    "show",
    "vectors",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "glyphs": ("vectors",),
        "contours": ("isosurfaces",),
        "look": ("Look",),
        "panels": ("flows",),
        "pictures": ("Pictured", "compare", "plotter", "show"),
        "probe": ("Rendering", "rendering"),
        "quantity": ("measured",),
    },
)
