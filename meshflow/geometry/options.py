"""Options: each is declared once with default, unit and meaning, from which flags, help and tables are made."""

from collections.abc import Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, TypeVar, get_type_hints

from meshflow.errors import InputError

__all__ = ["Option", "must_be_object", "named_fields", "nearest", "option", "options_of", "refused"]

Made = TypeVar("Made")


def option(default: Any, meaning: str, unit: str = "", flag: str = "") -> Any:
    """Declare a field of a frozen dataclass as an option.

    :param default: its value if it is not given; None: it is estimated from the data; MISSING: it must be given.
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


def must_be_object(given: object, what: str) -> None:
    """Refuse a class where one of its objects is meant: a forgotten pair of brackets.

    :param what: that is expected, for the message.
    :raises InputError: for a class.
    """
    if not isinstance(given, type):
        return
    needs = [p for p in signature(given).parameters.values() if p.default is p.empty] if is_dataclass(given) else ["?"]
    raise InputError(
        f"{what} expected, got the class {given.__name__}; give {given.__name__}({'...' if needs else ''})"
    )


def nearest(word: str, known: "list[str] | tuple[str, ...]") -> str:
    """The known word that an unknown one probably means; empty where none is similar."""
    from difflib import get_close_matches

    found = get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    return found[0] if found else ""


def refused(word: str, known: "list[str] | tuple[str, ...]", what: str) -> InputError:
    """The error for an unknown word; its message suggests the nearest one and lists all."""
    near = nearest(word, known)
    meant = f"; did you mean {near}? There" if near else "; there"
    return InputError(f"{word}: no such {what}{meant} are {', '.join(known) or 'none'}")


def named_fields(kind: type[Made]) -> type[Made]:
    """Decorator: a call of a dataclass that does not fit its fields is refused in words, with the field that was meant.

    Type checkers and :func:`inspect.signature` see the class as it is.
    """
    make = kind.__init__

    @wraps(make)
    def made(self: Made, *given: object, **named: object) -> None:
        """Make the object; what does not fit its fields is refused."""
        try:
            make(self, *given, **named)
        except TypeError:
            shown = signature(make)
            try:
                shown.bind(self, *given, **named)
            except TypeError:
                raise _misfit(kind, shown, given, named) from None
            raise

    setattr(kind, "__init__", made)  # noqa: B010 - a type checker goes on seeing the fields
    return kind


def _misfit(kind: type, shown: Signature, given: tuple[object, ...], named: Mapping[str, object]) -> InputError:
    """The error for a call with an unknown name, too many values, or too few."""
    known = tuple(shown.parameters)[1:]
    for word in named:
        if word not in known:
            return refused(word, known, f"option of {kind.__name__}")
    placed = [name for name in known if shown.parameters[name].kind is not Parameter.KEYWORD_ONLY]
    if given and not placed:
        return InputError(
            f"{kind.__name__}: options by name expected, got {given[0]!r:.60}; there are {', '.join(known) or 'none'}"
        )
    if len(given) > len(placed):
        most = f"{len(placed)} value{'' if len(placed) == 1 else 's'}"
        return InputError(f"{kind.__name__}({', '.join(placed)}): at most {most} expected, got {len(given)}")
    twice = [name for name in placed[: len(given)] if name in named]
    if twice:
        return InputError(f"{kind.__name__}: {twice[0]} is given twice")
    needed = [name for name in known if shown.parameters[name].default is Parameter.empty]
    lacking = [name for name in needed[len(given) :] if name not in named]
    return InputError(
        f"{kind.__name__}: a value expected for {' and '.join(lacking)}, got nothing; give {kind.__name__}({', '.join(needed)})"
    )
