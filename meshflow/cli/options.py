"""The flags that do not belong to a flow: about the input file, the output, and the appearance."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from meshflow.cli.flags import FIRST, Flag, only
from meshflow.io.metadata import Kind, SlicesWord

__all__ = ["ALL", "DRAWING", "FILES", "PLACING", "READING", "flags"]

INPUT, OUTPUT, LOOK = "Input file", "Output", "Appearance"
FILES = (
    "GeoTIFF, COG, stacks of TIFF (--kind volume), .asc, .hgt, .lbl, .dem, whatever GDAL opens; PLY, OBJ, STL, OFF, GLB, VTP, "
    "VTU, VTK, VTM, MSH; organised PCD; CSV (points); PNG, JPEG; NIfTI, NRRD, a folder of DICOM; .npy, .npz; DATA.zarr/VARIABLE."
)
QUANTITIES = Literal["curvature", "edges", "triangles", "samples"]
COMPARED = Literal["removed", "curvature", "edges", "triangles", "samples"]


def _yes(name: str, help: str, panel: str, *words: str) -> Flag:
    return Flag(name, bool, help, panel, False, words or (f"--{name.replace('_', '-')}",))


ALL: tuple[Flag, ...] = (
    # Input file.
    Flag("source", Path, f"{FILES} -: stdin.", default=..., metavar="IN"),
    Flag(
        "target",
        Path,
        "Where to write; the extension names the format. -: stdout, in the format of IN.",
        default=...,
        metavar="OUT",
    ),
    Flag(
        "more",
        list[Path] | None,
        "With --output all that is named is smoothed: files, folders, and patterns such as 'tiles/*.tif'.",
        metavar="MORE",
    ),
    Flag("output", Path | None, "Folder to write to, for several inputs, each under its own name.", OUTPUT),
    _yes(
        "together",
        "With --output: rasters are tiles of one survey, by their georeference: one choice for all, no seams.",
        OUTPUT,
    ),
    _yes("resume", "With --output: leave out what is there already.", OUTPUT),
    Flag("jobs", int, "With --output: how many files at a time, each with its share of the threads.", OUTPUT, 1),
    Flag("every", int, "Coarsening: every so manieth sample of each direction.", OUTPUT, 1),
    Flag("one_method", str | None, "A method: its own options only.", metavar="METHOD"),
    Flag(
        "methods",
        list[str],
        "Methods by name, in any spelling; see meshflow methods.",
        default=...,
        metavar="METHODS...",
    ),
    Flag("other", Path, "Data of the same kind on the same samples.", default=..., metavar="OTHER"),
    Flag("frames_in", list[Path], "Depth images of the same view, two or more.", default=..., metavar="IN..."),
    Flag("kind", Kind | None, "What the file holds, where the guess would be wrong.", FIRST),
    Flag(
        "camera",
        str | None,
        "The camera: IN is a depth image. A name (tum, 7scenes, kinect, primesense, tum-freiburg1 to 3), a JSON (Open3D, or fx, "
        "fy, cx, cy in pixels), or a camera_info YAML of ROS.",
        FIRST,
    ),
    Flag(
        "depth_scale",
        float | None,
        "Units of a depth image per metre; the camera's own, else 1000 (millimetres) for whole numbers.",
        INPUT,
    ),
    Flag(
        "measure",
        Literal["depth", "range"] | None,
        "What the depths are: along the optical axis, or range, along the ray.",
        INPUT,
    ),
    Flag("band", int | None, "Band of a raster, from 1; several are smoothed together otherwise.", INPUT),
    Flag("nodata", float | None, "Value that marks missing samples, where the file does not define it.", INPUT),
    Flag(
        "spacing",
        str | None,
        "Distance of neighbouring samples, DX or DX,DY, of a volume DZ,DY,DX; by default that of the file, metres where it is in "
        "degrees.",
        INPUT,
    ),
    Flag(
        "slices",
        SlicesWord | None,
        "Of a Zarr variable with a further dimension, such as time: each slice by its own choice, or all alike.",
        INPUT,
    ),
    Flag(
        "window",
        tuple[int, int, int, int] | None,
        "The part of a raster to read: COLUMN ROW WIDTH HEIGHT, in samples, as -srcwin of gdal_translate. What is left out does "
        "not count.",
        INPUT,
    ),
    Flag(
        "bounds",
        tuple[float, float, float, float] | None,
        "The part of a raster to read: LEFT BOTTOM RIGHT TOP in its CRS.",
        INPUT,
    ),
    Flag(
        "crs", str | None, "The CRS of a raster, such as EPSG:25832, in place of its own; it is not reprojected.", INPUT
    ),
    Flag(
        "unit",
        str | None,
        "The unit of heights, such as m or ft, in place of that of the file.",
        INPUT,
        None,
        ("--z-unit",),
    ),
    Flag(
        "channels",
        str | None,
        "Vertex attribute of a mesh, or columns of a table, to smooth: name, or 'colors'.",
        INPUT,
    ),
    Flag("max_edge", float | None, "Table of points: the longest edge of a triangle between them.", INPUT),
    Flag(
        "moves",
        Literal["points", "channels", "all"] | None,
        "What moves of a mesh with --channels. Default: channels.",
        INPUT,
    ),
    Flag(
        "time_unit",
        Literal["footprint", "length", "noise"] | None,
        "Unit of time of a range image: squared pixel footprints, squared length (metres²), or "
        "footprints in proportion to the noise of each sample.",
        INPUT,
    ),
    Flag(
        "viewpoint",
        tuple[float, float, float] | None,
        "Position x y z of the scanner of a range grid, in the frame of its points, which move along the rays from there. "
        "Default: the position in the file, else the points move along z.",
        INPUT,
    ),
    Flag(
        "allow_remote",
        bool | None,
        "A file may name others outside its folder, and in a network (VRT, VTM, glTF): only if you trust it.",
        INPUT,
        None,
        ("--allow-remote",),
    ),
    Flag("truth", Path | None, "True depths of the same pixels, seen by the same camera.", INPUT),
    Flag(
        "known",
        Path | None,
        "True values of the same samples, for the errors.",
        INPUT,
        None,
        ("--truth",),
    ),
    Flag("sigma", float | None, "Standard deviation of the noise. Default: estimated.", INPUT, None, ("--noise",)),
    Flag("share", float, "Share of the noise that each method removes, up to 1.", INPUT, 0.9, ("--share",)),
    Flag("truth_scale", float | None, "Units of the truth per metre, as --depth-scale of IN.", INPUT),
    Flag(
        "flow_time",
        float,
        "Time of the ray flow, in squared pixel footprints; the others stop when they are equally smooth.",
        INPUT,
        5.0,
        ("--time",),
    ),
    Flag(
        "rim",
        Literal["neumann", "plane-preserving", "fixed"],
        "The condition at borders and holes, the same for all flows.",
        INPUT,
        "plane-preserving",
        ("--boundary",),
    ),
    Flag(
        "jump",
        float,
        "A triangle is left out where its depths differ by more than this share of the nearest.",
        INPUT,
        0.05,
    ),
    # Output.
    Flag("fused", Path, "Where to write the result.", OUTPUT, ..., ("--out", "--output", "-o")),
    Flag("picture", Path | None, "Write a picture of before, after and what was removed (.png).", FIRST),
    Flag(
        "report",
        Path | None,
        "Write a report: before, after, removed, parameters and their reasons, risk (.html or .png).",
        FIRST,
    ),
    Flag("dtype", str | None, "Number type of a raster or picture; 'source' rounds back to whole numbers.", OUTPUT),
    Flag(
        "driver",
        str | None,
        "Driver of GDAL that writes a raster, such as COG. Default: that of the extension: .tif .asc .img .nc .gpkg .bil.",
        OUTPUT,
        None,
        ("--of",),
    ),
    Flag(
        "creation",
        list[str] | None,
        "Creation option of that driver, NAME=VALUE, such as COMPRESS=ZSTD; may be given several times.",
        OUTPUT,
        None,
        ("--co",),
    ),
    Flag("removed", Path | None, "Second raster to write: what was removed, IN minus OUT.", OUTPUT),
    Flag(
        "uncertainty",
        Path | None,
        "Raster to write with the expected error of each sample, a standard deviation: from 8 more runs on the result with noise "
        "of the estimated kind added.",
        OUTPUT,
    ),
    Flag(
        "most_memory",
        str | None,
        "Memory that the command may take, such as 2GB: what does not fit is smoothed by windows: noise and method are found on "
        "a sample of it, and similar patches are not grouped. Default: half of what is free.",
        OUTPUT,
        None,
        ("--memory",),
    ),
    _yes("overwrite", "Replace OUT if it is there.", FIRST),
    _yes("quiet", "Print errors only.", OUTPUT, "--quiet", "-q"),
    _yes(
        "verbose",
        "Print every parameter with its origin, and its unit where the data defines one.",
        OUTPUT,
        "--verbose",
        "-v",
    ),
    _yes("json", "Print JSON to stdout.", OUTPUT),
    _yes("markdown", "Print a table in Markdown.", OUTPUT),
    _yes("environment", "Print versions, threads and instruction set, for bug reports; without IN.", OUTPUT),
    # Appearance.
    Flag("shown", Path | None, "Where to draw (.png, .jpg, .tif). Default: a window.", metavar="PICTURE"),
    Flag("filmed", Path, "Where to write: .mp4 (needs meshflow[film]) or .gif.", default=..., metavar="FILM"),
    _yes("on_screen", "Open a window; needs a display.", LOOK, "--window"),
    Flag(
        "quantity",
        QUANTITIES | None,
        "What colour shows: mean curvature, edges (the edge indicator 1/W), quality of triangles, or samples (which are fixed "
        "or missing).",
        LOOK,
    ),
    Flag(
        "arrange",
        Literal["beside", "wipe", "blink"],
        "beside: side by side; wipe: one view with a divider; blink: one after the other (.gif, .png).",
        LOOK,
        "beside",
    ),
    Flag("at", float, "Position of the divider of a wipe, 0 (left) to 1.", LOOK, 0.5),
    Flag("seen_contrast", float, "Length per unit of the value, for --quantity edges.", LOOK, 1.0, ("--contrast",)),
    Flag(
        "azimuth",
        float,
        "Direction of the light, degrees clockwise from north or from the top of the picture.",
        LOOK,
        315.0,
    ),
    Flag("altitude", float, "Height of the light, degrees; low values give raking light.", LOOK, 30.0),
    Flag("exaggeration", float | None, "Factor on heights. Default: one that makes the relief visible.", LOOK),
    Flag("up", Literal["y", "z"] | None, "The axis of a mesh that points up. Default: guessed from its shape.", LOOK),
    Flag(
        "seen",
        Literal["front", "side"] | None,
        "front: as a map, a picture, or through the camera; side: as a surface seen obliquely, an image as heights of its "
        "brightness. Default: side for terrains, front for all else.",
        LOOK,
    ),
    Flag("colours", str | None, "A colour map of matplotlib, such as cividis or coolwarm.", LOOK),
    _yes("own_colours", "Draw meshes in their own colours or texture.", LOOK),
    Flag("size", tuple[int, int], "Width and height, pixels.", LOOK, (1600, 1200)),
    Flag("title", str | None, "The title. Default: the name of the file.", LOOK),
    Flag("frames", int, "Number of states of the flow, 2 or more.", LOOK, 48),
    Flag("rate", float, "Frames per second.", LOOK, 12.0),
    Flag("turn", float, "Degrees by which the camera moves around the surface during the film.", LOOK, 0.0),
    _yes("web", "Serve a page to a browser (needs meshflow[web]) instead of opening a window.", LOOK),
    Flag("host", str, "Address to serve at; the printed URL contains a token.", LOOK, "127.0.0.1"),
    Flag("port", int, "Port to serve at; 0: any free port.", LOOK, 0),
    Flag("browser", bool, "Open the page in a browser.", LOOK, True, ("--browser/--no-browser",)),
    Flag("export", Path | None, "Write one page with all states that opens offline (.html), and exit.", LOOK),
    Flag(
        "saved_as",
        Path | None,
        "Where to save a chosen state. Default: IN_smooth beside IN.",
        LOOK,
        None,
        ("--save-as",),
    ),
    Flag("memory", int, "Megabytes of states to keep in memory; others are computed again.", LOOK, 1024),
)
READING = (
    "kind", "camera", "depth_scale", "measure", "band", "nodata", "spacing", "channels", "max_edge", "viewpoint", "allow_remote",
)  # fmt: skip
# What of a raster is read, and where it lies.
PLACING = ("window", "bounds", "crs", "unit")
DRAWING = ("azimuth", "altitude", "exaggeration", "up", "seen", "colours", "own_colours", "size", "title")


def flags(*names: str, **defaults: Any) -> tuple[Flag, ...]:
    """The flags of these names, in this order.

    :param defaults: those that differ in this command.
    """
    return tuple(
        replace(flag, default=defaults[flag.name]) if flag.name in defaults else flag for flag in only(ALL, *names)
    )
