"""Which requests the demo accepts, and how large they may be; no server is started."""

import asyncio
import socket

import pytest

from psgn_jax.config import ConfigError
from psgn_jax.prediction import demo_server as lib


def ask(application, headers, body=(b"",), kind="http"):
    """(status, headers, body) of the answer, or the code of a closed web socket."""
    sent = []
    messages = [
        {"type": "http.request", "body": part, "more_body": i + 1 < len(body)}
        for i, part in enumerate(body)
    ]
    if kind == "websocket":
        messages = [{"type": "websocket.connect"}]

    async def receive():
        return messages.pop(0)

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "method": "POST",
        "path": "/",
        "headers": [(k.encode("latin1"), v.encode("latin1")) for k, v in headers],
    }
    asyncio.run(application(scope, receive, send))
    if kind == "websocket":
        return sent[0].get("code", sent[0]["type"])
    return sent[0]["status"], dict(sent[0]["headers"]), sent[1]["body"]


async def page(scope, receive, send):
    """Reads all that is sent and says how much it was."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    read, more = 0, True
    while more:
        message = await receive()
        more = message["type"] == "http.request" and message.get("more_body", False)
        read += len(message.get("body", b""))
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": f"{read} {message['type']}".encode()})


@pytest.mark.parametrize(
    ("host", "local", "remote"),
    [
        ("127.0.0.1:7860", True, True),
        ("localhost:7860", True, True),
        ("LOCALHOST", True, True),
        ("[::1]:7860", True, True),
        ("10.1.2.3:7860", False, True),
        ("here.example:7860", False, True),
        ("proxy.example", True, True),
        ("evil.com", False, False),
        ("127.0.0.1.evil.com", False, False),
        ("evil.com@127.0.0.1", False, False),
        ("localhost:x", False, False),
        ("localhost/", False, False),
        ("", False, False),
        ("ev\xeel.com", False, False),
    ],
)
def test_other_names_are_refused(host, local, remote):
    for address, served in (("127.0.0.1", local), ("here.example", remote)):
        guard = lib.guard(page, address, ["Proxy.example"])
        status, headers, _ = ask(guard, [("host", host)])
        assert status == (200 if served else 403)
        assert b"access-control-allow-origin" not in headers
        assert ask(guard, [("host", host)], kind="websocket") == (
            "websocket.accept" if served else 1008
        )


def test_a_request_names_one_host():
    assert ask(lib.guard(page, ""), [])[0] == 403
    assert ask(lib.guard(page, ""), [("host", "localhost"), ("host", "localhost")])[0] == 403


@pytest.mark.parametrize(
    ("origin", "served"),
    [
        ("http://localhost:7860", True),
        ("https://LOCALHOST:7860", True),
        ("http://localhost:8888", False),
        ("http://localhost", False),
        ("http://evil.com", False),
        ("http://localhost:7860.evil.com", False),
        ("null", False),
        ("", False),
    ],
)
def test_other_origins_are_refused(origin, served):
    guard = lib.guard(page, "127.0.0.1")
    headers = [("host", "localhost:7860"), ("origin", origin)]
    assert ask(guard, headers)[0] == (200 if served else 403)
    answer = ask(guard, headers, kind="websocket")
    assert answer == ("websocket.accept" if served else 1008)


def test_what_is_sent_is_bounded(monkeypatch):
    monkeypatch.setattr(lib, "_MAX_BODY_BYTES", 1000)
    guard = lib.guard(page, "127.0.0.1")
    host = ("host", "localhost")
    assert ask(guard, [host, ("content-length", "1000")], [bytes(1000)])[2] == b"1000 http.request"
    for length in ("1001", "9" * 30, "-1", "x", ""):
        assert ask(guard, [host, ("content-length", length)])[0] == 413
    # Without a length, in pieces.
    assert ask(guard, [host], [bytes(400)] * 2)[2] == b"800 http.request"
    assert ask(guard, [host], [bytes(400)] * 5)[2] == b"800 http.disconnect"


def test_addresses_that_cannot_be_listened_at_are_one_line():
    listener, address = lib.listen("127.0.0.1", 0)
    with listener:
        port = listener.getsockname()[1]
        assert address == f"http://127.0.0.1:{port}/"
        with pytest.raises(ConfigError, match=rf"--port={port}: .*Address already"):
            lib.listen("127.0.0.1", port)
    for host, port in (
        ("127.0.0.1", 65536),
        ("127.0.0.1", -1),
        ("no such host.invalid", 0),
        ("x" * 300, 0),
        ("192.0.2.1", 0),  # of no machine
        ("\0", 0),
    ):
        with pytest.raises(ConfigError, match=r"--host=.* --port=-?[0-9]+: ") as error:
            lib.listen(host, port)
        assert "\n" not in str(error.value)
    listener, address = lib.listen("0.0.0.0", 0)
    listener.close()
    assert address.startswith("http://localhost:")
    if socket.has_ipv6:
        try:
            listener, address = lib.listen("::1", 0)
        except ConfigError:
            return
        listener.close()
        assert address.startswith("http://[::1]:")
