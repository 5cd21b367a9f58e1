"""Options: each is declared once with default, unit and meaning, from which flags, help and tables are made."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import cache, wraps
from inspect import Parameter, Signature, signature
from math import isinf
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from meshflow.errors import InputError
from meshflow.geometry.validation import must_be_truth, number, shown

__all__ = [
    "Option",
    "expected",
    "must_be_object",
    "named_fields",
    "nearest",
    "option",
    "options_of",
    "refused",
    "spanned",
    "spelled",
]

Made = TypeVar("Made")
# Words that others have for the words of an option.
SYNONYMS = {
    "dem": "terrain", "dtm": "terrain", "dsm": "terrain", "heights": "terrain", "height": "terrain", "elevation": "terrain",
    "picture": "image", "photo": "image", "photograph": "image", "range": "depth", "depths": "depth", "surface": "mesh",
    "natural": "neumann", "linear": "plane-preserving", "dirichlet": "fixed", "implicit": "semi-implicit", "euler": "explicit",
    "frames": "count", "fps": "rate", "colormap": "colours", "cmap": "colours",
}  # fmt: skip


# Words that suit some data only.
NOTED = {"border-curve": "border-curve (of meshes)"}


def option(
    default: Any, meaning: str, unit: str = "", flag: str = "", within: tuple[float, float] | None = None
) -> Any:
    """Declare a field of a frozen dataclass as an option.

    :param default: its value if it is not given; None: it is estimated from the data; MISSING: it must be given.
    :param meaning: a short sentence for users.
    :param unit: of a number; empty if it has none.
    :param flag: its name in the command; by default the name of the field. ``-``: the command does not have it.
    :param within: the least and the largest number; others are refused by :func:`named_fields`.
    """
    return field(default=default, metadata={"meaning": meaning, "unit": unit, "flag": flag, "within": within})


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
        self.flag: str = declared.metadata["flag"] or declared.name.replace("_", "-")
        self.within: tuple[float, float] | None = declared.metadata["within"]

    @property
    def range(self) -> str:
        """The numbers that are possible, in words; empty where the declaration does not say."""
        return "" if self.within is None else spanned(self.within)

    @property
    def has_flag(self) -> bool:
        """Whether the command has it."""
        return self.flag != "-"


@cache
def options_of(owner: type) -> tuple[Option, ...]:
    """The options of a dataclass, in order."""
    kinds = get_type_hints(owner)
    return tuple(Option(owner, f, kinds[f.name]) for f in fields(owner) if "meaning" in f.metadata)  # type: ignore[arg-type]


def spanned(within: tuple[float, float]) -> str:
    """A range of numbers in words."""
    least, largest = within
    return f"{least:g} or more" if isinf(largest) else f"{least:g} to {largest:g}"


def must_be_object(given: object, what: str) -> None:
    """Refuse a class where one of its objects is meant: a forgotten pair of brackets.

    :param what: that is expected, for the message.
    :raises InputError: for a class.
    """
    if not isinstance(given, type):
        return
    way = ""
    if is_dataclass(given):
        needs = [p for p in signature(given).parameters.values() if p.default is p.empty]
        way = f"; give {given.__name__}({'...' if needs else ''})"
    raise InputError(f"{what} expected, got the class {given.__name__}{way}")


def nearest(word: str, known: "list[str] | tuple[str, ...]") -> str:
    """The known word that an unknown one probably means; empty where none is similar."""
    from difflib import get_close_matches

    if SYNONYMS.get(word.lower()) in known:
        return SYNONYMS[word.lower()]
    found = get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    return found[0] if found else ""


def refused(word: str, known: "list[str] | tuple[str, ...]", what: str) -> InputError:
    """The error for an unknown word; its message suggests the nearest one and lists all."""
    near = nearest(word, known)
    meant = f"; did you mean {near}? There" if near else "; there"
    return InputError(f"{word}: no such {what}{meant} are {', '.join(known) or 'none'}")


def spelled(given: str, known: Collection[str]) -> str:
    """The known word that is given, whichever its case and whether with spaces, hyphens or underscores; else empty."""
    if given in known:
        return given
    letters = "".join(filter(str.isalnum, given)).lower()
    return next((word for word in known if "".join(filter(str.isalnum, word)) == letters), "")


def expected(given: object, known: Sequence[str]) -> str:
    """What was expected instead of an unknown word, with the nearest one, as the end of a sentence."""
    near = nearest(given, tuple(known)) if isinstance(given, str) else ""
    meant = f"; did you mean {near}?" if near else ""
    got = repr(given) if isinstance(given, str) else shown(given)
    known = [NOTED.get(word, word) for word in known]
    listed = " or ".join(filter(None, (", ".join(known[:-1]), known[-1])))
    return f"{listed} expected, got {got}{meant}"


def named_fields(kind: type[Made]) -> type[Made]:
    """Decorator: a call of a dataclass that does not fit its fields is refused in words, with the field that was meant.

    Words of fields that are one of several (``Literal``) are taken in any spelling of :func:`spelled`, and others refused.
    Fields of yes or no take True and False alone, and numbers must be within the range that :func:`option` declares.
    Type checkers and :func:`inspect.signature` see the class as it is.
    """
    make, choices, checks = kind.__init__, _choices(kind), _checks(kind)
    placed = [f.name for f in _fields(kind) if f.init and not f.kw_only]

    @wraps(make)
    def made(self: Made, *given: object, **named: object) -> None:
        """Make the object; what does not fit its fields is refused."""
        if choices:
            given = (
                tuple(_chosen(choices, name, one) for name, one in zip(placed, given, strict=False))
                + given[len(placed) :]
            )
            named = {name: _chosen(choices, name, one) for name, one in named.items()}
        for name, one in (*zip(placed, given, strict=False), *named.items()):
            if name in checks:
                checks[name].made(one)
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


def _fields(kind: type) -> tuple["Field[Any]", ...]:
    """The fields of a dataclass; of another class none."""
    return fields(kind) if is_dataclass(kind) else ()


def _choices(kind: type) -> dict[str, tuple[tuple[str, ...], bool]]:
    """The fields that are one of several words: the words, and whether anything but a word may be given, too."""
    found = {}
    for one in _fields(kind):
        parts = get_args(one.type) if get_origin(one.type) in (Union, UnionType) else (one.type,)
        parts = [part for part in parts if part is not NoneType]
        words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
        if words and str not in parts and all(isinstance(word, str) for word in words):
            found[one.name] = tuple(words), any(get_origin(part) is not Literal for part in parts)
    return found


@dataclass(frozen=True)
class _Check:
    """What a field takes: True and False, or numbers within a range.

    :ivar name: of the field; ``within``: the least and the largest number, None for yes and no.
    :ivar whole: whether numbers are whole; ``optional``: whether None may be given.
    """

    name: str
    within: tuple[float, float] | None
    unit: str
    whole: bool
    optional: bool

    def made(self, given: object) -> None:
        """Refuse anything else.

        :raises InputError: with what came.
        """
        if given is None and self.optional:
            return
        if self.within is None:
            must_be_truth(given, self.name, self.optional)
            return
        found = number(given, self.name)
        if not self.within[0] <= found <= self.within[1] or (self.whole and found != int(found)):
            what = f"a whole number from {spanned(self.within)}" if self.whole else spanned(self.within)
            unit = f" {self.unit}" if self.unit else ""
            raise InputError(f"{self.name}: {what}{unit} expected, got {shown(given)}")


def _checks(kind: type) -> dict[str, _Check]:
    """The checks of the fields that have one."""
    found = {}
    for one in _fields(kind):
        parts = get_args(one.type) if get_origin(one.type) in (Union, UnionType) else (one.type,)
        within = one.metadata.get("within")
        if within is not None or bool in parts:
            whole = int in parts and float not in parts
            found[one.name] = _Check(one.name, within, one.metadata.get("unit", ""), whole, NoneType in parts)
    return found


def _chosen(choices: Mapping[str, tuple[tuple[str, ...], bool]], name: str, given: object) -> object:
    """The word that is meant by what is given for a field; anything but words unchanged.

    :raises InputError: for an unknown word.
    """
    if name not in choices or given is None:
        return given
    words, others = choices[name]
    if not isinstance(given, str) and others:
        return given
    word = spelled(given, words) if isinstance(given, str) else ""
    if not word:
        raise InputError(f"{name}: {expected(given, words)}")
    return word


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
