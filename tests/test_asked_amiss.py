"""What is asked for amiss is refused in one line that says what to do: wrong types, ranges, steps, names, streams, advice."""

import re
import sys
from dataclasses import fields, is_dataclass
from errno import ENOSPC
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import meshflow
from meshflow import HeightField, Image, InputError, classics, evaluate, smooth
from meshflow.cli import commands
from meshflow.cli.commands import main
from meshflow.cli.flags import FLOW
from meshflow.errors import said_by
from meshflow.flow.controls import FixedStep, Until
from meshflow.flow.methods import AUTHORS, HEIGHT_METHODS, METHODS, POINT_METHODS, word_of
from meshflow.flow.stops import Residual
from meshflow.geometry.options import options_of
from meshflow.geometry.validation import spacing_of
from meshflow.io.files import read

Z = np.add.outer(np.sin(np.arange(12.0)), np.arange(14.0))
OPTIONED = [
    kind
    for kind in (*(getattr(meshflow, name) for name in meshflow.__all__), *HEIGHT_METHODS, *POINT_METHODS)
    if is_dataclass(kind) and isinstance(kind, type) and any("meaning" in one.metadata for one in fields(kind))
]


@pytest.mark.parametrize("kind", dict.fromkeys(OPTIONED), ids=lambda kind: kind.__name__)
def test_options_of_yes_or_no_take_nothing_else(kind):
    for one in fields(kind):
        if bool in (one.type, *get_args(one.type)):
            for wrong in ("x", np.nan, [1], 1, 0.0, np.ones(2)):
                with pytest.raises(InputError, match=rf"{one.name}: True(,| or) False.* expected, got"):
                    kind(**{one.name: wrong})


@pytest.mark.parametrize("kind", dict.fromkeys(OPTIONED), ids=lambda kind: kind.__name__)
def test_numbers_beyond_the_range_that_an_option_declares_are_refused_with_it(kind):
    for one in options_of(kind):
        if one.within is not None:
            kind(**{one.name: one.within[1]})
            for wrong in (one.within[0] - 1, 2 * one.within[1] + 1, 1e300):
                with pytest.raises(InputError, match=rf"{one.name}: .*{re.escape(one.range)}.* expected, got"):
                    kind(**{one.name: wrong})


def test_every_width_of_a_gaussian_has_a_limit():
    with_it = [option for kind in HEIGHT_METHODS for option in options_of(kind) if option.name == "presmoothing"]
    assert len(with_it) >= 3
    assert all(option.within == (0.0, 1000.0) for option in with_it)


def test_a_run_of_millions_of_steps_is_refused_before_it_begins_with_their_number():
    with pytest.raises(InputError, match=r"dt: 1e\+11 steps of 1e-09 .* reach time 100, at most 1e\+06 .* a longer dt"):
        smooth(Z, method="heat", time=100, compute=meshflow.Compute(dt=1e-9))
    with pytest.raises(InputError, match="steps of .* would be needed"):
        FixedStep(1e-12).opened(None, meshflow.SemiImplicit(), Z, Until(time=1.0))
    FixedStep(1e-12).opened(None, meshflow.SemiImplicit(), Z, Until(time=1.0, steps=3))
    FixedStep(1e-8).opened(None, meshflow.SemiImplicit(), Z, Until(time=1.0, stops=(Residual(),)))


@pytest.mark.parametrize("take", [lambda array: evaluate.compare(array, array), evaluate.describe, meshflow.to_mesh])
@pytest.mark.parametrize(
    ("shape", "likeness"),
    [((50, 3), "points"), ((12, 14, 16), "a volume"), ((3, 20, 30), "3 channels that come first")],
)
def test_arrays_with_the_shape_of_something_else_are_refused(take, shape, likeness):
    with pytest.raises(InputError, match=f"looks like {likeness}; make it the data that it is"):
        take(np.zeros(shape))


def test_arrays_are_compared_described_and_triangulated_as_the_data_that_they_are():
    for array, kind in ((Z, HeightField), (np.dstack([Z, Z]), Image)):
        data = kind(array)
        assert evaluate.compare(array, array + 1).rms == evaluate.compare(data, kind(array + 1)).rms
        assert evaluate.compare(data, array).rms == 0
        assert evaluate.describe(array) == evaluate.describe(data)
        np.testing.assert_array_equal(meshflow.to_mesh(array).vertices, meshflow.to_mesh(data).vertices)
    base, detail = classics.hierarchy(Z, contrasts=0.3, time=1.0)
    np.testing.assert_allclose(base + detail, Z)


@pytest.mark.parametrize(
    "call",
    [
        lambda data: evaluate.compare(Z, data), lambda data: evaluate.compare(data, Z), evaluate.describe,
        meshflow.to_mesh, meshflow.to_points, meshflow.to_normals, meshflow.to_pyvista, meshflow.to_open3d,
        meshflow.expected_error, meshflow.fuse, lambda data: meshflow.compare_methods(Z, data),
        lambda data: evaluate.mesh_quality(Z, data), lambda data: classics.hierarchy(Z, data),
        lambda data: classics.hierarchy(data, 0.3),
    ],
)  # fmt: skip
@pytest.mark.parametrize("wrong", [None, "x", object()], ids=["None", "text", "object"])
def test_what_is_no_data_is_refused_by_every_function_that_takes_data(call, wrong):
    with pytest.raises((InputError, meshflow.MissingPackage)):
        call(wrong)


class Framed:
    """An object with numbers, as those of pandas."""

    def to_numpy(self):
        return Z


class Arrayed:
    """An object with an array, as those of torch."""

    def __array__(self, dtype=None, copy=None):
        return Z


def test_objects_with_numbers_are_refused_with_the_way_to_their_array():
    for data, way in ((Framed(), r"data\.to_numpy\(\)"), (Arrayed(), r"numpy\.asarray\(data\)")):
        with pytest.raises(InputError, match=rf"expected {way}, which gives the numbers"):
            smooth(data)
    with pytest.raises(InputError, match="got the class float$"):
        smooth(Z, method=float)


def test_a_spacing_may_be_an_array_of_two_numbers():
    assert spacing_of(np.array([1, 2]), 12) == spacing_of([1, 2], 12)


def test_numbers_of_which_powers_overflow_are_named():
    for wrong, words in (
        ({"noise": 1e300}, "^noise: 1e-150 to"),
        ({"strength": 1e300}, "^strength: 1e-150 to"),
        ({"noise": 1e100}, "^noise: with its strength it is too large"),
    ):
        with pytest.raises(InputError, match=words), np.errstate(all="ignore"):
            smooth(Z, **wrong)
    with pytest.raises(InputError, match="^values from .*e-310.* scale the data"):
        smooth(Z * 1e-310)


def test_coordinates_that_are_nan_are_named():
    xarray = pytest.importorskip("xarray")
    data = xarray.DataArray(Z, dims=("y", "x"), coords={"y": np.arange(12.0), "x": np.full(14, np.nan)})
    with pytest.raises(InputError, match="coordinates of y and x: no sample has a place, they are NaN"):
        smooth(data)


def test_chunks_of_unknown_size_are_refused_with_the_way_to_know_them():
    dask = pytest.importorskip("dask.array")
    data = dask.from_array(Z, chunks=6)
    with pytest.raises(InputError, match="compute_chunk_sizes"):
        smooth(data[data[:, 0] > 0])


def test_no_message_passes_on_advice_to_run_the_code_of_a_file(tmp_path):
    np.save(tmp_path / "o.npy", np.array([{}, None]), allow_pickle=True)
    (tmp_path / "p.npy").write_bytes(b"hello")
    (tmp_path / "p.vrt").write_text(
        '<VRTDataset rasterXSize="4" rasterYSize="4"><VRTRasterBand dataType="Float32" band="1" subClass="VRTDerivedRasterBand">'
        "<PixelFunctionType>f</PixelFunctionType><PixelFunctionLanguage>Python</PixelFunctionLanguage>"
        "<PixelFunctionCode>def f(*a): pass</PixelFunctionCode></VRTRasterBand></VRTDataset>"
    )
    for name in ("o.npy", "p.npy", "p.vrt"):
        with pytest.raises(InputError) as refusal:
            read(tmp_path / name)
        assert not re.search("pickle|unsafe|ENABLE|YES", str(refusal.value))
        assert "not read" in str(refusal.value) or "not run" in str(refusal.value)
    assert said_by(ValueError("a\n b")) == "a b"
    assert said_by(ValueError()) == "ValueError"


@pytest.mark.parametrize("word", ["99", "-9", "0"])
def test_a_face_of_an_obj_is_refused_with_the_number_of_the_file(tmp_path, word):
    (tmp_path / "f.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {word}\n")
    with pytest.raises(InputError, match=rf"\b{word}\b|f 1 2 {word}"):
        read(tmp_path / "f.obj")


@pytest.mark.parametrize(("count", "words"), [(2**31 - 1, "2147483647 triangles expected in 584"), (0, "500 bytes")])
def test_an_stl_that_lies_about_its_triangles_is_refused_with_what_it_says(tmp_path, count, words):
    (tmp_path / "lie.stl").write_bytes(bytes(80) + count.to_bytes(4, "little") + bytes(500))
    with pytest.raises(InputError, match=words):
        read(tmp_path / "lie.stl")


def test_names_that_are_no_files_are_refused_for_what_they_are(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, words in (
        (tmp_path / "loop", "a link to .*loop, which leads to no file"),
        ("https://example.com/a.tif", "download it first"),
        ("/dev/null", "^/dev/null is empty"),
    ):
        with pytest.raises(InputError, match=words):
            read(name)
    with pytest.raises(InputError, match="exists and is a folder; name a file in it .*--output"):
        meshflow.write(Z, tmp_path)


def test_methods_are_found_by_their_authors_and_by_the_keys_of_their_papers():
    assert all(word in METHODS for word in AUTHORS.values())
    assert [word_of(name) for name in ("Kornprost", "KDA97", "Rudin, Osher, Fatemi", "Alvarez")] == [
        "shock", "shock", "rof", "selective",
    ]  # fmt: skip
    for name in ("preusser-rumpf", "PR99"):
        with pytest.raises(InputError, match="meshflow.classics.field_picture"):
            smooth(Z, method=name)


def test_the_help_names_each_default_of_an_option_that_methods_share():
    helps = {flag.name: flag.help for flag in FLOW}
    for flag, words in (("sharpness", "Default: 1.0; perona-malik: 2.0"), ("patch", "Default: 0.0; patches: 0.7")):
        assert words in helps[flag]


def test_no_docstring_names_a_file_that_users_do_not_have():
    for file in Path(meshflow.__file__).parent.rglob("*.py"):
        assert "shared/" not in file.read_text(), file


def refused(monkeypatch, capsys, *words):
    """The line on stderr of a command that is refused."""
    monkeypatch.setattr(sys, "argv", ["meshflow", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def test_closed_and_full_streams_and_names_of_two_lines_are_refused_in_one_line(tmp_path, monkeypatch, capsys):
    assert "two\\nlines.tif: no such file" in refused(monkeypatch, capsys, "info", str(tmp_path / "two\nlines.tif"))
    with monkeypatch.context() as closed:
        closed.setattr(sys, "stdin", None)
        assert "stdin is closed" in refused(closed, capsys, "info", "-")
    with monkeypatch.context() as closed:
        closed.setattr(sys, "stdout", None)
        assert "stdout is closed" in refused(closed, capsys, "methods", "--json")
    full = OSError(ENOSPC, "No space left on device")
    monkeypatch.setattr(commands, "methods_table", lambda *given: (_ for _ in ()).throw(full))
    assert "stdout takes no more (No space left on device)" in refused(monkeypatch, capsys, "methods")
