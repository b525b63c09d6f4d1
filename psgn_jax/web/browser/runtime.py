"""ONNX Runtime Web, which runs the network in the browser. It is not part of the repository.

`npm pack` downloads the package `onnxruntime-web` once into the cache folder. On a machine without
npm or network, `--runtime` names a folder or an archive of the same version. We verify the checksum
of every file.
"""

import contextlib
import hashlib
import os
import pathlib
import shutil
import subprocess
import tarfile
import tempfile

from absl import logging

from psgn_jax.config.experiment import ConfigError
from psgn_jax.system.files import cache_folder, write_atomic
from psgn_jax.system.untrusted import message_line, reason_of, size_of

VERSION = "1.30.0"
FILES = {
    "ort.wasm.min.mjs": "219e6a1fc8a9938268d18efca3c91d310bd2f4a59bbd13744df5b2b7fc6cee3b",
    "ort-wasm-simd-threaded.mjs": (
        "e13f7f94fc51b4ca72b12faeb1ee95f4ace6dfbc8939bc718aabdc0a27c4299b"
    ),
    "ort-wasm-simd-threaded.wasm": (
        "3398c10d07d229bd91b364548e130e0e51a8e5704b88c7c083ebbeb78842dee2"
    ),
}
"""File in the package's folder `dist` -> SHA-256."""

_MAX_BYTES = 64 << 20  # of one file
_REMEDY = (
    f"run `npm pack onnxruntime-web@{VERSION}` on a machine with network access, and name the file "
    f"onnxruntime-web-{VERSION}.tgz (`runtime`)"
)


def runtime_files(given: str | os.PathLike[str] = "") -> dict[str, bytes]:
    """Name -> content of the runtime's files, from a folder or `.tgz`; "" = the cache or npm.

    Raises:
      ConfigError: the files are not available, or a checksum differs.
    """
    if given:
        return _checked(_read(pathlib.Path(given)), f"runtime={given}")
    kept = cache_folder() / f"onnxruntime-web-{VERSION}"
    with contextlib.suppress(ConfigError, OSError):  # it is incomplete, damaged or unreadable
        return _checked(_read(kept), str(kept))
    with tempfile.TemporaryDirectory(prefix="psgn-page-") as folder:
        files = _checked(_read(_packed(pathlib.Path(folder))), "the npm registry's package")
    try:
        for name, content in files.items():
            write_atomic(kept / name, content, sync=False)
    except OSError as error:
        logging.warning("onnxruntime-web is not kept: %s", message_line(error))
    return files


def _packed(folder: pathlib.Path) -> pathlib.Path:
    npm = shutil.which("npm")
    if npm is None:
        raise ConfigError(f"onnxruntime-web: npm is not installed; {_REMEDY}")
    logging.info("downloading onnxruntime-web %s (33 MB) with npm", VERSION)
    command = [npm, "pack", "--silent", f"onnxruntime-web@{VERSION}"]
    try:
        subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder, check=True)
    except subprocess.TimeoutExpired:
        raise ConfigError(f"onnxruntime-web: no answer from npm in 300 s; {_REMEDY}") from None
    except subprocess.CalledProcessError as error:
        why = " ".join((error.stderr or error.stdout).split())[-160:]
        raise ConfigError(f"onnxruntime-web: npm could not fetch it ({why}); {_REMEDY}") from None
    return next(folder.glob("*.tgz"))


def _read(path: pathlib.Path) -> dict[str, bytes]:
    """The files in a folder (or its `dist`) or in npm's archive."""
    if path.is_dir():
        folder = path / "dist" if (path / "dist").is_dir() else path
        return {name: (folder / name).read_bytes() for name in FILES if (folder / name).is_file()}
    files = {}
    try:
        size_of(path)
        with tarfile.open(path) as archive:
            for member in archive:
                name = member.name.removeprefix("package/dist/")
                content = archive.extractfile(member) if member.isreg() else None
                if content and name in FILES:
                    files[name] = content.read(_MAX_BYTES)
    except (OSError, EOFError, tarfile.TarError) as error:
        message = f"runtime={path}: {reason_of(error)}; expected a folder or a .tgz"
        raise ConfigError(message) from None
    return files


def _checked(files: dict[str, bytes], source: str) -> dict[str, bytes]:
    for name, digest in FILES.items():
        if name not in files:
            raise ConfigError(f"{source}: {name} is missing; expected onnxruntime-web {VERSION}")
        if hashlib.sha256(files[name]).hexdigest() != digest:
            raise ConfigError(
                f"{source}: {name} has another checksum; expected that of onnxruntime-web {VERSION}"
            )
    return files
