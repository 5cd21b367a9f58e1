"""Commands: ``meshflow smooth | convert | info | fuse | methods | options | compare | show | film | view | compare-flows``."""

import io
import json as notation
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import typer

from meshflow.cli import looking
from meshflow.cli.asking import asked, narrowed
from meshflow.cli.by_windows import memory_for, smooth_by_windows, tiles_together
from meshflow.cli.console import err, must_be_open, one_line, out, said, table
from meshflow.cli.environment import environment
from meshflow.cli.flags import FLOW, Given, command, only
from meshflow.cli.hints import usage
from meshflow.cli.inputs import frame, opened, per_sample, plain_sample
from meshflow.cli.looking import must_be_drawable, pictured
from meshflow.cli.many import Told, smooth_many
from meshflow.cli.options import PLACING, READING, flags
from meshflow.cli.rasters import Beside, without_type, writing_of
from meshflow.cli.spoken import spoken
from meshflow.cli.stores import is_of_stores, smooth_store
from meshflow.cli.tables import methods_table, options_table
from meshflow.errors import InputError, MissingPackage, NotConverged
from meshflow.estimate.suits import words_on
from meshflow.evaluate.facts import describe
from meshflow.fusing import fuse_frames as fused
from meshflow.io.document import Document, Writing
from meshflow.io.files import writable, write
from meshflow.io.grid_mesh import as_mesh_document
from meshflow.io.incoming import STDIN, temporary
from meshflow.large.outcome import Outcome
from meshflow.large.stacks import Slices
from meshflow.results.multipart import Results, every_warning
from meshflow.results.result import Result, release
from meshflow.smoothing import noise_facts, smooth_object
from meshflow.view.report import report as drawn_report
from meshflow.view.report import writable as reportable

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Remove noise from elevation models, meshes, depth images, images and volumes, and keep their edges.",
)

# What typer raises for bad usage. typer contains its own copy of click, and exports no other of its exceptions.
UsageError: Any = typer.BadParameter.__base__
# The exit status of typer on Ctrl-C, as shells have it.
INTERRUPTED = 130
# The signals that end a process without a word, and what shells say of a process that they have ended.
ENDING = ("SIGTERM", "SIGHUP")
ENDED = tuple(128 + getattr(signal, name) for name in ENDING if hasattr(signal, name))
# What libraries and threads say that find no room in the address space.
NO_ROOM = ("failed to map segment", "start new thread")
# The options that most users need come first in the help.
TEN = ("method", "time", "scale", "strength", "noise")
SAYING = ("picture", "report", "overwrite", "quiet", "verbose", "json")


@app.callback(invoke_without_command=True)
def about(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    """Remove noise from elevation models, meshes, depth images, images and volumes, and keep their edges."""
    if version:
        out.print(release(), highlight=False)
        raise typer.Exit


@command(
    app,
    "smooth",
    (
        *flags("source", "target", "more", target=None),
        *only(FLOW, *TEN),
        *flags("kind", "camera", "picture", "report", "overwrite"),
        *(flag for flag in FLOW if flag.name not in TEN),
        *flags(
            *READING[2:],
            *PLACING,
            "moves",
            "time_unit",
            "slices",
            "dtype",
            "driver",
            "creation",
            "removed",
            "uncertainty",
            "most_memory",
            "output",
            "together",
            "resume",
            "jobs",
            *SAYING[3:],
        ),
    ),
    context=True,
)
def smooth(given: Given) -> None:
    """Smooth IN and write the same kind of data to OUT. Options that you do not give are found from the data."""
    context, named = given.pop("context"), [given["source"], *_also(given)]
    if given["output"] is not None:
        smooth_many(given, named, _one, tiles_together)
        return
    source, target, quiet = given["source"], given["target"], given["quiet"]
    if target is None:
        raise UsageError("Missing argument 'OUT'", context)
    if given["together"] or given["resume"] or given["jobs"] != 1:
        raise InputError("smooth: --together, --resume and --jobs are for several files; give --output FOLDER")
    if len(named) > 2:
        raise InputError(f"smooth: IN and OUT expected, got {len(named)} names; --output FOLDER takes several inputs")
    piped = target == STDIN
    if piped or given["json"]:
        must_be_open()
    if piped and given["json"]:
        raise InputError("smooth: OUT or --json goes to stdout, not both; name a file for OUT")
    told = _one(given)
    result, notes = told.result, told.notes
    if not quiet:
        said(f"{source} → {target}: {f'{chr(10)}{result}' if given['verbose'] else result.summary}", notes)
    if piped:
        sys.stdout.buffer.write(given["target"].read_bytes())
    if told.pictured is not None and not isinstance(result, (Outcome, Slices)):
        title = f"{source.name}, {result.stopped_because}"
        notes += _shown(given, result, pictured_as=(*told.pictured, title), name=source.name)
    if given["json"]:
        summary = {"in": str(source), "out": str(target), **result.to_dict(), "notes": list(notes)}
        out.print_json(notation.dumps(summary))


def _also(given: Given) -> list[Path]:
    """What is named beside IN."""
    return [path for path in (given["target"], *(given["more"] or ())) if path is not None]


def _one(given: Given) -> Told:
    """Smooth one file; where it goes to stdout, the target that is given becomes the file that holds it."""
    source, target, overwrite = given["source"], given["target"], given["overwrite"]
    if is_of_stores(given):
        return smooth_store(given)
    memory = memory_for(given)
    if memory is not None:
        return smooth_by_windows(given, memory)
    document = opened(source, {name: given[name] for name in (*READING, *PLACING, "moves", "time_unit")})
    if target == STDIN:
        target = given["target"] = temporary(os.getpid()) / f"stdout{document.path.suffix}"
    word, suiting = given["method"], words_on(document.data)
    request = asked(given, partial(per_sample, document), suiting)
    stored = writing_of(given)
    _must_be_writable(document, target, given["picture"], given["report"], overwrite, stored)
    beside = Beside(given["removed"], given["uncertainty"], overwrite, without_type(stored))
    beside.must_be_writable(document, target)
    record = given["json"] or given["report"] is not None
    done, result = smooth_object(document, request, None if given["quiet"] else True, record=record)
    sides = beside.made(document, done, result)
    tags = {f"meshflow:{name}": word for name, word in result.tags.items()}
    options: Writing = {**stored, **_left(document, target, result, stored)}
    notes = (
        document.notes
        + narrowed(request, word, suiting)
        + write(done, target, overwrite=overwrite, tags=tags, **options)
        + beside.write(sides, tags)
    )
    notes += tuple(word for word in every_warning(result) if word not in (*notes, result.stopped_because))
    return Told(result, notes, (document, done))


def _shown(
    given: Given, result: Result | Results, pictured_as: tuple[Document, Document, str], name: str
) -> tuple[str, ...]:
    """Write the picture and the report that are asked for; returns notes on them."""
    notes: tuple[str, ...] = ()
    quiet, overwrite = given["quiet"], given["overwrite"]
    if given["picture"] is not None:
        before, after, title = pictured_as
        drawn = pictured(before, after, given["picture"], title, overwrite)
        notes += drawn
        said("", () if quiet else drawn)
    if given["report"] is not None:
        notes += _reported(result, given["report"], name, overwrite, quiet)
    return notes


@command(app, "info", (*flags("source", source=None), *flags(*READING, *PLACING, "json", "environment")))
def info(given: Given) -> None:
    """Describe IN: size, spacing, missing samples, noise, area, and quality of the triangles."""
    if given["environment"]:
        table(environment(), given["json"], ())
        return
    if given["source"] is None:
        raise InputError("info: a file expected, or --environment")
    document = opened(given["source"], {name: given[name] for name in (*READING, *PLACING)})
    facts = {"file": str(given["source"]), **describe(document.data), **noise_facts(document.data)}
    if (
        "type" in facts
        and facts["type"] != (stored := document.source.stored_as)
        and stored.startswith(("int", "uint"))
    ):
        facts["type"] = f"{stored}, smoothed as {facts['type']}"
    if "spacing" in facts and document.source.ground_unit:
        facts["spacing"] = f"{facts['spacing']} {document.source.ground_unit}"
    table(facts, given["json"], document.notes)


@command(app, "convert", flags("source", "target", "every", *READING, *PLACING, "overwrite", "quiet"))
def convert(given: Given) -> None:
    """Convert a terrain or an image, IN, to a triangle mesh, OUT. Channels become vertex attributes."""
    source, target = given["source"], given["target"]
    document = as_mesh_document(opened(source, {name: given[name] for name in (*READING, *PLACING)}), given["every"])
    notes = document.notes + write(document, target, overwrite=given["overwrite"])
    if not given["quiet"]:
        said(f"{source} → {target}: {document.data}", notes)


@command(app, "methods", flags("json", "markdown"))
def methods(given: Given) -> None:
    """List the methods: paper, what each moves, its options, what it is, when to use it, and what it conserves."""
    methods_table(given["json"], given["markdown"])


@command(app, "options", flags("one_method", "json", "markdown"))
def options(given: Given) -> None:
    """List the options of a flow: type, unit, meaning, default, and the methods that have them; or those of one METHOD."""
    options_table(given["json"], given["markdown"], given["one_method"])


FUSED = (
    "strength", "time", "method", "gamma", "sharpness", "contrast", "noise", "search", "domain", "max_change",
    "min_component", "threads",
)  # fmt: skip


@command(
    app,
    "fuse",
    (*flags("frames_in", "fused", "camera", "depth_scale", "measure"), *only(FLOW, *FUSED), *flags(*SAYING)),
)
def fuse(given: Given) -> None:
    """Fuse depth frames of the same view, smooth each pixel in proportion to its noise, and write the result."""
    sources, target, overwrite, quiet = given["frames_in"], given["fused"], given["overwrite"], given["quiet"]
    reading = {name: given[name] for name in ("camera", "depth_scale", "measure")}
    request = asked(given, plain_sample)
    first = next((found for path in sources if (found := frame(path, reading)) is not None), None)
    if first is None:
        raise InputError(f"fuse: depths expected, got {len(sources)} frames in which all are missing")
    _must_be_writable(first, target, given["picture"], given["report"], overwrite)
    images = (None if seen is None else seen.data for seen in (frame(path, reading) for path in sources))
    back, result = fused(images, request, None)
    before, done = first.holding(result.before), first.holding(back)
    tags = {f"meshflow:{name}": word for name, word in result.tags.items()}
    written = write(done, target, overwrite=overwrite, tags=tags, **_left(first, target, result))
    notes = (*first.notes, *written, *result.warnings)
    many = f"{len(sources)} frames"
    if not quiet:
        seen = result.parameters["frames"]
        said(
            f"{many} → {target}: {f'{chr(10)}{result}' if given['verbose'] else f'{result.summary}; {seen.why}'}", notes
        )
    notes += _shown(given, result, pictured_as=(before, done, f"{many}, {result.stopped_because}"), name=many)
    if given["json"]:
        summary = {"in": [str(path) for path in sources], "out": str(target), **result.to_dict(), "notes": list(notes)}
        out.print_json(notation.dumps(summary))


def _reported(result: Result | Results, path: Path, name: str, overwrite: bool, quiet: bool) -> tuple[str, ...]:

    notes = (*drawn_report(result, path, title=name, overwrite=overwrite).notes, f"report: {path}")
    said("", () if quiet else notes)
    return notes


def _left(document: Document, target: Path, result: Result | Results, options: Writing | None = None) -> Writing:
    """The noise that is left, for the writer of depth images, which rounds."""
    form = writable(document, target, overwrite=True, **(options or {}))
    if isinstance(result, Mapping) or "left" not in form.WRITES:
        return {}
    return {"left": result.left}


def _must_be_writable(
    document: Document,
    target: Path,
    picture: Path | None,
    report: Path | None,
    overwrite: bool,
    options: Writing | None = None,
) -> None:
    """Refuse outputs that cannot be written before any work is done."""
    writable(document, target, overwrite=overwrite, **(options or {}))
    must_be_drawable(picture, overwrite)
    if report is not None:
        reportable(report, overwrite)


looking.add_to(app)


def main() -> None:
    """Run the command. A refusal is one line on stderr and a nonzero exit code."""
    _end_in_order()
    _hush()
    _keep_streams_apart()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name, or a sign of ours, that the locale has no bytes for
            stream.reconfigure(errors="backslashreplace")
    try:
        # Without arguments typer prints the help; for bad usage it would draw a box around the message.
        sys.exit(app(standalone_mode=len(sys.argv) < 2))
    except UsageError as refusal:
        about = "" if refusal.ctx is None else f"; see {refusal.ctx.command_path} --help"
        dashed = [word for word in sys.argv[1:] if word.startswith("-") and word != "-" and Path(word).exists()]
        about += "".join(f"; for the file write ./{word}" for word in dashed)
        said(f"meshflow: {usage(refusal, sys.argv[1:])}{about}", (), style="red")
        sys.exit(refusal.exit_code)
    except (InputError, MissingPackage, NotConverged, OSError) as refusal:
        words = spoken(str(refusal))
        if isinstance(refusal, OSError) and refusal.filename is None:
            words = f"stdout takes no more ({refusal.strerror or refusal}); send it elsewhere"
        err.print(f"meshflow: {one_line(words)}", markup=False, soft_wrap=True, style="red")
        sys.exit(1)
    except (MemoryError, ImportError, RuntimeError) as refusal:
        if not isinstance(refusal, MemoryError) and not any(word in str(refusal) for word in NO_ROOM):
            raise
        why = " ".join(str(refusal).split()) or "the system gives this process no more"
        said(
            f"meshflow: not enough memory ({why}); smooth a part of the data, or use a machine with more memory",
            (),
            style="red",
        )
        sys.exit(1)
    except SystemExit as end:
        if end.code in (INTERRUPTED, *ENDED):
            err.print("meshflow: interrupted; OUT is complete, or as it was before", markup=False, soft_wrap=True)
        raise


def _keep_streams_apart() -> None:
    """Streams that are closed lead to nothing: a file would else be opened in their place, and libraries write into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _hush() -> None:
    """Suppress log messages and warnings of libraries, because a command prints one line; python -W shows them again."""
    logging.getLogger().addHandler(logging.NullHandler())
    if not sys.warnoptions:
        warnings.simplefilter("ignore")


def _end_in_order() -> None:
    """A signal that ends the process ends it as Ctrl-C does: what is half written is taken away."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in ENDING:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:  # nohup ignores SIGHUP
            signal.signal(number, _ended)


def _ended(number: int, frame: object) -> None:
    raise SystemExit(128 + number)
