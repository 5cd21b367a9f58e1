"""How ``meshflow smooth`` writes rasters: type, driver and creation options, and a second raster beside the result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from meshflow.cli.flags import Given
from meshflow.errors import FormatError, InputError
from meshflow.io.document import Document, Writing
from meshflow.io.files import writable, write

__all__ = ["Beside", "without_type", "writing_of"]


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
    :ivar overwrite: replace files that are there.
    :ivar options: of the writer.
    """

    removed: Path | None
    overwrite: bool
    options: Writing

    def must_be_writable(self, document: Document, target: Path) -> None:
        """Refuse what cannot be written, before the work.

        :param target: where the result goes.
        :raises FormatError: it says why.
        :raises InputError: for a mesh, and data of several parts.
        """
        if self.removed is None:
            return
        from meshflow.io.side_outputs import document_of, must_be_on_a_grid
        from meshflow.surfaces.data import array_of

        if self.removed.resolve() == target.resolve():
            raise FormatError(f"{target}: each output needs a name of its own")
        values = array_of(must_be_on_a_grid(document, "removed"))
        writable(document_of(document, values, "removed"), self.removed, overwrite=self.overwrite, **self.options)

    def write(self, before: Document, after: Document, tags: Mapping[str, str]) -> tuple[str, ...]:
        """Write them; returns notes."""
        if self.removed is None:
            return ()
        from meshflow.io.side_outputs import difference_of

        notes = write(
            difference_of(before, after), self.removed, overwrite=self.overwrite, tags=dict(tags), **self.options
        )
        return (*notes, f"removed: {self.removed}")
