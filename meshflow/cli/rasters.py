"""How ``meshflow smooth`` writes rasters: type, driver and creation options, and a second raster beside the result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshflow.cli.flags import Given
from meshflow.errors import FormatError, InputError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_apart, sides_of
from meshflow.io.document import Document, Writing
from meshflow.io.files import writable, write
from meshflow.results.expected_error import expected_error
from meshflow.results.multipart import Results
from meshflow.results.result import Result

__all__ = ["Beside", "must_not_be", "without_type", "writing_of"]


def writing_of(given: Given) -> Writing:
    """The options of the writer that were given.

    :raises InputError: for a creation option without a value.
    """
    found: Writing = {}
    if given["dtype"]:
        found["dtype"] = given["dtype"]
    if given["driver"]:
        found["driver"] = given["driver"]
    if given["creation"]:
        found["creation"] = dict(map(_pair, given["creation"]))
    return found


def without_type(stored: Writing) -> Writing:
    """The options for a raster of other numbers than the result's, which are never rounded."""
    found = stored.copy()
    found.pop("dtype", None)
    return found


def _pair(word: str) -> tuple[str, str]:
    name, sign, value = word.partition("=")
    if not (name and sign and value):
        raise InputError(f"creation: NAME=VALUE, such as COMPRESS=ZSTD, expected, got {word!r}")
    return name, value


@dataclass(frozen=True, eq=False)
class Beside:
    """The rasters that are written beside a result.

    :ivar removed: path of the one with what was removed; None: it is not written.
    :ivar uncertainty: path of the one with the expected error of each sample.
    :ivar overwrite: replace files that are there.
    :ivar options: of the writer.
    """

    removed: Path | None
    uncertainty: Path | None
    overwrite: bool
    options: Writing

    @property
    def paths(self) -> dict[str, Path]:
        """Those that are written, by what they hold."""
        return sides_of(self.removed, self.uncertainty)

    def must_be_writable(self, document: Document, target: Path) -> None:
        """Refuse what cannot be written, before the work.

        :param target: where the result goes.
        :raises FormatError: it says why.
        :raises InputError: for a mesh.
        """
        from meshflow.io.side_outputs import document_of, must_be_on_a_grid
        from meshflow.surfaces.data import array_of

        must_be_apart(target, self.paths)
        for word, path in self.paths.items():
            must_not_be(document.path, path)
            values = array_of(must_be_on_a_grid(document, word))
            writable(document_of(document, values, word), path, overwrite=self.overwrite, **self.options)

    def made(self, before: Document, after: Document, result: Result | Results) -> dict[str, Document]:
        """What they hold, by words.

        :raises InputError: for data without an expected error.
        """
        from meshflow.io.side_outputs import difference_of, document_of

        return {
            word: difference_of(before, after) if word == "removed" else document_of(before, _errors_of(result), word)
            for word in self.paths
        }

    def write(self, made: Mapping[str, Document], tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write them; returns notes."""
        notes: tuple[str, ...] = ()
        for word, document in made.items():
            path = self.paths[word]
            notes += write(document, path, overwrite=self.overwrite, tags=dict(tags), **self.options)
            notes += (f"{word}: {path}",)
        return notes


def must_not_be(source: Path, path: Path) -> None:
    """Refuse a raster beside the result that would replace the input.

    :raises FormatError: it says so.
    """
    if path.exists() and source.exists() and path.samefile(source):
        raise FormatError(f"{path}: it is the input; name another file")


def _errors_of(result: Result | Results) -> Array:
    """The expected errors (h, w) or (h, w, k) of a result; bands that were smoothed one by one are put side by side."""
    if isinstance(result, Result):
        return expected_error(result)
    return np.stack([expected_error(one) for one in result.values()], axis=2)
