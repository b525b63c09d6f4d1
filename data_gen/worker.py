"""A rendering process, which `data_gen.pool` talks to.

    python -m data_gen.worker serve FD

serves through the open pipe of that number.
"""

import signal
import sys
import time
from multiprocessing.connection import Connection

from data_gen import engine
from data_gen.render_model import Context, render_model
from data_gen.results import failure, pack_result

# A rendering process that nothing comes to for so long ends: its job may be gone.
_IDLE_SECONDS = 600.0


def serve(connection: Connection) -> None:
    """A rendering process: takes a `Context`, says None, takes entries, sends results.

    A result is (line, `pack_result`). It ends when None comes, the other side is gone or nothing
    has come for ten minutes.
    """
    # Ctrl-C goes to all processes of a terminal; the one that watches this one ends it.
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
            # Something that nobody has thought of: it ends with this model.
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
