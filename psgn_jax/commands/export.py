"""Exports a network for other programs: `psgn export --out=FOLDER`.

The folder will contain ONNX files, a StableHLO program, a README on inputs, outputs, frame and
framing, and one example each in Python and JavaScript. Each file is compared with JAX before it is
written: on the images of `--data=RECORDS`, or on random images. It is an error if the points of a
float32 file differ by more than 1e-4, or if any file changes the mean CD (measured only with
`--data`) by more than 1 %. The command needs the extra `export`.
"""

import sys
from collections.abc import Sequence
from typing import Any

from psgn_jax.commands.common import define_network_flags, keep_compiled
from psgn_jax.config.command_line import Flags
from psgn_jax.portable.folder import require_packages, write_folder
from psgn_jax.system.files import check_folder
from psgn_jax.weights.opening import open_network
from psgn_jax.weights.origin import sources_of
from psgn_jax.weights.run_folder import Trained


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn export --out=FOLDER", __doc__)
    define_network_flags(flags)
    flags.string("out", None, "Folder for the files.")
    flags.list(
        "weights_as", ["float32", "float16"], "Weights of the ONNX files: float32, float16, int8."
    )
    flags.bool("stablehlo", True, "Whether to write the StableHLO program.")
    flags.string("data", "", "Folder of records to check the files on.")
    flags.string("split", "validation", "Split of the records.")
    return flags.run(_main, argv)


def open_to_export(values: Any) -> Trained:
    """Opens the network that the flags name, after checks of what an export needs."""
    require_packages()
    check_folder(values.out, "--out")
    keep_compiled()
    network = open_network(values.workdir, values.weights, values.checkpoint)
    if network.source_kind == "workdir":
        network = network._replace(sources=sources_of(network.config))
    return network


def _main(flags: Flags) -> None:
    values = flags.values
    network = open_to_export(values)
    options = {name: values[name].value for name in ("stablehlo", "data", "split")}
    write_folder(network, values.out, weights=values.weights_as, **options)
    sys.stdout.write(f"{values.out}: see README.md there\n")
