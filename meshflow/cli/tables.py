"""Tables of methods and options, made from their declarations."""

import inspect
import json as notation
import re
from typing import Any

from rich.table import Table
from rich.text import Text

from meshflow.cli.console import out, rows_printed
from meshflow.cli.flags import FLOW
from meshflow.flow.methods import METHODS, POINT_METHODS, Search
from meshflow.geometry.options import options_of

__all__ = ["methods_table", "options_table"]


def methods_table(json: bool, markdown: bool) -> None:
    """Print the methods: name, what they move, options, the first lines of their docstring, and when to take them."""
    rows = []
    for word, kind in METHODS.items():
        if not isinstance(kind, type):
            continue
        moves = (
            "points of a mesh"
            if kind in POINT_METHODS
            else "both"
            if issubclass(kind, Search)
            else "heights, channels, depths"
        )
        names = ", ".join(f"--{o.flag.replace('_', '-')}" for o in options_of(kind) if o.has_flag)
        text = inspect.getdoc(kind) or ""
        taken = re.search(r"Take\s+it .*?(?=\n\n|\Z)", text, re.DOTALL)
        rows.append((word, moves, names, _plain(text.split("\n\n")[0]), _plain(taken.group() if taken else "")))
    _printed(("method", "moves", "options", "what it is", "when"), rows, json, markdown)


def options_table(json: bool, markdown: bool) -> None:
    """Print the options of a flow: flag, type, and meaning with unit and default."""
    rows = [(f"--{flag.name.replace('_', '-')}", _named(flag.kind), flag.panel, flag.help) for flag in FLOW]
    _printed(("option", "type", "of", "meaning"), rows, json, markdown)


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
