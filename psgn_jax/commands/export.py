"""Exports a network for other programs: `psgn export --out=FOLDER`.

The folder will contain ONNX files, a StableHLO program, a README on inputs, outputs, frame and
framing, and one example each in Python and JavaScript. Each file is compared with JAX before it is
written: on the images of `--data=RECORDS`, or on random images. It is an error if the points of a
float32 file differ by more than 1e-4, or if any file changes the mean CD (measured only with
`--data`) by more than 1 %. The command needs the extra `export`.
"""

import sys
from collections.abc import Sequence

from absl import app, flags

from psgn_jax.commands.common import define_network_flags, flags_only, keep_compiled, parse_flags
from psgn_jax.portable.folder import require_packages, write_folder
from psgn_jax.system.files import check_folder
from psgn_jax.weights.opening import open_network


def _main(argv: Sequence[str]) -> None:
    with flags_only(argv) as values:
        require_packages()
        check_folder(values.out, "--out")
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        options = {name: values[name].value for name in ("stablehlo", "data", "split")}
        write_folder(network, values.out, weights=values.weights_as, **options)
        sys.stdout.write(f"{values.out}: see README.md there\n")


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("out", None, "Folder for the files.", required=True)
    flags.DEFINE_list(
        "weights_as", ["float32", "float16"], "Weights of the ONNX files: float32, float16, int8."
    )
    flags.DEFINE_bool("stablehlo", True, "Whether to write the StableHLO program.")
    flags.DEFINE_string("data", "", "Folder of records to check the files on.")
    flags.DEFINE_string("split", "validation", "Split of the records.")
    app.run(_main, flags_parser=parse_flags)
