"""Builds the page's folder: JavaScript modules, the network, the runtime and example photos."""

import gzip
import json
import os
import pathlib

import numpy as np

from psgn_jax.models.mask_net import MaskNet
from psgn_jax.portable.folder import write_network
from psgn_jax.portable.network import InputSpec
from psgn_jax.prediction import masks
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing.page import CLOUD_SCRIPT
from psgn_jax.web.page.browser_runtime import runtime_files
from psgn_jax.weights.mask import read_mask_network
from psgn_jax.weights.run_folder import Trained

MASK_NETWORK = "mask.onnx"
_WASM = "runtime/ort-wasm-simd-threaded.wasm"
STATIC = pathlib.Path(__file__).resolve().parent / "static"


def build_page(
    run: Trained,
    out: str | os.PathLike[str],
    *,
    weights: str = "float16",
    runtime: str = "",
    data: str = "",
    split: str = "validation",
) -> int:
    """Writes the page, or replaces an earlier one; returns its size in bytes.

    Args:
      weights: how weights are stored, see `portable.folder.write_network`.
      runtime: see `browser_runtime.runtime_files`.
    """
    out = pathlib.Path(out)
    files = {f"runtime/{name}": content for name, content in runtime_files(runtime).items()}
    files[f"{_WASM}.gz"] = gzip.compress(files.pop(_WASM), mtime=0)  # 14 MB become 4
    for path in STATIC.rglob("*"):
        if path.is_file():
            files[path.relative_to(STATIC).as_posix()] = path.read_bytes()
    files[CLOUD_SCRIPT.name] = CLOUD_SCRIPT.read_bytes()
    from psgn_jax.portable.onnx_file import to_onnx  # imports onnx

    network = write_network(run, out, weights=(weights,), stablehlo=False, data=data, split=split)
    params, texts = read_mask_network()
    files[MASK_NETWORK] = to_onnx(
        lambda image: MaskNet().apply({"params": params}, image / np.float32(255)),
        [InputSpec("image", "uint8", (1, masks.SIDE, masks.SIDE, 3))],
        "probabilities",
        "float16",
        {},
    )
    network["mask_network"] = {
        "file": MASK_NETWORK,
        "side": masks.SIDE,
        "doubtful_below": masks.DOUBTFUL_BELOW,
        "middle": masks.MIDDLE,
        "least_agreement": masks.LEAST_AGREEMENT,
    }
    network["sources"] += texts["sources"]
    sizes = [row["bytes"] for row in network["files"].values()]
    network["download_bytes"] = sum(sizes) + len(files[MASK_NETWORK]) + len(files[f"{_WASM}.gz"])
    files["network.json"] = json.dumps(network, indent=1).encode()
    for name, content in files.items():
        write_atomic(out / name, content, sync=False)
    return sum(map(len, files.values())) + sum(sizes)
