"""Several processes that train together, each on its own accelerators, on one or more machines.

Every process runs the same program. `data.loader` splits the batches between the processes, and
`training.step` averages the gradients. Only the first process reads and writes the folder of the
run, so only the first process needs access to it; all processes need access to the records.
`current()` is the group of processes that this one belongs to: a single process, except in the
context of `joined`.
"""

import collections
import contextlib
import json
import os
import secrets
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from types import FrameType
from typing import Any, TypeVar

import jax
import numpy as np
from absl import logging
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.command_line import INTERRUPTED, exit_code_of
from psgn_jax.config import ConfigError, UserError
from psgn_jax.training import channel as channel_lib
from psgn_jax.training.launch import Place
from psgn_jax.training.signals import StopSignal
from psgn_jax.untrusted import message_line

T = TypeVar("T")

EXIT_CODE = 4
"""Exit code of a process that ends because another process of its training has ended."""

_INITIALIZE_SECONDS = 300
_NEWS_SECONDS = 5.0


class OtherProcessError(UserError):
    """Another process has failed; that process reports the error."""

    def __init__(self, line: str, exit_code: int) -> None:
        super().__init__(line)
        self.exit_code = exit_code


class Group:
    """The processes of a training: `count` processes, of which this one has the index `index`."""

    def __init__(
        self, index: int = 0, count: int = 1, channel: channel_lib.Channel | None = None
    ) -> None:
        self.index, self.count, self._channel = index, count, channel
        self.agreed_to_end = False

    @property
    def is_first(self) -> bool:
        """Whether this process is the first one, which writes the folder of the run."""
        return not self.index

    def exchange(self, value: Any) -> list[Any]:
        """The values (JSON) of all processes, in their order; every process must call this.

        Raises:
          OtherProcessError: another process has left an `agreement` with an error instead.
        """
        return self._exchange({"value": value})

    def _exchange(self, entry: Mapping[str, Any]) -> list[Any]:
        if self._channel is None:
            return [entry.get("value")]
        entries = [json.loads(text) for text in self._channel.exchange(json.dumps(entry))]
        for number, other in enumerate(entries):
            if "error" in other:
                self.agreed_to_end = True
                if "error" in entry:  # the caller raises its own error
                    break
                raise OtherProcessError(f"process {number}: {other['error']}", other["exit_code"])
        return [other.get("value") for other in entries]

    def wait(self) -> None:
        """Waits until every process has called this."""
        self.exchange(None)

    @contextlib.contextmanager
    def agreement(self) -> Iterator[None]:
        """Context that ends with an error in all processes if there is an error in any of them.

        Raises:
          OtherProcessError: there was an error in another process.
        """
        try:
            yield
        except OtherProcessError:
            raise
        except Exception as error:
            self._exchange({"error": _one_line(error), "exit_code": exit_code_of(error) or 1})
            raise
        self.wait()

    def from_first(self, make: Callable[[], T]) -> T:
        """The value (JSON) that `make` returns in the first process; it runs only there."""
        value: T = self.exchange(make() if self.is_first else None)[0]
        return value

    def first_then_others(self, make: Callable[[], T]) -> T:
        """Runs `make()` in the first process, and then in all others."""
        value = make() if self.is_first else None
        self.wait()
        return value if self.is_first else make()  # type: ignore[return-value]

    def arrays_from_first(self, arrays: Mapping[str, np.ndarray] | None) -> dict[str, np.ndarray]:
        """Copies arrays bit by bit from the first process to all; other processes pass None."""
        if self._channel is None:
            return dict(arrays or {})
        from jax.experimental import multihost_utils

        given = arrays or {}
        kinds: Any = self.from_first(
            lambda: [[name, array.dtype.name, array.shape] for name, array in given.items()]
        )
        result: dict[str, np.ndarray] = {}
        for name, dtype, shape in kinds:
            own = given[name] if self.is_first else np.zeros(shape, dtype)
            # Sent as integers: the broadcast adds zeros, and -0.0 + 0.0 is +0.0.
            flat = np.ascontiguousarray(own).reshape(-1)
            integers: Any = np.uint32 if flat.dtype.itemsize % 4 == 0 else np.uint8
            sent = np.asarray(multihost_utils.broadcast_one_to_all(flat.view(integers)))
            result[name] = sent.astype(integers).view(dtype).reshape(shape)
        return result


_ALONE = Group()
_group = _ALONE


def current() -> Group:
    """The group of this process."""
    return _group


@contextlib.contextmanager
def joined(place: Place | None) -> Iterator[Group]:
    """Context in which `current` is the group of all processes of the training.

    Must be entered before JAX is used. With several processes, an error inside is printed and ends
    this process; the other processes end with one line that names the failed process.

    Args:
      place: place of this process; None = single process, the context does nothing.

    Raises:
      ConfigError: the processes cannot connect to each other.
    """
    global _group
    if place is None:
        yield _ALONE
        return
    channel = _connected(place)
    _group = group = Group(place.index, place.count, channel)
    if not group.is_first:
        logging.set_verbosity(logging.WARNING)  # the first process logs for all
    try:
        yield group
        group.wait()
    except BaseException as error:
        _end_with(error, group, channel)
    finally:
        _group = _ALONE
    jax.distributed.shutdown()
    channel.leave()


def _connected(place: Place) -> channel_lib.Channel:
    from jax.experimental import multihost_utils

    with contextlib.suppress(AttributeError):
        # The service would replace the handler of SIGTERM that `StopSignal` installs.
        jax.config.update("jax_enable_preemption_service", False)
    try:
        jax.distributed.initialize(
            place.coordinator,
            place.count,
            place.index,
            local_device_ids=place.devices,
            cluster_detection_method="deactivate",
            initialization_timeout=_INITIALIZE_SECONDS,
        )
    except RuntimeError as error:  # raised by XLA if the connection fails
        raise ConfigError(
            f"--coordinator={place.coordinator}: process {place.index} of {place.count} could not "
            f"connect to the others: {_one_line(error)}"
        ) from error
    # The token prevents other programs from connecting as a process of this training.
    listener = channel_lib.Listener() if not place.index else None
    own = [listener.port, secrets.randbits(31)] if listener else [0, 0]
    port, number = np.asarray(multihost_utils.broadcast_one_to_all(np.array(own, np.int32)))
    token = f"{number:x}"
    if listener:
        return listener.accept(place.count, token, _end_without)
    host = place.coordinator.rpartition(":")[0].strip("[]")
    return channel_lib.connect((host, int(port)), place.index, token, _end_without)


def _end_without(line: str) -> None:
    """Ends this process because another one is lost; called from a thread."""
    again = "; run the same command again to resume from the newest checkpoint"
    os.write(2, f"error: {line}, so this process ends too{again}\n".encode())
    os._exit(EXIT_CODE)  # the main thread may wait forever for the lost process


def _end_with(error: BaseException, group: Group, channel: channel_lib.Channel) -> None:
    """Ends this process with its error, and makes the other processes end.

    It does not use `sys.exit`, because Python would then wait for the other processes at exit.
    """
    code: int | None = 1
    if isinstance(error, OtherProcessError):
        code = error.exit_code  # the other process reports the error
    elif isinstance(error, SystemExit):
        code = error.code if isinstance(error.code, int) else 1
    elif isinstance(error, KeyboardInterrupt):
        code = INTERRUPTED
    elif isinstance(error, Exception):
        code = exit_code_of(error)
        if code is None or isinstance(error, ConnectionError):
            # The cause may be that another process has ended; then `_end_without` reports that.
            channel.await_loss(_NEWS_SECONDS)
        if code is None:
            traceback.print_exception(error)
        else:
            sys.stderr.write(f"error: {message_line(error)}\n")
    sys.stderr.flush()
    if group.agreed_to_end:
        channel.leave()
    else:
        channel.fail(_one_line(error) or type(error).__name__)
    os._exit(1 if code is None else code)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:500]


class SharedStop(StopSignal):
    """`StopSignal` of several processes: `signal` is set in all of them after the same step.

    Each process contributes its own signal to a maximum over the devices after every step. It reads
    the maximum two steps later, when the step is complete, so that it does not have to wait.
    """

    def __init__(self, group: Group, mesh: Mesh) -> None:
        super().__init__()
        self._group, self._own = group, 0
        self._split = NamedSharding(mesh, P("data"))
        self._local_devices = len(mesh.local_devices)
        self._largest = jax.jit(jax.numpy.max, out_shardings=NamedSharding(mesh, P()))
        self._pending: collections.deque[jax.Array] = collections.deque()

    def after_step(self) -> None:
        """Combines the signals of all processes; every process must call it after every step."""
        own = np.full(self._local_devices, self._own, np.int32)
        flags = jax.make_array_from_process_local_data(self._split, own)
        self._pending.append(self._largest(flags))
        if len(self._pending) > 2:
            self.signal = int(self._pending.popleft()) or None

    def settle(self) -> None:
        """Combines the signals without the delay of two steps; every process must call it."""
        self.signal = max(self._group.exchange(self._own)) or None

    @property
    def arrived(self) -> bool:
        """Whether this process has received a signal; the others may not know it yet."""
        return bool(self._own)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._own = number
        self._restore()
