"""Smooths a volume in a file by windows: it is read, run and written in a bounded memory."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError, InputError
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress, reporting
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_apart, must_be_free
from meshflow.io.document import WriteOptions
from meshflow.io.formats.volume_storage import VolumeWriter, volume_written
from meshflow.io.formats.volume_windows import BY_WINDOWS, VolumeReader, stored_like, volume_read, volume_shape
from meshflow.io.metadata import ReadOptions
from meshflow.io.rounding import rounded
from meshflow.io.suffixes import suffix_of
from meshflow.large.census import census_of
from meshflow.large.memory import Room
from meshflow.large.outcome import Outcome, Removed
from meshflow.large.outputs import Output
from meshflow.large.running import Run, at_the_last_leg, smoothed
from meshflow.large.sample import ENOUGH, sample_of
from meshflow.large.source import Form, Window, tiled
from meshflow.large.stopping import stopped_by_all
from meshflow.large.windows import windowed
from meshflow.surfaces.volume import Volume

__all__ = ["form_of_volume", "smooth_volume"]


@dataclass(frozen=True, eq=False)
class Scanned:
    """A volume in a file as a grid that is read by windows."""

    reader: VolumeReader
    form: Form

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (s, r, c) or (s, r, c, k) of a window, and those (s, r, c) that are missing."""
        return self.reader.read(window)


def _scanned(reader: VolumeReader) -> Scanned:
    form = Form(reader.shape, reader.channels, reader.dtype, reader.spacing, Volume, reader.unit)
    return Scanned(reader, form)


def form_of_volume(path: Path) -> Form:
    """The form of a volume in a file, of which no sample is read, with a spacing of 1.

    :raises FormatError: for a file that is not read by windows.
    """
    shape, dtype = volume_shape(path)
    return Form(shape[:3], shape[3] if len(shape) == 4 else None, dtype, (1.0, 1.0, 1.0), Volume)


def smooth_volume(
    path: Path,
    target: Path,
    request: Request,
    options: ReadOptions,
    writing: Output,
    progress: Progress = None,
) -> Outcome:
    """Smooth a volume by windows; what is written equals, bit for bit, what the same plan makes of the whole.

    Noise, method and time are found on cubes spread over the whole. One parameter for each end of the way, hence their number.

    :param path: of the volume; ``target``: of the one that is written, atomically.
    :param options: of the reader: spacing, nodata, unit.
    :raises FormatError: for files that cannot be read or written so.
    :raises InputError: for what cannot be done by windows, and a memory that is too small.
    """
    _must_be_writable(target, writing)
    with volume_read(path, options, target.resolve().parent) as reader, request.compute.running():
        for to in (target, *writing.sides.values()):
            stored_like(reader, to, writing.options)
        source, budget = _scanned(reader), writing.budget
        budget.must_hold(source.form)
        with reporting(progress, "reading") as report:
            census = census_of(source, report, budget.counted(source.form))
        run = windowed(source.form, sample_of(source, budget.sample(source.form, ENOUGH)), request)
        room = Room(budget, target.resolve().parent)
        run, bound = stopped_by_all(run, run.local.over(census), source, request, room, progress)
        found = Run.of(bound, run, census, request, room)
        with at_the_last_leg(source, found, budget, progress) as last:
            return _written(source, last, target, writing, progress)


def _must_be_writable(target: Path, writing: Output) -> None:
    """Refuse files that are there, no folder, other formats, and options of rasters.

    :raises FormatError: it says which.
    :raises InputError: for the expected error, which volumes do not have.
    """
    if writing.uncertainty is not None:
        raise InputError("expected error: only for height fields and images that were smoothed as a whole")
    if writing.driver is not None or writing.creation:
        raise FormatError("driver, creation: of rasters; leave them out for a volume")
    for path in (target, *writing.sides.values()):
        must_be_free(path, writing.overwrite)
        if suffix_of(path) not in BY_WINDOWS:
            known = ", ".join(BY_WINDOWS)
            raise FormatError(
                f"{path.name}: a volume is written by windows as {known}, got {path.suffix or 'no extension'}"
            )
        if not path.parent.is_dir():
            raise FormatError(f"{path.parent} is not a folder; create it first")
    must_be_apart(target, writing.sides)


def _written(source: Scanned, run: Run, target: Path, writing: Output, progress: Progress) -> Outcome:
    """Run all windows of a volume, and write them."""
    form = source.form
    windows = list(tiled(form.shape, writing.budget.sides(form, run.leg.halo, run.leg.held)))
    removed = Removed()
    outcome = Outcome(run.found, len(windows), removed, legs=run.legs)
    tags = {f"meshflow:{name}": word for name, word in outcome.tags.items()}
    with ExitStack() as stack, reporting(progress, f"smoothing by {len(windows)} windows") as report:
        into, notes = _opened(stack, source.reader, target, writing.options, tags)
        plain = WriteOptions()
        sides = {word: _opened(stack, source.reader, path, plain, tags)[0] for word, path in writing.sides.items()}
        clipped: dict[str, None] = {}
        for i, window in enumerate(windows):
            done = smoothed(source, run, window)
            removed.add(done.before, done.after, done.missing)
            gone = np.broadcast_to(~np.isfinite(done.after), done.after.shape)
            stored, said = rounded(done.after, gone, into.layout.dtype)
            into.write(window, stored)
            clipped |= dict.fromkeys(said)
            for word, side in sides.items():
                side.write(window, done.side(word))
            report((i + 1) / len(windows))
    return replace(outcome, notes=(*notes, *clipped))


def _opened(
    stack: ExitStack, reader: VolumeReader, path: Path, options: WriteOptions, tags: Mapping[str, str]
) -> tuple[VolumeWriter, tuple[str, ...]]:
    """Begin a file like that of the reader, and notes; it is complete, or not there, when the stack is closed."""
    layout, notes = stored_like(reader, path, replace(options, tags=tags))
    return stack.enter_context(volume_written(path, layout)), notes
