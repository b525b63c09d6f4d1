"""Processes of a process group, and the shared memory that they have mapped."""

import contextlib
import pathlib
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


def shared_memory(group):
    """Files of /dev/shm that processes of the group have mapped."""
    files = set()
    for process in of_group(group):
        with contextlib.suppress(OSError):
            for line in pathlib.Path(f"/proc/{process}/maps").read_text().splitlines():
                path = line.partition("/dev/shm/")[2]
                files |= {path.removesuffix(" (deleted)")} if path else set()
    return files


def wait_until(condition, seconds=60.0):
    """Whether `condition` came true within the time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True
