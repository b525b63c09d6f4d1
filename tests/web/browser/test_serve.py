import http.client
import os
import pathlib
import socket
import threading

import pytest
from helpers.refusals import refused

from psgn_jax.system.errors import UserError
from psgn_jax.web.browser.serve import server


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("served")
    folder = tmp_path / "site"
    (folder / "inner").mkdir(parents=True)
    (folder / "index.html").write_text("<p>page</p>")
    (folder / "inner" / "a b.mjs").write_text("export {};")
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    (folder / "out").symlink_to(tmp_path)
    (folder / "circle").symlink_to("circle")
    os.mkfifo(folder / "fifo")
    running = server(folder)
    threading.Thread(target=running.serve_forever, daemon=True).start()
    yield running
    running.shutdown()
    running.server_close()


def ask(served, path, method="GET", host=None):
    connection = http.client.HTTPConnection("127.0.0.1", served.server_port, timeout=20)
    connection.putrequest(method, path, skip_host=True)
    if host != "":
        connection.putheader("Host", host or f"localhost:{served.server_port}")
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, {name.title(): value for name, value in answer.getheaders()}, body


def test_files_of_the_folder_are_served(served):
    for path in ("/", "/index.html?x=/../y"):
        status, headers, body = ask(served, path)
        assert (status, body) == (200, b"<p>page</p>"), path
        assert headers["Content-Type"].startswith("text/html")
    status, headers, body = ask(served, "/inner/a%20b.mjs", host=f"127.0.0.1:{served.server_port}")
    assert (status, body) == (200, b"export {};")
    assert headers["Content-Type"].startswith("text/javascript")
    status, headers, body = ask(served, "/index.html", "HEAD")
    assert (status, headers["Content-Length"], body) == (200, "11", b"")


def test_nothing_else_is_nor_to_other_methods_and_hosts(served):
    for path in (
        "/inner/", "/none", "/link.txt", "/out/secret.txt", "/fifo", "/circle",
        "/circle/x", "/../secret.txt",
        "/%2e%2e/secret.txt", "/inner/..%2f..%2fsecret.txt", "//etc/passwd", "/%00",
        "/" + "a" * 5000,
    ):  # fmt: skip
        status, _, body = ask(served, path)
        assert status == 404, path
        assert b"secret" not in body
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(served, "/", method)[0] == 501
    for host in ("evil.example", f"evil.example:{served.server_port}", "localhost.evil", ""):
        status, _, body = ask(served, "/", host=host)
        assert status == 403
        assert b"host must be 127.0.0.1 or localhost" in body
    for host in ("localhost", "127.0.0.1", "localhost:9000"):  # port 80; a tunnel
        assert ask(served, "/", host=host)[0] == 200


def test_only_this_machine_reaches_it(served):
    assert served.server_address[0] == "127.0.0.1"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with refused(UserError, f"port={taken.getsockname()[1]}"):
            server(pathlib.Path(), taken.getsockname()[1])
