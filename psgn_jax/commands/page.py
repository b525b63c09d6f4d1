"""A web page that runs a network in the browser: `psgn page --out=FOLDER`.

Any file server can serve the folder, for example `python -m http.server`. The page loads nothing
from other hosts: reading a photo and its mask and predicting the points run on the visitor's
device. ONNX Runtime Web is downloaded by npm the first time and kept in the cache folder;
`--runtime=FOLDER|TGZ` reads it from another place. The command needs the extra `export`.
"""

import sys
from collections.abc import Sequence

from absl import app, flags

from psgn_jax.commands.common import define_network_flags, flags_only, keep_compiled, parse_flags
from psgn_jax.portable.folder import require_packages
from psgn_jax.system.files import check_folder
from psgn_jax.web.page.build import build_page
from psgn_jax.weights.opening import open_network


def _main(argv: Sequence[str]) -> None:
    with flags_only(argv) as values:
        require_packages()
        check_folder(values.out, "--out")
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        options = {name: getattr(values, name) for name in ("runtime", "data", "split")}
        size = build_page(network, values.out, weights=values.weights_as, **options)
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
