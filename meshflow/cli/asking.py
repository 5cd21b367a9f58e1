"""Makes a request of the flags of a command."""

from collections.abc import Callable, Iterable
from dataclasses import fields
from typing import Any

from meshflow.cli.flags import FLOW, Given
from meshflow.errors import InputError
from meshflow.estimate.constraints import (
    Constraint,
    DataWeights,
    Fixed,
    Mask,
    MaxChange,
    MinComponent,
    Mobility,
    PreserveArea,
    PreserveVolume,
)
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import METHODS, Method, Search, no_method, word_of
from meshflow.flow.stops import AreaLoss, Displacement, Residual, Steps
from meshflow.geometry.options import options_of

__all__ = ["asked", "narrowed"]

STOPS: dict[str, Callable[[Any], Any]] = {
    "steps": Steps, "residual": Residual, "area_loss": AreaLoss, "displacement": Displacement,
}  # fmt: skip
CONSTRAINTS: dict[str, Callable[[Any], Constraint]] = {
    "fixed": Fixed, "mask": Mask, "max_change": MaxChange, "data_weights": DataWeights, "mobility": Mobility,
    "min_component": MinComponent,
}  # fmt: skip
PRESERVED: dict[str, Constraint] = {
    "volume": PreserveVolume(), "scaling": PreserveVolume(by="scaling"), "area": PreserveArea(),
}  # fmt: skip


def asked(given: Given, per_sample: Callable[[str, str], Any], suiting: tuple[str, ...] = tuple(METHODS)) -> Request:
    """Make the request; the flags of a flow are removed from ``given``.

    :param per_sample: makes the numbers of a flag that holds one for each sample: of its name and what was given.
    :param suiting: the words of the methods that suit the data.
    :raises InputError: for options that exclude each other, or that the method does not have.
    """
    if given.get("quiet") and given.get("verbose"):
        raise InputError("--quiet and --verbose: they contradict each other; leave one of them out")
    flags = {flag.name: given.pop(flag.name, None) for flag in FLOW}
    stops = [made(flags[name]) for name, made in STOPS.items() if flags[name] is not None]
    constraints = []
    for name, made in CONSTRAINTS.items():
        if flags[name] is not None:
            value = flags[name] if name == "min_component" else per_sample(name, flags[name])
            constraints.append(made(value))
    if flags["preserve"] is not None:
        constraints.append(PRESERVED[flags["preserve"]])
    compute = Compute(**_of(Compute, flags))
    numbers = {name: value for name, value in _of(Request, flags).items() if name != "method"}
    return Request.of(_method(flags, suiting), stops, constraints, compute=compute, **numbers)


def narrowed(request: Request, word: str | None, suiting: tuple[str, ...]) -> tuple[str, ...]:
    """A note where options alone, without a method, have decided the method: no other is searched for.

    :param word: the method that was named; ``suiting``: the words of the methods that suit the data.
    """
    method = request.method
    if word is not None or method is None or isinstance(method, Search):
        return ()
    given = [o.name for o in options_of(type(method)) if getattr(method, o.name) != o.default]
    having = [
        word
        for word, kind in METHODS.items()
        if isinstance(kind, type) and _has(kind, given) and word in suiting and word != method.word
    ]
    others = f" (--method names another one that has it: {', '.join(having)})" if having else ""
    return (
        f"{', '.join(map(_flag, given))}: an option of method {method.word}, so this method was used{others}; no other method "
        "was tried",
    )


def _of(kind: type, flags: Given) -> Given:
    """The options of a class that were given."""
    return {o.name: flags[o.name] for o in options_of(kind) if flags.get(o.name) is not None}


def _method(flags: Given, suiting: tuple[str, ...]) -> Method | None:
    """The named method with its options; without a name, the first method that has all the given options.

    :param suiting: the words of the methods that suit the data.

    :raises InputError: for an unknown word, and an option that the method does not have.
    """
    names = {o.name for kind in METHODS.values() if isinstance(kind, type) for o in options_of(kind)}
    options = {name: flags[name] for name in sorted(names) if flags.get(name) is not None}
    word = flags["method"]
    if word is None:
        if not options:
            return None
        having = {word: kind for word, kind in METHODS.items() if isinstance(kind, type) and _has(kind, options)}
        for word, kind in having.items():
            if word in suiting:
                return kind(**options)
        given = ", ".join(_flag(name) for name in options)
        if having:
            raise InputError(f"{given}: belongs to {', '.join(having)}; methods for this data are {', '.join(suiting)}")
        raise InputError(f"{given}: no method has all of these options")
    word = word_of(word) or word
    if word not in METHODS:
        raise no_method(word)
    kind = METHODS[word]
    known = {f.name for f in fields(kind)} if isinstance(kind, type) else set()  # type: ignore[arg-type]
    for name in options:
        if name not in known:
            having = [w for w, k in METHODS.items() if isinstance(k, type) and name in {o.name for o in options_of(k)}]
            raise InputError(f"{_flag(name)}: no option of method {word}; it belongs to {', '.join(having)}")
    return kind(**options)


def _has(kind: type, names: Iterable[str]) -> bool:
    """Whether a class has all these options."""
    return set(names) <= {o.name for o in options_of(kind)}


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"
