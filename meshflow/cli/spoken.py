"""Messages of the package in the words of the command: flags where Python has keywords and classes."""

import re

from meshflow.cli.flags import FLOW
from meshflow.cli.options import ALL

__all__ = ["spoken"]

# What a class of Python is called here.
CLASSES = {
    "DataWeights": "--data-weights",
    "Displacement": "--displacement",
    "AreaLoss": "--area-loss",
    "MaxChange": "--max-change",
    "MinComponent": "--min-component",
    "Mobility": "--mobility",
    "PreserveArea": "--preserve area",
    "PreserveVolume": "--preserve volume",
    "Residual": "--residual",
}
NAMES = {
    flag.name: (flag.words or (f"--{flag.name.replace('_', '-')}",))[0].partition("/")[0]
    for flag in (*ALL, *FLOW)
    if not flag.metavar
}
# name='value', name=3.5, unless it is that of a slice; name= before what it takes; a name at the beginning; a name of two words
# anywhere.
_ANY, _VALUE = "|".join(NAMES), r"'[^']*'|-?[\d.]+(?:e[+-]?\d+)?(?![\w.-])|nan|True|False|\([^)]*\)"
_GIVEN = re.compile(rf"(?<!slice )(?<![\w.\"'-])({_ANY})=({_VALUE}|(?=[\s;:,)]|$))")
_FIRST = re.compile(rf"^({_ANY})(?=:|, )")
_LONG = re.compile(rf"(?<![\w.-])({'|'.join(name for name in NAMES if '_' in name)})(?![\w(=-])")
# The list of what applies.
_TAKES = re.compile(r"(?<=which takes )[\w, ]+")
_CLASS = re.compile(rf"(?<![\w.-])({'|'.join(CLASSES)})(?:\([^)]*\))?(?!\w)")


def spoken(message: str, *, refusal: bool = True) -> str:
    """A message of the package with flags in the place of keywords and classes.

    ``max_change='step'`` becomes ``--max-change step``, and ``constraints=DataWeights(...)`` becomes ``--data-weights``.

    :param refusal: a refusal, which begins with the name of what it refuses.
    """
    message = re.sub(r"(?:constraints|stop)=\[?(?=[A-Z])", "", message)
    message = re.sub(r"(?:compute|method)=[A-Z]\w+\((\w+)=\.\.\.\)", r"\1=", message)
    message = _CLASS.sub(lambda found: CLASSES[found[1]], message)
    message = _GIVEN.sub(lambda found: _flag(found[1], found[2]), message)
    message = _FIRST.sub(lambda found: NAMES[found[1]], message) if refusal else message
    message = _TAKES.sub(lambda found: ", ".join(NAMES.get(name, name) for name in found[0].split(", ")), message)
    return _LONG.sub(lambda found: NAMES[found[1]], message)


def _flag(name: str, value: str) -> str:
    """A flag and its value, as they are typed; a placeholder of several values is left out."""
    flag, value = NAMES[name], value.strip("'")
    if value in ("True", "False"):
        return flag if value == "True" else f"--no-{flag[2:]}"
    if not value or value.startswith("("):
        return flag
    return f"{flag}={value}" if value.startswith("-") else f"{flag} {value}"
