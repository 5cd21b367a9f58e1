"""The words of the command line: each option once, with its help and its panel."""

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer

from meshflow.flow.methods.beltrami import Method

Kind = Literal["terrain", "image", "depth", "mesh"]
Measure = Literal["depth", "range"]
Pace = Literal["footprint", "length", "noise"]
Moves = Literal["points", "channels", "all"]
Quantity = Literal["curvature", "edges", "triangles", "samples"]
Compared = Literal["removed", "curvature", "edges", "triangles", "samples"]


def _option(panel: str, words: str, *flags: str) -> Any:
    """An option of the command line, in its panel of the help."""
    return typer.Option(*flags, help=words, rich_help_panel=panel)


INPUT, FLOW, STOP, HOLD, OUTPUT, LOOK = (
    "What the file is",
    "How it is smoothed",
    "When it stops before its time",
    "What is held",
    "What is written",
    "How it looks",
)
FILES = (
    "GeoTIFF, COG, .asc, .hgt, .lbl, .dem, whatever GDAL opens; PLY, OBJ, STL, OFF, GLB, VTP, VTK, VTM; PNG, JPEG; "
    ".npy, .npz."
)
In = Annotated[Path, typer.Argument(metavar="IN", help=FILES)]
Out = Annotated[Path, typer.Argument(metavar="OUT", help="Where to write; the extension names the format.")]
Other = Annotated[Path, typer.Argument(metavar="OTHER", help="The same kind of thing on the same samples.")]
Depths = Annotated[Path, typer.Argument(metavar="IN", help="Depth image: 16-bit PNG, TIFF, .npy; needs --camera.")]
Truth = Annotated[Path | None, _option(INPUT, "True depths of the same pixels, seen by the same camera.")]
TruthScale = Annotated[float | None, _option(INPUT, "Units of the truth per metre, as --depth-scale of IN.")]
KindOption = Annotated[Kind | None, _option(INPUT, "What the file holds, where the guess would be wrong.")]
Camera = Annotated[
    str | None,
    _option(
        INPUT,
        "The camera: IN is a depth image. A name (tum, 7scenes, kinect, primesense, tum-freiburg1 to 3), a JSON (Open3D, or fx, "
        "fy, cx, cy in pixels), or a camera_info YAML of ROS.",
    ),
]
MeasureOption = Annotated[
    Measure | None, _option(INPUT, "What the depths are: along the optical axis, or range, along the ray.", "--measure")
]
Viewpoint = Annotated[
    tuple[float, float, float] | None,
    _option(
        INPUT,
        "Where the scanner of a range grid stood, x y z in the frame of its points: they move along their rays from there. "
        "Default: what the file says, else along z.",
    ),
]
PaceOption = Annotated[
    Pace | None,
    _option(
        FLOW,
        "What time of a range image is counted in: pixel footprints, length (metres squared), or footprints by noise.",
        "--pace",
    ),
]
DepthScale = Annotated[
    float | None,
    _option(INPUT, "Units of a depth image per metre; the camera's own, else 1000 (millimetres) for whole numbers."),
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
        "How far, in squared length: m² of a terrain, pixels² of an image or a range image. Default: searched for; "
        "10 sigma / pixel width of a range image.",
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
# A word, so that an unknown one is refused in one line like everything else.
MethodOption = Annotated[
    str | None,
    _option(
        FLOW,
        f"A member of the family by name. Default: the one of least estimated risk. {' | '.join(get_args(Method))}.",
    ),
]
Order = Annotated[
    int | None,
    _option(
        FLOW, "Of a mesh, method fairing: 1 implicit fairing, 2 bi-Laplacian, up to 20, all but an ideal low-pass."
    ),
]
WeightsOption = Annotated[
    Literal["cotangent", "uniform"] | None,
    _option(FLOW, "Of a mesh, method fairing: cotangent keeps the sampling, uniform evens it too.", "--weights"),
]
Evened = Annotated[
    float | None,
    _option(FLOW, "Of a mesh, method facets: squared length over which the sampling is evened first."),
]
AlongOption = Annotated[
    Literal["all", "normals"], _option(FLOW, "Points of a mesh move anywhere, or along their normals.", "--along")
]
TrianglesOption = Annotated[
    Literal["auto", "given", "delaunay", "clamped"],
    _option(
        FLOW,
        "Whose cotangents: the mesh's own, those of its intrinsic Delaunay triangulation, or clamped to weights of zero and "
        "above, so that no value leaves its range.",
        "--triangles",
    ),
]
KeepOption = Annotated[
    Literal["volume", "scale", "area"] | None,
    _option(HOLD, "Of a closed mesh: its volume exactly, the volume by scaling, or the area by scaling.", "--keep"),
]
Strength = Annotated[float, _option(FLOW, "More or less of it: the noise times this is what is removed.")]
Sigma = Annotated[
    float | None,
    _option(FLOW, "Standard deviation of the noise, unit of the values. Default: estimated."),
]
Search = Annotated[
    bool | None,
    _option(
        FLOW,
        "Search for what is not given, or take one member for all data. Default: search, but for depth.",
        "--search/--no-search",
    ),
]
Patch = Annotated[
    float | None, _option(FLOW, "Width in samples of the patches in whose space lengths are measured; grids only.")
]
Twice = Annotated[float | None, _option(FLOW, "Weight of twicing, 0 to 1: u(t) + w (u(t) - u(2 t)).")]
Residual = Annotated[
    float | None, _option(STOP, "Stop when the rms change is this share of the noise; 0.9 is near the best.")
]
AreaLoss = Annotated[float | None, _option(STOP, "Stop when this share of the area is lost.")]
Displacement = Annotated[
    float | None, _option(STOP, "Stop when a sample has moved as far as this, unit of the values.")
]
Limit = Annotated[
    str | None,
    _option(
        HOLD,
        "No sample leaves its value by more: a number, a raster or .npy of them, the name of a vertex attribute, or 'step': half "
        "the step of quantised data, of depth at each depth. Default: half the quantum where rounding is the noise, else none.",
    ),
]
Confidence = Annotated[
    str | None,
    _option(
        HOLD,
        "Weights of a fidelity term, 1 / variance: a number, a raster or .npy of them, or the name of a vertex attribute.",
    ),
]
Only = Annotated[
    str | None,
    _option(HOLD, "Mask of the samples that may move, not zero: a raster, picture, .npy, or vertex attribute."),
]
SpeedOption = Annotated[
    str | None,
    _option(
        HOLD,
        "How fast samples go, 0 (stays) to 1 (as they would): a number, a raster or .npy, or the name of a vertex attribute.",
        "--speed",
    ),
]
FixedMask = Annotated[str | None, _option(HOLD, "Mask of the samples that stay: as --only.", "--fixed")]
Islands = Annotated[int | None, _option(HOLD, "Drop pieces of a range image of fewer samples. Default: none.")]
SpaceOption = Annotated[
    Literal["length", "disparity"],
    _option(
        FLOW, "disparity: move inverse depths, where the noise of stereo and structured light is even; all members."
    ),
]
Frames = Annotated[
    list[Path], typer.Argument(help="Depth images of a view that stays, two or more.", show_default=False)
]
Fused = Annotated[Path, typer.Option("--out", "-o", help="Where the result goes.", show_default=False)]
Gamma = Annotated[
    float | None,
    _option(
        FLOW,
        "Instead of --method: 0: Beltrami flow; above 0: edges kept more; -1: mean curvature diffusion; -2: graph flow. No "
        "effect on a mesh whose points move.",
    ),
]
Contrast = Annotated[
    float | None,
    _option(
        FLOW,
        "Length per unit of the value: larger keeps smaller edges. Default: searched for, in samples over the noise.",
    ),
]
BoundaryOption = Annotated[
    Literal["natural", "linear", "fixed", "curve"] | None,
    _option(
        FLOW,
        "linear: tilted planes rest at borders and holes; natural: no flux; fixed: borders stay; curve: those of a mesh move by "
        "their own curvature. Default: natural for images, else linear.",
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
    float | None,
    _option(
        FLOW,
        "Above 1: less flux across edges; 2 with --gamma -1 is Perona and Malik. Not for depth, nor for points.",
    ),
]
StepperOption = Annotated[
    Literal["auto", "explicit", "super-time", "semi-implicit"], _option(FLOW, "How time is stepped.")
]
Dt = Annotated[float | None, _option(FLOW, "Length of a step, squared length. Default: what suits the stepper.")]
Threads = Annotated[
    int | None, _option(FLOW, "Threads for grids. Default: MESHFLOW_NUM_THREADS, or one for each core.")
]
Picture = Annotated[Path | None, _option(OUTPUT, "A picture of before, after and what was removed (.png).")]
Panels = Annotated[Path | None, _option(OUTPUT, "A picture of all flows and one silhouette close up (.png).")]
FlowTime = Annotated[
    float,
    _option(FLOW, "How far the ray flow goes, in squared pixel footprints; the others go until they are as smooth."),
]
Jump = Annotated[
    float, _option(INPUT, "A triangle is left out where its depths differ by more than this share of the nearest.")
]
RimOption = Annotated[
    Literal["natural", "linear", "fixed"], _option(FLOW, "What holds at borders and holes, for all flows alike.")
]
Dtype = Annotated[
    str | None, _option(OUTPUT, "Number type of a raster or picture; 'source' rounds back to whole numbers.")
]
Report = Annotated[
    Path | None, _option(OUTPUT, "What was done and why: before, after, removed, parameters, risk (.html or .png).")
]
Overwrite = Annotated[bool, _option(OUTPUT, "Replace OUT if it is there.", "--overwrite")]
Quiet = Annotated[bool, _option(OUTPUT, "Say nothing but errors.", "--quiet", "-q")]
Verbose = Annotated[bool, _option(OUTPUT, "Every parameter, with its unit and where it came from.", "--verbose", "-v")]
Json = Annotated[bool, _option(OUTPUT, "JSON on stdout.", "--json")]
Shown = Annotated[
    Path | None, typer.Argument(metavar="PICTURE", help="Where to draw (.png, .jpg, .tif). Default: a window.")
]
Film = Annotated[Path, typer.Argument(metavar="FILM", help="Where to write: .mp4 (needs meshflow[film]) or .gif.")]
Window = Annotated[bool, _option(LOOK, "Open a window; needs a display.", "--window")]
QuantityOption = Annotated[
    Quantity | None,
    _option(
        LOOK,
        "Colour stands for: mean curvature, edges (the edge indicator 1/W), quality of triangles, or samples (which are fixed "
        "or missing).",
    ),
]
ComparedOption = Annotated[
    Compared,
    _option(LOOK, "Colour stands for: what was removed; or before and after for their curvature, edges, ..."),
]
Arrange = Annotated[
    Literal["beside", "wipe", "blink"],
    _option(LOOK, "Beside each other; wipe: one view with a divider; blink: one after the other (.gif, .png)."),
]
At = Annotated[float, _option(LOOK, "Where the divider of a wipe stands, 0 (left) to 1.")]
Azimuth = Annotated[
    float, _option(LOOK, "Where the light comes from, degrees clockwise from north, or the top of the picture.")
]
Altitude = Annotated[float, _option(LOOK, "How high the light stands, degrees; low for raking light.")]
Exaggeration = Annotated[float | None, _option(LOOK, "Factor on heights. Default: one that makes the relief visible.")]
Up = Annotated[Literal["y", "z"] | None, _option(LOOK, "What is up of a mesh. Default: guessed from its shape.")]
Seen = Annotated[
    Literal["front", "side"] | None,
    _option(
        LOOK,
        "front: as a map, an image, through its camera; side: as a surface seen aslant, an image as the heights of its "
        "brightness. Default: terrains side, all else front.",
    ),
]
Colours = Annotated[str | None, _option(LOOK, "A colour map of matplotlib, as cividis or coolwarm.")]
OwnColours = Annotated[bool, _option(LOOK, "Meshes in their own colours or texture.", "--own-colours")]
Size = Annotated[tuple[int, int], _option(LOOK, "Width and height, pixels.")]
Title = Annotated[str | None, _option(LOOK, "A line above it. Default: the name of the file.")]
States = Annotated[int, _option(LOOK, "How many states of the flow are shown, 2 or more.", "--frames")]
Rate = Annotated[float, _option(LOOK, "Frames per second.")]
Turn = Annotated[float, _option(LOOK, "Degrees by which the camera walks around the surface meanwhile.")]
FilmedOption = Annotated[
    Compared | None,
    _option(LOOK, "Colour stands for: what was removed so far, curvature, edges, ... Default: nothing.", "--quantity"),
]
SeenContrast = Annotated[float, _option(LOOK, "Length per unit of the value, for edges.", "--contrast")]
Web = Annotated[
    bool, _option(LOOK, "Serve it to a browser (needs meshflow[web]) instead of opening a window.", "--web")
]
Host = Annotated[str, _option(LOOK, "Address to serve at; beyond this machine a token is asked for.")]
Port = Annotated[int, _option(LOOK, "Port to serve at; 0: any that is free.")]
Browser = Annotated[bool, _option(LOOK, "Open the page.", "--browser/--no-browser")]
Export = Annotated[
    Path | None,
    _option(LOOK, "Write one page that holds all states and opens offline (.html), and end."),
]
SavedAs = Annotated[
    Path | None, _option(LOOK, "Where a state that is chosen is saved. Default: IN_smooth beside IN.", "--save-as")
]
Memory = Annotated[int, _option(LOOK, "Megabytes of states that are kept; others are computed again.")]
