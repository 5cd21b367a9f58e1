"""A film of data while it is smoothed."""

from pathlib import Path
from typing import Unpack

from meshflow.estimate.parameters import squared_unit
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress
from meshflow.geometry.options import refused
from meshflow.results.run import states as flowing
from meshflow.view.appearance import flowing_together, taken
from meshflow.view.film import Reel, filmable, filmed
from meshflow.view.look import OF_PAIRS, Looks, looking
from meshflow.view.pictures import Pictured
from meshflow.view.quantity import Quantity
from meshflow.view.scale_bar import ground_of
from meshflow.view.scene import Removed

__all__ = ["Films", "film"]

SIZE, COUNT = (960, 720), 48


class Films(Looks, total=False):
    """The options of a film, by name.

    :ivar count: how many states are shown, 48 by default.
    :ivar rate: frames per second, 12 by default.
    :ivar turn: degrees by which the camera moves around the surface during the film; 0, the default: it does not move.
    :ivar quantity: what colour shows: ``removed``, ``curvature``, ``edges``, ``triangles``, ``samples``; None: nothing.
    """

    count: int
    rate: float
    turn: float
    quantity: Quantity | Removed | None


def film(
    data: object,
    path: str | Path,
    *,
    overwrite: bool = False,
    request: Request | None = None,
    progress: Progress = None,
    **options: Unpack[Films],
) -> Pictured:
    """Write a film of data while it is smoothed: the surface, what was removed so far, or a quantity, over time.

    Colours, light and view are the same in all frames, and each shows its time; times grow quadratically.

    Example:

        >>> from meshflow.estimate.request import Request
        >>> from meshflow.synthetic import mesas, noisy
        >>> quick = Request.of(method="quick")
        >>> made = film(noisy(mesas(32), 2.0), "film.gif", request=quick, count=3, size=(320, 240))
        >>> made.path.name
        'film.gif'

    :param data: a :class:`meshflow.Document`, a data object, or anything that :func:`meshflow.smooth` takes.
    :param path: ``.mp4`` (needs ``pip install 'meshflow[film]'``) or ``.gif``.
    :param overwrite: replace an existing file.
    :param request: of the flow, as ``Request.of(method=..., time=...)``; options that are not given are estimated.
    :param progress: as in :func:`meshflow.smooth`.
    :param options: those of :class:`Films` and of :class:`meshflow.view.Look`.
    :raises InputError: for data that cannot be smoothed or drawn.
    :raises FormatError: before anything is computed, for a path that cannot be written, another extension, or a file that exists
        and must not be replaced.
    :raises MissingPackage: for ``.mp4`` without ffmpeg, and where VTK is needed and cannot draw.
    """
    for name in options:
        if name not in Films.__annotations__:
            raise refused(name, tuple(Films.__annotations__), "option of a film")
    count, quantity = options.pop("count", COUNT), options.pop("quantity", None)
    rate, turn = options.pop("rate", Reel.rate), options.pop("turn", Reel.turn)
    looks: Looks = {"size": SIZE, **options}
    seen, target = looking((*OF_PAIRS, "unit"), **looks), filmable(path, overwrite)
    surface, notes = taken(data, seen.own_colours)
    notes += flowing_together(data)
    states = flowing(surface, request or Request(), count, progress)
    reel = Reel(rate, turn, squared_unit(surface), ground_of(data, surface))
    written = filmed(states, target, seen, reel, quantity, overwrite)
    return Pictured(written.path, written.renderer, (*notes, *written.notes))
