"""Serves a web page on which a network can be tried on photos: `python -m psgn_jax.demo`.

The network is read from weights, `--weights=NAME|FILE`, or from a run, `--workdir=W`. Without
either flag, the package's default weights are used.

Drop a photo, correct the automatic mask with brush and eraser, choose the number of samples and the
seed, rotate the result, and download its files, which are those of `psgn_jax.predict`. The page is
served to this machine only, unless `--host` is given; nothing is sent anywhere. Requests from other
sites that are open in the same browser are refused. Files may have up to 25 MB, and one large photo
is read at a time. The page writes into a temporary folder, which is deleted when the process ends.
Results that are older than an hour are deleted at the next prediction.
"""

import contextlib
import os
import pathlib
import signal
import sys
import tempfile
import time
from collections.abc import Sequence

from absl import app, flags, logging

from psgn_jax.command_line import (
    define_network_flags,
    exit_on_user_error,
    keep_compiled,
    log_to_terminal,
    parse_flags,
)
from psgn_jax.config import ConfigError
from psgn_jax.prediction.demo_page import Demo, import_gradio, launch
from psgn_jax.prediction.demo_server import is_local, listen
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.weights.opening import open_network


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with (
        exit_on_user_error(),
        contextlib.suppress(KeyboardInterrupt),
        tempfile.TemporaryDirectory(prefix="psgn-demo-", ignore_cleanup_errors=True) as folder,
        contextlib.ExitStack() as stack,
    ):
        if argv[1:]:
            raise ConfigError(
                f"unexpected argument {argv[1]!r}; expected only flags, as photos are dropped onto "
                "the page"
            )
        # gradio reads these variables when it is imported.
        os.environ["GRADIO_TEMP_DIR"] = os.path.join(folder, "gradio")
        os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
        os.environ["GRADIO_RUN_HISTORY"] = "False"
        import_gradio()
        # The port is opened before the network is read, which takes longer.
        listener, address = listen(values.host, values.port)
        stack.callback(listener.close)
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        predictor = Predictor.from_run(network)
        predictor.warm_up()
        if not is_local(values.host):
            logging.warning("--host=%s: other machines can reach the page", values.host)
        demo = Demo(predictor, pathlib.Path(folder) / "out")
        server = launch(demo, listener, values.host, values.allowed_hosts)
        stack.callback(server.close)
        stack.callback(_ignore_signals)  # until the folder is removed
        sys.stdout.write(f"{address}\n")
        sys.stdout.flush()
        while True:
            time.sleep(3600)


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("host", "127.0.0.1", "Address to listen on.")
    flags.DEFINE_integer("port", 7860, "Port to listen on; 0 = a free one.")
    flags.DEFINE_list(
        "allowed_hosts", [], "Further host names of this server, such as that of a proxy."
    )
    app.run(_main, flags_parser=parse_flags)
