"""A file is whole, or it is the old one: meshflow.io.atomic_write."""

import os

import pytest

from meshflow.errors import FormatError
from meshflow.io.atomic_write import beside


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write_half(path, failure, *sidecars):
    with beside(path) as temporary:
        temporary.write_bytes(b"half")
        for sidecar in sidecars:
            temporary.with_name(temporary.name + sidecar).write_bytes(b"sidecar")
        temporary.with_suffix(".prj").write_bytes(b"sidecar")
        raise failure


@pytest.fixture
def old(tmp_path):
    path = tmp_path / "dem.tif"
    path.write_bytes(b"old")
    return path


def test_what_was_written_takes_the_place_of_the_old_file(old):
    with beside(old) as temporary:
        assert temporary.parent == old.parent
        assert temporary.suffix == old.suffix
        temporary.write_bytes(b"new")
        assert old.read_bytes() == b"old"
    assert old.read_bytes() == b"new"
    assert names(old.parent) == ["dem.tif"]


@pytest.mark.parametrize("failure", [RuntimeError("broken"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_file_and_nothing_else(old, failure):
    with pytest.raises(type(failure)):
        write_half(old, failure, ".aux.xml")
    assert old.read_bytes() == b"old"
    assert names(old.parent) == ["dem.tif"]


def test_a_full_disk_is_refused_by_name_and_reason(old):
    with pytest.raises(FormatError, match=r"dem\.tif was not written \(No space left on device\)"):
        write_half(old, OSError(28, "No space left on device"))
    assert old.read_bytes() == b"old"
    assert names(old.parent) == ["dem.tif"]


def test_a_replacement_that_fails_leaves_the_old_file(old, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(FormatError, match="Permission denied"), beside(old) as temporary:
        temporary.write_bytes(b"new")
    assert old.read_bytes() == b"old"
    assert names(old.parent) == ["dem.tif"]


def test_a_writer_that_wrote_nothing_is_an_error(old):
    with pytest.raises(FormatError, match=r"dem\.tif was not written"), beside(old):
        pass
    assert old.read_bytes() == b"old"


def test_sidecars_of_the_old_file_go_with_it_and_others_stay(old):
    for name in ("dem.tif.aux.xml", "dem.tif.ovr", "dem.tif.msk", "dem2.tif.aux.xml", "dem.prj"):
        (old.parent / name).write_bytes(b"about the old")
    with beside(old) as temporary:
        temporary.write_bytes(b"new")
    assert names(old.parent) == ["dem.prj", "dem.tif", "dem2.tif.aux.xml"]


def test_links_and_permissions_stay(old):
    old.chmod(0o640)
    link = old.with_name("link.tif")
    link.symlink_to(old)
    with beside(link) as temporary:
        temporary.write_bytes(b"new")
    assert link.is_symlink()
    assert old.read_bytes() == b"new"
    assert old.stat().st_mode & 0o777 == 0o640
