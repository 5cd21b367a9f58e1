"""Smooths a raster file by windows: it is read, run and written in a bounded memory."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.progress import Progress, reporting
from meshflow.geometry.validation import Array, Spacing, spacing_of
from meshflow.io.formats.raster_windows import RasterReader, raster_read
from meshflow.io.formats.rasters import notes_on, period_of, spacing_in, unlike_bands
from meshflow.io.metadata import ReadOptions
from meshflow.io.spacing import height_unit, said_of_turn
from meshflow.large.census import Census, bands, census_of
from meshflow.large.cleaning import bound_over
from meshflow.large.marks import marked
from meshflow.large.memory import Budget, Room
from meshflow.large.outcome import Outcome, Removed
from meshflow.large.outputs import Output, Written, must_be_stored, must_be_writable, opened_beside, stored_as
from meshflow.large.running import Block, Done, Run, at_the_last_leg, smoothed
from meshflow.large.sample import ENOUGH, Sample, sample_of
from meshflow.large.source import Form, Source, Window, moved_by, rows_and_columns, tiled
from meshflow.large.step_lengths import lengths_by_all
from meshflow.large.stopping import stopped_by_all
from meshflow.large.windows import windowed
from meshflow.results.expected_error import must_have_error
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image

__all__ = ["Gridded", "Sheet", "counted", "form_of", "gridded", "smooth_raster", "written"]


@dataclass(frozen=True, eq=False)
class Gridded:
    """A raster as a grid that is read by windows."""

    reader: RasterReader
    form: Form

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing."""
        values, gone = self.reader.values(rows_and_columns(window))
        return self.laid(values), np.logical_or.reduce(gone)

    def laid(self, bands: Array) -> Array:
        """Bands (k, r, c) as values of the grid."""
        return bands[0] if self.form.channels is None else np.moveaxis(bands, 0, 2)

    def bands(self, values: Array) -> Array:
        """Values of the grid as bands (k, r, c)."""
        return values[None] if self.form.channels is None else np.moveaxis(values, 2, 0)


def form_of(path: Path, options: ReadOptions) -> Form:
    """The form of a raster, of which no sample is read.

    :raises FormatError: for a file that is not read by windows.
    """
    with raster_read(path, options) as reader:
        return gridded(reader, options)[0].form


def smooth_raster(
    path: Path,
    target: Path,
    request: Request,
    options: ReadOptions,
    writing: Output,
    progress: Progress = None,
) -> Outcome:
    """Smooth a raster by windows; what is written equals, bit for bit, what the same plan makes of the whole.

    Noise, method and time are found on tiles spread over the whole.

    :param path: of the raster; ``target``: of the raster that is written, atomically.
    :param options: of the reader: kind, band, nodata, spacing, allow_remote.
    :raises FormatError: for files that cannot be read or written so.
    :raises InputError: for what cannot be done by windows, and a memory that is too small.
    """
    must_be_writable(target, writing)
    with raster_read(path, options) as opened, request.compute.running():
        source, notes = gridded(opened, options)
        must_be_stored(opened, target, writing)
        source, census, more = counted(source, writing.budget, progress)
        stored_as(
            source.reader, census, target, writing
        )  # where no value is left for missing samples, it is refused now
        sample = sample_of(source, writing.budget.sample(source.form, ENOUGH))
        _must_be_alike(source, sample, options)
        run = windowed(source.form, sample, request)
        if writing.uncertainty is not None:
            must_have_error(run.found)
        sheet = Sheet(source, source, (slice(0, source.form.shape[0]), slice(0, source.form.shape[1])))
        with reporting(progress, "looking for outliers") as report:
            at_once = writing.budget.counted(source.form)
            bound = bound_over(run.local, source, request.constraints, census, report, at_once)
        room = Room(writing.budget, target.resolve().parent, alone=writing.uncertainty is not None)
        run, bound = lengths_by_all(run, bound, source, request, room, progress)
        run, bound = stopped_by_all(run, bound, source, request, room, progress)
        made = Run.of(bound, run, census, request, room)
        with at_the_last_leg(source, made, writing.budget, progress) as last:
            outcome = written(sheet, last, target, writing, progress)
    return replace(outcome, notes=(*notes, *more, *outcome.notes))


def gridded(reader: RasterReader, options: ReadOptions) -> tuple[Gridded, tuple[str, ...]]:
    """A raster as a grid, and notes.

    :raises InputError: for several bands as one terrain, and a grid that is sheared.
    """
    frame, kind, count = reader.frame, options.kind, len(reader.chosen)
    if kind not in (None, "terrain", "image"):
        raise InputError(f"{reader.path.name}: a raster is a terrain or an image, got kind={kind!r}")
    if kind == "terrain" and count > 1:
        raise InputError(f"{reader.path.name}: one band expected for a terrain, got {count}; choose one: band=1")
    unit, notes = height_unit(frame.crs, frame.units[0]), ()
    if options.spacing is None:
        spacing, notes = spacing_in(frame, unit, reader.shape)
    else:
        spacing = spacing_of(options.spacing, reader.shape[0])
    terrain = count == 1 and kind != "image"
    form = _form(reader, spacing, unit if terrain else "", terrain)
    period = period_of(frame, np.broadcast_to(0.0, reader.shape))
    return Gridded(reader, form), notes + said_of_turn(period, together=False) + notes_on(frame)


def _form(reader: RasterReader, spacing: Spacing, unit: str, terrain: bool) -> Form:
    channels = None if len(reader.chosen) == 1 else len(reader.chosen)
    return Form(reader.shape, channels, reader.dtype, spacing, HeightField if terrain else Image, unit)


def counted(
    source: Gridded,
    budget: Budget,
    progress: Progress,
    seen: Callable[[Window, Array, Array], object] | None = None,
) -> tuple[Gridded, Census, tuple[str, ...]]:
    """The source with undeclared marks of missing samples, its count, and notes.

    :param seen: takes each window with its values and those that are missing; once more where a mark was found.
    :raises NothingThere: where no sample is present.
    :raises InputError: for a memory in which no window fits.
    """
    budget.must_hold(source.form)
    notes: tuple[str, ...] = ()
    at_once = budget.counted(source.form)
    windows = bands(source.form, at_once)
    while True:
        with reporting(progress, "reading") as report:
            census = census_of(source, report, at_once, seen)
        ends = _stored_ends(source, census, windows)
        reader, mark = marked(source.reader, ends, windows)
        if mark is None:
            return source, census, notes
        source, notes = replace(source, reader=reader), (*notes, mark.sentence)


def _stored_ends(source: Gridded, census: Census, windows: list[Window]) -> tuple[float, float]:
    """The least and the greatest number as it is stored."""
    if not source.reader.frame.scaled:
        return float(census.ends[:, 0].min()), float(census.ends[:, 1].max())
    low, high = np.inf, -np.inf
    for window in windows:
        raw, gone = source.reader.stored(rows_and_columns(window))
        known = raw[~gone].astype(np.float64)
        low, high = float(known.min(initial=low)), float(known.max(initial=high))
    return low, high


def _must_be_alike(source: Gridded, sample: Sample, options: ReadOptions) -> None:
    """Refuse bands that are quantities of their own, which are not smoothed together.

    :raises InputError: it names them.
    """
    if options.kind is not None or source.form.channels is None or not isinstance(sample.data, Image):
        return
    values = source.bands(sample.data.values)
    gone = np.broadcast_to(sample.data.missing, values.shape)
    unlike = unlike_bands(values, replace(source.reader.frame, gone=gone))
    if unlike:
        raise InputError(
            f"{source.reader.path.name}: {len(unlike)} bands of different size or unit ({', '.join(unlike[:6])}); in windows "
            "choose one (band=1), or smooth them together (kind='image')"
        )


@dataclass(frozen=True, eq=False)
class Sheet:
    """A raster file, and its place in a grid.

    :ivar grid: the file itself, or all files of a survey.
    :ivar place: of the file in the grid.
    :ivar block: the window that holds it and its neighbours; None: it is run by windows of its own.
    :ivar tags: of what is written for it, beside those of the run.
    """

    file: Gridded
    grid: Source
    place: Window
    block: Block | None = None
    tags: Mapping[str, str] = field(default_factory=dict)

    def windows(self, sides: tuple[int, ...]) -> list[Window]:
        """By which the file is written.

        :param sides: of windows that fit into memory.
        """
        shape = self.file.form.shape
        return list(tiled(shape, sides if self.block is None else shape))

    def smoothed(self, run: Run, window: Window, *, with_error: bool) -> Done:
        """A window of the file, smoothed."""
        place = moved_by(window, self.place)
        return smoothed(self.grid, run, place, with_error=with_error) if self.block is None else self.block.part(place)


def written(sheet: Sheet, run: Run, target: Path, writing: Output, progress: Progress) -> Outcome:
    """Run all windows of a file, and write them.

    :raises FormatError: when the file cannot be written whole.
    """
    form, reader = sheet.file.form, sheet.file.reader
    stored, notes = stored_as(reader, run.census, target, writing)
    windows = sheet.windows(writing.window(form, run.leg))
    removed, threads = Removed(), run.request.compute.workers
    outcome = Outcome(run.found, len(windows), removed, legs=run.legs)
    clipped: dict[str, int] = {}
    with ExitStack() as stack, reporting(progress, f"smoothing by {len(windows)} windows") as report:
        tags = {f"meshflow:{name}": word for name, word in {**outcome.tags, **sheet.tags}.items()}
        into = Written.opened(stack, (target, stored, reader.layout), writing, threads, tags)
        sides = opened_beside(stack, reader, writing, threads, tags)
        for i, window in enumerate(windows):
            part = rows_and_columns(window)
            done = sheet.smoothed(run, window, with_error=writing.uncertainty is not None)
            removed.add(done.before, done.after, done.missing)
            # A band may be missing where others are there.
            gone = done.missing[None] if form.channels is None else reader.values(part)[1]
            bands = sheet.file.bands
            clipped |= dict.fromkeys(into.write(part, bands(done.after), gone, reader.alpha_of(part)), 0)
            for word, side in sides.items():
                side.write(part, bands(done.side(word)), gone)
            report((i + 1) / len(windows))
    return replace(outcome, notes=(*notes, *clipped))
