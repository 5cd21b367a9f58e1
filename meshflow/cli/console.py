"""Output of the commands: results on stdout, messages and notes on stderr."""

import json as notation
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from meshflow.cli.spoken import spoken
from meshflow.errors import InputError

__all__ = ["err", "listed", "must_be_open", "one_line", "out", "rows_printed", "said", "table"]

# The width of what is not shown on a terminal: no line of a table is broken, and no name is cut.
WIDE = 100_000
out, err = Console(), Console(stderr=True, highlight=False)


def must_be_open() -> None:
    """Refuse to write to a stdout that is closed.

    :raises InputError: it says so.
    """
    if sys.stdout is None:
        raise InputError("stdout is closed; send it to a file or to another command")


def one_line(message: str) -> str:
    """A message in which the signs of a name that begin a line, or command a terminal, are spelled out."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in message)


def table(facts: dict[str, Any], json: bool, notes: tuple[str, ...]) -> None:
    """Print facts as JSON or as a table to stdout, notes to stderr."""
    must_be_open()
    if json:
        out.print_json(notation.dumps({**facts, "notes": list(notes)}))
        return
    rows = Table.grid(padding=(0, 2))
    for name, value in facts.items():
        # Text, not markup: brackets in a name or a path are not styles.
        rows.add_row(Text(name, style="bold"), Text(f"{value:.6g}" if isinstance(value, float) else str(value)))
    rows_printed(rows)
    said("", notes)


def listed(rows: Sequence[Mapping[str, Any]], json: bool, notes: tuple[str, ...]) -> None:
    """Print rows of the same facts as JSON or as a table with their names above to stdout, notes to stderr."""
    must_be_open()
    if json:
        out.print_json(notation.dumps({"rows": list(rows), "notes": list(notes)}))
        return
    heads = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    shown = Table(*heads, box=None, padding=(0, 2, 0, 0))
    for row in rows:
        shown.add_row(*(Text(f"{row[h]:.4g}" if isinstance(row[h], float) else str(row[h])) for h in heads))
    rows_printed(shown)
    said("", notes)


def rows_printed(rows: Table) -> None:
    """Print a table to stdout, one line for each row where it is a file or a program that reads it."""
    (out if out.is_terminal else Console(file=out.file, width=WIDE)).print(rows)


def said(line: str, notes: tuple[str, ...], style: str | None = None) -> None:
    """Print a line and its notes to stderr, leaving out empty ones."""
    for sentence in (line, *(spoken(note, refusal=False) for note in notes)):
        if sentence:
            err.print(sentence, markup=False, soft_wrap=True, style=style)
