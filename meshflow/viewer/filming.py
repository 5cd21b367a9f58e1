"""From a thing to a film of its flow."""

from pathlib import Path
from typing import Any, Unpack

from meshflow.estimate.parameters import squared_unit
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.results.run import states as flowing
from meshflow.view.appearance import flowing_together, taken
from meshflow.view.film import filmable, filmed
from meshflow.view.look import Looks, looking
from meshflow.view.pictures import Pictured
from meshflow.view.quantity import Quantity
from meshflow.view.renderer import How
from meshflow.view.scene import Removed

__all__ = ["film"]

SIZE = (960, 720)


def film(
    thing: Any,
    path: str | Path,
    *,
    count: int = 48,
    rate: float = 12.0,
    turn: float = 0.0,
    quantity: Quantity | Removed | None = None,
    contrast: float = 1.0,
    how: How | None = None,
    overwrite: bool = False,
    request: Request | None = None,
    progress: Progress = None,
    **look: Unpack[Looks],
) -> Pictured:
    """Film a thing while it is smoothed: the surface, or what was removed so far, or a quantity, over time.

    Colours, light and frame are the same in all frames, and the time is written into each; times grow with the square.

    :param thing: a :class:`meshflow.Document`, a noun, or anything that :func:`meshflow.smooth` takes.
    :param path: ``.mp4`` (needs ``pip install 'meshflow[film]'``) or ``.gif``.
    :param count: how many states are shown.
    :param rate: frames per second.
    :param turn: degrees by which the camera walks around the surface meanwhile; 0: it stands still.
    :param quantity: what colour stands for: ``removed``, ``curvature``, ``edges``, ``triangles``, ``samples``; None: nothing.
    :param contrast: length per unit of the values, for ``edges``.
    :param how: as in :func:`meshflow.view.compare`.
    :param overwrite: replace a file that is there.
    :param request: of the flow, as ``Request.of(method=..., time=...)``; what is not given is estimated.
    :param progress: as in :func:`meshflow.smooth`.
    :param look: the fields of :class:`meshflow.view.Look`.
    :raises InputError: for what cannot be smoothed or drawn.
    :raises FormatError: for a path that cannot be written, another extension, or a file that is there and is not to be replaced;
        before anything is computed.
    :raises MissingPackage: for ``.mp4`` without ffmpeg, and for what only VTK could draw where it cannot.
    """
    looks: Looks = {"size": SIZE, **look}
    seen, target = looking(**looks), filmable(path, overwrite)
    noun, notes = taken(thing, seen.own_colours)
    notes += flowing_together(thing)
    states = flowing(noun, request or Request(), count, progress)
    unit = squared_unit(noun)
    told = filmed(
        states,
        target,
        seen,
        time_unit=unit,
        rate=rate,
        turn=turn,
        quantity=quantity,
        contrast=contrast,
        how=how,
        overwrite=overwrite,
    )
    return Pictured(told.path, told.how, (*notes, *told.notes))
