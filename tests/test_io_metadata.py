"""What data does not say of itself: one set of options, and which apply to what. meshflow.io.metadata, files, document."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

from meshflow.errors import InputError
from meshflow.io.document import WriteOptions, Writing
from meshflow.io.files import FORMATS, read
from meshflow.io.metadata import Metadata, ReadOptions


def test_keywords_and_fields_are_the_same_names_of_the_same_types():
    assert get_type_hints(Metadata) == get_type_hints(ReadOptions)
    assert get_type_hints(Writing) == {k: t for k, t in get_type_hints(WriteOptions).items() if k != "tags"}


def test_every_option_that_a_format_names_exists():
    names = {field.name for field in fields(ReadOptions)}
    for entry in FORMATS:
        found = entry.load()
        assert set(found.READS) <= names, found.NAME
        assert set(found.WRITES) <= set(get_type_hints(Writing)), found.NAME


@pytest.mark.parametrize("name", [field.name for field in fields(ReadOptions)])
def test_what_was_not_said_is_not_given_and_what_was_said_is(name):
    words = {
        "allow_remote": True,
        "unit": "m",
        "kind": "mesh",
        "moves": "all",
        "measure": "range",
        "time_unit": "noise",
        "slices": "each",
    }
    said = ReadOptions.of({name: words.get(name, 0.5)})
    assert said.given == (name,)
    assert said.without(name).given == ()
    with pytest.raises(InputError, match=f"{name}: no option of a stone, which takes none"):
        said.must_belong("a stone", ())
    said.must_belong("a stone", (name,))


def test_a_name_that_is_no_option_is_refused_with_the_nearest_one():
    for wrong, right in (("spacng", "spacing"), ("depthscale", "depth_scale"), ("time_units", "time_unit")):
        with pytest.raises(InputError, match=f"{wrong}: no such option; did you mean {right}?"):
            ReadOptions.of({wrong: 1})
    with pytest.raises(InputError, match="xyzzy: no such option; there are kind, spacing"):
        ReadOptions.of({"xyzzy": 1})


def test_an_option_that_does_not_apply_is_refused_by_name_with_those_that_do(tmp_path):
    np.save(tmp_path / "z.npy", np.eye(4))
    with pytest.raises(InputError, match=r"band: no option of an array file \(z.npy\), which takes kind, spacing"):
        read(tmp_path / "z.npy", band=1)


def test_reading_and_writing_load_nothing_of_other_libraries_before_one_of_their_files_comes_in(tmp_path):
    np.save(tmp_path / "z.npy", np.eye(4))
    heavy = "rasterio trimesh pyvista vtk open3d xarray meshio OpenEXR matplotlib"
    code = (
        "import sys, meshflow.io.files as files, meshflow.io.objects as objects\n"
        f"objects.from_object(files.read({str(tmp_path / 'z.npy')!r}))\n"
        f"print(*sorted(set({heavy!r}.split()) & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[1])
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
