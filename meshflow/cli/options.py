"""The flags that do not belong to a flow: about the input file, the output, and the appearance."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from meshflow.cli.flags import FIRST, Flag, only
from meshflow.io.metadata import Kind, SlicesWord

__all__ = ["ALL", "DRAWING", "FILES", "PLACING", "READING", "flags"]

INPUT, OUTPUT, LOOK = "Input file", "Output", "Appearance"
FILES = (
    "Raster (GeoTIFF, COG, .asc, .hgt, .lbl, .dem, and others of GDAL), mesh (PLY, OBJ, STL, OFF, GLB, VTP, VTU, VTK, "
    "VTM, MSH), organised point cloud (PCD), table of points (CSV), image (PNG, JPEG), volume (NIfTI, NRRD, a folder of DICOM, a "
    "TIFF stack with --kind volume), array (.npy, .npz), or DATA.zarr/VARIABLE."
)
QUANTITIES = Literal["curvature", "edges", "triangles", "samples"]
COMPARED = Literal["removed", "curvature", "edges", "triangles", "samples"]


def _yes(name: str, help: str, panel: str, *words: str) -> Flag:
    return Flag(name, bool, help, panel, False, words or (f"--{name.replace('_', '-')}",))


ALL: tuple[Flag, ...] = (
    # Input file.
    Flag("source", Path, f"{FILES} A dash (-) reads stdin.", default=..., metavar="IN"),
    Flag(
        "target",
        Path,
        "Output file. The extension selects the format. A dash (-) writes to stdout in the format of IN.",
        default=...,
        metavar="OUT",
    ),
    Flag(
        "more",
        list[Path] | None,
        "More inputs, with --output: files, folders, and patterns such as 'tiles/*.tif'.",
        metavar="MORE",
    ),
    Flag("output", Path | None, "Output folder for several inputs. Each file keeps its name.", OUTPUT),
    _yes(
        "together",
        "With --output: the rasters are tiles of one survey. They are smoothed with the same parameters and without "
        "seams.",
        OUTPUT,
    ),
    _yes(
        "resume",
        "With --output: skip files that exist in the output folder. With --together, those that were made of the same "
        "tiles with the same options; others are written again.",
        OUTPUT,
    ),
    Flag("jobs", int, "With --output: number of files processed at the same time. They share the threads.", OUTPUT, 1),
    Flag("every", int, "Coarsening: keep every n-th row and column.", OUTPUT, 1),
    Flag("one_method", str | None, "Print the options of this method only.", metavar="METHOD"),
    Flag(
        "methods",
        list[str],
        "Names of methods, as listed by meshflow methods.",
        default=...,
        metavar="METHODS...",
    ),
    Flag("other", Path, "Data of the same kind, on the same samples.", default=..., metavar="OTHER"),
    Flag("frames_in", list[Path], "Two or more depth images of the same view.", default=..., metavar="IN..."),
    Flag("kind", Kind | None, "Kind of data in the file. Default: guessed from the file.", FIRST),
    Flag(
        "camera",
        str | None,
        "Camera of the depth image IN: a name (tum, 7scenes, kinect, primesense, tum-freiburg1 to 3), a JSON file (of "
        "Open3D, or with fx, fy, cx, cy in pixels), or a camera_info YAML file of ROS.",
        FIRST,
    ),
    Flag(
        "depth_scale",
        float | None,
        "Units of a depth image per metre. Default: that of the camera, else 1000 (millimetres) for whole numbers.",
        INPUT,
    ),
    Flag(
        "measure",
        Literal["depth", "range"] | None,
        "What depths measure: depth is the distance along the optical axis, range the distance along the ray.",
        INPUT,
    ),
    Flag("band", int | None, "Band of a raster, counted from 1. Default: all bands, smoothed together.", INPUT),
    Flag("nodata", float | None, "Value of missing samples, if the file does not declare it.", INPUT),
    Flag(
        "spacing",
        str | None,
        "Distance between neighbouring samples: D or DX,DY; for a volume DZ,DY,DX. Default: that of the file, converted "
        "to metres for a raster in degrees.",
        INPUT,
    ),
    Flag(
        "slices",
        SlicesWord | None,
        "For a Zarr variable with a further dimension such as time: each finds parameters for each slice, alike uses "
        "the same for all.",
        INPUT,
    ),
    Flag(
        "window",
        tuple[int, int, int, int] | None,
        "Part of the raster to read: COLUMN ROW WIDTH HEIGHT in samples, as in -srcwin of gdal_translate. The rest is "
        "ignored.",
        INPUT,
    ),
    Flag(
        "bounds",
        tuple[float, float, float, float] | None,
        "Part of the raster to read: LEFT BOTTOM RIGHT TOP in its CRS.",
        INPUT,
    ),
    Flag(
        "crs",
        str | None,
        "CRS of the raster, such as EPSG:25832. It replaces that of the file; nothing is reprojected.",
        INPUT,
    ),
    Flag(
        "unit",
        str | None,
        "Unit of the heights, such as m or ft. It replaces that of the file.",
        INPUT,
        None,
        ("--z-unit",),
    ),
    Flag(
        "channels",
        str | None,
        "What to smooth: a vertex attribute of a mesh ('colors' for its colours), or columns of a table.",
        INPUT,
    ),
    Flag("max_edge", float | None, "For a table of points: the longest edge of a triangle between them.", INPUT),
    Flag(
        "moves",
        Literal["points", "channels", "all"] | None,
        "What moves in a mesh with --channels. Default: channels.",
        INPUT,
    ),
    Flag(
        "time_unit",
        Literal["footprint", "length", "noise"] | None,
        "Unit of time for a range image: squared pixel footprints, squared length (metres²), or footprints in "
        "proportion to the noise of each sample.",
        INPUT,
    ),
    Flag(
        "viewpoint",
        tuple[float, float, float] | None,
        "Position x y z of the scanner of a range grid, in the coordinates of its points. The points move along the "
        "rays from there. Default: the position in the file; without one, points move along z.",
        INPUT,
    ),
    Flag(
        "allow_remote",
        bool | None,
        "Let a file refer to files outside its folder or on the network (VRT, VTM, glTF). Use it only for files that "
        "you trust.",
        INPUT,
        None,
        ("--allow-remote",),
    ),
    Flag("truth", Path | None, "True depths of the same pixels, from the same camera.", INPUT),
    Flag(
        "known",
        Path | None,
        "True values of the same samples, to measure errors.",
        INPUT,
        None,
        ("--truth",),
    ),
    Flag("sigma", float | None, "Standard deviation of the noise. Default: estimated.", INPUT, None, ("--noise",)),
    Flag("share", float, "Share of the noise that each method is to remove, at most 1.", INPUT, 0.9, ("--share",)),
    Flag("truth_scale", float | None, "Units of the truth per metre, like --depth-scale for IN.", INPUT),
    Flag(
        "flow_time",
        float,
        "Time of the ray flow, in squared pixel footprints. The other flows stop when they are equally smooth.",
        INPUT,
        5.0,
        ("--time",),
    ),
    Flag(
        "rim",
        Literal["neumann", "plane-preserving", "fixed"],
        "Boundary condition at borders and holes, the same for all flows.",
        INPUT,
        "plane-preserving",
        ("--boundary",),
    ),
    Flag(
        "jump",
        float,
        "Triangles are left out if their depths differ by more than this share of the smallest.",
        INPUT,
        0.05,
    ),
    # Output.
    Flag("fused", Path, "Output file.", OUTPUT, ..., ("--out", "--output", "-o")),
    Flag("picture", Path | None, "Write a picture of before, after and what was removed (.png).", FIRST),
    Flag(
        "report",
        Path | None,
        "Write a report (.html or .png): before, after, what was removed, the parameters with their reasons, and the "
        "estimated errors.",
        FIRST,
    ),
    Flag(
        "dtype",
        str | None,
        "Number type of the output raster or picture. 'source' rounds back to whole numbers.",
        OUTPUT,
    ),
    Flag(
        "driver",
        str | None,
        "GDAL driver that writes the raster, such as COG. Default: by the extension (.tif .asc .img .nc .gpkg .bil).",
        OUTPUT,
        None,
        ("--of",),
    ),
    Flag(
        "creation",
        list[str] | None,
        "Creation option of the driver, NAME=VALUE, such as COMPRESS=ZSTD. May be given several times.",
        OUTPUT,
        None,
        ("--co",),
    ),
    Flag("removed", Path | None, "Also write what was removed, IN minus OUT, to this raster.", OUTPUT),
    Flag(
        "uncertainty",
        Path | None,
        "Also write the expected error (standard deviation) of each sample to this raster. It takes 8 more runs, on the "
        "result with noise of the estimated kind added.",
        OUTPUT,
    ),
    Flag(
        "most_memory",
        str | None,
        "Memory limit, such as 2GB. Larger data is smoothed in windows; noise and method are then found on a part of "
        "the data. Default: half of the free memory.",
        OUTPUT,
        None,
        ("--memory",),
    ),
    _yes("overwrite", "Replace OUT if it exists.", FIRST),
    _yes("quiet", "Print errors only.", OUTPUT, "--quiet", "-q"),
    _yes(
        "verbose",
        "Print every parameter with its unit and its origin.",
        OUTPUT,
        "--verbose",
        "-v",
    ),
    _yes("json", "Print JSON to stdout.", OUTPUT),
    _yes("markdown", "Print a table in Markdown.", OUTPUT),
    _yes("environment", "Print versions, threads and instruction set, for bug reports. IN is not needed.", OUTPUT),
    # Appearance.
    Flag("shown", Path | None, "Output picture (.png, .jpg, .tif). Default: open a window.", metavar="PICTURE"),
    Flag("filmed", Path, "Output film: .mp4 (needs meshflow\\[film]) or .gif.", default=..., metavar="FILM"),
    _yes("on_screen", "Open a window. Needs a display.", LOOK, "--window"),
    Flag(
        "quantity",
        QUANTITIES | None,
        "What the colours show: mean curvature, edges (the edge indicator 1/W), quality of the triangles, or samples "
        "(which are fixed or missing).",
        LOOK,
    ),
    Flag(
        "arrange",
        Literal["beside", "wipe", "blink"],
        "beside: side by side; wipe: one view with a divider; blink: one after the other (.gif, .png).",
        LOOK,
        "beside",
    ),
    Flag("at", float, "Position of the divider with --arrange wipe, from 0 (left) to 1 (right).", LOOK, 0.5),
    Flag("seen_contrast", float, "Length per unit of the value, for --quantity edges.", LOOK, 1.0, ("--contrast",)),
    Flag(
        "azimuth",
        float,
        "Direction of the light in degrees, clockwise from north or from the top of the picture.",
        LOOK,
        315.0,
    ),
    Flag("altitude", float, "Height of the light in degrees. Small values give raking light.", LOOK, 30.0),
    Flag("exaggeration", float | None, "Vertical exaggeration. Default: chosen so that the relief is visible.", LOOK),
    Flag("up", Literal["y", "z"] | None, "Axis of a mesh that points up. Default: guessed from its shape.", LOOK),
    Flag(
        "seen",
        Literal["front", "side"] | None,
        "front: as a map, a picture, or through the camera. side: as a surface in oblique view; an image becomes a "
        "relief of its brightness. Default: side for terrains, front for all else.",
        LOOK,
    ),
    Flag("colours", str | None, "Colour map of matplotlib, such as cividis or coolwarm.", LOOK),
    _yes("own_colours", "Draw meshes in their own colours or texture.", LOOK),
    Flag("size", tuple[int, int], "Width and height in pixels.", LOOK, (1600, 1200)),
    Flag("title", str | None, "Title. Default: the name of the file.", LOOK),
    Flag("frames", int, "Number of states of the flow, at least 2.", LOOK, 48),
    Flag("rate", float, "Frames per second.", LOOK, 12.0),
    Flag("turn", float, "Degrees by which the camera moves around the surface.", LOOK, 0.0),
    _yes("web", "Serve a page to a browser instead of opening a window. Needs meshflow\\[web].", LOOK),
    Flag("host", str, "Address to serve at. The printed URL contains a token.", LOOK, "127.0.0.1"),
    Flag("port", int, "Port to serve at. 0: any free port.", LOOK, 0),
    Flag("browser", bool, "Open the page in a browser.", LOOK, True, ("--browser/--no-browser",)),
    Flag("export", Path | None, "Write a page (.html) with all states that opens offline, and exit.", LOOK),
    Flag(
        "saved_as",
        Path | None,
        "Output file for a saved state. Default: IN_smooth beside IN.",
        LOOK,
        None,
        ("--save-as",),
    ),
    Flag("memory", int, "Memory for states in megabytes. States that do not fit are computed again.", LOOK, 1024),
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
