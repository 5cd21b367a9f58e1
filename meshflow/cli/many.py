"""``meshflow smooth`` of several files: each by itself, a table at the end, and an exit code of the worst."""

import json as notation
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from glob import glob, has_magic
from pathlib import Path
from time import monotonic
from typing import Any

import typer
from rich.table import Table
from rich.text import Text

from meshflow.cli.console import err, out, rows_printed, said
from meshflow.cli.flags import Given
from meshflow.cli.spoken import spoken
from meshflow.errors import FormatError, InputError, MissingPackage, NotConverged
from meshflow.flow.progress import reporting
from meshflow.geometry.validation import whole
from meshflow.io.files import FORMATS
from meshflow.io.incoming import STDIN
from meshflow.io.stores import in_store
from meshflow.kernels.library import default_threads
from meshflow.large.outcome import Outcome, Removed
from meshflow.large.stacks import Slices
from meshflow.results.multipart import Results
from meshflow.results.result import Result

__all__ = ["Told", "inputs_of", "smooth_many"]

# What ends the work on one file, and not that on the others.
REFUSALS = (InputError, MissingPackage, NotConverged, OSError, MemoryError)
# Extensions of rasters that are read and not written; and that of what is written for them.
READ_ONLY, RASTER = (
    frozenset({".hgt", ".dem", ".lbl", ".img", ".vrt", ".jp2", ".nc", ".zip", ".bil", ".flt", ".gpkg"}),
    ".tif",
)


@dataclass(frozen=True, eq=False)
class Told:
    """What is said of one file.

    :ivar result: of the run; ``notes``: sentences.
    :ivar pictured: the documents before and after, where both are in memory.
    """

    result: Result | Results | Slices | Outcome
    notes: tuple[str, ...] = ()
    pictured: tuple[Any, Any] | None = None


# Smooths tiles, pairs of paths, and tells each or refuses it; None: it is done already.
Together = Callable[[Given, Sequence[tuple[Path, Path]]], Iterator[tuple[Path, Told | Exception | None]]]


@dataclass(frozen=True, eq=False)
class Line:
    """One line of the table.

    :ivar told: None where the file was refused, or is done already.
    :ivar why: the reason of a refusal.
    """

    source: Path
    target: Path | None
    told: Told | None = None
    why: str = ""
    seconds: float = 0.0
    skipped: bool = field(default=False)

    def to_dict(self) -> dict[str, Any]:
        """In types of JSON."""
        found: dict[str, Any] = {"in": str(self.source), "out": None if self.target is None else str(self.target)}
        if self.told is not None:
            return {**found, **self.told.result.to_dict(), "notes": list(self.told.notes)}
        return {**found, **({"skipped": True} if self.skipped else {"refused": self.why})}

    @property
    def cells(self) -> tuple[str, ...]:
        """Of the table: file, noise, time, what was removed, seconds, and how it ended."""
        if self.told is None:
            return (str(self.source), "", "", "", "", "done before" if self.skipped else spoken(self.why))
        result, seconds = self.told.result, f"{self.seconds:.1f} s"
        if isinstance(result, (Slices, Results)):
            return (str(self.source), "", "", "", seconds, result.stopped_because)
        removed = result.to_dict()["removed"]
        rms = "" if removed is None else f"{removed['rms']:.4g}"
        numbers = (f"{result.noise.sigma:.4g}", f"{result.parameters['time'].value:.4g}", rms)
        return (str(self.source), *numbers, seconds, result.stopped_because)


def inputs_of(paths: Sequence[Path]) -> list[Path]:
    """The files that are named: themselves, those of a folder that can be read, and those of a pattern.

    :raises FormatError: for a folder or a pattern without a file.
    """
    known = READ_ONLY.union(*(entry.written for entry in FORMATS))
    found: list[Path] = []
    for path in paths:
        if path.is_dir() and in_store(path) is None:
            inside = sorted(one for one in path.iterdir() if one.is_file() and one.suffix.lower() in known)
            inside = [one for one in inside if not one.name.startswith(".")]
        elif has_magic(str(path)) and not path.exists():
            inside = [Path(name) for name in sorted(glob(str(path), recursive=True)) if Path(name).is_file()]
        else:
            inside = [path]
        if not inside:
            raise FormatError(f"{path}: no file in it that can be read")
        found += inside
    return list(dict.fromkeys(found))


def smooth_many(given: Given, paths: Sequence[Path], one: Callable[[Given], Told], together: Together) -> None:
    """Smooth several files into a folder; what fails does not keep the others from being done.

    :param one: smooths one file; ``together``: the tiles of a survey.
    :raises InputError: for options of one file.
    :raises typer.Exit: with the code 1, where a file was refused.
    """
    _must_be_of_many(given, paths)
    folder, jobs = given["output"], given["jobs"]
    sources = inputs_of(paths)
    targets = _targets(sources, folder)
    folder.mkdir(parents=True, exist_ok=True)
    work = [_Work(given, source, target, one) for source, target in zip(sources, targets, strict=True)]
    many = f"{len(sources)} file{'s' * (len(sources) != 1)}"
    lines: list[Line] = []
    with reporting(None if given["quiet"] else True, many) as report, _pool(jobs) as pool:
        for line in _tiles(given, work, together) if given["together"] else pool.map(_Work.line, work):
            lines.append(line)
            report(len(lines) / len(work))
            _tell(line, given)
    if given["json"]:
        out.print_json(notation.dumps([line.to_dict() for line in lines]))
    elif not given["quiet"]:
        _table(lines)
        as_one = _as_one(lines) if given["together"] else None
        if as_one is not None:
            said(f"as one: {f'{chr(10)}{as_one}' if given['verbose'] else as_one.summary}", as_one.warnings)
    refused = sum(line.told is None and not line.skipped for line in lines)
    if refused:
        said(f"meshflow: {refused} of {many} refused", (), style="red")
        raise typer.Exit(1)


def _as_one(lines: Sequence[Line]) -> Outcome | None:
    """What was done to all tiles of a survey, as if they were one file; None where none was smoothed."""
    done = [line.told.result for line in lines if line.told is not None and isinstance(line.told.result, Outcome)]
    if not done:
        return None
    removed = Removed.joined(one.removed for one in done if one.removed is not None)
    return replace(done[0], windows=sum(one.windows for one in done), removed=removed, notes=())


@dataclass(frozen=True, eq=False)
class _Work:
    """One of several files."""

    given: Given
    source: Path
    target: Path | str
    one: Callable[[Given], Told]

    def line(self) -> Line:
        """Smooth it, or say why not."""
        if isinstance(self.target, str):
            return Line(self.source, None, why=self.target)
        if self.given["resume"] and self.target.exists():
            return Line(self.source, self.target, skipped=True)
        jobs, own = self.given["jobs"], {**self.given, "source": self.source, "target": self.target, "quiet": True}
        own["overwrite"] = own["overwrite"] and not self.given["resume"]
        if jobs > 1 and own["threads"] is None:
            own["threads"] = max(1, default_threads() // jobs)
        begun = monotonic()
        try:
            return Line(self.source, self.target, self.one(own), seconds=monotonic() - begun)
        except REFUSALS as refusal:
            return Line(self.source, self.target, why=_reason(refusal))


def _tiles(given: Given, work: Sequence[_Work], together: Together) -> Iterator[Line]:
    """The lines of the tiles of a survey."""
    targets = {one.source: one.target for one in work if isinstance(one.target, Path)}
    yield from (Line(one.source, None, why=one.target) for one in work if isinstance(one.target, str))
    begun = monotonic()
    own = {**given, "overwrite": given["overwrite"] and not given["resume"]}
    for source, found in together(own, list(targets.items())):
        if found is None:
            yield Line(source, targets[source], skipped=True)
        elif isinstance(found, Told):
            yield Line(source, targets[source], found, seconds=monotonic() - begun)
        else:
            yield Line(source, targets[source], why=_reason(found))
        begun = monotonic()


def _reason(refusal: BaseException) -> str:
    """A refusal in one line."""
    return " ".join(str(refusal).split()) or type(refusal).__name__


def _must_be_of_many(given: Given, paths: Sequence[Path]) -> None:
    whole(given["jobs"], "jobs", 1)
    for name in ("picture", "report", "removed", "uncertainty"):
        if given[name] is not None:
            raise InputError(f"--{name}: only for a single file; leave it out")
    if STDIN in paths:
        raise InputError("-: stdin is one file; with --output name files")
    if given["output"].exists() and not given["output"].is_dir():
        raise FormatError(f"{given['output']} is not a folder; --output expects one")


def _targets(sources: Sequence[Path], folder: Path) -> Iterator[Path | str]:
    """Where each file is written, or why it is not."""
    taken: dict[Path, Path] = {}
    for source in sources:
        suffix = source.suffix.lower()
        place = in_store(source)
        name = source.name if suffix not in READ_ONLY else f"{source.name.split('.')[0]}{RASTER}"
        target = folder / (name if place is None else place.store.name)
        if target in taken:
            yield f"{source.name}: {taken[target]} is written under the same name; give them folders of their own"
        elif target.exists() and source.exists() and target.samefile(source):
            yield f"{source.name}: it is in the output folder itself; choose another folder"
        else:
            taken[target] = source
            yield target


@contextmanager
def _pool(jobs: int) -> Iterator[ThreadPoolExecutor]:
    """Threads, one for each file at a time; what has not begun when the user interrupts is left out."""
    pool = ThreadPoolExecutor(jobs)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _tell(line: Line, given: Given) -> None:
    """Say how one file went."""
    if line.told is None and not line.skipped:
        err.print(f"{line.source}: {spoken(line.why)}", markup=False, soft_wrap=True, style="red")
    elif line.told is not None and not given["quiet"]:
        result = line.told.result
        words = f"{chr(10)}{result}" if given["verbose"] else result.summary
        said(f"{line.source} → {line.target}: {words}", line.told.notes)


def _table(lines: Sequence[Line]) -> None:
    """Print the table of all files to stdout."""
    rows = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("file", "noise", "time", "removed", "took", "ended"):
        rows.add_column(name, overflow="fold")
    for line in lines:
        rows.add_row(*(Text(cell) for cell in line.cells))
    rows_printed(rows)
