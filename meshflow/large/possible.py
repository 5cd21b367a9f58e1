"""Refuses what no window of a grid can know of the whole."""

from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.stops import AreaLoss, Residual

__all__ = ["must_be_local", "must_be_of_the_family"]


def must_be_local(request: Request) -> None:
    """Refuse what no window can know of the whole.

    :raises InputError: it names the option, and says why.
    """
    held = request.constraints
    asked = {
        "stop": (
            not all(isinstance(stop, (Residual, AreaLoss)) for stop in request.stops),
            "any single sample may meet it; take a residual, a loss of area, or a time",
        ),
        "twicing": (bool(request.stops) and bool(request.twicing), "with a stop it needs the whole; give a time"),
        "level": (request.level is not None, "offsets are those of whole lines"),
        "max_change='step'": (isinstance(held.max_change, str), "the step is found from all samples; give a number"),
        "domain": (
            request.domain not in ("auto", "length", "stabilized", "magnitudes"),
            "only for range images, and for pictures in memory",
        ),
    }
    for word, (given, why) in asked.items():
        if given:
            raise InputError(f"{word}: not in windows, {why}")


def must_be_of_the_family(request: Request, channels: int) -> None:
    """Refuse methods whose rates or steps no window can have as the whole has them.

    :param channels: their number.
    :raises InputError: it names the method.
    """
    asked = request.heights
    if request.named and not asked.searches_for(channels):
        raise InputError(
            f"method={asked.word!r}: not in windows; take a method of the Beltrami family, such as beltrami or "
            "perona-malik"
        )
    if asked.control(None) is not None:
        raise InputError(
            f"method={asked.word!r}: not in windows, its steps follow the area of the whole; leave area_steps out"
        )
