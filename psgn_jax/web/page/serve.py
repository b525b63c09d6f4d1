"""Serves the files of one folder to the browsers of this machine."""

import contextlib
import http.server
import pathlib
import shutil
from http import HTTPStatus
from urllib.parse import unquote, urlsplit

from psgn_jax.system.errors import UserError

TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".mjs": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".wasm": "application/wasm",
}


def server(folder: pathlib.Path, port: int = 0) -> http.server.ThreadingHTTPServer:
    """A server of the files in `folder` on 127.0.0.1, to be started with `serve_forever`.

    It answers GET and HEAD, shows no folders, and follows no links out of `folder`. Requests whose
    `Host` names another server are refused: a foreign page could send them by DNS rebinding.

    Args:
      port: its port; 0 = a free one.

    Raises:
      UserError: it cannot listen there.
    """
    try:
        made = http.server.ThreadingHTTPServer(("127.0.0.1", port), _Handler)
    except (OSError, OverflowError) as error:
        raise UserError(f"port={port}: cannot listen there: {error}") from error
    made.folder = folder.resolve()  # type: ignore[attr-defined]
    made.hosts = {f"{name}:{made.server_port}" for name in ("127.0.0.1", "localhost")}  # type: ignore[attr-defined]
    return made


class _Handler(http.server.BaseHTTPRequestHandler):
    timeout = 60  # seconds without data, after which a connection is closed

    def do_GET(self) -> None:
        """Sends a file."""
        path = self._path()
        if path is None:
            return
        with path.open("rb") as file, contextlib.suppress(ConnectionError):
            self._head(path)
            if self.command == "GET":
                shutil.copyfileobj(file, self.wfile)

    do_HEAD = do_GET  # noqa: N815

    def _path(self) -> pathlib.Path | None:
        """The requested file; None after an error was sent."""
        if self.headers.get("Host") not in self.server.hosts:  # type: ignore[attr-defined]
            self.send_error(HTTPStatus.FORBIDDEN)
            return None
        folder = self.server.folder  # type: ignore[attr-defined]
        with contextlib.suppress(OSError, ValueError):  # a name that no file can have
            name = unquote(urlsplit(self.path).path).lstrip("/") or "index.html"
            path: pathlib.Path = (folder / name).resolve()
            if path.is_relative_to(folder) and path.is_file():
                return path
        self.send_error(HTTPStatus.NOT_FOUND)
        return None

    def _head(self, path: pathlib.Path) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", TYPES.get(path.suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(path.stat().st_size))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Cache-Control", "no-cache")
        self.end_headers()

    def log_message(self, format: str, *arguments: object) -> None:
        """Logs nothing."""
