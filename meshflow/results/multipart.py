"""Things of several parts, each smoothed as if it were alone, and what was done to each of them."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.parameters import Parameter
from meshflow.geometry.validation import Array
from meshflow.io.document import Adopted, Multipart
from meshflow.io.metadata import PER_SAMPLE
from meshflow.results.result import Result, release
from meshflow.surfaces.lift import Noun, together

__all__ = ["Results", "one_by_one"]

# Parts that a line tells of.
LISTED = 12


@dataclass(frozen=True, eq=False)
class Results(Mapping[str, Result]):
    """What became of a thing of several parts: a :class:`Result` of each, by its name; ``print`` it to read them all.

    :ivar thing: what came back, of the kind that was given.
    :ivar parts: the results, none of which has anything to do with another.
    :ivar warnings: sentences on the whole; each part has its own.
    """

    thing: Any
    parts: dict[str, Result]
    warnings: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Result:
        return self.parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    @property
    def reason(self) -> str:
        """How many parts there are."""
        return f"{len(self)} parts, each smoothed as if it were alone"

    @property
    def summary(self) -> str:
        """A line for each part."""
        lines = [f"  {name}: {one.summary}" for name, one in list(self.items())[:LISTED]]
        more = [f"  and {len(self) - LISTED} more"] if len(self) > LISTED else []
        return "\n".join([self.reason, *lines, *more])

    @property
    def facts(self) -> dict[str, str]:
        """Parameters of each part, words to words: for the tags of files."""
        told = {
            f"part {' '.join(name.split())}": "; ".join(f"{word} {value}" for word, value in one.facts.items())
            for name, one in self.items()
        }
        return {"version": self.version, "parts": str(len(self)), **told}

    def words(self) -> dict[str, Any]:
        """All of it but the data, as JSON has it."""
        told = {name: one.words() for name, one in self.items()}
        return {"version": self.version, "ended": self.reason, "parts": told, "warnings": list(self.warnings)}

    def json(self, **options: Any) -> str:
        """:meth:`words` as JSON text; ``options`` of :func:`json.dumps`."""
        return json.dumps(self.words(), **options)

    def __str__(self) -> str:
        lines = [self.reason]
        for name, one in self.items():
            lines.append(f"{name}: {one}")
        return "\n".join(lines + [f"  warning     {warning}" for warning in self.warnings])

    # The same, as one run: what a report of it asks for, by properties (a cached one is none to a type checker).

    @property
    def before(self) -> Noun:
        """All parts as one mesh, one after the other.

        :raises InputError: where they are no meshes of one kind.
        """
        return self._before

    @property
    def noun(self) -> Noun:
        """The same after it was smoothed."""
        return self._noun

    @cached_property
    def _before(self) -> Noun:
        return together([one.before for one in self.values()])

    @cached_property
    def _noun(self) -> Noun:
        return together([one.noun for one in self.values()])

    @property
    def removed(self) -> Array:
        """What was there less what is there now, of all parts."""
        return np.concatenate([one.removed for one in self.values()])

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Those of each part, its name before theirs."""
        return {f"{name}: {word}": told for name, one in self.items() for word, told in one.parameters.items()}

    @property
    def version(self) -> str:
        """Of meshflow."""
        return release()

    noise = None
    trials = ()
    moments = ()
    correlation = None


def one_by_one(
    several: Multipart, words: dict[str, Any], fixed: str | None, smoothed: Callable[[Adopted], Result]
) -> Results:
    """A thing of several parts, each as if it were alone.

    :param words: of the caller; ``fixed`` is the name of an array.
    :param smoothed: what is done to a part.
    :raises InputError: for an array of numbers per sample, whose parts nobody has said; and as ``smoothed``, the part named.
    :raises NotConverged: likewise.
    """
    for word in () if several.whole else PER_SAMPLE:
        if words.get(word) is not None and np.ndim(words[word]) > 0:
            raise InputError(f"{word}: of several parts the name of an array in each of them expected, got an array")
    found: dict[str, Result] = {}
    for name, part in several.parts:
        try:
            found[name] = smoothed(part)
        except (InputError, NotConverged) as cause:
            raise type(cause)(f"part {name}: {cause}") from cause
    return Results(several.to_object([one.noun for one in found.values()]), found)
