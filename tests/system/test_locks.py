import fcntl
import os
import signal
import subprocess
import sys
import threading

from helpers.refusals import refused

from psgn_jax.system.locks import TakenError, lock_part, locked

HOLD = """
import pathlib, sys
from psgn_jax.system.locks import lock_part
with lock_part(pathlib.Path(sys.argv[1]), (0, 2)):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_claim_ends_with_its_process(tmp_path):
    folder = tmp_path / "job" / ".work"
    command = [sys.executable, "-c", HOLD, str(folder)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True) as process:
        assert process.stdout.readline() == "held\n"
        for part, *names in (((0, 2), f"pid {process.pid}", "0/2"), ((0, 1), "2 parts", "not 1")):
            with refused(TakenError, *names, folder.parent), lock_part(folder, part):
                pass
        with lock_part(folder, (1, 2)):
            pass
        process.send_signal(signal.SIGKILL)
        process.wait()
    with lock_part(folder, (0, 1)):
        assert folder.is_dir()
    assert not folder.exists()


def test_a_lock_can_be_waited_for_also_if_it_is_released_at_once(tmp_path, caplog):
    caplog.set_level("INFO", "absl")
    path, order = tmp_path / "new" / ".lock", []

    def second():
        with locked(path, waiting="another process renders"):
            order.append("second")

    with locked(path) as held:
        assert held
        thread = threading.Thread(target=second)
        thread.start()
        while "another process renders" not in caplog.text:
            thread.join(0.05)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]
    assert not path.exists()
    held = os.open(tmp_path / "a.lock", os.O_RDWR | os.O_CREAT)
    fcntl.flock(held, fcntl.LOCK_EX)
    threading.Timer(0.1, os.close, (held,)).start()
    with locked(tmp_path / "a.lock") as is_held:
        assert is_held
