"""The commands that look: ``meshflow compare | show | film | compare-flows``."""

import json as notation
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.text import Text

from meshflow.cli import options as words
from meshflow.cli.console import out, said, table
from meshflow.cli.inputs import INPUTS, opened, per_sample
from meshflow.errors import InputError
from meshflow.evaluate.flows import compare_flows as compared
from meshflow.evaluate.metrics import compare as measured
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_free
from meshflow.io.files import Document
from meshflow.surfaces.lift import Mesh, RangeImage
from meshflow.view import compare as draw_pair
from meshflow.view import show as draw_one
from meshflow.view.attributes import Riding, riding
from meshflow.view.film import filmable
from meshflow.view.panels import flows as draw_flows
from meshflow.view.pictures import writable as drawable
from meshflow.viewer.controls import Address
from meshflow.viewer.filming import film as filmed
from meshflow.viewer.session import Saving
from meshflow.viewer.session import view as viewed

__all__ = ["compare", "compare_flows", "film", "must_be_drawable", "pictured", "show", "view"]


# How a film's flow may be told.
FLOW = ("time", "scale", "steps", "strength", "method", "gamma", "sharpness", "patch", "contrast", "search", "keep")
# What a file is, as every command that reads one may be told.
READ = tuple(name for name in INPUTS if name not in ("moves", "pace"))


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
    viewpoint: words.Viewpoint = None,
    picture: words.Picture = None,
    window: words.Window = False,
    quantity: words.ComparedOption = "removed",
    arrange: words.Arrange = "beside",
    at: words.At = 0.5,
    contrast: words.SeenContrast = 1.0,
    azimuth: words.Azimuth = 315.0,
    altitude: words.Altitude = 30.0,
    exaggeration: words.Exaggeration = None,
    up: words.Up = None,
    seen: words.Seen = None,
    colours: words.Colours = None,
    own_colours: words.OwnColours = False,
    size: words.Size = (1600, 1200),
    title: words.Title = None,
    overwrite: words.Overwrite = False,
    json: words.Json = False,
) -> None:
    """Compare IN with OTHER: differences, normals, area, volume; and draw them, as a picture or in a window."""
    _compared(**locals())


def _compared(
    one: Path,
    other: Path,
    picture: Path | None,
    window: bool,
    title: str | None,
    overwrite: bool,
    json: bool,
    **given: Any,
) -> None:
    """The command ``compare``, with its options by name."""
    if picture is not None:
        must_be_free(picture, overwrite)
    reading = {name: given.pop(name) for name in READ}
    first, second = (opened(path, **reading) for path in (one, other))
    if first.kind != second.kind and {first.kind, second.kind} <= {"image", "terrain"}:
        what = f"compare: two things of one kind expected, got {first.kind} and {second.kind}"
        raise InputError(f"{what}; give --camera if they are depth images, or --kind")
    facts = {"in": str(one), "other": str(other), **measured(first.noun, second.noun).words()}
    notes = first.notes + second.notes
    ridden = _ridden(first, second)
    if ridden is not None:
        facts[f"rms difference of {ridden.name}"] = ridden.rms
        notes += (ridden.told,)
    for path in (*((picture,) if picture is not None else ()), *((None,) if window else ())):
        told = draw_pair(
            first, second, path, title=_titled(title, f"{one.name} and {other.name}"), overwrite=overwrite, **given
        ).notes
        notes += (*(note for note in told if note not in notes), *(() if path is None else (f"picture: {path}",)))
    table(facts, json, notes)


def _ridden(first: Document, second: Document) -> Riding | None:
    """In which attribute two meshes differ whose points do not."""
    one, other = first.noun, second.noun
    return riding(first, second, one, other) if isinstance(one, Mesh) and isinstance(other, Mesh) else None


def show(
    source: words.In,
    picture: words.Shown = None,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    viewpoint: words.Viewpoint = None,
    fixed: words.FixedMask = None,
    quantity: words.QuantityOption = None,
    contrast: words.SeenContrast = 1.0,
    azimuth: words.Azimuth = 315.0,
    altitude: words.Altitude = 30.0,
    exaggeration: words.Exaggeration = None,
    up: words.Up = None,
    seen: words.Seen = None,
    colours: words.Colours = None,
    own_colours: words.OwnColours = False,
    size: words.Size = (1600, 1200),
    title: words.Title = None,
    overwrite: words.Overwrite = False,
    quiet: words.Quiet = False,
) -> None:
    """Show IN, plain or in the colours of its curvature, edges, triangles or samples, as a picture or in a window."""
    _shown(**locals())


def _shown(
    source: Path,
    picture: Path | None,
    fixed: str | None,
    title: str | None,
    overwrite: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """The command ``show``, with its options by name."""
    must_be_drawable(picture, overwrite)
    document = opened(source, **{name: given.pop(name) for name in READ})
    if fixed is not None:
        document = document.holding(replace(document.noun, fixed=per_sample(document, "fixed", fixed)))
    told = draw_one(document, picture, title=_titled(title, source.name), overwrite=overwrite, **given)
    notes = (*told.notes, *(() if picture is None else (f"picture: {picture}",)))
    said("", () if quiet else notes)


def film(
    source: words.In,
    target: words.Film,
    time: words.Time = None,
    scale: words.Scale = None,
    steps: words.Steps = None,
    strength: words.Strength = 1.0,
    method: words.MethodOption = None,
    gamma: words.Gamma = None,
    sharpness: words.Sharpness = None,
    patch: words.Patch = None,
    contrast: words.Contrast = None,
    search: words.Search = None,
    keep: words.KeepOption = None,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    viewpoint: words.Viewpoint = None,
    frames: words.States = 48,
    rate: words.Rate = 12.0,
    turn: words.Turn = 0.0,
    quantity: words.FilmedOption = None,
    azimuth: words.Azimuth = 315.0,
    altitude: words.Altitude = 30.0,
    exaggeration: words.Exaggeration = None,
    up: words.Up = None,
    seen: words.Seen = None,
    colours: words.Colours = None,
    own_colours: words.OwnColours = False,
    size: words.Size = (960, 720),
    title: words.Title = None,
    overwrite: words.Overwrite = False,
    quiet: words.Quiet = False,
) -> None:
    """Film IN while it is smoothed, to FILM: .mp4 or .gif; what is not given is estimated, as in smooth."""
    _filmed(**locals())


def _filmed(
    source: Path, target: Path, frames: int, title: str | None, overwrite: bool, quiet: bool, **given: Any
) -> None:
    """The command ``film``, with its options by name."""
    filmable(target, overwrite)
    document = opened(source, **{name: given.pop(name) for name in READ})
    settings = {name: given.pop(name) for name in FLOW}
    told = filmed(
        document,
        target,
        count=frames,
        overwrite=overwrite,
        settings=settings,
        progress=None if quiet else True,
        title=_titled(title, source.name),
        **given,
    )
    said("", () if quiet else (*told.notes, f"film: {target}"))


def view(
    source: words.In,
    target: words.SavedAs = None,
    web: words.Web = False,
    host: words.Host = "127.0.0.1",
    port: words.Port = 0,
    browser: words.Browser = True,
    export: words.Export = None,
    time: words.Time = None,
    scale: words.Scale = None,
    strength: words.Strength = 1.0,
    method: words.MethodOption = None,
    gamma: words.Gamma = None,
    sharpness: words.Sharpness = None,
    patch: words.Patch = None,
    contrast: words.Contrast = None,
    search: words.Search = None,
    keep: words.KeepOption = None,
    kind: words.KindOption = None,
    camera: words.Camera = None,
    depth_scale: words.DepthScale = None,
    measure: words.MeasureOption = None,
    band: words.Band = None,
    nodata: words.Nodata = None,
    spacing: words.Spacing = None,
    channels: words.Channels = None,
    viewpoint: words.Viewpoint = None,
    frames: words.States = 32,
    memory: words.Memory = 1024,
    azimuth: words.Azimuth = 315.0,
    altitude: words.Altitude = 30.0,
    exaggeration: words.Exaggeration = None,
    up: words.Up = None,
    seen: words.Seen = None,
    colours: words.Colours = None,
    own_colours: words.OwnColours = False,
    size: words.Size = (1280, 900),
    title: words.Title = None,
    overwrite: words.Overwrite = False,
    quiet: words.Quiet = False,
) -> None:
    """View IN through the time of its flow: a slider over its states, knobs for what can be turned, in a window or a browser."""
    _viewed(**locals())


def _viewed(
    source: Path,
    target: Path | None,
    web: bool,
    export: Path | None,
    title: str | None,
    overwrite: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """The command ``view``, with its options by name."""
    reading = {name: given.pop(name) for name in READ}
    document = opened(source, **reading)
    target = source.with_name(f"{source.stem}_smooth{source.suffix}") if target is None else target
    settings = {name: given.pop(name) for name in FLOW if name in given}
    address = Address(given.pop("host"), given.pop("port"), given.pop("browser"))
    told = viewed(
        document,
        way="page" if export is not None else "browser" if web else "window",
        page=export,
        overwrite=overwrite,
        address=address,
        saving=Saving(str(source), target, overwrite, _spoken(reading)),
        count=given.pop("frames"),
        memory=given.pop("memory") << 20,
        settings=settings,
        progress=None if quiet else True,
        said=lambda sentence: said(sentence, ()),
        title=_titled(title, source.name),
        **given,
    )
    said("", () if quiet else told)


def _spoken(reading: dict[str, Any]) -> tuple[str, ...]:
    """The options with which a file was read, as words of a command line."""
    found: list[str] = []
    for name, value in reading.items():
        if value is not None:
            found += [f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, tuple) else (value,))]
    return tuple(found)


def _titled(title: str | None, default: str) -> str:
    return default if title is None else title


def compare_flows(
    source: words.Depths,
    camera: words.Camera = None,
    truth: words.Truth = None,
    depth_scale: words.DepthScale = None,
    truth_scale: words.TruthScale = None,
    jump: words.Jump = 0.05,
    time: words.FlowTime = 5.0,
    boundary: words.RimOption = "linear",
    picture: words.Panels = None,
    overwrite: words.Overwrite = False,
    json: words.Json = False,
) -> None:
    """Compare 3D flow, flow along normals, graph flow of z and ray flow on a depth image, at matched smoothing."""
    must_be_drawable(picture, overwrite)
    depths, cam, notes = _depths(source, camera, depth_scale)
    true, more = None, ()
    if truth is not None:
        true, _, more = _depths(truth, camera, truth_scale)
    found = compared(depths, cam, true, time=time, jump=jump, boundary=boundary)
    notes += more
    if picture is not None:
        title = f"{source.name}: four flows, each until it is as smooth as the ray flow"
        notes += (*draw_flows(found.panels(), picture, title=title, overwrite=overwrite).notes, f"picture: {picture}")
    if json:
        out.print_json(notation.dumps({"in": str(source), **found.as_dict(), "notes": list(notes)}))
        return
    out.print(Text(str(found)), soft_wrap=True)
    said("", notes)


def _depths(path: Path, camera: str | None, depth_scale: float | None) -> tuple[Array, Any, tuple[str, ...]]:
    """Depths, NaN where missing, their camera, and what was said of them.

    :raises InputError: for what is no range image.
    """
    if camera is None:
        raise InputError("compare-flows: rays are those of a camera; give --camera")
    document = opened(path, "depth", camera, depth_scale, None, None, None, None, None)
    noun = document.noun
    assert isinstance(noun, RangeImage)
    return np.where(np.asarray(noun.missing), np.nan, noun.depth), noun.camera, document.notes


def must_be_drawable(picture: Path | None, overwrite: bool) -> None:
    """Refuse a picture that cannot be written, or is there."""
    if picture is not None:
        drawable(picture, overwrite=overwrite)


def pictured(before: Document, after: Document, path: Path, title: str, overwrite: bool) -> tuple[str, ...]:
    """Draw before and after; what is to be said of it."""
    return (*draw_pair(before.noun, after.noun, path, title=title, overwrite=overwrite).notes, f"picture: {path}")
