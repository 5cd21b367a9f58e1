"""Options: each is declared once with default, unit and meaning, from which flags, help and tables are made."""

from dataclasses import MISSING, Field, field, fields
from typing import Any, get_type_hints

from meshflow.errors import InputError

__all__ = ["Option", "nearest", "option", "options_of", "refused"]


def option(default: Any, meaning: str, unit: str = "", flag: str = "") -> Any:
    """Declare a field of a frozen dataclass as an option.

    :param default: its value if it is not given; None: it is estimated from the data.
    :param meaning: a short sentence for users.
    :param unit: of a number; empty if it has none.
    :param flag: its name in the command; by default the name of the field. ``-``: the command does not have it.
    """
    return field(default=default, metadata={"meaning": meaning, "unit": unit, "flag": flag})


class Option:
    """A declared option.

    :param owner: the class that has it.
    :param declared: the field.
    :param kind: its type.
    """

    def __init__(self, owner: type, declared: "Field[Any]", kind: Any) -> None:
        self.owner, self.name, self.kind = owner, declared.name, kind
        self.default = None if declared.default is MISSING else declared.default
        self.meaning: str = declared.metadata["meaning"]
        self.unit: str = declared.metadata["unit"]
        self.flag: str = declared.metadata["flag"] or declared.name

    @property
    def has_flag(self) -> bool:
        """Whether the command has it."""
        return self.flag != "-"


def options_of(owner: type) -> tuple[Option, ...]:
    """The options of a dataclass, in order."""
    kinds = get_type_hints(owner)
    return tuple(Option(owner, f, kinds[f.name]) for f in fields(owner) if "meaning" in f.metadata)  # type: ignore[arg-type]


def nearest(word: str, known: "list[str] | tuple[str, ...]") -> str:
    """The known word that an unknown one probably means; empty where none is similar."""
    from difflib import get_close_matches

    found = get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    return found[0] if found else ""


def refused(word: str, known: "list[str] | tuple[str, ...]", what: str) -> InputError:
    """The error for an unknown word; its message suggests the nearest one and lists all."""
    near = nearest(word, known)
    meant = f"; did you mean {near}?" if near else ""
    return InputError(f"{word}: no such {what}{meant}{'' if meant else ';'} there are {', '.join(known)}")
