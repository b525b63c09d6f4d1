import concurrent.futures
import errno
import os
import pathlib
import stat

import pytest
from helpers.processes import without_room
from helpers.refusals import all_refused, check_message, refused

from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import LossConfig
from psgn_jax.system import errors, files
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import check_folder, write_atomic


def test_a_write_that_fails_names_its_file_and_leaves_it(tmp_path):
    path = tmp_path / "new" / "file"
    write_atomic(path, "one")
    with without_room(), pytest.raises(OSError, match="File too large") as caught:
        write_atomic(path, "two" * 1000)
    assert caught.value.filename == str(path)
    assert errors.is_disk_full(caught.value)
    assert path.read_text() == "one"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_folders_that_cannot_be_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    table = [("file", "a file"), ("file/a",), ("new/" + "a" * 300, "aaa..."), ("", "empty")]
    table += [(address, address) for address in ("gs://bucket/x", "hdfs://a/b", "https://a.b/c")]
    table += [("~nobody-has-this-name/x", "no such user", "./~nobody")]
    table = [(folder, "--out=", *names) for folder, *names in table]
    all_refused(lambda folder: check_folder(folder, "--out"), UserError, table)
    monkeypatch.delattr(pathlib.Path, "mkdir")  # others may create a folder at the same time
    for folder in (tmp_path / "a" / "b", tmp_path):
        check_folder(folder, "--out")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_the_home_of_a_user_is_found_in_every_path(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    flags = Flags("psgn anything", "")
    flags.path("out", "~/results", "A folder.")
    flags.path("runs", [], "Folders.", "list")
    flags.config(LossConfig())
    (tmp_path / "c.py").write_text(
        "import ml_collections\ndef get_config():\n    return ml_collections.ConfigDict()\n"
    )
    assert flags.run(print, ["--out="]) == 2
    check_message(capsys.readouterr().err, "--out=", "empty")
    given = ["--out=~/x", "--runs=~/a,b", "--config=~/c.py"]

    def shown(flags):
        print(flags.values.out, flags.values.runs, flags.config_file)

    assert flags.run(shown, given) == 0
    assert capsys.readouterr().out == f"{tmp_path}/x ['{tmp_path}/a', 'b'] {tmp_path}/c.py\n"
    assert files.local_path("~/results", "out") == f"{tmp_path}/results"
    assert files.local_path("a~/b", "out") == "a~/b"
    monkeypatch.setenv("PSGN_CACHE", "~/c")
    assert files.cache_folder() == tmp_path / "c"
    assert files.local_path("~root/x", "out") == f"{os.path.expanduser('~root')}/x"


def test_a_file_is_written_where_folders_cannot_be_flushed(tmp_path, monkeypatch):
    def fsync(descriptor, kept=os.fsync):
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "Invalid argument")
        kept(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    write_atomic(tmp_path / "file", "one")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_is_known_by_number_and_cause_and_not_by_a_name():
    def raised(cause):
        error = ValueError("x")
        error.__cause__ = cause
        return error

    text = "No space left on device"
    path = pathlib.Path(f"/{text}/shard")
    for error, full in (
        (OSError(errno.ENOSPC, "x"), True),
        (raised(OSError(errno.EDQUOT, "x")), True),
        (OSError(errno.EACCES, "x"), False),
        (UserError(f"{text}.jpg: not an image"), False),
        (FileNotFoundError(errno.ENOENT, text, f"/photos/{text}.jpg"), False),
        (errors.native_error(RuntimeError(f"{path}: write: {text}"), path), True),
        (errors.native_error(RuntimeError(f"writing {path}: I/O error"), path), False),
    ):
        assert errors.is_disk_full(error) == full, error


def test_threads_that_write_the_same_file_leave_a_whole_one(tmp_path):
    path, contents = tmp_path / "file", [bytes([i]) * 100_000 for i in range(8)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        writes = [pool.submit(write_atomic, path, c, sync=False) for c in contents * 20]
        while not all(write.done() for write in writes):
            if path.exists():
                assert path.read_bytes() in contents
    for write in writes:
        write.result()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_user_without_a_home_is_told_to_name_a_cache(monkeypatch, tmp_path):
    def no_home(_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(pathlib.Path, "home", classmethod(no_home))
    monkeypatch.setenv("PSGN_CACHE", str(tmp_path))
    assert files.cache_folder() == tmp_path
    monkeypatch.delenv("PSGN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert files.cache_folder() == tmp_path / "psgn_jax"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    with refused(UserError, "PSGN_CACHE"):
        files.cache_folder()
