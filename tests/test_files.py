import pytest

from psgn_jax import files
from psgn_jax.files import write_atomic


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
