"""A signal is recorded at once; a second one, or the end of the grace, ends the process."""

import signal
import subprocess
import sys
import time

import pytest

# A signal's Python handler does not run before the call into C returns, as in a compilation.
BLOCKED = """
import hashlib, sys
from psgn_jax.system import signals
with signals.StopSignal(float(sys.argv[1])):
    print("ready", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
"""

WRITING = """
import hashlib, threading, time
from psgn_jax.system import signals
written = []
def write():
    time.sleep(0.5)
    written.append("checkpoint")
writer = threading.Thread(target=write)
def last():
    writer.join()
    print(*written, flush=True)
with signals.StopSignal(0.1, last) as stop:
    with stop.lock:
        print("ready", flush=True)
        time.sleep(0.5)
        writer.start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
"""


def start(code, *arguments):
    command, pipe = [sys.executable, "-c", code, *arguments], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize(("grace", "signals"), [("0", 1), ("0.2", 1), ("1e10", 2)])
def test_a_blocked_process_ends(grace, signals):
    process = start(BLOCKED, grace)
    for _ in range(signals):
        process.send_signal(signal.SIGTERM)
        time.sleep(0.1)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 143
    (line,) = err.splitlines()
    assert line.startswith("stopped by SIGTERM without waiting for the current step")


def test_a_checkpoint_that_is_being_written_is_waited_for():
    process = start(WRITING)
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=20)
    assert (process.returncode, out) == (143, "checkpoint\n")


def test_a_command_without_checkpoints_names_the_signal():
    process = start(
        "import time; from psgn_jax.system.signals import exit_on_signals; exit_on_signals();"
        "print('ready', flush=True); time.sleep(20)"
    )
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert (process.returncode, err.split(";")[0]) == (130, "stopped by SIGINT")
