"""Exports a network for other programs: `psgn export --out=FOLDER`.

The folder gets ONNX files, a README on inputs, outputs, frame and framing, and an example each in
Python and JavaScript. Before we write a file, we compare its points with JAX's on random images.
The command fails if they differ by more than 1e-4, or 1e-2 with weights in float16. It needs the
extra `export`.
"""

import importlib.util
import sys
from collections.abc import Sequence
from typing import Any

from psgn_jax.commands.common import define_network_flags, keep_compiled, network_of
from psgn_jax.config.command_line import Flags
from psgn_jax.config.structured import ConfigError
from psgn_jax.portable.folder import ONNX_NAMES, write_folder
from psgn_jax.system.files import check_folder
from psgn_jax.weights.opening import open_weights, origins_of
from psgn_jax.weights.run_folder import Trained


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn export --out=FOLDER", __doc__)
    define_network_flags(flags)
    flags.path("out", None, "Folder for the files.")
    flags.list("weights_as", list(ONNX_NAMES), "Weights of the ONNX files: float32, float16.")
    return flags.run(_main, argv)


def open_to_export(values: Any) -> Trained:
    """Checks what an export needs, then opens the network that the flags name."""
    if importlib.util.find_spec("onnx") is None:
        raise ConfigError("onnx: not installed; pip install 'psgn-jax[export]'")
    check_folder(values.out, "--out")
    keep_compiled()
    network = open_weights(**network_of(values))
    if network.source_kind == "workdir":
        network = network._replace(sources=origins_of(network.config)[1])
    return network


def _main(flags: Flags) -> None:
    values = flags.values
    write_folder(open_to_export(values), values.out, weights=values.weights_as)
    sys.stdout.write(f"{values.out}: see README.md there\n")
