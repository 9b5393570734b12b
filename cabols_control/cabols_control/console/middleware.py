# SPDX-License-Identifier: Apache-2.0
"""Access middleware of the console's server: token, origin and size of every request, as ASGI."""

from __future__ import annotations

import asyncio
import html
import time
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from cabols_control.console.access import COOKIE, AccessPolicy, Request

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LOGIN = "/login"
PATH_SIZE = 1000
"""Longest path of an address [characters]."""
PAGES, PAGES_PER_S = 40.0, 5.0
"""Pages that may be built at once, and how many more a second: each takes 40 ms of the loop that
also takes the stop."""
ASSETS = ("/_nicegui", "/console", "/reports", "/api")
"""Beginnings of paths for which no page is built."""
LOGIN_BYTES = 4096
WRONG_TOKEN_S = 1.0
"""Delay of the answer to a wrong token [s]."""
POLICY_VIOLATION = 1008
HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),
]
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>cabols console</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>body{{font:16px system-ui,sans-serif;background:#10151b;color:#e8edf2;display:grid;
place-items:center;min-height:95vh;margin:0}}form{{display:grid;gap:14px;width:min(340px,90vw)}}
input,button{{font:inherit;padding:11px;border-radius:6px;border:1px solid #4a5866;
background:#1a222b;color:inherit}}button{{background:#0e7490;border-color:#0e7490;font-weight:600}}
p{{color:#ffb4a8;min-height:1.3em;margin:0}}</style>
<form method="post" action="/login"><h1 style="font-size:22px;margin:0">cabols console</h1>
<label for="token">Token of this console</label>
<input id="token" name="token" type="password" autocomplete="current-password" autofocus required>
<p role="alert">{message}</p><button type="submit">Open</button></form></html>"""


class TooLargeError(Exception):
    """A request's body is longer than allowed."""


class AccessMiddleware:
    """Passes a request on to the application, or answers it itself."""

    def __init__(self, app: App, policy: AccessPolicy, body_bytes: int) -> None:
        """Wrap an application.

        Args:
            app: that answers the accepted requests.
            policy: decides.
            body_bytes: longest body of a request.
        """
        self._app = app
        self._policy = policy
        self._body_bytes = body_bytes
        self._pages, self._counted_s = PAGES, time.monotonic()

    def _page_may_be_built(self) -> bool:
        """Whether another page may be built now; counts it."""
        now_s = time.monotonic()
        self._pages += PAGES_PER_S * (now_s - self._counted_s)
        self._pages, self._counted_s = min(self._pages, PAGES), now_s
        if self._pages < 1.0:
            return False
        self._pages -= 1.0
        return True

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if "\x00" in scope["path"] or len(scope["path"]) > PATH_SIZE:
            await self._refuse(scope, send, 400, "expected a path of this console")
            return
        request = request_of(scope)
        foreign = self._policy.foreign(request)
        if foreign:
            await self._refuse(scope, send, 403, foreign)
        elif scope["path"] == LOGIN and not request.websocket:
            await self._login(scope, request, receive, send)
        elif not self._policy.admitted(request):
            await self._demand(scope, request, send)
        elif request.query_token and not request.websocket:
            # The redirect removes the token from the address bar and the browser's history.
            await self._welcome(scope, send, scope["path"])
        else:
            await self._pass(scope, receive, send)

    async def _demand(self, scope: Scope, request: Request, send: Send) -> None:
        wants_page = request.method == "GET" and "text/html" in request.headers.get("accept", "")
        if wants_page and not request.websocket:
            await answer(send, 303, "", [(b"location", LOGIN.encode())])
            return
        if request.query_token or "authorization" in request.headers:
            await asyncio.sleep(WRONG_TOKEN_S)
        await self._refuse(scope, send, 401, "expected the console's token")

    async def _login(self, scope: Scope, request: Request, receive: Receive, send: Send) -> None:
        if request.method != "POST":
            await answer(send, 200, PAGE.format(message=""), html_page=True)
            return
        try:
            body = await _read(receive, LOGIN_BYTES)
        except TooLargeError:
            await answer(send, 413, "expected a token\n")
            return
        given = parse_qs(body.decode(errors="replace")).get("token", [""])[0]
        if self._policy.needs_token and self._policy.knows(given.strip()):
            await self._welcome(scope, send, "/")
            return
        await asyncio.sleep(WRONG_TOKEN_S)
        message = html.escape("This is not the console's token.")
        await answer(send, 401, PAGE.format(message=message), html_page=True)

    async def _welcome(self, scope: Scope, send: Send, path: str) -> None:
        cookie = f"{COOKIE}={self._policy.session}; Path=/; HttpOnly; SameSite=Strict"
        if scope.get("scheme") in ("https", "wss"):
            cookie += "; Secure"
        # Two slashes would redirect to another host.
        where = "/" + path.lstrip("/\\")
        headers = [(b"location", where.encode()), (b"set-cookie", cookie.encode())]
        await answer(send, 303, "", headers)

    async def _refuse(self, scope: Scope, send: Send, status: int, reason: str) -> None:
        if scope["type"] == "websocket":
            # Servers turn a close before the end of the handshake into 403.
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": ""})
            return
        await answer(send, status, reason + "\n")

    async def _pass(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return
        # A path that is none gets a page, too. What is posted, as a stop, always passes.
        builds = scope["method"] in ("GET", "HEAD") and not scope["path"].startswith(ASSETS)
        if builds and not self._page_may_be_built():
            # Closed, so that no request that waits behind it in the connection is read.
            closing = [(b"retry-after", b"1"), (b"connection", b"close")]
            await answer(send, 503, "too many pages at once; try again\n", closing)
            return
        begun = False
        left = self._body_bytes

        async def limited() -> Message:
            nonlocal left
            message = await receive()
            left -= len(message.get("body", b""))
            if left < 0:
                raise TooLargeError
            return message

        async def guarded(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                message["headers"] = [*message.get("headers", []), *HEADERS]
            await send(message)

        try:
            declared = int(dict(scope["headers"]).get(b"content-length", b"0"))
        except ValueError:
            declared = 0
        try:
            if declared > self._body_bytes:
                raise TooLargeError
            await self._app(scope, limited, guarded)
        except TooLargeError:
            if not begun:
                text = f"expected at most {self._body_bytes} bytes\n"
                await answer(send, 413, text, [(b"connection", b"close")])


def request_of(scope: Scope) -> Request:
    """Read what the policy needs from an ASGI scope."""
    headers = {
        key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]
    }
    jar: SimpleCookie = SimpleCookie()
    try:
        jar.load(headers.get("cookie", ""))
    except CookieError:
        jar.clear()
    query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
    return Request(
        method=scope.get("method", "GET"),
        websocket=scope["type"] == "websocket",
        headers=headers,
        cookies={name: morsel.value for name, morsel in jar.items()},
        query_token=query.get("token", [""])[0],
    )


async def _read(receive: Receive, limit: int) -> bytes:
    body = b""
    while True:
        message = await receive()
        body += bytes(message.get("body", b""))
        if len(body) > limit:
            raise TooLargeError
        if not message.get("more_body", False):
            return body


async def answer(
    send: Send,
    status: int,
    text: str,
    headers: list[tuple[bytes, bytes]] | None = None,
    html_page: bool = False,
) -> None:
    """Send a whole response, which browsers must not store.

    Args:
        send: ASGI's, of the request.
        status: HTTP status code.
        text: of the body, sent as UTF-8.
        headers: names in lower case and values, beside those of every response.
        html_page: whether the text is HTML; else it is plain.
    """
    kind = b"text/html; charset=utf-8" if html_page else b"text/plain; charset=utf-8"
    body = text.encode()
    base = [(b"content-type", kind), (b"content-length", str(len(body)).encode())]
    base.append((b"cache-control", b"no-store"))
    await send(
        {
            "type": "http.response.start",
            "status": status,
            "headers": [*base, *HEADERS, *(headers or [])],
        }
    )
    await send({"type": "http.response.body", "body": body})
