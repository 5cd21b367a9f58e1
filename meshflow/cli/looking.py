"""The commands that draw: ``meshflow compare | show | film | view | compare-flows``."""

import json as notation
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.text import Text

from meshflow.cli.asking import asked
from meshflow.cli.console import listed, out, said, table
from meshflow.cli.flags import FLOW, Given, command, only
from meshflow.cli.inputs import opened, per_sample, plain_sample
from meshflow.cli.options import COMPARED, DRAWING, PLACING, READING, flags
from meshflow.comparing import compare_methods as methods_compared
from meshflow.errors import InputError
from meshflow.evaluate.flows import compare_flows as compared
from meshflow.evaluate.metrics import compare as measured
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import must_be_free
from meshflow.io.files import Document
from meshflow.surfaces.data import array_of
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import compare as draw_pair
from meshflow.view import show as draw_one
from meshflow.view.attributes import AttributeChange, attribute_change
from meshflow.view.film import filmable
from meshflow.view.panels import flows as draw_flows
from meshflow.view.pictures import writable as drawable
from meshflow.viewer.controls import Address, Page, States
from meshflow.viewer.filming import film as filmed
from meshflow.viewer.session import Saving
from meshflow.viewer.session import view as viewed

__all__ = [
    "add_to",
    "compare",
    "compare_flows",
    "compare_methods",
    "film",
    "must_be_drawable",
    "pictured",
    "show",
    "view",
]

COMPARING = "What the colours show: what was removed; or curvature, edges, triangles or samples, before and after."
FILMING = "What the colours show: what was removed so far, or curvature, edges, triangles or samples. Default: nothing."


# The flags that describe the flow of a film.
FILMED = (
    "time", "scale", "strength", "noise", "method", "gamma", "sharpness", "patch", "contrast", "order", "weights", "search",
    "preserve",
)  # fmt: skip


def compare(given: Given) -> None:
    """Compare IN with OTHER: differences, normals, area, volume. Draw both as a picture or in a window."""
    one, other, picture, overwrite = given["source"], given["other"], given["picture"], given["overwrite"]
    if picture is not None:
        must_be_free(picture, overwrite)
    first, second = (opened(path, _some(given, READING)) for path in (one, other))
    if first.kind != second.kind and {first.kind, second.kind} <= {"image", "terrain"}:
        what = f"compare: data of one kind expected, got {first.kind} and {second.kind}"
        raise InputError(f"{what}; give --camera if they are depth images, or --kind")
    facts = {"in": str(one), "other": str(other), **measured(first.data, second.data).words()}
    notes = first.notes + second.notes
    attribute = _attribute_change(first, second)
    if attribute is not None:
        facts[f"rms difference of {attribute.name}"] = attribute.rms
        notes += (attribute.reported,)
    look = {**_some(given, DRAWING), "title": _titled(given["title"], f"{one.name} and {other.name}")}
    how = {**_some(given, ("quantity", "arrange", "at")), "contrast": given["seen_contrast"]}
    for path in (*((picture,) if picture is not None else ()), *((None,) if given["on_screen"] else ())):
        written = draw_pair(first, second, path, overwrite=overwrite, **how, **look).notes
        notes += (*(note for note in written if note not in notes), *(() if path is None else (f"picture: {path}",)))
    table(facts, given["json"], notes)


def _some(given: Given, names: tuple[str, ...]) -> Given:
    return {name: given[name] for name in names}


def _attribute_change(first: Document, second: Document) -> AttributeChange | None:
    """The vertex attribute in which two meshes with identical points differ."""
    one, other = first.data, second.data
    return attribute_change(first, second, one, other) if isinstance(one, Mesh) and isinstance(other, Mesh) else None


def show(given: Given) -> None:
    """Draw IN as a picture or in a window, plain or coloured by curvature, edges, triangles or samples."""
    source, picture, overwrite = given["source"], given["shown"], given["overwrite"]
    must_be_drawable(picture, overwrite)
    document = opened(source, _some(given, (*READING, *PLACING)))
    if given["fixed"] is not None:
        fixed = document.samples(per_sample(document, "fixed", given["fixed"]), "fixed")
        document = document.holding(replace(document.data, fixed=fixed))
    look = {**_some(given, DRAWING), "title": _titled(given["title"], source.name)}
    how = {"quantity": given["quantity"], "contrast": given["seen_contrast"]}
    written = draw_one(document, picture, overwrite=overwrite, **how, **look)
    notes = (*written.notes, *(() if picture is None else (f"picture: {picture}",)))
    said("", () if given["quiet"] else notes)


def film(given: Given) -> None:
    """Write a film (.mp4 or .gif) of IN while it is smoothed. Options that you do not give are found as in smooth."""
    source, target, overwrite, quiet = given["source"], given["filmed"], given["overwrite"], given["quiet"]
    filmable(target, overwrite)
    document = opened(source, _some(given, READING))
    request = asked(given, plain_sample)
    look = {**_some(given, DRAWING), "title": _titled(given["title"], source.name)}
    how = {**_some(given, ("rate", "turn", "quantity")), "count": given["frames"]}
    written = filmed(
        document, target, request=request, overwrite=overwrite, progress=None if quiet else True, **how, **look
    )
    said("", () if quiet else (*written.notes, f"film: {target}"))


def view(given: Given) -> None:
    """View the flow of IN over time, in a window or a browser, with a slider over time and controls for the method."""
    source, export, overwrite, quiet = given["source"], given["export"], given["overwrite"], given["quiet"]
    reading = _some(given, READING)
    document = opened(source, reading)
    target = given["saved_as"] or source.with_name(f"{source.stem}_smooth{source.suffix}")
    request = asked(given, plain_sample)
    look: Given = {**_some(given, DRAWING), "title": _titled(given["title"], source.name)}
    served = Address(given["host"], given["port"], given["browser"], lambda sentence: said(sentence, ()))
    place = Page(export, overwrite) if export is not None else served if given["web"] else None
    written = viewed(
        document,
        place=place,
        saving=Saving(str(source), target, overwrite, _spoken(reading)),
        states=States(given["frames"], given["memory"] << 20),
        request=request,
        progress=None if quiet else True,
        **look,
    )
    said("", () if quiet else written)


def _spoken(reading: Given) -> tuple[str, ...]:
    """The options with which a file was read, as arguments of a command line."""
    found: list[str] = []
    for name, value in reading.items():
        if value is True:
            found.append(f"--{name.replace('_', '-')}")
        elif value is not None:
            found += [f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, tuple) else (value,))]
    return tuple(found)


def _titled(title: str | None, default: str) -> str:
    return default if title is None else title


def compare_methods(given: Given) -> None:
    """Run each of METHODS on IN until it has removed the same amount. Compare them in a table, a picture, and with a truth."""
    source, picture = given["source"], given["picture"]
    must_be_drawable(picture, given["overwrite"])
    reading = _some(given, READING)
    document = opened(source, reading)
    truth = None if given["known"] is None else array_of(opened(given["known"], reading).data)
    runs = methods_compared(
        document, given["methods"], truth, noise=given["sigma"], removed=given["share"], picture=picture,
        overwrite=given["overwrite"],
    )  # fmt: skip
    notes = (*document.notes, *(() if picture is None else (f"picture: {picture}",)))
    listed([run.as_dict() for run in runs], given["json"], notes)


def compare_flows(given: Given) -> None:
    """Compare four flows on a depth image at equal smoothness: in 3D, along normals, along z, along rays."""
    source, camera, picture = given["source"], given["camera"], given["picture"]
    must_be_drawable(picture, given["overwrite"])
    depths, cam, notes = _depths(source, camera, given["depth_scale"])
    true, more = None, ()
    if given["truth"] is not None:
        true, _, more = _depths(given["truth"], camera, given["truth_scale"])
    found = compared(depths, cam, true, time=given["flow_time"], jump=given["jump"], boundary=given["rim"])
    notes += more
    if picture is not None:
        title = f"{source.name}: four flows, each until it is as smooth as the ray flow"
        drawn = draw_flows(found.panels(), picture, title=title, overwrite=given["overwrite"]).notes
        notes += (*drawn, f"picture: {picture}")
    if given["json"]:
        out.print_json(notation.dumps({"in": str(source), **found.as_dict(), "notes": list(notes)}))
        return
    out.print(Text(str(found)), soft_wrap=True)
    said("", notes)


def _depths(path: Path, camera: str | None, depth_scale: float | None) -> tuple[Array, Any, tuple[str, ...]]:
    """Depths, NaN where missing, their camera, and notes.

    :raises InputError: for data that is no range image.
    """
    if camera is None:
        raise InputError("compare-flows: rays are those of a camera; give --camera")
    document = opened(path, {"kind": "depth", "camera": camera, "depth_scale": depth_scale})
    image = document.data
    if not isinstance(image, RangeImage):
        raise InputError(f"{path}: a depth image expected, got {type(image).__name__}")
    return np.where(image.missing, np.nan, image.depth), image.camera, document.notes


def add_to(app: typer.Typer) -> None:
    """Make commands of these functions."""
    drawn = flags(*DRAWING, "overwrite")
    command(
        app,
        "compare",
        (
            *flags("source", "other", *READING, "picture", "on_screen"),
            *(replace(flag, kind=COMPARED, default="removed", help=COMPARING) for flag in flags("quantity")),
            *flags("arrange", "at", "seen_contrast"), *drawn, *flags("json"),
        ),
    )(compare)  # fmt: skip
    asking = ("source", "methods", *READING, "picture", "overwrite", "known", "sigma", "share", "json")
    command(app, "compare-methods", flags(*asking))(compare_methods)
    shown = (*flags("source", "shown", *READING, *PLACING), *only(FLOW, "fixed"), *flags("quantity", "seen_contrast"))
    command(app, "show", (*shown, *drawn, *flags("quiet")))(show)
    command(
        app,
        "film",
        (
            *flags("source", "filmed"), *only(FLOW, *FILMED[:5], "steps", *FILMED[5:]),
            *flags(*READING, "frames", "rate", "turn"),
            *(replace(flag, kind=COMPARED | None, help=FILMING) for flag in flags("quantity")),
            *flags(*DRAWING, "overwrite", "quiet", size=(960, 720)),
        ),
    )(film)  # fmt: skip
    command(
        app,
        "view",
        (
            *flags("source", "saved_as", "web", "host", "port", "browser", "export"), *only(FLOW, *FILMED),
            *flags(*READING, "frames", "memory", frames=32), *flags(*DRAWING, "overwrite", "quiet", size=(1280, 900)),
        ),
    )(view)  # fmt: skip
    compared_ = ("source", "camera", "truth", "depth_scale", "truth_scale", "jump", "flow_time", "rim", "picture")
    command(app, "compare-flows", flags(*compared_, "overwrite", "json"))(compare_flows)


def must_be_drawable(picture: Path | None, overwrite: bool) -> None:
    """Refuse a picture that cannot be written, or that exists."""
    if picture is not None:
        drawable(picture, overwrite=overwrite)


def pictured(before: Document, after: Document, path: Path, title: str, overwrite: bool) -> tuple[str, ...]:
    """Draw before and after; returns notes."""
    return (*draw_pair(before.data, after.data, path, title=title, overwrite=overwrite).notes, f"picture: {path}")
