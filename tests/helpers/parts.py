"""Flat words to the typed parts of the door, for tests that go over many of them."""

from typing import Any

from meshflow.cli.asking import CONSTRAINTS, STOPS
from meshflow.estimate.constraints import PreserveArea, PreserveVolume
from meshflow.flow.compute import Compute
from meshflow.flow.methods import METHODS
from meshflow.geometry.options import options_of

PRESERVE = {"volume": PreserveVolume(), "scaling": PreserveVolume(by="scaling"), "area": PreserveArea()}


def parts(**words: Any) -> dict[str, Any]:
    """Keywords of ``smooth``: options of methods, stops, constraints and of Compute may be given by their names."""
    words = {name: value for name, value in words.items() if value is not None}
    names = {o.name for kind in METHODS.values() for o in options_of(kind)}
    options = {name: words.pop(name) for name in list(words) if name in names}
    compute = {o.name: words.pop(o.name) for o in options_of(Compute) if o.name in words}
    stops = [made(words.pop(name)) for name, made in STOPS.items() if name in words]
    stops += [words.pop("stop")] if "stop" in words else []
    held = [made(words.pop(name)) for name, made in CONSTRAINTS.items() if name in words]
    held += [PRESERVE[words.pop("preserve")]] if "preserve" in words else []
    if options:
        word = words.pop("method", None)
        kinds = METHODS.values() if word is None else (METHODS[word],)
        kind = next(kind for kind in kinds if set(options) <= {o.name for o in options_of(kind)})
        words["method"] = kind(**options)
    if compute:
        words["compute"] = Compute(**compute)
    if stops:
        words["stop"] = stops
    if held:
        words["constraints"] = held
    return words
