import errno
import os

import pytest
from helpers.disk import without_room

from psgn_jax.system import files
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import check_folder, write_atomic


def test_write_atomic_replaces_whole_files(tmp_path, monkeypatch):
    path = tmp_path / "new" / "file"
    write_atomic(path, "one")
    assert path.read_text() == "one"

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(files.os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, "two")
    assert path.read_text() == "one"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_a_write_that_fails_names_its_file(tmp_path):
    path = tmp_path / "file"
    write_atomic(path, "one")
    with without_room(), pytest.raises(OSError, match="File too large") as caught:
        write_atomic(path, "two" * 1000)
    assert caught.value.filename == str(path)
    assert files.is_disk_full(caught.value)
    assert path.read_text() == "one"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("folder", "why"),
    [
        ("FILE", "it is a file"),
        ("FILE/a", "Not a directory"),
        ("/proc/a/b", "No such file or directory"),
        ("a" * 300, "File name too long"),
        ("new/" + "a" * 300, "File name too long"),
        ("", "the name is empty"),
    ],
)
def test_folders_that_cannot_be_written(folder, why, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(UserError, match=why) as caught:
        check_folder(folder.replace("FILE", str(file)), "--out")
    assert str(caught.value).startswith("--out=")
    assert len(str(caught.value)) < 200
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_folders_that_can_be_written_are_left_as_they_were(tmp_path):
    for folder in (tmp_path / "a" / "b", tmp_path):
        check_folder(folder, "--out")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(UserError, match="Permission denied"):
        check_folder(tmp_path, "--out")


def test_a_full_disk_is_known_by_number_text_and_cause():
    def raised(cause):
        error = ValueError("x")
        error.__cause__ = cause
        return error

    assert files.is_disk_full(OSError(errno.ENOSPC, "x"))
    assert files.is_disk_full(RuntimeError("write() failed: No space left on device; writing"))
    assert files.is_disk_full(raised(OSError(errno.EDQUOT, "x")))
    assert not files.is_disk_full(OSError(errno.EACCES, "x"))
    assert not files.is_disk_full(raised(None))
