"""Messages between the processes of one training, over TCP.

The first process listens, and every other process connects to it. Messages are short: errors,
signals, metrics. Arrays are sent through the devices. Each side also sends a heartbeat every few
seconds, so that every process detects within a minute that another one has ended, hangs or has lost
its connection.
"""

import contextlib
import json
import queue
import socket
import threading
import time
from collections.abc import Callable

HEARTBEAT_SECONDS = 5.0
SILENCE_SECONDS = 40.0
"""A process without a heartbeat for this long counts as lost. If its connection is closed, as when
it is killed, it counts as lost immediately."""

_CONNECT_SECONDS = 60.0
_LEAVING_SECONDS = 2.0

# Kinds of messages.
_ALIVE, _TEXT, _FAILED, _BYE = b"a", b"t", b"f", b"b"

OnLost = Callable[[str], None]


class _Link:
    """A connection to one other process."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._sending = threading.Lock()
        self.texts: queue.Queue[str] = queue.Queue()
        self.over = threading.Event()
        """Set when nothing more will be received."""
        connection.settimeout(SILENCE_SECONDS)

    def send(self, kind: bytes, text: str = "") -> None:
        data = text.encode()
        with self._sending:
            self._connection.sendall(kind + len(data).to_bytes(8, "little") + data)

    def receive(self) -> tuple[bytes, str]:
        """The next message; raises `OSError` if the connection is closed or silent."""
        head = self._read(9)
        return head[:1], self._read(int.from_bytes(head[1:], "little")).decode()

    def _read(self, count: int) -> bytes:
        parts = bytearray()
        while len(parts) < count:
            part = self._connection.recv(min(count - len(parts), 1 << 20))
            if not part:
                raise ConnectionError("ended")
            parts += part
        return bytes(parts)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._connection.close()


class Channel:
    """The connections of one process.

    Args:
      index: index of this process.
      links: connections by the index of the other process. The first process has one to every other
        process, each other process only one to the first.
      on_lost: called once, in a thread, with a line that names the process that was lost or failed.
    """

    def __init__(self, index: int, links: dict[int, _Link], on_lost: OnLost) -> None:
        self._index, self._links, self._on_lost = index, links, on_lost
        self._leaving = threading.Event()
        self._lost = threading.Event()
        self._ending = threading.Lock()
        for other, link in links.items():
            threading.Thread(target=self._listen, args=(other, link), daemon=True).start()
        threading.Thread(target=self._send_heartbeats, daemon=True).start()

    def exchange(self, text: str) -> list[str]:
        """Waits until every process has called this; returns their texts, in order."""
        if self._index:
            link = self._links[0]
            link.send(_TEXT, text)
            texts: list[str] = json.loads(link.texts.get())
            return texts
        texts = [text, *(self._links[other].texts.get() for other in sorted(self._links))]
        answer = json.dumps(texts)
        for link in self._links.values():
            link.send(_TEXT, answer)
        return texts

    def fail(self, text: str) -> None:
        """Makes all other processes end; `text` is the reason why this one ends."""
        self._tell(f"process {self._index} failed: {text}")

    def await_loss(self, seconds: float) -> None:
        """Waits `seconds`; never returns if another process is lost: `on_lost` handles that."""
        if self._lost.wait(seconds):
            threading.Event().wait()

    def leave(self) -> None:
        """Closes the connections so that the other processes do not count this one as lost."""
        self._leaving.set()
        for link in self._links.values():
            with contextlib.suppress(OSError):
                link.send(_BYE)
        self._wait_for_others()
        for link in self._links.values():
            link.close()

    def _tell(self, line: str) -> None:
        self._leaving.set()
        for link in self._links.values():
            with contextlib.suppress(OSError):
                link.send(_FAILED, line)
        self._wait_for_others()

    def _wait_for_others(self) -> None:
        """Lets the first process end last, because the others need JAX's service, which it runs."""
        until = time.monotonic() + _LEAVING_SECONDS
        for link in self._links.values() if not self._index else ():
            link.over.wait(max(0.0, until - time.monotonic()))

    def _listen(self, other: int, link: _Link) -> None:
        try:
            while True:
                kind, text = link.receive()
                if kind == _TEXT:
                    link.texts.put(text)
                elif kind == _FAILED:
                    return self._end(link, text)
                elif kind == _BYE:
                    return link.over.set()
        except TimeoutError:
            self._end(link, f"process {other} has been silent for {SILENCE_SECONDS:.0f} s")
        except OSError:
            self._end(link, f"process {other} has ended unexpectedly")

    def _end(self, link: _Link, line: str) -> None:
        link.over.set()
        if self._leaving.is_set() or not self._ending.acquire(blocking=False):
            return
        self._lost.set()
        if not self._index:
            self._tell(line)
        self._on_lost(line)

    def _send_heartbeats(self) -> None:
        while not self._leaving.wait(HEARTBEAT_SECONDS):
            for link in self._links.values():
                with contextlib.suppress(OSError):  # the listening thread reports the error
                    link.send(_ALIVE)


class Listener:
    """The socket of the first process, on a free port, to which the other processes connect."""

    def __init__(self) -> None:
        if socket.has_dualstack_ipv6():
            self._server = socket.create_server(
                ("", 0), family=socket.AF_INET6, dualstack_ipv6=True
            )
        else:
            self._server = socket.create_server(("", 0))
        self.port: int = self._server.getsockname()[1]

    def accept(self, count: int, token: str, on_lost: OnLost) -> Channel:
        """The channel of the first process, once the `count` - 1 others have connected."""
        links: dict[int, _Link] = {}
        self._server.settimeout(_CONNECT_SECONDS)
        with contextlib.closing(self._server):
            while len(links) < count - 1:
                link = _Link(self._server.accept()[0])
                if (other := _greeting(link, token)) is None:
                    link.close()
                else:
                    links[other] = link
        return Channel(0, links, on_lost)


def _greeting(link: _Link, token: str) -> int | None:
    """The index that the other side sends, or None if it does not belong to this training."""
    with contextlib.suppress(OSError, ValueError, TypeError):
        shown, other = json.loads(link.receive()[1])
        return int(other) if shown == token else None
    return None


def connect(address: tuple[str, int], index: int, token: str, on_lost: OnLost) -> Channel:
    """The channel of process `index`, connected to the first process at `address`."""
    link = _Link(socket.create_connection(address, timeout=_CONNECT_SECONDS))
    link.send(_TEXT, json.dumps([token, index]))
    return Channel(index, {0: link}, on_lost)
