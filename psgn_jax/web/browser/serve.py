"""Serves the files of one folder to the browsers of this machine."""

import contextlib
import functools
import http.server
import pathlib
import re
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from psgn_jax.system.errors import UserError


def server(folder: pathlib.Path, port: int = 0) -> http.server.ThreadingHTTPServer:
    """A server of the files in `folder` on 127.0.0.1; start it with `serve_forever`.

    It answers GET and HEAD, shows no folders, and follows no links out of `folder`. It refuses
    requests whose `Host` names another server, which foreign pages could send by DNS rebinding.

    Args:
      port: 0 = a free port.

    Raises:
      UserError: it cannot listen there.
    """
    handler = functools.partial(_Handler, directory=str(folder.resolve()))
    try:
        return _Server(("127.0.0.1", port), handler)
    except (OSError, OverflowError) as error:
        raise UserError(f"port={port}: cannot listen there: {error}") from error


class _Server(http.server.ThreadingHTTPServer):
    request_queue_size = 128  # of browsers that wait; by default 5


class _Handler(http.server.SimpleHTTPRequestHandler):
    timeout = 60  # seconds without data, after which a connection is closed
    # Some systems have other types.
    extensions_map = http.server.SimpleHTTPRequestHandler.extensions_map | {
        ".js": "text/javascript",
        ".mjs": "text/javascript",
        ".wasm": "application/wasm",
    }

    def handle(self) -> None:
        with contextlib.suppress(ConnectionError):
            super().handle()

    def send_head(self) -> Any:
        # Any port: browsers omit 80, and a tunnel has another port.
        if re.fullmatch(r"(127\.0\.0\.1|localhost)(:\d+)?", self.headers.get("Host") or ""):
            return super().send_head()
        why = "The host must be 127.0.0.1 or localhost."
        return self.send_error(HTTPStatus.FORBIDDEN, explain=why)

    def translate_path(self, path: str) -> str:
        """The requested file, or "", which cannot be opened, if it is not in the folder."""
        start = urlsplit(path).path == "/"
        # For impossible names, and (RuntimeError, before Python 3.13) for cyclic links.
        with contextlib.suppress(OSError, ValueError, RuntimeError):
            file = pathlib.Path(super().translate_path("/index.html" if start else path)).resolve()
            if file.is_relative_to(self.directory) and file.is_file():
                return str(file)
        return ""

    def end_headers(self) -> None:
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Cache-Control", "no-cache")
        super().end_headers()

    def log_message(self, format: str, *arguments: object) -> None:
        """Logs nothing."""
