"""Files that name other files: they stay in their own folder."""

from collections.abc import Iterable
from pathlib import Path

from meshflow.errors import FormatError

__all__ = ["must_stay_inside"]


def must_stay_inside(path: Path, names: Iterable[str], what: str, advice: str) -> None:
    """Refuse a file that names others outside its own folder, in a network, or in a virtual file system.

    :param names: of the files, as they are written in it.
    :param what: it is, with its article.
    :param advice: what to do where it is trusted.
    :raises FormatError: with the first such name.
    """
    folder = path.resolve().parent
    for name in names:
        outside = "://" in name or "/vsi" in name or name.startswith("<") or ":" in name.partition("/")[0]
        if outside or "\0" in name or not (folder / name).resolve().is_relative_to(folder):
            raise FormatError(
                f"{path.name}: {what} reads files of its own folder alone, this one names {name[:80]!r}; {advice}"
            )
