"""Keywords that a function does not have: refused with the nearest one, or with the part to which they belong."""

from collections.abc import Iterable, Sequence

from meshflow.errors import InputError
from meshflow.estimate.constraints import DataWeights, Fixed, Mask, MaxChange, MinComponent, Mobility
from meshflow.flow.compute import Compute
from meshflow.flow.methods import HEIGHT_METHODS, POINT_METHODS, Method, Search, method_of
from meshflow.flow.stops import AreaLoss, Displacement, Residual, Steps
from meshflow.geometry.options import nearest, options_of
from meshflow.io.metadata import Metadata

__all__ = ["must_be_keywords", "must_be_metadata"]

PARTS = {
    "stop": (Steps, Residual, AreaLoss, Displacement),
    "constraints": (Fixed, Mask, MaxChange, DataWeights, Mobility, MinComponent),
}
# Words that other tools have for what is here, and what to give instead.
MEANT = {
    "sigma": "noise=", "std": "noise=", "noise_sigma": "noise=", "iterations": "stop=Steps(count=...)",
    "iters": "stop=Steps(count=...)", "n_iter": "stop=Steps(count=...)", "steps": "stop=Steps(count=...)",
    "radius": "scale=", "bandwidth": "scale=", "weights": "constraints=DataWeights(...)",
    "roi": "constraints=Mask(...)",
}  # fmt: skip


def must_be_keywords(words: Iterable[str], own: Sequence[str], method: Method | str | None = None) -> None:
    """Refuse keywords that are neither those of :func:`meshflow.smooth` nor metadata, and suggest the nearest one.

    :param own: the keywords of the function itself.
    :param method: that is named beside them: a hint names its own option first.
    :raises InputError: naming them.
    """
    known = (*own, *Metadata.__annotations__)
    inside = {name: f"method={kind.__name__}({name}=...)" for name, kind in _method_options(method).items()}
    inside |= {o.name: f"compute=Compute({o.name}=...)" for o in options_of(Compute)}
    inside |= {
        o.flag.replace("-", "_"): f"{where}={k.__name__}(...)"
        for where, ks in PARTS.items()
        for k in ks
        for o in options_of(k)
    }
    for word in words:
        if word in known:
            continue
        if word in MEANT and word not in inside:
            raise InputError(f"{word}: no keyword of smooth; give {MEANT[word]}")
        if word in inside:
            raise InputError(f"{word}: no keyword of smooth; give {inside[word]}")
        near = nearest(word, (*known, *inside))
        meant = f"; did you mean {inside.get(near, near)}? There" if near else "; there"
        raise InputError(
            f"{word}: no such keyword{meant} are {', '.join(own)}, and metadata (help(meshflow.smooth) lists it by kind of data)"
        )


def must_be_metadata(words: Iterable[str], function: str) -> None:
    """Refuse keywords of a function that takes metadata only.

    :param function: its name.
    :raises InputError: naming them, and what there is.
    """
    known = tuple(Metadata.__annotations__)
    for word in words:
        if word not in known:
            near = nearest(word, known)
            meant = f"did you mean {near}? It" if near else "it"
            raise InputError(f"{word}: no keyword of {function}; {meant} takes metadata only: {', '.join(known)}")


def _method_options(method: Method | str | None) -> dict[str, type[Method]]:
    """The options of all methods, each with the named method if it has the option, else the first method that has it."""
    found: dict[str, type[Method]] = {}
    named = () if method is None else (type(method_of(method)),)
    for kind in (*named, *HEIGHT_METHODS, Search, *POINT_METHODS):
        for option in options_of(kind):
            found.setdefault(option.name, kind)
    return found
