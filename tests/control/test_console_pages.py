# SPDX-License-Identifier: Apache-2.0
"""A flood of requests for pages leaves the console's loop free for the stop."""

from __future__ import annotations

import asyncio

import pytest

from cabols_control.console import middleware
from cabols_control.console.access import AccessPolicy
from cabols_control.console.middleware import PAGES, PAGES_PER_S, AccessMiddleware, answer

PORT = 8080


class Server:
    """The middleware before an application that counts what reaches it."""

    def __init__(self):
        self.reached = []
        self.middleware = AccessMiddleware(self._app, AccessPolicy("127.0.0.1", ""), 1000)

    async def _app(self, scope, receive, send):
        del receive
        self.reached.append(scope["path"])
        await answer(send, 200, "")

    def ask(self, path, method="GET"):
        """Status and headers of one request."""
        said = []
        host = f"127.0.0.1:{PORT}".encode()
        scope = {
            "type": "http",
            "path": path,
            "method": method,
            "headers": [(b"host", host), (b"origin", b"http://" + host)],
            "client": ("127.0.0.1", 40000),
        }

        async def receive():
            return {"type": "http.request"}

        async def send(message):
            said.append(message)

        asyncio.run(self.middleware(scope, receive, send))
        return said[0]["status"], dict(said[0]["headers"])


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(middleware.time, "monotonic", lambda: now[0])
    return now


def test_flood_of_pages_is_refused_and_the_stop_passes(clock):
    """100 readers of 20 pages each, who read none, held the page for 10 s, and 400 MB."""
    server = Server()
    statuses = [server.ask(path)[0] for path in ("/", "/no/such/page") * 50]
    assert statuses == [200] * int(PAGES) + [503] * (100 - int(PAGES))
    status, headers = server.ask("/")
    assert (status, headers[b"connection"]) == (503, b"close")
    assert server.ask("/api/emergency_stop", "POST")[0] == 200
    for path in ("/console/page.css", "/_nicegui/x.js", "/reports/run"):
        assert server.ask(path)[0] == 200
    clock[0] += 1.0
    statuses = [server.ask("/")[0] for _ in range(10)]
    assert statuses == [200] * int(PAGES_PER_S) + [503] * (10 - int(PAGES_PER_S))


def test_pages_that_people_open_pass(clock):
    server = Server()
    for _ in range(200):
        assert server.ask("/")[0] == 200
        clock[0] += 0.25
