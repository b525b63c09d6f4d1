"""Writes the page's folder: JavaScript modules, network, runtime and example photos."""

import gzip
import json
import os
import pathlib

from psgn_jax.portable.folder import write_network
from psgn_jax.prediction import mask_networks, masks
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing.viewer import CLOUD_SCRIPT
from psgn_jax.web.browser.runtime import runtime_files
from psgn_jax.weights.run_folder import Trained

_WASM = "runtime/ort-wasm-simd-threaded.wasm"
MASK_RULES = ["DOUBTFUL_BELOW", "BORDER", "JOINED", "LEAST_PART", "REACH", "MARGINS", "WINDOWS"]
STATIC = pathlib.Path(__file__).resolve().parent / "static"


def build_page(
    run: Trained, out: str | os.PathLike[str], *, weights: str = "float16", runtime: str = ""
) -> int:
    """Writes the page, or replaces an earlier one; returns its size in bytes.

    Args:
      weights: the stored type, see `portable.folder.write_network`.
      runtime: see `runtime.runtime_files`.
    """
    out = pathlib.Path(out)
    files = {f"runtime/{name}": content for name, content in runtime_files(runtime).items()}
    files[f"{_WASM}.gz"] = gzip.compress(files.pop(_WASM), mtime=0)  # 14 MB become 4
    for path in STATIC.rglob("*"):
        if path.is_file():
            files[path.relative_to(STATIC).as_posix()] = path.read_bytes()
    files[CLOUD_SCRIPT.name] = CLOUD_SCRIPT.read_bytes()
    network = write_network(run, out, weights=(weights,))
    mask_network = mask_networks.FILE.name
    files[mask_network] = mask_networks.FILE.read_bytes()
    network["mask_network"] = {
        "file": mask_network,
        "side": mask_networks.SIDE,
        "mean": mask_networks.MEAN,
        "deviation": mask_networks.DEVIATION,
        **{name.lower(): getattr(masks, name) for name in MASK_RULES},
    }
    network["sources"] += [mask_networks.SOURCE]
    sizes = [row["bytes"] for row in network["files"].values()]
    network["download_bytes"] = sum(sizes) + len(files[mask_network]) + len(files[f"{_WASM}.gz"])
    files["network.json"] = json.dumps(network, indent=1).encode()
    for name, content in files.items():
        write_atomic(out / name, content, sync=False)
    return sum(map(len, files.values())) + sum(sizes)
