"""Reports of runs: what they hold, and that they harm nothing."""

from dataclasses import replace
from html import unescape

import numpy as np
import pytest

import meshflow
from meshflow.errors import FormatError, MissingPackage
from meshflow.flow.compute import Compute
from meshflow.surfaces.camera import Pinhole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.view import charts, findings
from meshflow.view.findings import found
from meshflow.view.pair import paired
from meshflow.view.report import _figure, report

ROWS, COLUMNS = np.mgrid[:64, :64].astype(float)
NOISE = np.random.default_rng(0).normal(size=(64, 64, 3))


def terrain():
    z = np.where(COLUMNS > 30, 10.0, 0.0) + 0.1 * ROWS + 0.5 * NOISE[..., 0]
    z[10:16, 20:30] = np.nan
    return HeightField(z, spacing=(30.0, 60.0), unit="m")


def colours():
    return Image(np.stack([3 * ROWS, 3 * COLUMNS, np.full((64, 64), 90.0)], axis=2) + 10 * NOISE)


def patch_of_mesh():
    points = np.stack([COLUMNS[:20, :20].ravel(), ROWS[:20, :20].ravel(), 0.2 * NOISE[:20, :20, 0].ravel()], axis=1)
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    lower, upper = (
        np.stack([corner, corner + 1, corner + 21], axis=1),
        np.stack([corner, corner + 21, corner + 20], axis=1),
    )
    return Mesh(points, np.concatenate([lower, upper]))


def depths():
    return RangeImage(2 + 0.01 * NOISE[..., 0], Pinhole(60.0, 60.0, 31.5, 31.5))


SURFACES = {"height field": terrain, "colour": colours, "range image": depths}


@pytest.fixture(scope="module", params=SURFACES)
def result(request):
    return meshflow.smooth(SURFACES[request.param](), result=True)


@pytest.fixture(scope="module")
def smoothed():
    return meshflow.smooth(terrain(), result=True)


@pytest.fixture(scope="module")
def mesh():
    return meshflow.smooth(patch_of_mesh(), result=True)


@pytest.fixture(scope="module")
def idle():
    return meshflow.smooth(np.full((64, 64), 3.0), result=True)


def html(result, folder, **options):
    return unescape(report(result, folder / "a.html", **options).path.read_text())


def written(figure):
    """The words that stand on a picture, each where it is drawn."""
    return [text.get_text() for text in figure.texts]


@pytest.mark.long
def test_a_report_holds_every_parameter_and_its_origin(result, tmp_path):
    page, words = html(result, tmp_path), written(_figure(found(result, "")))
    for name, parameter in result.parameters.items():
        value = findings._number(parameter.value)
        row = page[page.index(f"<th>{name}</th>") :].split("</tr>")[0]
        for word in (value, parameter.unit, parameter.origin, parameter.why):
            assert word in row, (name, word, row)
        assert {name, value, parameter.origin} <= set(words), name


def test_a_report_says_why_it_ended_what_noise_was_found_and_what_to_beware_of(smoothed, tmp_path):
    warned = replace(smoothed, warnings=("the first <warning>", "the second"))
    page, words = html(warned, tmp_path), written(_figure(found(warned, "")))
    for sentence in (smoothed.stopped_because, *warned.warnings, f"meshflow {smoothed.version}"):
        assert sentence in page
        assert sentence in words
    assert f"σ = {smoothed.noise.sigma:.4g} m" in page


def test_a_page_needs_no_network_and_markup_in_words_is_words(smoothed, tmp_path):
    reported = report(smoothed, tmp_path / "a.html", "<script>alert(1)</script>")
    page = reported.path.read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "http" not in page
    sources = page.split("src='")[1:]
    assert len(sources) == 3 + 1 + 4, "before, after, removed; the colour bar; four charts"
    assert all(source.startswith("data:image/png;base64,") for source in sources)


def test_a_picture_holds_the_panels_and_charts_of_the_page(smoothed, tmp_path):
    from matplotlib.image import imread

    picture = imread(report(smoothed, tmp_path / "a.png", "A title").path)
    assert picture.shape[1] == 1600
    figure = _figure(found(smoothed, "A title"))
    assert written(figure)[0] == "A title"
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["before", "after", "removed"]
    assert [title for title in titles[3:] if title] == [chart.title for chart in found(smoothed, "").charts]


def test_colours_of_what_was_removed_are_symmetric_and_show_it_with_its_unit(smoothed):
    scale = found(smoothed, "").scale
    gone = np.isnan(terrain().z)
    np.testing.assert_allclose(scale.values[~gone], smoothed.removed[~gone], atol=1e-12)
    assert np.isnan(scale.values[gone]).all()
    assert scale.low == -scale.high == -np.percentile(np.abs(smoothed.removed[~gone]), 99)
    assert scale.label == "height before − after [m]"


def test_samples_are_as_wide_and_tall_in_a_report_as_in_the_field(smoothed):
    for panel in found(smoothed, "").panels:
        assert panel.picture.shape == (64, 64, 3)
        assert panel.aspect == pytest.approx(0.5)


def test_missing_samples_are_grey_in_every_panel(smoothed):
    for panel in found(smoothed, "").panels:
        hole = panel.picture[11:15, 21:29].reshape(-1, 3)
        assert (hole == hole[0]).all(), panel.label
        assert np.ptp(hole[0].astype(int)) < 25, panel.label


def test_large_grids_are_thinned_and_the_report_says_so(smoothed):
    z = np.tile(smoothed.before.z, (1, 40))[:8]
    wide = replace(smoothed, before=HeightField(z), after=HeightField(z + 0.1))
    shown = found(wide, "")
    assert all(panel.picture.shape[1] <= 1000 for panel in shown.panels)
    assert "every 3rd sample" in shown.notes


def test_an_idle_result_has_a_report_too(idle, tmp_path):
    page = html(idle, tmp_path)
    assert idle.stopped_because in page
    assert "nothing was removed" in page
    assert report(idle, tmp_path / "a.png").path.stat().st_size > 1000
    assert found(idle, "").charts == ()


def test_without_a_search_there_is_no_panel_of_it(smoothed):
    titles = [chart.title for chart in found(smoothed, "").charts]
    assert "what the search estimated" in titles
    plain = meshflow.smooth(terrain(), compute=Compute(search=False), result=True)
    assert [chart.title for chart in found(plain, "").charts] == titles[:3]


def test_the_chosen_variant_is_the_strong_line_of_the_search(smoothed):
    chart = found(smoothed, "").charts[-1]
    figure = charts.blank(4, 3)
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    chart.draw(axes)
    lines = {line.get_label(): line for line in axes.lines}
    np.testing.assert_array_equal(lines["chosen"].get_ydata(), smoothed.candidates[0].risks)
    np.testing.assert_array_equal(lines["chosen"].get_xdata(), smoothed.candidates[0].times)
    assert len(axes.lines) == len(smoothed.candidates) + 1, "one line for each candidate, one for the time"


def test_the_histogram_is_a_density_beside_that_of_the_noise():
    chart = charts.histogram(NOISE, 1.0, "m")
    axes = charts.blank(4, 3).add_axes((0.1, 0.1, 0.8, 0.8))
    chart.draw(axes)
    area = sum(patch.get_width() * patch.get_height() for patch in axes.patches)
    assert area == pytest.approx(1.0, abs=0.01)
    x, curve = axes.lines[0].get_data()
    assert curve.sum() * (x[1] - x[0]) == pytest.approx(1.0, abs=0.01)


def test_of_channels_that_are_no_colours_the_first_is_shown_and_the_report_says_so(tmp_path):
    values = np.concatenate([colours().values, colours().values[..., :2]], axis=2)
    five = meshflow.smooth(Image(values), compute=Compute(search=False), result=True)
    reported = report(five, tmp_path / "a.html")
    assert reported.notes == ("pictures: channel 1, of 5",)
    assert reported.notes[0] in reported.path.read_text()
    np.testing.assert_allclose(found(five, "").scale.values, five.removed[..., 0], atol=1e-12)


@pytest.mark.needs_gl
def test_a_mesh_is_drawn_and_counted_along_its_normals(mesh, tmp_path):
    shown = found(mesh, "")
    assert [panel.label for panel in shown.panels] == ["before", "after", "removed"]
    assert shown.scale.what == "moved inwards along the normal"
    for name in ("a.html", "a.png"):
        assert report(mesh, tmp_path / name).path.stat().st_size > 10_000


def test_where_a_mesh_cannot_be_drawn_the_report_says_so_and_holds_the_rest(mesh, tmp_path, monkeypatch):
    def refused(*_, **__):
        raise MissingPackage("VTK cannot draw here")

    monkeypatch.setattr(findings, "renderer_for", refused)
    page = html(mesh, tmp_path)
    assert "no pictures: VTK cannot draw here" in page
    assert mesh.stopped_because in page
    assert report(mesh, tmp_path / "a.png").notes == ("no pictures: VTK cannot draw here",)


@pytest.mark.parametrize("name", ["a.html", "a.png"])
def test_a_report_is_not_written_over_a_file_unasked(idle, tmp_path, name):
    target = tmp_path / name
    target.write_text("mine")
    with pytest.raises(FormatError, match="exists; name another file"):
        report(idle, target)
    assert target.read_text() == "mine"
    assert report(idle, target, overwrite=True).path == target
    assert target.stat().st_size > 1000
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.pdf", "a report ends in .html or .png; got .pdf"),
        ("a", "got no extension"),
        ("gone/a.html", "does not exist; create it first"),
        ("folder.html", "is a folder; name a file in it"),
    ],
)
def test_a_path_that_cannot_be_written_is_refused_by_name(idle, tmp_path, name, words):
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(FormatError, match=words):
        report(idle, tmp_path / name)


def test_a_report_changes_nothing_of_the_result(smoothed, tmp_path):
    before, after = smoothed.before.z.copy(), smoothed.after.z.copy()
    report(smoothed, tmp_path / "a.html")
    np.testing.assert_array_equal(smoothed.before.z, before)
    np.testing.assert_array_equal(smoothed.after.z, after)


def test_pyplot_is_left_alone(idle, tmp_path):
    import subprocess
    import sys

    code = (
        "import sys, numpy, meshflow; from meshflow.view.report import _figure, report; "
        f"report(meshflow.smooth(numpy.ones((8, 8)), result=True), {str(tmp_path / 'a.png')!r}); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_picture_and_a_report_show_the_same_removed(smoothed):
    scale, shown = found(smoothed, "").scale, paired(smoothed.before, smoothed.after, "m").removed
    np.testing.assert_array_equal(scale.values, shown.values)
    assert (scale.low, scale.high, scale.label, scale.ends) == (shown.low, shown.high, shown.label, shown.ends)
