"""Writes a web page that runs a network in the browser: `psgn page --out=FOLDER`.

`--serve` serves the folder to the browsers of this machine and prints the address; any other file
server can serve it, too. The page loads nothing from other hosts: the visitor's device reads the
photo, finds the mask and predicts the points. The first call downloads ONNX Runtime Web by npm into
the cache folder; `--runtime=FOLDER|TGZ` reads it from another place. The command needs the extra
`export`.
"""

import contextlib
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.commands.common import define_network_flags
from psgn_jax.commands.export import open_to_export
from psgn_jax.config.command_line import Flags
from psgn_jax.portable.folder import ONNX_NAMES
from psgn_jax.system.untrusted import one_line
from psgn_jax.web.browser.build import build_page
from psgn_jax.web.browser.serve import server


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn page", __doc__)
    define_network_flags(flags)
    flags.path("out", "page", "Folder for the page.")
    flags.enum("weights_as", "float16", list(ONNX_NAMES), "Type of the page's weights.")
    flags.path("runtime", "", "Folder or .tgz with onnxruntime-web; default: from npm.")
    flags.bool("serve", False, "Serve the page to this machine, until Ctrl-C.")
    flags.integer("port", 0, "Port of --serve; 0 = a free one.")
    return flags.run(_main, argv)


def _main(flags: Flags) -> None:
    values = flags.values
    network = open_to_export(values)
    size = build_page(network, values.out, weights=values.weights_as, runtime=values.runtime)
    sys.stdout.write(f"{one_line(values.out)}: {size / 1e6:.1f} MB\n")
    if not values.serve:
        return
    with server(pathlib.Path(values.out), values.port) as running:
        # Not localhost: another program may listen on that name's IPv6 address.
        sys.stdout.write(f"http://127.0.0.1:{running.server_port}/ (Ctrl-C ends it)\n")
        sys.stdout.flush()
        with contextlib.suppress(KeyboardInterrupt):
            running.serve_forever()
