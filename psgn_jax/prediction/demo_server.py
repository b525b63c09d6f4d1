"""Serves the demo's page: checks which requests are accepted, and how large they may be.

A page of another site that is open in the same browser must not reach this server. Two checks
prevent this, for HTTP requests and for web sockets:

- The `Host` of a request must be a name of this server. A site that points its own name at this
  address (DNS rebinding) still sends its own name and is refused.
- The `Origin` of a request, if the browser sends it, must be this server itself.
"""

import ipaddress
import socket
import threading
import urllib.parse
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

from psgn_jax.config import ConfigError

MAX_UPLOAD_BYTES = 25_000_000
"""Largest size of an uploaded file."""

_MAX_BODY_BYTES = MAX_UPLOAD_BYTES + 1_000_000  # with the form around the file
_MAX_CONNECTIONS = 200
_SECONDS_TO_START = 30.0

_Message = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[_Message]]
_Send = Callable[[_Message], Awaitable[None]]
_App = Callable[[Any, _Receive, _Send], Awaitable[None]]


class Guard:
    """An ASGI application that passes permitted requests to another application.

    Args:
      app: the other application.
      names: host names of this server besides "localhost"; lower case, without a port.
      any_address: whether `Host` may be any IP address; otherwise only loopback addresses.
    """

    def __init__(self, app: _App, names: Iterable[str] = (), *, any_address: bool = False) -> None:
        self._app, self._any_address = app, any_address
        self._names = {"localhost", *names}

    async def __call__(self, scope: Any, receive: _Receive, send: _Send) -> None:
        """Serves a connection."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = [
            (name.decode("latin1").lower(), value.decode("latin1"))
            for name, value in scope["headers"]
        ]
        problem = self._problem(headers)
        if problem:
            await _refuse(scope, receive, send, *problem)
            return
        await self._app(scope, _bounded(receive), send)

    def _problem(self, headers: list[tuple[str, str]]) -> tuple[int, str] | None:
        hosts = [value.strip().lower() for name, value in headers if name == "host"]
        if len(hosts) != 1 or not self._is_own(_host_name(hosts[0])):
            return 403, "this server has another name; see --allowed_hosts"
        for name, value in headers:
            if name == "origin" and urllib.parse.urlsplit(value.lower()).netloc != hosts[0]:
                return 403, "requests from other sites are refused"
            if name == "content-length" and not _is_count(value, _MAX_BODY_BYTES):
                return 413, f"files of up to {MAX_UPLOAD_BYTES:,} bytes are accepted"
        return None

    def _is_own(self, name: str) -> bool:
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._any_address or address.is_loopback


class Server:
    """A running server, in a thread of its own.

    Args:
      app: an ASGI application.
      listener: a bound socket, see `listen`.
    """

    def __init__(self, app: _App, listener: socket.socket) -> None:
        import uvicorn

        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_level="warning",
                limit_concurrency=_MAX_CONNECTIONS,
                timeout_graceful_shutdown=2,
            )
        )
        self._listener = listener
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [listener]}, daemon=True
        )

    def start(self) -> None:
        """Begins to serve, and returns.

        Raises:
          ConfigError: the server does not start.
        """
        self._thread.start()
        waited = threading.Event()
        for _ in range(round(_SECONDS_TO_START / 0.05)):
            if self._server.started:
                return
            if not self._thread.is_alive():
                break
            waited.wait(0.05)
        self.close()
        raise ConfigError("the server of the page does not start")

    def close(self) -> None:
        """Ends the server."""
        self._server.should_exit = True
        if self._thread.ident is not None:
            self._thread.join(10)
        self._listener.close()


def listen(host: str, port: int) -> tuple[socket.socket, str]:
    """A socket bound to an address, and the address for a browser.

    Args:
      host: name or IP address of this machine; "0.0.0.0" or "::" for all of its addresses.
      port: 0 for any free one.

    Raises:
      ConfigError: there is no such address here, or the port is taken or not allowed.
    """
    given = f"--host={host} --port={port}"
    if not 0 <= port <= 65535:
        raise ConfigError(f"{given}: accepted: a port from 0 to 65535")
    try:
        kind, _, _, _, address = socket.getaddrinfo(
            host.strip("[]") or "127.0.0.1", port, type=socket.SOCK_STREAM
        )[0]
        listener = socket.create_server(address[:2], family=kind)
    except (OSError, UnicodeError, ValueError) as error:
        text = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"{given}: cannot listen there: {text}") from None
    number = listener.getsockname()[1]
    shown = {"0.0.0.0": "localhost", "::": "localhost"}.get(host.strip("[]"), host)
    shown = f"[{shown.strip('[]')}]" if ":" in shown else shown or "127.0.0.1"
    return listener, f"http://{shown}:{number}/"


def is_local(host: str) -> bool:
    """Whether an address to listen on can be reached only from this machine."""
    name = host.strip("[]").lower()
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return name in ("", "localhost")


def guard(app: _App, host: str, allowed_hosts: Iterable[str] = ()) -> Guard:
    """`Guard` for a server that listens on `host`; `allowed_hosts` are further names of it."""
    names = {name.strip().lower() for name in allowed_hosts}
    if is_local(host):
        return Guard(app, names)
    own = {host.strip("[]").lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
    return Guard(app, names | own, any_address=True)


def _host_name(host: str) -> str:
    """The name in a `Host` header, without port and brackets; "" if the header is invalid."""
    try:
        parts = urllib.parse.urlsplit(f"//{host}")
        _ = parts.port  # raises for a wrong one
    except ValueError:
        return ""
    return parts.hostname or "" if parts.netloc == host and "@" not in host else ""


def _is_count(text: str, most: int) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 16 and int(text) <= most


def _bounded(receive: _Receive) -> _Receive:
    """`receive`, which disconnects when a body without a stated length is too long."""
    read = 0

    async def bounded() -> _Message:
        nonlocal read
        message = await receive()
        if message["type"] == "http.request":
            read += len(message.get("body", b""))
            if read > _MAX_BODY_BYTES:
                return {"type": "http.disconnect"}
        return message

    return bounded


async def _refuse(scope: Any, receive: _Receive, send: _Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    body = f"{why}\n".encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"),
    ]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
