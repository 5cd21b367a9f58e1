"""Tables of methods and options, made from their declarations."""

import inspect
import json as notation
import re
from typing import Any

from rich.table import Table
from rich.text import Text

from meshflow.cli.console import must_be_open, out, rows_printed, said
from meshflow.cli.flags import FLOW
from meshflow.errors import Fact
from meshflow.flow.methods import METHODS, Search, no_method, papers_of, word_of
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.geometry.options import Option, options_of

# What is said below the methods.
CLASSICS = (
    "schemes as they were published (umbrella, hc, perona_malik, field_picture, hierarchy, compressed, ...) are functions of "
    "meshflow.classics in Python"
)

__all__ = ["methods_table", "options_table"]


def methods_table(json: bool, markdown: bool) -> None:
    """Print the methods: name, paper, what they move, options, what they are, when to use them, and what they conserve."""
    rows = []
    for word, kind in METHODS.items():
        if not isinstance(kind, type):
            continue
        names = ", ".join(f"--{o.flag}" for o in _used(kind) if o.has_flag)
        text = inspect.getdoc(kind) or ""
        taken = re.search(r"Use\s+it .*?(?=\n\n|\Z)", text, re.DOTALL)
        what, when = _plain(text.split("\n\n")[0]), _plain(taken.group() if taken else "")
        conserves = getattr(kind, "conserves", "")
        rows.append((word, ", ".join(papers_of(kind)), _moved(kind), names, what, when, conserves))
    heads = ("method", "paper", "moves", "options", "what it is", "when", "conserves")
    _printed(heads, rows, json, markdown)
    said("", () if json else (Fact(CLASSICS),))


def _used(kind: type) -> tuple[Option, ...]:
    """The options of a method that have an effect."""
    return tuple(option for option in options_of(kind) if option.name not in getattr(kind, "unused", ()))


def _moved(kind: type) -> str:
    """What a method moves, in words."""
    if issubclass(kind, Search):
        return "all data"
    if not issubclass(kind, HeightMethod):
        return "points of a mesh"
    method = kind()
    depths = "" if method.misfit(along_rays=True, on_grid=True) else ", depths"
    return f"heights, images{depths}" + (
        "" if method.misfit(along_rays=False, on_grid=False) else ", channels of a mesh"
    )


def options_table(json: bool, markdown: bool, method: str | None = None) -> None:
    """Print the options of a flow, or of one method: flag, type, meaning, and unit and default.

    :param method: its name, in any spelling.
    :raises InputError: for an unknown method.
    """
    if method is not None:
        _options_of_method(method, json, markdown)
        return
    rows = [(f"--{flag.name.replace('_', '-')}", _named(flag.kind), flag.panel, flag.help) for flag in FLOW]
    _printed(("option", "type", "of", "meaning"), rows, json, markdown)


def _options_of_method(given: str, json: bool, markdown: bool) -> None:
    """Print the options of one method, and in text what it is."""
    kind = METHODS.get(word_of(given))
    if not isinstance(kind, type):
        raise no_method(given)
    rows = []
    for one in _used(kind):
        flag = f"--{one.flag}" if one.has_flag else "(Python only)"
        default = "from the data" if one.default is None else str(one.default)
        rows.append((flag, one.name, _named(_readable(one.kind)), one.unit, one.range, default, one.meaning))
    if not json and not markdown:
        text = "\n".join(map(_plain, (inspect.getdoc(kind) or "").split("\n\n")))
        conserves = getattr(kind, "conserves", "")
        out.print(
            Text(f"{word_of(given)} ({kind.__name__}): {text}\nIt moves: {_moved(kind)}. It conserves: {conserves}.\n")
        )
    _printed(("option", "in Python", "type", "unit", "range", "default", "meaning"), rows, json, markdown)


def _readable(kind: Any) -> Any:
    """A type without its alias."""
    return getattr(kind, "__name__", kind) if isinstance(kind, type) else kind


def _plain(sentence: str) -> str:
    """A sentence of a docstring without its markup: ``words`` and :class:`names` as plain words."""
    return re.sub(r":[a-z]+:`~?\.?([^`]+)`", r"\1", " ".join(sentence.split())).replace("``", "")


def _named(kind: Any) -> str:
    """A type in words."""
    words = str(kind).replace("typing.", "").replace(" | None", "").replace("Optional", "")
    return {
        "<class 'float'>": "number",
        "float": "number",
        "int": "whole number",
        "str": "word or file",
        "bool": "yes or no",
    }.get(words, " ".join(words.replace("Literal", "").strip("[]").replace("'", "").split()))


def _printed(heads: tuple[str, ...], rows: list[tuple[str, ...]], json: bool, markdown: bool) -> None:
    """A table on stdout."""
    must_be_open()
    if json:
        out.print_json(notation.dumps([dict(zip(heads, row, strict=True)) for row in rows]))
        return
    if markdown:
        lines = [heads, tuple("---" for _ in heads), *rows]
        text = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        out.print(Text(text), soft_wrap=True)
        return
    table = Table(*heads, box=None, padding=(0, 2, 0, 0))
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    rows_printed(table)
