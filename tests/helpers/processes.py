"""Processes of a process group, without room on the disk, and modules that none may import."""

import contextlib
import importlib.metadata
import pathlib
import resource
import sys
import time


def of_group(group):
    """Ids of the processes in a process group that are neither dead nor zombies."""
    found = []
    for folder in pathlib.Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        with contextlib.suppress(OSError):
            # pid (name) state parent group ...; a name may have spaces and brackets.
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[2]) == group and fields[0] not in "ZX":
                found.append(int(folder.name))
    return found


def wait_until(condition, seconds=60.0):
    """Whether `condition` came true within the time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def wait_for(condition, process, log):
    """Waits until `condition` is true, which must be before the process ends."""
    assert wait_until(lambda: condition() or process.poll() is not None, 300), log.read_text()
    assert process.poll() is None, log.read_text()


@contextlib.contextmanager
def without_room(largest=1000):
    """Writes of this process fail if they would make a file larger than `largest` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def write_modules(folder, mark):
    """Writes a module under every name that may be imported; it leaves a mark when it runs."""
    own = {"psgn_jax", "data_gen"}
    for name in {*sys.stdlib_module_names, *importlib.metadata.packages_distributions()} - own:
        if name.isidentifier():
            text = f"open({str(mark)!r}, 'a').write({name!r} + '\\n')\n"
            (folder / f"{name}.py").write_text(text)
