# SPDX-License-Identifier: Apache-2.0
"""Limits on connections of the console's server, before any request is read whole.

A request that is never completed would keep its connection, and a thousand of them all of the
process's file descriptors: the page's emergency stop would then find no place.
"""

from __future__ import annotations

import asyncio
from typing import Any, ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_S = 5.0
"""A request must be complete, with its body, within this time of its connection, or of the
answer to the one before [s]."""
UPLOAD_S = 30.0
"""The body of a request whose head is complete may take this long [s]."""
INCOMPLETE = 64
"""Most connections without a complete request; beyond it the oldest is closed."""


class LimitedHttp(H11Protocol):
    """HTTP/1.1 whose connections end when no complete request comes."""

    _waiting: ClassVar[dict[LimitedHttp, None]] = {}
    """Connections without a complete request, oldest first."""
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Give the connection a place and a deadline."""
        super().connection_made(transport)
        self._wait_for_request()
        while len(self._waiting) > INCOMPLETE:
            next(iter(self._waiting))._close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Free its place."""
        self._rest()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Take what has arrived; a request that is complete has no deadline any more."""
        before = self.cycle
        super().handle_events()
        if self.cycle is None or self.cycle.response_complete:
            return
        if not self.cycle.more_body:
            self._rest()
        elif self.cycle is not before and self._deadline is not None:
            self._deadline.cancel()
            self._deadline = self.loop.call_later(UPLOAD_S, self._close)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand the connection over; the page's protocol has limits of its own."""
        self._rest()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Wait for the next request of the same connection."""
        super().on_response_complete()
        if not self.transport.is_closing():
            self._wait_for_request()

    def _wait_for_request(self) -> None:
        self._rest()
        self._waiting[self] = None
        self._deadline = self.loop.call_later(REQUEST_S, self._close)

    def _rest(self) -> None:
        self._waiting.pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _close(self) -> None:
        self._rest()
        # Not close(), which would wait for a reader that does not read.
        self.transport.abort()
