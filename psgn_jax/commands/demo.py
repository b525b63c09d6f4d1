"""Serves a web page on which a network can be tried on photos: `psgn demo`.

The page is served to this machine only, unless `--host` is given; nothing is sent anywhere. Files
may have up to 25 MB. The page writes into a temporary folder, which is removed when the process
ends; that of a killed process is removed at the next start.
"""

import contextlib
import os
import shutil
import signal
import socket
import sys
from collections.abc import Sequence

from absl import app, flags, logging

from psgn_jax.commands.common import define_network_flags, flags_only, keep_compiled, parse_flags
from psgn_jax.config.experiment import ConfigError
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.web import demo
from psgn_jax.weights.opening import open_network

_LOCAL = ("localhost", "127.0.0.1", "[::1]")


def listen(host: str, port: int) -> socket.socket:
    """A socket bound to an address.

    Raises:
      ConfigError: there is no such address here, or the port is taken or not allowed.
    """
    try:
        kind, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address[:2], family=kind)
    except (OSError, UnicodeError, OverflowError, ValueError) as error:
        text = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"--host={host} --port={port}: cannot listen there: {text}") from None


def _main(argv: Sequence[str]) -> None:
    # uvicorn raises the signal that ended it again; the folder is removed then.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with flags_only(argv) as values, contextlib.suppress(KeyboardInterrupt):
        folder = demo.temporary_folder()
        try:
            os.environ["GRADIO_TEMP_DIR"] = str(folder / "gradio")  # read by gradio's import
            demo.import_gradio()
            # The port is opened before the network is read, which takes longer.
            with listen(values.host, values.port) as listener:
                keep_compiled()
                predictor = Predictor(
                    open_network(values.workdir, values.weights, values.checkpoint)
                )
                predictor.warm_up()
                hosts = [*_LOCAL, *values.allowed_hosts]
                if values.host not in _LOCAL:
                    logging.warning("--host=%s: other machines can reach the page", values.host)
                    hosts += [values.host, socket.gethostname(), socket.getfqdn()]
                sys.stdout.write(f"http://{values.host}:{listener.getsockname()[1]}/\n")
                sys.stdout.flush()
                demo.serve(demo.Demo(predictor, folder / "out"), listener, hosts)
        finally:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("host", "127.0.0.1", "Address to listen on.")
    flags.DEFINE_integer("port", 7860, "Port to listen on; 0 = a free one.")
    flags.DEFINE_list(
        "allowed_hosts", [], "Further host names of this server, such as that of a proxy."
    )
    app.run(_main, flags_parser=parse_flags)
