"""Files that refer to other files may do so only within their own folder."""

from collections.abc import Iterable
from pathlib import Path

from meshflow.errors import FormatError

__all__ = ["must_stay_inside"]


def must_stay_inside(path: Path, names: Iterable[str], what: str, advice: str) -> None:
    """Refuse a file that refers to files outside its folder, in a network, or in a virtual file system.

    :param names: the names of the other files, as written in it.
    :param what: the kind of the file, with its article.
    :param advice: what to do if the file is trusted.
    :raises FormatError: with the first such name.
    """
    folder = path.resolve().parent
    for name in names:
        outside = "://" in name or "/vsi" in name or name.startswith("<") or ":" in name.partition("/")[0]
        if outside or "\0" in name or not (folder / name).resolve().is_relative_to(folder):
            raise FormatError(
                f"{path.name}: {what} reads files of its own folder alone, this one names {name[:80]!r}; {advice}"
            )
