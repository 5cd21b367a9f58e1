"""The report of a run on one page: before, after, removed, course, parameters and reasons."""

from base64 import b64encode
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from meshflow.errors import FormatError
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside, must_be_free
from meshflow.view.charts import FAINT, INK, LETTERS, Chart, bar, blank, png
from meshflow.view.findings import Findings, Panel, Run, found

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Reported", "excerpt", "report", "writable"]

_FORMATS = (".html", ".png")
_COARSE = 400  # samples per side; with fewer, each is drawn as a square
_HEAD = ("parameter", "value", "unit", "origin", "why")
# Inches of a page that is one picture.
_WIDTH, _GAP, _LINE, _CHART, _BAR = 16.0, 0.4, 0.22, 2.6, 0.15
_COLUMNS = (0.0, 1.6, 3.6, 6.4, 7.8)
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #26282b; background: #fff; margin: 1.5rem auto; max-width: 1500px;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .5rem; }
.row { display: grid; gap: 1rem; align-items: start; }
.of1 { grid-template-columns: minmax(0, 25rem); } .of2 { grid-template-columns: repeat(2, minmax(0, 1fr)); }
.of3 { grid-template-columns: repeat(3, minmax(0, 1fr)); } .of4 { grid-template-columns: repeat(4, minmax(0, 1fr)); }
@media (max-width: 1000px) { .of4 { grid-template-columns: repeat(2, minmax(0, 1fr)); } }
@media (max-width: 640px) { .of2, .of3, .of4 { grid-template-columns: minmax(0, 1fr); } }
figure { margin: 0; min-width: 0; } figcaption { text-align: center; margin-bottom: .3rem; }
img { display: block; width: 100%; } .coarse { image-rendering: pixelated; }
.faint { color: #6b7075; font-size: .87rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; } th, td { text-align: left; vertical-align: top; padding: .2rem 1.2rem .2rem 0; }
.all th, .all td { border-bottom: 1px solid #e3e6e9; } td.number { font-variant-numeric: tabular-nums; }
.warning { color: #9a1a28; } .estimated { color: #1f5f99; } .given { font-weight: 600; }
"""

# For a cell of a notebook: the rules have effect inside the excerpt alone.
_CELL = """
.meshflow { max-width: 1200px; } .meshflow figure { margin: 0; } .meshflow figcaption { text-align: center; }
.meshflow .row { display: grid; gap: 1rem; grid-template-columns: repeat(3, minmax(0, 1fr)); align-items: start; }
.meshflow img { display: block; width: 100%; } .meshflow .coarse { image-rendering: pixelated; }
.meshflow th, .meshflow td { text-align: left; padding: .1rem 1rem .1rem 0; } .meshflow .warning { color: #9a1a28; }
"""


@dataclass(frozen=True)
class Reported:
    """A report that was written.

    :ivar path: the file.
    :ivar notes: sentences for the user.
    """

    path: Path
    notes: tuple[str, ...] = ()


def report(result: Run, path: str | Path, title: str = "", *, overwrite: bool = False) -> Reported:
    """Write a report of a run.

    It shows before, after and what was removed; the histogram of what was removed beside the estimated noise; area and change
    over time; the curves of the search; and every parameter with its unit, origin and reason.

    Height fields are drawn as shaded reliefs, range images likewise from their camera, images as pictures (for channels that are
    no colours the first channel), meshes by VTK. Where VTK cannot draw, the report says so and has no pictures. Colours of what
    was removed are symmetric about 0 and end at the 99th percentile of its absolute value. Grids are thinned to 1000 samples per
    side.

    :param result: of ``meshflow.smooth(..., result=True)``.
    :param path: ``.html``, a self-contained page; or ``.png``, the same as one picture.
    :param title: by default a description of the data.
    :param overwrite: replace an existing file.
    :raises FormatError: for another extension, a folder that is not there, or a file that exists and must not be replaced.
    """
    target = writable(path, overwrite)
    findings = found(result, title)
    html = target.suffix.lower() == ".html"
    content = _page(findings).encode() if html else png(_figure(findings), sharp=1.0)
    with beside(target) as draft:
        draft.write_bytes(content)
    return Reported(target, findings.notes)


def excerpt(result: Run) -> str:
    """Before, after and what was removed, and how the run went, as HTML for a notebook; ``report`` shows all.

    :param result: of ``meshflow.smooth(..., result=True)``.
    """
    findings = found(result, "")
    pictures = _pictures(findings) if findings.panels else ""
    notes = "".join(f"<p>{escape(note)}</p>" for note in findings.notes)
    return f"<style>{_CELL}</style><div class='meshflow'>{pictures}{notes}<table>{_facts(findings)}</table></div>"


def writable(path: str | Path, overwrite: bool) -> Path:
    """Check that a path can be written, before anything is drawn.

    :raises FormatError: as :func:`report`.
    """
    target = Path(path)
    if target.suffix.lower() not in _FORMATS:
        got = target.suffix or "no extension"
        raise FormatError(f"{target.name}: a report ends in {' or '.join(_FORMATS)}; got {got}")
    if target.is_dir():
        raise FormatError(f"{target} is a folder; name a file in it")
    if not target.parent.is_dir():
        raise FormatError(f"{target}: the folder {target.parent} does not exist; create it first")
    must_be_free(target, overwrite)
    return target


def _page(findings: Findings) -> str:
    """The page as HTML, with embedded pictures."""
    title = escape(findings.title)
    rows = [_pictures(findings)] if findings.panels else []
    notes = "".join(f"<p class='faint'>{escape(note)}</p>" for note in findings.notes)
    charts = "".join(_diagram(chart) for chart in findings.charts)
    head = "".join(f"<th>{name}</th>" for name in _HEAD)
    table = "".join(_parameter(row) for row in findings.table)
    return "\n".join([
        f"<!DOCTYPE html>\n<html lang='en'>\n<head><meta charset='utf-8'><title>{title}</title>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
        f"<style>{_STYLE}</style></head>\n<body>\n<h1>{title}</h1>",
        *rows, notes,
        f"<h2>Summary</h2>\n<table>{_facts(findings)}</table>",
        f"<div class='row of{len(findings.charts)}' style='margin-top: 1rem'>{charts}</div>",
        f"<h2>Parameters</h2>\n<div class='wide'><table class='all'><thead><tr>{head}</tr></thead>",
        f"<tbody>{table}</tbody></table></div>\n</body>\n</html>\n",
    ])  # fmt: skip


def _facts(findings: Findings) -> str:
    """The rows of the table of how the run went."""
    return "".join(
        f"<tr class='{'warning' if name == 'warning' else 'fact'}'><th>{escape(name)}</th><td>{escape(words)}</td></tr>"
        for name, words in findings.facts
    )


def _pictures(findings: Findings) -> str:
    """Before, after, and what was removed over its colour bar."""
    figure = blank(4.8, 0.8)
    bar(figure.add_axes((0.06, 0.7, 0.88, 0.18)), findings.scale)
    colours = f"<img src='{_uri(png(figure))}' alt='{escape(findings.scale.label)}'>"
    parts = [_picture(panel, colours if panel.label == "removed" else "") for panel in findings.panels]
    return f"<div class='row of3'>{''.join(parts)}</div>\n<p class='faint'>{escape(findings.foot)}</p>"


def _picture(panel: Panel, below: str) -> str:
    kind = " class='coarse'" if max(panel.picture.shape[:2]) <= _COARSE else ""
    image = f"<img{kind} src='{_uri(_encoded(panel.picture))}' alt='{panel.label}' style='aspect-ratio: {panel.aspect:.4f}'>"
    return f"<figure><figcaption>{panel.label}</figcaption>{image}{below}</figure>"


def _diagram(chart: Chart) -> str:
    figure = blank(4.4, 3.0)
    chart.draw(figure.add_axes((0.15, 0.17, 0.82, 0.78)))
    image = f"<img src='{_uri(png(figure))}' alt='{escape(chart.words)}'>"
    return f"<figure><figcaption>{escape(chart.title)}</figcaption>{image}</figure>"


def _parameter(row: tuple[str, str, str, str, str]) -> str:
    name, value, unit, origin, why = map(escape, row)
    cells = f"<td class='number'>{value}</td><td>{unit}</td><td class='{origin}'>{origin}</td><td>{why}</td>"
    return f"<tr><th>{name}</th>{cells}</tr>"


def _encoded(picture: Array) -> bytes:
    """A picture (h, w, 3) as the bytes of a PNG."""
    from matplotlib.image import imsave

    file = BytesIO()
    imsave(file, picture, format="png")
    return file.getvalue()


def _uri(content: bytes) -> str:
    return f"data:image/png;base64,{b64encode(content).decode()}"


def _figure(findings: Findings) -> "Figure":
    """The report as one picture: panels, charts and text below each other."""
    wide = (_WIDTH - 4 * _GAP) / 3
    tall = min(max(wide / findings.panels[0].aspect, 2.4), 6.0) if findings.panels else 0.0
    low = _CHART + 1.2 if findings.charts else 0.0
    lines = _lines(findings)
    height = 0.7 + (tall + 1.3 if tall else 0.0) + low + _LINE * (len(lines) + 1)
    figure = blank(_WIDTH, height)
    top = height - 0.7
    figure.text(_GAP / _WIDTH, 1 - 0.4 / height, findings.title, va="center", fontsize=17, color=INK, parse_math=False)
    if findings.panels:
        _hang(figure, findings, top - 0.2, (wide, tall))
        top -= tall + 1.3
    each = (_WIDTH - 2 * _GAP) / max(len(findings.charts), 1)
    for k, chart in enumerate(findings.charts):
        left, right = _GAP + k * each + 0.65, _GAP + (k + 1) * each - 0.15
        axes = _box(figure, left, top - 0.3 - _CHART, right - left, _CHART)
        chart.draw(axes)
        axes.set_title(chart.title, fontsize=LETTERS + 2, color=INK)
    top -= low
    for k, line in enumerate(lines):
        for x, word, colour in line:
            figure.text(
                (_GAP + x) / _WIDTH,
                (top - k * _LINE) / height,
                word,
                va="center",
                fontsize=LETTERS + 1,
                color=colour,
                parse_math=False,
            )
    return figure


def _hang(figure: "Figure", findings: Findings, top: float, size: tuple[float, float]) -> None:
    """Place the panels side by side below ``top``, the colour bar below the last, the text below the first."""
    wide, tall = size
    for k, panel in enumerate(findings.panels):
        axes = _box(figure, _GAP + k * (wide + _GAP), top - tall, wide, tall)
        coarse = max(panel.picture.shape[:2]) <= _COARSE
        axes.imshow(panel.picture, aspect=panel.pixel, interpolation="nearest" if coarse else "antialiased")
        axes.set_axis_off()
        axes.set_title(panel.label, fontsize=LETTERS + 2, color=INK)
    bar(_box(figure, _GAP + 2 * (wide + _GAP), top - tall - 0.1 - _BAR, wide, _BAR), findings.scale)
    low = (top - tall - 0.2) / figure.get_figheight()
    figure.text(_GAP / _WIDTH, low, findings.foot, va="center", fontsize=LETTERS, color=FAINT, parse_math=False)


def _box(figure: "Figure", left: float, bottom: float, width: float, height: float):  # noqa: ANN202
    """Axes that cover a box, inches from the lower left corner."""
    page = figure.get_figheight()
    return figure.add_axes((left / _WIDTH, bottom / page, width / _WIDTH, height / page))


def _lines(findings: Findings) -> list[list[tuple[float, str, str]]]:
    """Facts, parameters and notes as lines of text, each with its start in inches and its colour."""
    lines: list[list[tuple[float, str, str]]] = []
    for name, words in (*findings.facts, *(("note", note) for note in findings.notes)):
        colour = "#9a1a28" if name == "warning" else INK
        for k, part in enumerate(wrap(words, 150) or [""]):
            lines.append([*([(0.0, name, FAINT)] if k == 0 else []), (_COLUMNS[1], part, colour)])
    lines += [[], [(x, word, FAINT) for x, word in zip(_COLUMNS, _HEAD, strict=True)]]
    for *cells, why in findings.table:
        parts = wrap(why, 80) or [""]
        lines.append([(x, word, INK) for x, word in zip(_COLUMNS, (*cells, parts[0]), strict=True)])
        lines += [[(_COLUMNS[-1], part, INK)] for part in parts[1:]]
    return lines
