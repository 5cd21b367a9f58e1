"""How a raster that is smoothed by windows is written, and the rasters beside it."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_apart, must_be_free, sides_of
from meshflow.io.document import WriteOptions
from meshflow.io.formats.raster_encoding import DRIVERS, driver_of, encoding_for
from meshflow.io.formats.raster_frame import Frame
from meshflow.io.formats.raster_place import Part
from meshflow.io.formats.raster_windows import Layout, RasterReader, RasterWriter, raster_written
from meshflow.io.formats.rasters import lossy, marking, must_suit, type_for
from meshflow.io.rounding import mark_outside, rounded
from meshflow.io.side_outputs import side_frame
from meshflow.large.census import Census
from meshflow.large.legs import Leg
from meshflow.large.memory import Budget
from meshflow.large.source import Form

__all__ = ["Output", "Written", "must_be_stored", "must_be_writable", "opened_beside", "stored_as"]

# The driver that takes a raster as a whole only.
AS_A_WHOLE = "AAIGrid"


@dataclass(frozen=True)
class Output:
    """How a raster is written.

    :ivar budget: the memory.
    :ivar dtype: number type of the samples, or ``source``; None: floating point.
    :ivar overwrite: replace an existing file.
    :ivar resume: of the tiles of a survey: keep a file that this run would write so, and replace one of another run.
    :ivar driver: of GDAL; None: that of the extension. ``creation``: its creation options.
    :ivar removed: of a second raster, with what was removed; None: there is none.
    :ivar uncertainty: of one with the expected error of each sample.
    """

    budget: Budget
    dtype: str | None = None
    overwrite: bool = False
    driver: str | None = None
    creation: Mapping[str, str] = field(default_factory=dict)
    removed: Path | None = None
    uncertainty: Path | None = None
    resume: bool = False

    @property
    def sides(self) -> dict[str, Path]:
        """The rasters beside the result, by what they hold."""
        return sides_of(self.removed, self.uncertainty)

    def window(self, form: Form, leg: Leg) -> tuple[int, ...]:
        """The sides of the windows of a leg."""
        twice = 1 if self.uncertainty is None else 2  # runs on what a run makes
        return self.budget.sides(form, twice * leg.halo, leg.held)

    @property
    def options(self) -> WriteOptions:
        """Of the writer of rasters."""
        return WriteOptions(dtype=self.dtype, driver=self.driver, creation=self.creation)


def must_be_writable(target: Path, writing: Output) -> None:
    """Refuse a file that is there, no folder, and a format that is not written by windows.

    :raises FormatError: it says which.
    """
    for path in (target, *writing.sides.values()):
        must_be_free(path, writing.overwrite)
        known = writing.driver is not None or path.suffix.lower() in DRIVERS
        if not known or driver_of(path, writing.driver) == AS_A_WHOLE:
            *some, last = (suffix for suffix, driver in DRIVERS.items() if driver != AS_A_WHOLE)
            raise FormatError(
                f"{path.name}: a {', '.join(some)} or {last} is written by windows, got {path.suffix or 'no extension'}"
            )
        if not path.parent.is_dir():
            raise FormatError(f"{path.parent} is not a folder; create it first")
    must_be_apart(target, writing.sides)


def must_be_stored(reader: RasterReader, target: Path, writing: Output) -> None:
    """Refuse a number type, a driver and creation options that do not suit, before the work.

    :raises InputError: it says which.
    """
    frame, layout, dtype = reader.frame, reader.layout, reader.dtype
    kind = type_for(writing.dtype, frame, dtype)
    must_suit(target, writing.options, (frame, kind, layout.count + layout.alpha, layout.shape))
    for word, path in writing.sides.items():
        plain = side_frame(frame, str(dtype), word)
        must_suit(path, writing.options, (plain, dtype, layout.count, layout.shape))


@dataclass(frozen=True, eq=False)
class Stored:
    """How samples are stored: what is around them, their type, and the value of missing ones."""

    frame: Frame
    kind: np.dtype
    nodata: float | None


@dataclass(frozen=True, eq=False)
class Written:
    """A raster that is being written, and how its samples are stored."""

    writer: RasterWriter
    stored: Stored

    @classmethod
    def opened(
        cls,
        stack: ExitStack,
        file: tuple[Path, Stored, Layout],
        writing: Output,
        threads: int,
        tags: Mapping[str, str],
    ) -> "Written":
        """Begin a raster; it is complete, or not there, when the stack is closed.

        :param file: its path, how its samples are stored, and its bands.
        :param threads: that compress it.
        """
        path, stored, layout = file
        encoding = encoding_for(
            driver_of(path, writing.driver), writing.creation, stored.nodata, stored.kind, layout.shape
        )
        if not encoding.copied:
            encoding = replace(encoding, creation={"NUM_THREADS": threads, **encoding.creation})
        return cls(stack.enter_context(raster_written(path, layout, stored.frame, stored.kind, encoding, tags)), stored)

    def write(self, window: Part, values: Array, gone: Array, alpha: Array | None = None) -> tuple[str, ...]:
        """Write values (k, r, c) of a window; returns notes.

        :param gone: (1 or k, r, c), missing samples; ``alpha``: (r, c).
        :raises FormatError: where a sample has the value that marks missing ones.
        """
        stored = self.stored
        samples, clipped = rounded(stored.frame.stored(values), gone, stored.kind)
        if stored.nodata is not None:
            taken = int((samples == stored.nodata)[~gone].sum())
            if taken:
                raise FormatError(
                    f"{taken} smoothed samples have the value {stored.nodata:g}, which marks missing ones; give another (nodata, "
                    "--nodata)"
                )
            samples = np.where(gone, stored.kind.type(stored.nodata), samples)
        self.writer.write(window, samples, alpha)
        return clipped


def stored_as(reader: RasterReader, census: Census, path: Path, writing: Output) -> tuple[Stored, tuple[str, ...]]:
    """How the samples are stored, and notes."""
    frame, notes, dtype = reader.frame, (), reader.dtype
    kind, driver = type_for(writing.dtype, frame, dtype), driver_of(path, writing.driver)
    whole = kind.kind in "iu"
    notes += lossy(encoding_for(driver, writing.creation, None, kind, reader.shape))
    if frame.scaled and not (writing.dtype == "source" and whole):
        frame = frame.without_scale()
        notes += ("scale and offset of the source were applied: the values are stored as they are",)
    if whole:
        step = frame.scales[0] if frame.scaled else 1
        notes += (
            f"rounded to {kind}: the result is quantised again, in steps of {step:g}; float32 keeps the smoothed values",
        )
    some_gone = census.present < reader.shape[0] * reader.shape[1]
    if frame.nodata is None and (not some_gone or (reader.alpha is not None and whole)):
        return Stored(frame, kind, None), notes
    ends = frame.stored(census.ends[:, None, :])
    nodata = mark_outside(marking(frame.nodata, driver), (float(ends.min()), float(ends.max())), kind)
    if nodata != frame.nodata and not (np.isnan(nodata) and np.isnan(frame.nodata or 0.0)):
        notes += (f"missing samples are marked by nodata {nodata:g}",)
    return Stored(frame, kind, nodata), notes


def opened_beside(
    stack: ExitStack, reader: RasterReader, writing: Output, threads: int, tags: Mapping[str, str]
) -> dict[str, Written]:
    """Begin the rasters beside a result, by what they hold.

    :param threads: that compress them.
    """
    sides = {}
    for word, path in writing.sides.items():
        nodata = marking(float("nan"), driver_of(path, writing.driver))
        stored = Stored(side_frame(reader.frame, str(reader.dtype), word), reader.dtype, nodata)
        layout = Layout(reader.layout.count, reader.shape)
        sides[word] = Written.opened(stack, (path, stored, layout), writing, threads, tags)
    return sides
