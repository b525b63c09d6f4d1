"""Messages between processes; here, threads of one process take their place."""

import contextlib
import queue
import socket
import threading

import pytest

from psgn_jax.config import ConfigError
from psgn_jax.training import channel as channel_lib
from psgn_jax.training.processes import Group, OtherProcessError


@pytest.fixture
def channels():
    """A function that makes the channels of `count` processes, each with a queue for losses."""
    opened = []

    def make(count):
        lost = [queue.Queue() for _ in range(count)]
        listener, results = channel_lib.Listener(), [None] * count

        def join(index):
            address = ("127.0.0.1", listener.port)
            results[index] = channel_lib.connect(address, index, "token", lost[index].put)

        threads = [threading.Thread(target=join, args=(index,)) for index in range(1, count)]
        for thread in threads:
            thread.start()
        results[0] = listener.accept(count, "token", lost[0].put)
        for thread in threads:
            thread.join()
        opened.extend(results)
        return results, lost

    yield make
    for one in opened:
        one._leaving.set()
        for link in one._links.values():
            link.close()


def at_once(*functions):
    """The results of functions that wait for each other."""
    results = [None] * len(functions)

    def run(index):
        try:
            results[index] = functions[index]()
        except Exception as error:
            results[index] = error

    threads = [threading.Thread(target=run, args=(i,)) for i in range(len(functions))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    return results


def test_exchange(channels):
    (a, b, c), _ = channels(3)
    for texts in (["one", "two", "three"], ["", "x" * 100_000, "é"]):
        mine = [lambda one=one, text=text: one.exchange(text) for one, text in zip((a, b, c), texts,
                strict=True)]  # fmt: skip
        assert at_once(*mine) == [texts] * 3


def test_leaving_is_no_loss(channels):
    (a, b), lost = channels(2)
    at_once(b.leave, a.leave)
    assert lost[0].empty()
    assert lost[1].empty()


@pytest.mark.parametrize("victim", [0, 1])
def test_a_closed_connection_is_a_loss_for_all(channels, victim):
    ends, lost = channels(3)
    ends[victim]._leaving.set()
    for link in ends[victim]._links.values():
        link._connection.shutdown(socket.SHUT_RDWR)
    for index in {0, 1, 2} - {victim}:
        assert lost[index].get(timeout=10) == f"process {victim} has ended unexpectedly"


def test_silence_is_a_loss(channels, monkeypatch):
    monkeypatch.setattr(channel_lib, "SILENCE_SECONDS", 0.3)
    monkeypatch.setattr(channel_lib, "HEARTBEAT_SECONDS", 30.0)
    _, lost = channels(2)
    assert lost[0].get(timeout=10) == "process 1 has been silent for 0 s"


def test_a_failure_reaches_all(channels):
    ends, lost = channels(3)
    ends[2].fail("no disk")
    assert lost[0].get(timeout=10) == "process 2 failed: no disk"
    assert lost[1].get(timeout=10) == "process 2 failed: no disk"


def test_a_stranger_is_not_let_in(channels):
    listener = channel_lib.Listener()
    address = ("127.0.0.1", listener.port)
    lost = queue.Queue()
    with contextlib.closing(socket.create_connection(address)) as stranger:
        stranger.sendall(b"GET / HTTP/1.1\r\n\r\n" + bytes(300))
        stranger.shutdown(socket.SHUT_WR)
        own, _ = at_once(
            lambda: listener.accept(2, "token", lost.put),
            lambda: channel_lib.connect(address, 1, "token", lost.put),
        )
    assert list(own._links) == [1]
    own._leaving.set()
    own._links[1].close()


def groups(ends):
    return [Group(index, len(ends), one) for index, one in enumerate(ends)]


def test_all_leave_an_agreement_or_none(channels):
    ends, _ = channels(3)
    a, b, c = groups(ends)

    def agree(group, error=None):
        with group.agreement():
            if group is a:
                group.from_first(lambda: 1)  # the others are at the end of the block
            if error:
                raise error
        return "left"

    refused = ConfigError("data.path='x' does not exist")
    results = at_once(lambda: agree(a), lambda: agree(b, refused), lambda: agree(c))
    assert results[1] is refused
    for other in (results[0], results[2]):
        assert isinstance(other, OtherProcessError)
        assert str(other) == "process 1: data.path='x' does not exist"
        assert other.exit_code == 2


def test_the_first_process_decides(channels):
    ends, _ = channels(2)
    a, b = groups(ends)
    values = at_once(lambda: a.from_first(lambda: [1, "x"]), lambda: b.from_first(lambda: 2))
    assert values == [[1, "x"], [1, "x"]]
    order = []
    at_once(
        lambda: b.first_then_others(lambda: order.append("b")),
        lambda: a.first_then_others(lambda: order.append("a")),
    )
    assert order == ["a", "b"]


def test_one_process_is_a_group():
    group = Group()
    with group.agreement():
        assert group.exchange(3) == [3]
        assert group.from_first(lambda: 4) == 4
    with pytest.raises(ConfigError), group.agreement():
        raise ConfigError("own")
