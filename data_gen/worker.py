"""A rendering process, which `data_gen.pool` starts and communicates with.

    python -m data_gen.worker serve FD

communicates through the open pipe with the file descriptor FD.
"""

import signal
import sys
import time
from multiprocessing.connection import Connection

from data_gen import engine
from data_gen.render_model import Context, render_model
from data_gen.results import failure, pack_result

# A rendering process ends after this time without a message, because the job may have been killed.
_IDLE_SECONDS = 600.0


def serve(connection: Connection) -> None:
    """Main loop of a rendering process.

    It receives a `Context`, sends None when ready, then receives entries and sends results. A
    result is (line, content), where content is made by `pack_result`. The loop ends when it
    receives None, when the connection is closed, or after ten minutes without a message.
    """
    # Ctrl-C is sent to all processes of a terminal; the `Renderer` ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    context: Context = connection.recv()
    engine.start(*context.variant)
    connection.send(None)  # ready
    while connection.poll(_IDLE_SECONDS):
        try:
            entry = connection.recv()
        except (EOFError, ConnectionResetError):
            return
        if entry is None:
            return
        started = time.perf_counter()
        try:
            data, line = render_model(entry, context)
        except Exception as error:
            # An unexpected error: only this model fails.
            what = f"{type(error).__name__}: {error}".splitlines()[0][:300]
            data, line = [], failure(entry, "error", what)
        line["seconds_total"] = round(time.perf_counter() - started, 3)
        try:
            connection.send((line, pack_result(line, data)))
        except (BrokenPipeError, ConnectionResetError):
            return
        del data
        engine.release()


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        with Connection(int(sys.argv[2])) as _pipe:
            serve(_pipe)
    else:
        sys.exit(__doc__)
