"""Data of several parts, which are smoothed one by one, and the results of all parts."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshflow.errors import InputError, NotConverged
from meshflow.estimate.constraints import Constraints
from meshflow.estimate.parameters import Parameter
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.io.document import Imported, Multipart
from meshflow.results.result import Result, release
from meshflow.surfaces.data import Data
from meshflow.surfaces.image import Image
from meshflow.surfaces.multipart import as_one

__all__ = ["Results", "every_warning", "one_by_one"]

# The most parts that a summary lists.
LISTED = 12


@named_fields
@dataclass(frozen=True, eq=False)
class Results(Mapping[str, Result]):
    """The results of data of several parts: a :class:`Result` for each part, by its name. ``print`` shows them all.

    :ivar data: the smoothed data, of the kind that was given.
    :ivar parts: the results, independent of each other.
    :ivar warnings: warnings about the whole; each part has its own.
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
        """A sentence with the number of parts."""
        return f"{len(self)} parts, each smoothed separately"

    @property
    def summary(self) -> str:
        """A line for each part."""
        lines = [f"  {name}: {one.summary}" for name, one in list(self.items())[:LISTED]]
        more = [f"  and {len(self) - LISTED} more"] if len(self) > LISTED else []
        return "\n".join([self.stopped_because, *lines, *more])

    @property
    def tags(self) -> dict[str, str]:
        """The parameters of each part as text, for the tags of files."""
        summary = {
            f"part {' '.join(name.split())}": "; ".join(f"{word} {value}" for word, value in one.tags.items())
            for name, one in self.items()
        }
        return {"version": self.version, "parts": str(len(self)), **summary}

    def to_dict(self) -> dict[str, Any]:
        """Everything but the data, in types of JSON."""
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

    # What a report reads of one run. These are properties because a type checker does not take a cached_property for one.

    @property
    def before(self) -> Data:
        """All parts as one mesh, one after the other; bands as an image.

        :raises InputError: where they are neither meshes of one kind nor bands of one grid.
        """
        return self._before

    @property
    def after(self) -> Data:
        """The same after smoothing."""
        return self._after

    @cached_property
    def _before(self) -> Data:
        return as_one([one.before for one in self.values()])

    @cached_property
    def _after(self) -> Data:
        return as_one([one.after for one in self.values()])

    @property
    def removed(self) -> Array:
        """Before minus after, for all parts."""
        each = [one.removed for one in self.values()]
        return np.stack(each, axis=2) if isinstance(self.after, Image) else np.concatenate(each)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The parameters of all parts; names begin with the part."""
        return {
            f"{name}: {word}": parameter for name, one in self.items() for word, parameter in one.parameters.items()
        }

    @property
    def version(self) -> str:
        """The version of meshflow."""
        return release()

    noise = None
    candidates = ()
    history = ()
    correlation = None


def every_warning(found: Result | Results) -> tuple[str, ...]:
    """The warnings of a run; those of a part begin with its name."""
    return (*found.warnings, *(f"{name}: {word}" for name, one in found.parts.items() for word in one.warnings))


def one_by_one(several: Multipart, constraints: Constraints, smoothed: Callable[[Imported], Result]) -> Results:
    """Smooth the parts of data one by one.

    :param constraints: as the caller gave them, before they are aligned with any part.
    :param smoothed: smooths one part.
    :raises InputError: for an array of one number per sample, because it is not known which entries belong to which part; and
        as ``smoothed``, with the name of the part.
    :raises NotConverged: as ``smoothed``, with the name of the part.
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
