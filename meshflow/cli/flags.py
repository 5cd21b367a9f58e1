"""Flags of the commands. Those of a flow are made from the declarations of its options."""

import inspect
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer

from meshflow.estimate.constraints import DataWeights, Fixed, Mask, MaxChange, MinComponent, Mobility
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import HEIGHT_METHODS, METHODS, POINT_METHODS, Search
from meshflow.flow.stops import AreaLoss, Displacement, Residual, Steps
from meshflow.geometry.options import Option, options_of

__all__ = ["FIRST", "FLOW", "Flag", "Given", "command", "flow_flags", "only"]

# The values given on the command line, by the names of the flags.
Given = dict[str, Any]

FIRST, HEIGHTS, POINTS, STOP, HOLD, COMPUTE = (
    "Most used",
    "Heights, channels and depths: the method",
    "Points of a mesh: the method",
    "Stops",
    "Constraints",
    "Computation",
)


@dataclass(frozen=True)
class Flag:
    """A flag, or an argument, of a command.

    :ivar name: of the value, a Python name.
    :ivar kind: its type, as typer reads it.
    :ivar help: a short sentence.
    :ivar panel: the panel of the help in which it stands.
    :ivar default: its value where it is not given; ``...``: it must be given.
    :ivar words: what the user types, where that is not made from the name.
    :ivar metavar: the name of an argument, which has no flag.
    """

    name: str
    kind: Any
    help: str
    panel: str = ""
    default: Any = None
    words: tuple[str, ...] = ()
    metavar: str = ""

    def parameter(self) -> inspect.Parameter:
        """The flag as a parameter of a function, as typer reads it."""
        if self.metavar:
            declared: Any = typer.Argument(metavar=self.metavar, help=self.help, show_default=False)
        else:
            words = self.words or (f"--{self.name.replace('_', '-')}",)
            declared = typer.Option(*words, help=self.help, rich_help_panel=self.panel or None)
        default = inspect.Parameter.empty if self.default is ... else self.default
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[self.kind, declared]
        )


def command(
    app: typer.Typer, name: str, flags: Iterable[Flag], context: bool = False
) -> Callable[[Callable[[Given], None]], Callable[[Given], None]]:
    """Decorator: make a command of a function that takes the given values.

    :param name: of the command.
    :param flags: in the order of the help; arguments first.
    :param context: give the context of typer under that name, too.
    """
    parameters = [flag.parameter() for flag in flags]
    if context:
        parameters.append(inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))

    def made(work: Callable[[Given], None]) -> Callable[[Given], None]:
        """Make the command of a function."""

        def called(**given: Any) -> None:
            """Call the function with the given values."""
            work(given)

        called.__doc__ = work.__doc__
        called.__name__ = work.__name__
        called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {p.name: p.annotation for p in parameters}
        app.command(name)(called)
        return work

    return made


def flow_flags() -> tuple[Flag, ...]:
    """The flags of a flow: request, methods, stops, constraints, computation."""
    words = " | ".join(METHODS)
    method = Flag("method", str | None, f"The method: {words}. Default: search.", FIRST)
    late = ("boundary", "domain", "outliers", "level")
    request = [_of(option, FIRST) for option in options_of(Request) if option.name not in late]
    stops = [_of(option, STOP) for kind in (Steps, Residual, AreaLoss, Displacement) for option in options_of(kind)]
    constraints = [
        _of(option, HOLD)
        for kind in (Fixed, Mask, MaxChange, DataWeights, Mobility, MinComponent)
        for option in options_of(kind)
    ]
    preserve = Flag(
        "preserve",
        Literal["volume", "scaling", "area"] | None,
        "What a mesh preserves while its points move: volume (exactly), scaling (its volume, by rescaling), or area (by "
        "rescaling).",
        HOLD,
    )
    compute = [_of(option, COMPUTE) for option in options_of(Request) if option.name in late]
    compute += [_of(option, COMPUTE) for option in options_of(Compute) if option.has_flag]
    heights = _of_methods((Search, *HEIGHT_METHODS), HEIGHTS, {"along"})
    points = _of_methods((*POINT_METHODS, Search), POINTS, {flag.name for flag in heights})
    return (method, *request, *heights, *points, *stops, *constraints, preserve, *compute)


def _of_methods(methods: Iterable[type], panel: str, known: set[str]) -> list[Flag]:
    """The options of methods, each once; each says which methods have it."""
    found: dict[str, tuple[Option, list[tuple[str, Option]]]] = {}
    for method in methods:
        for option in options_of(method):
            if option.name not in known and option.has_flag:
                found.setdefault(option.name, (option, []))[1].append((getattr(method, "word", ""), option))
    every = []
    for first, having in found.values():
        words = [word for word, _ in having]
        flag = _of(first, panel, _others(first, having))
        every.append(flag if "search" in words else replace(flag, help=f"For {', '.join(words)}: {flag.help}"))
    return every


def _others(first: Option, having: Iterable[tuple[str, Option]]) -> str:
    """The defaults of the methods whose default is another one."""
    return "".join(f"; {word}: {one.default}" for word, one in having if one.default not in (None, first.default))


def _of(option: Option, panel: str, others: str = "") -> Flag:
    """The flag of an option. Its value is None where it is not given, so that given values can be told from defaults.

    :param others: the defaults of the methods whose default is another one.
    """
    unit = f" ({found})" if (found := ", ".join(filter(None, (option.unit, option.range)))) else ""
    declared = option.default is None or "Default" in option.meaning or panel == STOP
    default = "" if declared else f" Default: {option.default}{others}."
    kind = _kind(option.kind)
    words = (f"--{option.flag}", f"--no-{option.flag}") if kind == bool | None else ()
    named = (f"{words[0]}/{words[1]}",) if words else ()
    return Flag(option.flag.replace("-", "_"), kind, f"{option.meaning}{unit}{default}", panel, None, named)


def _kind(kind: Any) -> Any:
    """The type of a flag: a number, one of several words, or text that names a file or an attribute."""
    parts = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
    if words:
        return Literal[tuple(words)] | None  # type: ignore[valid-type]
    for plain in (bool, int, float):
        if plain in parts and str not in parts:
            return plain | None
    return str | None


FLOW = flow_flags()


def only(flags: Iterable[Flag], *names: str) -> tuple[Flag, ...]:
    """The flags of these names, in this order."""
    by_name = {flag.name: flag for flag in flags}
    return tuple(by_name[name] for name in names)
