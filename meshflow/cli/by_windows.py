"""``meshflow smooth`` of a raster or a volume that does not fit into the memory that it may take."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshflow.cli.asking import asked, narrowed
from meshflow.cli.flags import Given
from meshflow.cli.inputs import plain_sample, read_options
from meshflow.cli.many import Told
from meshflow.cli.options import PLACING, READING
from meshflow.cli.rasters import must_not_be, writing_of
from meshflow.cli.regions import Names, is_region, region_by_parts
from meshflow.errors import InputError
from meshflow.estimate.volumes import volume_words
from meshflow.flow.methods import words_for
from meshflow.io.files import format_of
from meshflow.io.formats.volume_windows import BY_WINDOWS
from meshflow.io.incoming import STDIN
from meshflow.io.metadata import ReadOptions
from meshflow.io.suffixes import suffix_of
from meshflow.large.memory import SHARE, Budget, bytes_in, free_memory, needed
from meshflow.large.source import rows_and_columns
from meshflow.surfaces.height_field import HeightField

if TYPE_CHECKING:
    from meshflow.large.outputs import Output
    from meshflow.large.rasters import Gridded
    from meshflow.large.source import Form, Window

__all__ = ["memory_for", "smooth_by_windows", "tiles_together"]

# Bytes of a file below which it is not asked whether its samples fit.
SMALL = 1 << 20
# What refers to other files, and may be small itself.
REFERRING = (".vrt",)
# Values of which an expression is evaluated at a time; it takes some arrays of their size.
PIECE = 1 << 20
# The formats that are read by windows, by their names.
RASTER, SCAN = "a raster", "a volume"
# Formats of rasters that are not read by windows.
AS_A_WHOLE = (".asc", ".zip")


def memory_for(given: Given) -> float | None:
    """Bytes in which IN must be smoothed by windows; None where it fits, and for everything but rasters and volumes."""
    source, words = given["source"], given["most_memory"]
    memory = None if words is None else bytes_in(words)
    if STDIN in (source, given["target"]) or not source.is_file() or source.suffix.lower() in AS_A_WHOLE:
        return None
    if memory is None and source.stat().st_size < SMALL and source.suffix.lower() not in REFERRING:
        return None
    options = _reading(given)
    if not _is_volume(source, options) and format_of(source, options).NAME != RASTER:
        return None
    memory = SHARE * free_memory() if memory is None else memory
    memory /= given["jobs"]
    return memory if needed(_form(source, options)) > memory else None


def _is_volume(source: Path, options: ReadOptions) -> bool:
    """Whether a file is a volume that is read by windows."""
    return suffix_of(source) in BY_WINDOWS and (options.kind == "volume" or format_of(source, options).NAME == SCAN)


def _form(source: Path, options: ReadOptions) -> "Form":
    """What a file holds; its samples are not read."""
    if _is_volume(source, options):
        from meshflow.large.volumes import form_of_volume

        return form_of_volume(source)
    from meshflow.large.rasters import form_of

    return form_of(source, options)


def smooth_by_windows(given: Given, memory: float) -> Told:
    """Smooth IN by windows.

    :raises InputError: for options that need the whole.
    """
    source, target, quiet = given["source"], given["target"], given["quiet"]
    for name in ("picture", "report"):
        if given[name] is not None:
            raise InputError(
                f"--{name}: it needs the whole data, which does not fit into {memory / 1e6:.0f} MB (--memory)"
            )
    options = _reading(given)
    known = format_of(source, options)
    options.must_belong(f"{known.NAME} ({source.name})", known.READS)
    word, suiting = given["method"], _words(source, options)
    request = asked(given, partial(_per_sample, source, options, memory), suiting)
    writing = _output(given, memory)
    for path in writing.sides.values():
        must_not_be(source, path)
    progress = None if quiet else True
    if _is_volume(source, options):
        from meshflow.large.volumes import smooth_volume

        result = smooth_volume(source, target, request, options, writing, progress)
    else:
        from meshflow.large.rasters import smooth_raster

        result = smooth_raster(source, target, request, options, writing, progress)
    more = (word for word in result.warnings if word not in result.notes)
    return Told(result, (*narrowed(request, word, suiting), *result.notes, *more))


def _per_sample(source: Path, options: ReadOptions, memory: float, word: str, given: str) -> Any:
    """The numbers per sample of an option: those of :func:`plain_sample`, or a region of a raster by an expression.

    The mask of the whole takes one byte for each sample.
    """
    if word not in ("mask", "fixed") or isfile(given) or not is_region(given) or _is_volume(source, options):
        return plain_sample(word, given)
    from meshflow.io.formats.raster_windows import raster_read
    from meshflow.large.census import bands
    from meshflow.large.rasters import gridded

    with raster_read(source, options) as reader:
        grid, _ = gridded(reader, options)
        windows = bands(grid.form, min(PIECE, Budget(memory).counted(grid.form)))
        return region_by_parts(((window, _names(grid, window)) for window in windows), grid.form.shape, given, word)


def _names(grid: "Gridded", window: "Window") -> Names:
    """The numbers of a window of a raster, by name."""
    (values, missing), part, form = grid.read(window), rows_and_columns(window), grid.form
    values = values if form.kind is HeightField else values.reshape(*missing.shape, -1)
    return Names.on_grid(values, missing, part, form.plane, grid.reader.frame.places(part))


def _words(source: Path, options: ReadOptions) -> tuple[str, ...]:
    """The names of the methods that are defined on what a file holds."""
    return volume_words() if _is_volume(source, options) else words_for(points=False)


def tiles_together(given: Given, pairs: Sequence[tuple[Path, Path]]) -> Iterator[tuple[Path, Told | Exception | None]]:
    """Smooth the tiles of a survey with one choice; each with what is said of it, or its refusal; None: it is done already.

    :raises InputError: for options that need the whole.
    """
    from meshflow.large.survey import smooth_together

    if given["jobs"] != 1:
        raise InputError("--together: the tiles are one run; leave out --jobs")
    options, word, suiting = _reading(given), given["method"], words_for(points=False)
    options.must_belong("a raster of several", ("kind", "band", "nodata", "spacing", "crs", "unit", "allow_remote"))
    request = asked(given, plain_sample, suiting)
    memory = SHARE * free_memory() if given["most_memory"] is None else bytes_in(given["most_memory"])
    writing = replace(_output(given, memory), resume=given["resume"])
    said = narrowed(request, word, suiting)
    for path, found in smooth_together(pairs, request, options, writing):
        if found is None or isinstance(found, Exception):
            yield path, found
        else:
            yield path, Told(found, (*said, *found.notes, *(one for one in found.warnings if one not in found.notes)))


def _output(given: Given, memory: float) -> "Output":
    """How the rasters are written."""
    from meshflow.large.outputs import Output

    stored = writing_of(given)
    return Output(
        Budget(memory),
        stored.get("dtype"),
        given["overwrite"],
        stored.get("driver"),
        stored.get("creation", {}),
        given["removed"],
        given["uncertainty"],
    )


def _reading(given: Given) -> ReadOptions:
    names = (*READING, *PLACING, "moves", "time_unit")
    return ReadOptions.of(read_options({name: given.get(name) for name in names}))
