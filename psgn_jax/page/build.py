"""Builds the page's folder: JavaScript modules, the network, the runtime and example photos."""

import hashlib
import os
import pathlib

from absl import logging

from psgn_jax.files import write_atomic
from psgn_jax.page.browser_runtime import VERSION, runtime_files
from psgn_jax.portable.folder import write_network
from psgn_jax.training.run_folder import Run

STATIC = pathlib.Path(__file__).resolve().parent / "static"
LARGEST = 30_000_000
"""Size in bytes above which a warning is logged: a larger page may not open well on a phone."""

_LICENCE = f"""ONNX Runtime Web {VERSION}, MIT License

Copyright (c) Microsoft Corporation

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
associated documentation files (the "Software"), to deal in the Software without restriction,
including without limitation the rights to use, copy, modify, merge, publish, distribute,
sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial
portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
NONINFRINGEMENT.
IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
"""


def build_page(
    run: Run,
    out: str | os.PathLike[str],
    *,
    weights: str = "float16",
    runtime: str = "",
    data: str = "",
    split: str = "validation",
) -> int:
    """Writes the page; returns its size in bytes.

    Args:
      run: the network.
      out: folder, created if missing; files of an earlier page are replaced.
      weights: how weights are stored, see `portable.folder.write_network`.
      runtime: source of the runtime, see `browser_runtime.runtime_files`.
      data: folder of records for the check, see `portable.folder.write_network`.
      split: split of the records.

    Raises:
      ConfigError, ExportError: see `portable.folder.write_network` and `runtime_files`.
    """
    out = pathlib.Path(out)
    files = {f"runtime/{name}": content for name, content in runtime_files(runtime).items()}
    files["runtime/LICENSE.txt"] = _LICENCE.encode()
    for path in sorted(STATIC.rglob("*")):
        if path.is_file():
            files[path.relative_to(STATIC).as_posix()] = path.read_bytes()
    written = write_network(run, out, weights=(weights,), stablehlo=False, data=data, split=split)
    # The page checks network.json against this checksum, and the network against network.json.
    digest = hashlib.sha256((out / "network.json").read_bytes()).hexdigest()
    files["network.sha256"] = f"{digest}\n".encode()
    for name, content in files.items():
        write_atomic(out / name, content, sync=False)
    names = [*files, *written]
    size = sum((out / name).stat().st_size for name in names)
    if size > LARGEST:
        logging.warning(
            "%s has %.1f MB; more than %d MB may not open well on a phone; "
            "--weights_as=int8 --data=RECORDS makes the network smaller",
            out,
            size / 1e6,
            LARGEST // 1_000_000,
        )
    return size
