"""Things of several parts, each smoothed as if it were alone, and what was done to each of them."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.parameters import Parameter
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported, Multipart
from meshflow.results.result import Result, release
from meshflow.surfaces.data import Data
from meshflow.surfaces.image import Image
from meshflow.surfaces.multipart import as_one

__all__ = ["Results", "one_by_one"]

# Parts that a line tells of.
LISTED = 12


@dataclass(frozen=True, eq=False)
class Results(Mapping[str, Result]):
    """What became of a thing of several parts: a :class:`Result` of each, by its name; ``print`` it to read them all.

    :ivar data: what came back, of the kind that was given.
    :ivar parts: the results, none of which has anything to do with another.
    :ivar warnings: sentences on the whole; each part has its own.
    """

    data: Any
    parts: dict[str, Result]
    warnings: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Result:
        return self.parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    @property
    def stopped_because(self) -> str:
        """How many parts there are."""
        return f"{len(self)} parts, each smoothed as if it were alone"

    @property
    def summary(self) -> str:
        """A line for each part."""
        lines = [f"  {name}: {one.summary}" for name, one in list(self.items())[:LISTED]]
        more = [f"  and {len(self) - LISTED} more"] if len(self) > LISTED else []
        return "\n".join([self.stopped_because, *lines, *more])

    @property
    def tags(self) -> dict[str, str]:
        """Parameters of each part, words to words: for the tags of files."""
        summary = {
            f"part {' '.join(name.split())}": "; ".join(f"{word} {value}" for word, value in one.tags.items())
            for name, one in self.items()
        }
        return {"version": self.version, "parts": str(len(self)), **summary}

    def to_dict(self) -> dict[str, Any]:
        """All of it but the data, as JSON has it."""
        summary = {name: one.to_dict() for name, one in self.items()}
        return {
            "version": self.version,
            "stopped_because": self.stopped_because,
            "parts": summary,
            "warnings": list(self.warnings),
        }

    def to_json(self, **options: Any) -> str:
        """:meth:`to_dict` as JSON text; ``options`` of :func:`json.dumps`."""
        return json.dumps(self.to_dict(), **options)

    def __str__(self) -> str:
        lines = [self.stopped_because]
        for name, one in self.items():
            lines.append(f"{name}: {one}")
        return "\n".join(lines + [f"  warning     {warning}" for warning in self.warnings])

    # The same, as one run: what a report of it asks for, by properties (a cached one is none to a type checker).

    @property
    def before(self) -> Data:
        """All parts as one mesh, one after the other; bands as an image.

        :raises InputError: where they are neither meshes of one kind nor bands of one grid.
        """
        return self._before

    @property
    def after(self) -> Data:
        """The same after it was smoothed."""
        return self._after

    @cached_property
    def _before(self) -> Data:
        return as_one([one.before for one in self.values()])

    @cached_property
    def _after(self) -> Data:
        return as_one([one.after for one in self.values()])

    @property
    def removed(self) -> Array:
        """What was there less what is there now, of all parts."""
        each = [one.removed for one in self.values()]
        return np.stack(each, axis=2) if isinstance(self.after, Image) else np.concatenate(each)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Those of each part, its name before theirs."""
        return {f"{name}: {word}": summary for name, one in self.items() for word, summary in one.parameters.items()}

    @property
    def version(self) -> str:
        """Of meshflow."""
        return release()

    noise = None
    candidates = ()
    history = ()
    correlation = None


def one_by_one(several: Multipart, constraints: Constraints, smoothed: Callable[[Imported], Result]) -> Results:
    """Data of several parts, each as if it were alone.

    :param constraints: of the caller, before they are aligned with any part.
    :param smoothed: what is done to a part.
    :raises InputError: for an array of numbers per sample, whose parts nobody has said; and as ``smoothed``, the part named.
    :raises NotConverged: likewise.
    """
    for word in () if several.whole else constraints.arrays:
        raise InputError(f"{word}: of several parts the name of an array in each of them expected, got an array")
    found: dict[str, Result] = {}
    for name, part in several.parts:
        try:
            found[name] = smoothed(part)
        except (InputError, NotConverged) as cause:
            raise type(cause)(f"part {name}: {cause}") from cause
    return Results(several.to_object([one.after for one in found.values()]), found)
