"""Words to one call: ``meshflow smooth | info | compare``."""

import json as notation
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meshflow import options as words
from meshflow.errors import InputError, MissingPackage, NotConverged
from meshflow.geometry.lift import Mesh, data_of
from meshflow.io.files import Document, read, writable, write

if TYPE_CHECKING:
    from meshflow.geometry.gates import Array
    from meshflow.result import Result

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Smooth meshes, elevation models, range images and images along their free directions, edges kept.",
)
out, err = Console(), Console(stderr=True, highlight=False)


# What typer exits with on Ctrl-C, as shells do.
INTERRUPTED = 130


@app.command()
def smooth(
    source: words.In,
    target: words.Out,
    time: words.Time = None,
    scale: words.Scale = None,
    steps: words.Steps = None,
    strength: words.Strength = 1.0,
    method: words.MethodOption = None,
    gamma: words.Gamma = None,
    sharpness: words.Sharpness = None,
    patch: words.Patch = None,
    contrast: words.Contrast = None,
    twice: words.Twice = None,
    sigma: words.Sigma = None,
    search: words.Search = True,
    boundary: words.BoundaryOption = None,
    diagonals: words.DiagonalsOption = "alternate",
    indicator: words.IndicatorOption = "metric",
    mass: words.MassOption = "barycentric",
    stepper: words.StepperOption = "auto",
    dt: words.Dt = None,
    threads: words.Threads = None,
    residual: words.Residual = None,
    area_loss: words.AreaLoss = None,
    displacement: words.Displacement = None,
    limit: words.Limit = None,
    confidence: words.Confidence = None,
    only: words.Only = None,
    fixed: words.FixedMask = None,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    moves: words.MovesOption = None,
    pace: words.PaceOption = None,
    picture: words.Picture = None,
    report: words.Report = None,
    dtype: words.Dtype = None,
    overwrite: words.Overwrite = False,
    quiet: words.Quiet = False,
    verbose: words.Verbose = False,
    json: words.Json = False,
) -> None:
    """Smooth IN and write the same kind of thing to OUT; what is not given is estimated from the data."""
    _smoothed(**locals())


def _smoothed(
    source: Path,
    target: Path,
    picture: Path | None,
    report: Path | None,
    fixed: Path | None,
    dtype: str | None,
    overwrite: bool,
    quiet: bool,
    verbose: bool,
    json: bool,
    **given: Any,
) -> None:
    """The command ``smooth``, with its options by name."""
    from meshflow.settings import Settings
    from meshflow.smoothing import smooth_noun

    document = _opened(source, **{name: given.pop(name) for name in INPUTS})
    held = {name: read_as(given[name]) for name, read_as in HELD.items()}
    settings = Settings(**{**given, **held})
    _must_be_writable(document, target, picture, report, overwrite)
    noun = document.noun if fixed is None else replace(document.noun, fixed=_mask(fixed))
    result = smooth_noun(noun, settings, progress=None if quiet else True, record=json or report is not None)
    done = document.holding(result.noun)
    tags = {f"meshflow:{name}": word for name, word in result.facts.items()}
    notes = document.notes + write(done, target, overwrite=overwrite, tags=tags, **({"dtype": dtype} if dtype else {}))
    notes += (*result.warnings, *_warned(document, result))
    if not quiet:
        _said(f"{source} → {target}: {f'{chr(10)}{result}' if verbose else result.summary}", notes)
    if picture is not None:
        drawn = _pictured(document, done, picture, f"{source.name}, {result.reason}")
        notes += drawn
        _said("", () if quiet else drawn)
    if report is not None:
        notes += _reported(result, report, source.name, overwrite, quiet)
    if json:
        out.print_json(notation.dumps({"in": str(source), "out": str(target), **result.words(), "notes": list(notes)}))


@app.command()
def info(
    source: words.In,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    json: words.Json = False,
) -> None:
    """Say what IN is: size, spacing, missing samples, noise, area, quality of its triangles."""
    from meshflow.smoothing import noise
    from meshflow.study.facts import describe

    document = _opened(source, kind, camera, depth_scale, measure, band, nodata, spacing, channels)
    facts = {"file": str(source), **describe(document.noun), **noise(document.noun)}
    _table(facts, json, document.notes)


@app.command()
def compare(
    one: words.In,
    other: words.Other,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    picture: words.Picture = None,
    json: words.Json = False,
) -> None:
    """Compare IN with OTHER: differences, normals, area, volume."""
    from meshflow.study.metrics import compare as measured

    first, second = (
        _opened(path, kind, camera, depth_scale, measure, band, nodata, spacing, channels) for path in (one, other)
    )
    facts = {"in": str(one), "other": str(other), **measured(first.noun, second.noun).words()}
    notes = first.notes + second.notes
    if picture is not None:
        notes += _pictured(first, second, picture, f"{one.name} and {other.name}")
    _table(facts, json, notes)


def _opened(
    path: Path,
    kind: words.Kind | None,
    camera: str | None,
    depth_scale: float | None,
    measure: words.Measure | None,
    band: int | None,
    nodata: float | None,
    spacing: float | None,
    channels: str | None,
    moves: words.Moves | None = None,
    pace: words.Pace | None = None,
) -> Document:
    """Read a file with the options that were given, and no others."""
    given = {
        "camera": camera,
        "depth_scale": depth_scale,
        "measure": measure,
        "band": band,
        "nodata": nodata,
        "spacing": spacing,
        "channels": channels,
        "moves": moves,
        "pace": pace,
    }
    return read(path, kind=kind, **{name: value for name, value in given.items() if value is not None})


def _samples(path: Path | None) -> "Array | None":
    """The samples of a raster, a picture or an array file: weights, limits."""
    if path is None:
        return None
    return data_of(read(path).noun)


def _limit(word: str | None) -> "float | Array | None":
    """A number, or the samples of a file."""
    if word is None:
        return None
    try:
        return float(word)
    except ValueError:
        return _samples(Path(word))


def _mask(path: Path | None) -> "Array | None":
    """Where the samples of a file are there and not zero, in any channel."""
    if path is None:
        return None
    noun = read(path).noun
    if isinstance(noun, Mesh) or noun.missing is None:
        raise InputError(f"{path}: a raster, a picture or an array is a mask, a mesh is none")
    values = np.nan_to_num(data_of(noun))
    return (values if values.ndim == 2 else values.any(axis=2)).astype(bool) & ~noun.missing


INPUTS = ("kind", "camera", "depth_scale", "measure", "band", "nodata", "spacing", "channels", "moves", "pace")
HELD = {"limit": _limit, "confidence": _samples, "only": _mask}


def _reported(result: "Result", path: Path, name: str, overwrite: bool, quiet: bool) -> tuple[str, ...]:
    from meshflow.view.report import report as drawn

    notes = (*drawn(result, path, title=name, overwrite=overwrite).notes, f"report: {path}")
    _said("", () if quiet else notes)
    return notes


def _warned(document: Document, result: "Result") -> tuple[str, ...]:
    """A word where a mesh is about to vanish."""
    if document.kind != "mesh" or result.end.area > 0.8 * result.start.area:
        return ()
    lost = 1 - result.end.area / result.start.area
    return (f"the surface lost {lost:.0%} of its area; a smaller --time keeps more",)


def _must_be_writable(
    document: Document, target: Path, picture: Path | None, report: Path | None, overwrite: bool
) -> None:
    """Refuse before the work what would be refused after it."""
    from meshflow.view.picture import writable as drawable
    from meshflow.view.report import writable as reportable

    writable(document, target, overwrite=overwrite)
    if picture is not None:
        drawable(picture)
        if picture.exists() and not overwrite:
            raise InputError(f"{picture} exists; name another picture or give --overwrite")
    if report is not None:
        reportable(report, overwrite)


def _pictured(before: Document, after: Document, path: Path, title: str) -> tuple[str, ...]:
    from meshflow.view import compare as draw

    return (*draw(before.noun, after.noun, path, title=title).notes, f"picture: {path}")


def _table(facts: dict[str, Any], json: bool, notes: tuple[str, ...]) -> None:
    """Facts as JSON or as a table on stdout, notes on stderr."""
    if json:
        out.print_json(notation.dumps({**facts, "notes": list(notes)}))
        return
    table = Table.grid(padding=(0, 2))
    for name, value in facts.items():
        # Text, not markup: brackets in a name or a path are not styles.
        table.add_row(Text(name, style="bold"), Text(f"{value:.6g}" if isinstance(value, float) else str(value)))
    out.print(table)
    _said("", notes)


def _said(line: str, notes: tuple[str, ...]) -> None:
    for said in (line, *notes):
        if said:
            err.print(said, markup=False, soft_wrap=True)


def main() -> None:
    """Run the command; a refusal is one line on stderr and an exit code that is not 0."""
    try:
        app()
    except (InputError, MissingPackage, NotConverged, OSError) as refusal:
        err.print(f"meshflow: {refusal}", markup=False, soft_wrap=True, style="red")
        sys.exit(1)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            err.print("meshflow: interrupted; OUT is whole, or as it was before", markup=False)
        raise
