"""Words to one call: ``meshflow smooth | info | fuse | compare | show | film | compare-flows``."""

import json as notation
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from meshflow.cli import looking
from meshflow.cli import options as words
from meshflow.cli.console import err, out, said, table
from meshflow.cli.inputs import HELD, INPUTS, frame, opened, per_sample
from meshflow.cli.inputs import limit as limit_of
from meshflow.cli.looking import must_be_drawable, pictured
from meshflow.errors import InputError, MissingPackage, NotConverged
from meshflow.estimate.settings import Settings
from meshflow.evaluate.facts import describe
from meshflow.fusing import fuse as fused
from meshflow.io.document import Document, Writing
from meshflow.io.files import writable, write
from meshflow.results.multipart import Results
from meshflow.results.result import Result
from meshflow.smoothing import noise, smooth_document
from meshflow.view.report import report as drawn_report
from meshflow.view.report import writable as reportable

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Smooth meshes, elevation models, range images and images along their free directions, edges kept.",
)

# What typer raises for a wrong word; it brings a click of its own, and names no more of it than this child.
UsageError: Any = typer.BadParameter.__base__
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
    order: words.Order = None,
    weights: words.WeightsOption = None,
    evened: words.Evened = None,
    along: words.AlongOption = "all",
    triangles: words.TrianglesOption = "auto",
    twice: words.Twice = None,
    sigma: words.Sigma = None,
    search: words.Search = None,
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
    speed: words.SpeedOption = None,
    fixed: words.FixedMask = None,
    keep: words.KeepOption = None,
    islands: words.Islands = None,
    space: words.SpaceOption = "length",
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
    viewpoint: words.Viewpoint = None,
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
    dtype: str | None,
    overwrite: bool,
    quiet: bool,
    verbose: bool,
    json: bool,
    **given: Any,
) -> None:
    """The command ``smooth``, with its options by name."""
    document = opened(source, **{name: given.pop(name) for name in INPUTS})
    held = {word: per_sample(document, word, given.pop(word)) for word in HELD}
    fixed = held.pop("fixed")
    Settings(**given, **held)  # what makes no sense is refused before the target is looked at
    _must_be_writable(document, target, picture, report, overwrite)
    if fixed is not None:
        document = document.holding(replace(document.noun, fixed=fixed))
    shown = None if quiet else True
    done, result = smooth_document(document, {**given, **held}, shown, record=json or report is not None)
    tags = {f"meshflow:{name}": word for name, word in result.facts.items()}
    options = {**({"dtype": dtype} if dtype else {}), **_left(document, target, result)}
    notes = document.notes + write(done, target, overwrite=overwrite, tags=tags, **options)
    notes += _warned(document, result)
    if not quiet:
        said(f"{source} → {target}: {f'{chr(10)}{result}' if verbose else result.summary}", notes)
    if picture is not None:
        drawn = pictured(document, done, picture, f"{source.name}, {result.reason}", overwrite)
        notes += drawn
        said("", () if quiet else drawn)
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
    viewpoint: words.Viewpoint = None,
    json: words.Json = False,
) -> None:
    """Say what IN is: size, spacing, missing samples, noise, area, quality of its triangles."""
    document = opened(source, kind, camera, depth_scale, measure, band, nodata, spacing, channels, viewpoint=viewpoint)
    facts = {"file": str(source), **describe(document.noun), **noise(document.noun)}
    table(facts, json, document.notes)


@app.command()
def fuse(
    sources: words.Frames,
    target: words.Fused,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    strength: words.Strength = 1.0,
    time: words.Time = None,
    gamma: words.Gamma = None,
    search: words.Search = None,
    space: words.SpaceOption = "length",
    limit: words.Limit = None,
    islands: words.Islands = None,
    threads: words.Threads = None,
    picture: words.Picture = None,
    report: words.Report = None,
    overwrite: words.Overwrite = False,
    quiet: words.Quiet = False,
    verbose: words.Verbose = False,
    json: words.Json = False,
) -> None:
    """Smooth the mean of depth frames of a view that stays, each pixel by how far it can be trusted, and write it to OUT."""
    _fused(**locals())


def _fused(
    sources: list[Path],
    target: Path,
    picture: Path | None,
    report: Path | None,
    overwrite: bool,
    quiet: bool,
    verbose: bool,
    json: bool,
    limit: str | None,
    **given: Any,
) -> None:
    """The command ``fuse``, with its options by name."""
    reading = {name: given.pop(name) for name in ("camera", "depth_scale", "measure")}
    first = next((found for path in sources if (found := frame(path, **reading)) is not None), None)
    if first is None:
        raise InputError(f"fuse: depths expected, got {len(sources)} frames without a single one")
    _must_be_writable(first, target, picture, report, overwrite)
    nouns = (None if seen is None else seen.noun for seen in (frame(path, **reading) for path in sources))
    result = fused(nouns, full=True, limit=limit_of(limit), **given)
    before, done = first.holding(result.before), first.holding(result.thing)
    tags = {f"meshflow:{name}": word for name, word in result.facts.items()}
    written = write(done, target, overwrite=overwrite, tags=tags, **_left(first, target, result))
    notes = (*first.notes, *written, *result.warnings)
    many = f"{len(sources)} frames"
    if not quiet:
        seen = result.parameters["frames"]
        said(f"{many} → {target}: {f'{chr(10)}{result}' if verbose else f'{result.summary}; {seen.why}'}", notes)
    if picture is not None:
        drawn = pictured(before, done, picture, f"{many}, {result.reason}", overwrite)
        notes += drawn
        said("", () if quiet else drawn)
    if report is not None:
        notes += _reported(result, report, many, overwrite, quiet)
    if json:
        told = {"in": [str(path) for path in sources], "out": str(target), **result.words(), "notes": list(notes)}
        out.print_json(notation.dumps(told))


def _reported(result: Result | Results, path: Path, name: str, overwrite: bool, quiet: bool) -> tuple[str, ...]:

    notes = (*drawn_report(result, path, title=name, overwrite=overwrite).notes, f"report: {path}")
    said("", () if quiet else notes)
    return notes


def _warned(document: Document, result: Result | Results) -> tuple[str, ...]:
    """The warnings of a run, and a word where a mesh is about to vanish; of each part, its name before it."""
    if isinstance(result, Mapping):
        each = ((name, _warned(document, one)) for name, one in result.items())
        return (*result.warnings, *(f"{name}: {word}" for name, words in each for word in words))
    moves = document.kind == "mesh" and getattr(result.noun, "moves", "") == "points"
    if not moves or result.end.area > 0.8 * result.start.area:  # the area of points and channels is of both
        return result.warnings
    lost = 1 - result.end.area / result.start.area
    return (*result.warnings, f"the surface lost {lost:.0%} of its area; a smaller --time keeps more")


def _left(document: Document, target: Path, result: Result | Results) -> Writing:
    """For the writer of depth images, which rounds: the noise that is left."""
    if isinstance(result, Mapping) or writable(document, target, overwrite=True) != "depth_images":
        return {}
    return {"left": result.left}


def _must_be_writable(
    document: Document, target: Path, picture: Path | None, report: Path | None, overwrite: bool
) -> None:
    """Refuse before the work what would be refused after it."""
    writable(document, target, overwrite=overwrite)
    must_be_drawable(picture, overwrite)
    if report is not None:
        reportable(report, overwrite)


app.command()(looking.compare)
app.command()(looking.show)
app.command()(looking.film)
app.command()(looking.view)
app.command("compare-flows")(looking.compare_flows)


def main() -> None:
    """Run the command; a refusal is one line on stderr and an exit code that is not 0."""
    try:
        # Without a word there is help to print, which typer does itself; a wrong word it would put into a box.
        sys.exit(app(standalone_mode=len(sys.argv) < 2))
    except UsageError as refusal:
        about = "" if refusal.ctx is None else f"; see {refusal.ctx.command_path} --help"
        said(f"meshflow: {' '.join(refusal.format_message().split()).rstrip('.')}{about}", (), style="red")
        sys.exit(refusal.exit_code)
    except (InputError, MissingPackage, NotConverged, OSError) as refusal:
        err.print(f"meshflow: {refusal}", markup=False, soft_wrap=True, style="red")
        sys.exit(1)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            err.print("meshflow: interrupted; OUT is whole, or as it was before", markup=False)
        raise
