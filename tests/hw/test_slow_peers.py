# SPDX-License-Identifier: Apache-2.0
"""Controllers that drip or hang at any place of an exchange: its deadline holds for all of it.

A time-out of each read is none: every byte begins it anew. A peer that never ends its answer ends
these tests by their time limit, unless the client gives it up by itself.
"""

from __future__ import annotations

import socket
import threading
from contextlib import contextmanager, suppress

import pytest

from cabols_hw.abb.errors import RwsError, RwsFailure
from cabols_hw.abb.rws.client import RwsSession
from cabols_hw.abb.rws.http_exchange import Deadline, HttpAddress, HttpConnection, tls_context
from cabols_hw.abb.rws.stop import StopAttempts
from rws_fake import PASSWORD, USER, FakeController

pytestmark = pytest.mark.timeout(60)

DEADLINE_S = 0.4
EVERY_S = 0.02
"""Between two bytes: far within any time-out of a read."""
HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
DRIPS = {
    "status line": (b"HTTP/1.", b"1"),
    "after the status line": (HEAD, b""),
    "name of a header": (HEAD + b"X", b"x"),
    "value of a header": (HEAD + b"X: ", b"x"),
    "headers without an end": (HEAD, b"X: x\r\n"),
    "body of a length": (HEAD + b"Content-Length: 100000\r\n\r\n", b" "),
    "body without a length": (HEAD + b"Connection: close\r\n\r\n", b" "),
    "length of a chunk": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"0"),
    "chunk": (HEAD + b"Transfer-Encoding: chunked\r\n\r\nffff\r\n", b" "),
    "chunks without an end": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
    "trailers without an end": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n0\r\n", b"X: x\r\n"),
    "interim answers": (b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
}


@contextmanager
def peer(behave, count=64):
    """Serve each connection by behave(link, over), in a thread of its own; yields the port."""
    over = threading.Event()

    def serve(link):
        with link, suppress(OSError):
            behave(link, over)

    def accept(server):
        with suppress(OSError):
            for _ in range(count):
                link, _ = server.accept()
                threading.Thread(target=serve, args=(link,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=accept, args=(server,), daemon=True).start()
        yield server.getsockname()[1]
        over.set()


def dripping(first, again):
    def behave(link, over):
        link.recv(4096)
        link.sendall(first)
        while not over.wait(EVERY_S):
            link.sendall(again)

    return behave


def fetch(port, scheme="http", deadline_s=DEADLINE_S):
    connection = HttpConnection(HttpAddress(scheme, "127.0.0.1", port), tls_context())
    try:
        return connection.exchange("GET", "/", {}, b"", Deadline(deadline_s))
    finally:
        connection.close()


@pytest.mark.parametrize("place", DRIPS)
def test_answer_that_drips_ends_with_the_deadline(place):
    with peer(dripping(*DRIPS[place])) as port, pytest.raises(RwsError) as caught:
        fetch(port)
    # Too many headers end it earlier.
    endless = place in ("headers without an end", "trailers without an end")
    allowed = {RwsFailure.TIMED_OUT} | ({RwsFailure.DROPPED} if endless else set())
    assert caught.value.failure in allowed


RECORD = bytes([22, 3, 3, 0x40, 0])
"""Begin of a TLS record of a hand-shake that announces 16 KiB."""


@pytest.mark.parametrize(("first", "again"), [(b"", b""), (b"", b"\x16"), (RECORD, b"\x02")])
def test_hand_shake_that_drips_ends_with_the_deadline(first, again):
    with peer(dripping(first, again)) as port, pytest.raises(RwsError) as caught:
        fetch(port, "https")
    assert caught.value.failure in (RwsFailure.TIMED_OUT, RwsFailure.DROPPED)


def test_connection_that_nobody_accepts_ends_with_the_deadline():
    """Its queue is full, so that even the connection's own hand-shake stays half open."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server:
        port, waiting = server.getsockname()[1], []
        for _ in range(4):
            link = socket.socket()
            link.setblocking(False)
            link.connect_ex(("127.0.0.1", port))
            waiting.append(link)
        with pytest.raises(RwsError) as caught:
            fetch(port)
        for link in waiting:
            link.close()
    assert caught.value.failure is RwsFailure.TIMED_OUT


def test_a_name_with_several_addresses_shares_the_deadline_among_them(monkeypatch):
    """The first one never answers; the second is reached within the same deadline."""

    def answer(link, over):
        del over
        link.recv(4096)
        link.sendall(HEAD + b"Content-Length: 2\r\n\r\n{}")

    with (
        socket.create_server(("127.0.0.1", 0), backlog=0) as full,
        peer(answer) as port,
        socket.socket() as first,
        socket.socket() as second,
    ):
        for link in (first, second):
            link.setblocking(False)
            link.connect_ex(full.getsockname())
        family = (socket.AF_INET, socket.SOCK_STREAM, 6, "")
        both = [(*family, full.getsockname()), (*family, ("127.0.0.1", port))]
        monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: both)
        assert fetch(port, deadline_s=4.0).body == b"{}"


def relay(link, target):
    """Pass on what comes from a connection, and the answers."""

    def answers():
        with suppress(OSError):
            while part := target.recv(4096):
                link.sendall(part)

    threading.Thread(target=answers, daemon=True).start()
    while part := link.recv(4096):
        target.sendall(part)


@pytest.mark.parametrize("place", ["headers without an end", "chunk", "interim answers"])
def test_stop_arrives_although_the_first_attempts_hang(place):
    """Each attempt has a connection of its own, and none waits for those before."""
    hung, controller = threading.Semaphore(3), FakeController()
    where = HttpAddress.of(controller.url)

    def behave(link, over):
        if hung.acquire(blocking=False):
            dripping(*DRIPS[place])(link, over)
            return
        with socket.create_connection((where.host, where.port)) as target:
            relay(link, target)

    with peer(behave) as port:
        attempts = StopAttempts(RwsSession(f"http://127.0.0.1:{port}", USER, PASSWORD))
        attempts.run(seconds=20.0)
    controller.close()
    assert controller.stops() >= 1
    assert attempts.made >= 4
