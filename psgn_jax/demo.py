"""A page to try a network on photos: `python -m psgn_jax.demo`.

The network is that of `--weights=NAME|FILE` or of a run, `--workdir=W`; without either the one that
comes with the package.

Drop a photo, correct the mask that was found with brush and eraser, choose samples and seed, turn
the result, take its files along: those of `psgn_jax.predict`. The page is served to this machine
alone unless `--host` says otherwise; nothing is sent anywhere. What it writes lies in a temporary
folder that goes with the process, results after an hour.
"""

import contextlib
import os
import pathlib
import signal
import tempfile
from collections.abc import Sequence

from absl import app, flags, logging

from psgn_jax.command_line import exit_on_user_error, keep_compiled, log_to_terminal, parse_flags
from psgn_jax.config import ConfigError
from psgn_jax.prediction.demo_page import Demo, import_gradio, launch
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.weights.opening import open_network


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with (
        exit_on_user_error(),
        contextlib.suppress(KeyboardInterrupt),
        tempfile.TemporaryDirectory(prefix="psgn-demo-", ignore_cleanup_errors=True) as folder,
    ):
        if argv[1:]:
            raise ConfigError(f"{argv[1]}: photos are dropped onto the page; accepted: flags")
        # Before gradio is imported: it reads both then.
        os.environ["GRADIO_TEMP_DIR"] = os.path.join(folder, "gradio")
        os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
        import_gradio()
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        predictor = Predictor.from_run(network)
        predictor.warm_up()
        if values.host not in ("127.0.0.1", "localhost"):
            logging.warning("--host=%s: other machines can reach the page", values.host)
        launch(Demo(predictor, pathlib.Path(folder) / "out"), host=values.host, port=values.port)


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of a run, in place of weights.")
    flags.DEFINE_string("weights", None, "Name or file of weights; default: the package's.")
    flags.DEFINE_enum("checkpoint", "best", ["best", "last"], "Which checkpoint.")
    flags.DEFINE_string("host", "127.0.0.1", "Address to listen at.")
    flags.DEFINE_integer("port", 7860, "Port to listen at, 0 for a free one.")
    app.run(_main, flags_parser=parse_flags)
