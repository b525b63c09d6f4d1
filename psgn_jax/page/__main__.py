"""A web page that runs a network in the browser: `python -m psgn_jax.page --out=FOLDER`.

The network is given by `--weights=NAME|FILE` or by a run, `--workdir=W`; without either, the
default weights of the package are used, if it has any. Any file server can serve the folder, for
example `python -m http.server`. The page loads nothing from other hosts: reading a photo, finding
the mask and predicting the points all run on the visitor's device. ONNX Runtime Web is downloaded
by npm the first time and kept in the cache folder; `--runtime=FOLDER|TGZ` reads it from another
place. The command needs the extra `export`.

Exit code: 0, or 2 after an error, which is reported in one line; `docs/reliability.md` lists the
exit codes of a full disk and of Ctrl-C.
"""

import sys
from collections.abc import Sequence

from absl import app, flags

from psgn_jax.command_line import (
    define_network_flags,
    flags_only,
    keep_compiled,
    parse_flags,
)
from psgn_jax.page.build import build_page
from psgn_jax.portable.runtime import require_packages
from psgn_jax.weights.opening import open_network


def _main(argv: Sequence[str]) -> None:
    with flags_only(argv) as values:
        require_packages()
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        size = build_page(
            network,
            values.out,
            weights=values.weights_as,
            runtime=values.runtime,
            data=values.data,
            split=values.split,
        )
        sys.stdout.write(
            f"{values.out}: {size / 1e6:.1f} MB; "
            f"to open it: python -m http.server --directory {values.out}\n"
        )


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("out", None, "Folder for the page.", required=True)
    flags.DEFINE_enum(
        "weights_as", "float16", ["float32", "float16", "int8"], "Format of the page's weights."
    )
    flags.DEFINE_string("runtime", "", "Folder or .tgz with onnxruntime-web; default: from npm.")
    flags.DEFINE_string("data", "", "Folder of records for checking the exported network.")
    flags.DEFINE_string("split", "validation", "Split of the records.")
    app.run(_main, flags_parser=parse_flags)
