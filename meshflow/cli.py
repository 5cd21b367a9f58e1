"""Words to one call: ``meshflow smooth | info | compare``."""

import json as notation
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meshflow.errors import InputError, MissingPackage, NotConverged
from meshflow.io.files import Document, read, writable, write

if TYPE_CHECKING:
    from meshflow.smoothing import Outcome

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Smooth meshes, elevation models, range images and images along their free directions, edges kept.",
)
out, err = Console(), Console(stderr=True, highlight=False)


Kind = Literal["terrain", "image", "depth", "mesh"]
Moves = Literal["points", "channels", "all"]


def _option(panel: str, words: str, *flags: str) -> Any:
    """An option of the command line, in its panel of the help."""
    return typer.Option(*flags, help=words, rich_help_panel=panel)


# What typer exits with on Ctrl-C, as shells do.
INTERRUPTED = 130
INPUT, FLOW, OUTPUT = "What the file is", "How it is smoothed", "What is written"
FILES = "GeoTIFF, COG, .asc, .hgt, .lbl, .dem, whatever GDAL opens; PLY, OBJ, STL, OFF, GLB, VTP, VTK; PNG, JPEG; .npy, .npz."
In = Annotated[Path, typer.Argument(metavar="IN", help=FILES)]
Out = Annotated[Path, typer.Argument(metavar="OUT", help="Where to write; the extension names the format.")]
Other = Annotated[Path, typer.Argument(metavar="OTHER", help="The same kind of thing on the same samples.")]
KindOption = Annotated[Kind | None, _option(INPUT, "What the file holds, where the guess would be wrong.")]
Camera = Annotated[
    Path | None,
    _option(INPUT, "JSON of the camera: IN is a depth image. Open3D intrinsics, or fx, fy, cx, cy in pixels."),
]
DepthScale = Annotated[
    float | None, _option(INPUT, "Units of a depth image per metre; 1000 (millimetres) for whole numbers.")
]
Band = Annotated[int | None, _option(INPUT, "Band of a raster, from 1; several are smoothed together otherwise.")]
Nodata = Annotated[float | None, _option(INPUT, "Value that marks missing samples, where the file does not say.")]
Spacing = Annotated[
    float | None,
    _option(INPUT, "Distance of neighbouring samples; the raster's own by default, metres where it is in degrees."),
]
Channels = Annotated[str | None, _option(INPUT, "Vertex attribute of a mesh to smooth: its name, or 'colors'.")]
MovesOption = Annotated[Moves | None, _option(INPUT, "What of a mesh with --channels moves; channels by default.")]
Time = Annotated[
    float | None,
    _option(
        FLOW,
        "How far, in squared length: m² of a terrain, pixels² of an image or a range image. Default: 5 samples²; half an "
        "edge² for a mesh.",
    ),
]
Scale = Annotated[
    float | None,
    _option(
        FLOW,
        "Instead of --time: standard deviation of the Gaussian that the flow equals on flat data, a length; time = scale²/2.",
    ),
]
Steps = Annotated[int | None, _option(FLOW, "Stop after this many steps.")]
Gamma = Annotated[
    float,
    _option(
        FLOW,
        "0: Beltrami flow; above 0: edges kept more; -1: mean curvature diffusion; -2: graph flow. No effect on a mesh "
        "whose points move.",
    ),
]
Contrast = Annotated[
    float | None,
    _option(
        FLOW,
        "Length per unit of the value: larger keeps smaller edges. Default: 1.5 samples over the noise that is found.",
    ),
]
BoundaryOption = Annotated[
    Literal["natural", "linear", "fixed"] | None,
    _option(
        FLOW,
        "linear: tilted planes rest at borders and holes; natural: no flux; fixed: borders stay. Default: natural for "
        "images, else linear.",
    ),
]
DiagonalsOption = Annotated[
    Literal["forward", "backward", "both", "alternate"], _option(FLOW, "How the cells of a grid become triangles.")
]
IndicatorOption = Annotated[
    Literal["metric", "projection"], _option(FLOW, "How edges are told, for gamma other than 0.")
]
MassOption = Annotated[
    Literal["barycentric", "voronoi", "ring"],
    _option(FLOW, "Area of a vertex; with ring, as in the paper, time runs three times slower."),
]
Sharpness = Annotated[
    float,
    _option(
        FLOW,
        "Above 1: less flux across edges; 2 with --gamma -1 is Perona and Malik. Not for depth, nor for points.",
    ),
]
StepperOption = Annotated[
    Literal["auto", "explicit", "super-time", "semi-implicit"], _option(FLOW, "How time is stepped.")
]
Dt = Annotated[float | None, _option(FLOW, "Length of a step, squared length. Default: what suits the stepper.")]
Threads = Annotated[int | None, _option(FLOW, "Threads for grids. Default: NUMBA_NUM_THREADS, or one for each core.")]
Picture = Annotated[Path | None, _option(OUTPUT, "A picture of before, after and the difference (.png).")]
Dtype = Annotated[
    str | None, _option(OUTPUT, "Number type of a raster or picture; 'source' rounds back to whole numbers.")
]
Overwrite = Annotated[bool, _option(OUTPUT, "Replace OUT if it is there.", "--overwrite")]
Quiet = Annotated[bool, _option(OUTPUT, "Say nothing but errors.", "--quiet", "-q")]
Json = Annotated[bool, _option(OUTPUT, "JSON on stdout.", "--json")]


@app.command()
def smooth(
    source: In,
    target: Out,
    time: Time = None,
    scale: Scale = None,
    steps: Steps = None,
    gamma: Gamma = 0.0,
    sharpness: Sharpness = 1.0,
    contrast: Contrast = None,
    boundary: BoundaryOption = None,
    diagonals: DiagonalsOption = "alternate",
    indicator: IndicatorOption = "metric",
    mass: MassOption = "barycentric",
    stepper: StepperOption = "auto",
    dt: Dt = None,
    threads: Threads = None,
    kind: KindOption = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    band: Band = None,
    nodata: Nodata = None,
    spacing: Spacing = None,
    channels: Channels = None,
    moves: MovesOption = None,
    picture: Picture = None,
    dtype: Dtype = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Smooth IN and write the same kind of thing to OUT."""
    given = locals()
    from meshflow.smoothing import Settings, smooth_noun

    settings = Settings(**{name: given[name] for name in Settings.__dataclass_fields__ if name in given})
    document = _opened(source, kind, camera, depth_scale, band, nodata, spacing, channels, moves)
    _must_be_writable(document, target, picture, overwrite)
    outcome = smooth_noun(document.noun, settings, progress=None if quiet else True)
    done = document.holding(outcome.noun)
    tags = {f"meshflow:{name}": word for name, word in outcome.facts.items()}
    notes = document.notes + write(done, target, overwrite=overwrite, tags=tags, **({"dtype": dtype} if dtype else {}))
    notes += _warned(document, outcome)
    if not quiet:
        _said(f"{source} → {target}: {_summary(outcome)}", notes)
    if picture is not None:
        drawn = _pictured(document, done, picture, f"{source.name}, {outcome.facts['ended']}")
        notes += drawn
        _said("", () if quiet else drawn)
    if json:
        out.print_json(notation.dumps({"in": str(source), "out": str(target), **outcome.facts, "notes": list(notes)}))


@app.command()
def info(
    source: In,
    kind: KindOption = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    band: Band = None,
    nodata: Nodata = None,
    spacing: Spacing = None,
    channels: Channels = None,
    json: Json = False,
) -> None:
    """Say what IN is: size, spacing, missing samples, noise, area, quality of its triangles."""
    from meshflow.smoothing import noise
    from meshflow.study.facts import describe

    document = _opened(source, kind, camera, depth_scale, band, nodata, spacing, channels, None)
    facts = {"file": str(source), **describe(document.noun), **noise(document.noun)}
    _table(facts, json, document.notes)


@app.command()
def compare(
    one: In,
    other: Other,
    kind: KindOption = None,
    camera: Camera = None,
    depth_scale: DepthScale = None,
    band: Band = None,
    nodata: Nodata = None,
    spacing: Spacing = None,
    channels: Channels = None,
    picture: Picture = None,
    json: Json = False,
) -> None:
    """Compare IN with OTHER: differences, normals, area, volume."""
    from meshflow.study.metrics import compare as measured

    first, second = (
        _opened(path, kind, camera, depth_scale, band, nodata, spacing, channels, None) for path in (one, other)
    )
    facts = {"in": str(one), "other": str(other), **measured(first.noun, second.noun).words()}
    notes = first.notes + second.notes
    if picture is not None:
        notes += _pictured(first, second, picture, f"{one.name} and {other.name}")
    _table(facts, json, notes)


def _opened(
    path: Path,
    kind: Kind | None,
    camera: Path | None,
    depth_scale: float | None,
    band: int | None,
    nodata: float | None,
    spacing: float | None,
    channels: str | None,
    moves: Moves | None,
) -> Document:
    """Read a file with the options that were given, and no others."""
    given = {
        "camera": camera,
        "depth_scale": depth_scale,
        "band": band,
        "nodata": nodata,
        "spacing": spacing,
        "channels": channels,
        "moves": moves,
    }
    return read(path, kind=kind, **{name: value for name, value in given.items() if value is not None})


def _summary(outcome: "Outcome") -> str:
    area = f"area {outcome.start.area:.6g} → {outcome.end.area:.6g}"
    return f"{outcome.facts['ended']}, contrast {outcome.facts['contrast']}, {area}"


def _warned(document: Document, outcome: "Outcome") -> tuple[str, ...]:
    """A word where a mesh is about to vanish."""
    if document.kind != "mesh" or outcome.end.area > 0.8 * outcome.start.area:
        return ()
    lost = 1 - outcome.end.area / outcome.start.area
    return (f"the surface lost {lost:.0%} of its area; a smaller --time keeps more",)


def _must_be_writable(document: Document, target: Path, picture: Path | None, overwrite: bool) -> None:
    """Refuse before the work what would be refused after it."""
    from meshflow.view.picture import writable as drawable

    writable(document, target, overwrite=overwrite)
    if picture is not None:
        drawable(picture)
        if picture.exists() and not overwrite:
            raise InputError(f"{picture} exists; name another picture or give --overwrite")


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
    for words in (line, *notes):
        if words:
            err.print(words, markup=False, soft_wrap=True)


def main() -> None:
    """Run the command; a refusal is one line on stderr and an exit code that is not 0."""
    try:
        app()
    except (InputError, MissingPackage, NotConverged, OSError) as refusal:
        err.print(f"meshflow: {refusal}", markup=False, soft_wrap=True, style="red")
        sys.exit(1)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            err.print("meshflow: interrupted; what was not yet written is not there", markup=False)
        raise
