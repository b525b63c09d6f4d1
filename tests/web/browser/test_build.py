import hashlib
import io
import os
import tarfile

import pytest
from helpers.commands import psgn
from helpers.refusals import all_refused, refused

from psgn_jax.config.experiment import ConfigError
from psgn_jax.web.browser import runtime as lib


@pytest.fixture
def small_runtime(monkeypatch):
    """Replaces the runtime's files by files of a few bytes; returns these."""
    files = {name: name.encode() * 3 for name in lib.FILES}
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    monkeypatch.setattr(lib, "FILES", digests)
    return files


def archive(path, files):
    with tarfile.open(path, "w:gz") as tar:
        for name, content in files.items():
            member = tarfile.TarInfo(f"package/dist/{name}")
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))
    return path


def test_a_folder_or_an_archive_of_the_runtime_and_nothing_else(tmp_path, small_runtime):
    with refused(ConfigError, "ort.wasm.min.mjs", lib.VERSION):
        lib.runtime_files(tmp_path)
    (tmp_path / "dist").mkdir()
    for name, content in small_runtime.items():
        (tmp_path / "dist" / name).write_bytes(content)
    assert lib.runtime_files(tmp_path) == small_runtime
    assert lib.runtime_files(archive(tmp_path / "a.tgz", small_runtime)) == small_runtime
    changed = {**small_runtime, "ort-wasm-simd-threaded.wasm": b"x"}
    (tmp_path / "text").write_text("no archive")
    table = [(archive(tmp_path / "c.tgz", changed), "threaded.wasm"), (tmp_path / "none", "none")]
    table += [(tmp_path / "text", "text", ".tgz"), ("/dev/zero", "/dev/zero", "device")]
    link = tarfile.TarInfo("package/dist/ort.wasm.min.mjs")
    link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
    with tarfile.open(tmp_path / "link.tgz", "w:gz") as tar:
        tar.addfile(link)
    table.append((tmp_path / "link.tgz", "ort.wasm.min.mjs"))
    all_refused(lib.runtime_files, ConfigError, table)


def test_npm_fills_the_cache_or_the_way_out_is_named(tmp_path, small_runtime, monkeypatch):
    monkeypatch.setenv("PSGN_CACHE", str(tmp_path / "cache"))
    commands = []

    def pack(command, cwd, **_):
        commands.append(command[1:])
        archive(cwd / "onnxruntime-web.tgz", small_runtime)

    with monkeypatch.context() as patch:
        patch.setattr(lib.shutil, "which", lambda _: "npm")
        patch.setattr(lib.subprocess, "run", pack)
        for _ in range(2):
            assert lib.runtime_files() == small_runtime
        assert commands == [["pack", "--silent", f"onnxruntime-web@{lib.VERSION}"]]
        (damaged,) = (tmp_path / "cache").rglob("*.wasm")
        damaged.write_bytes(b"")
        assert lib.runtime_files() == small_runtime
        assert len(commands) == 2
        patch.setenv("PSGN_CACHE", os.devnull)  # nothing can be kept there
        assert lib.runtime_files() == small_runtime
    monkeypatch.setenv("PSGN_CACHE", str(tmp_path))
    for npm in (None, "false"):
        monkeypatch.setattr(lib.shutil, "which", lambda _, npm=npm: npm)
        with refused(ConfigError, "npm pack", "`runtime`"):
            lib.runtime_files()


def test_the_default_page_warns_of_nothing_and_stays_small(tmp_path, runtime):
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    done = psgn("page", f"--out={tmp_path}", *[f"--runtime={runtime}"] * bool(runtime))
    (line,) = done.stderr.splitlines()
    assert "network_float16.onnx: 10.7 MB, largest difference" in line
    size = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    assert done.stdout == f"{tmp_path}: {size / 1e6:.1f} MB\n"
    assert size < 22e6
