# SPDX-License-Identifier: Apache-2.0
"""The console's web server: the middleware, the pages' WebSockets, the page itself."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import secrets
import socket
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, HTTPException, WebSocket
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

from cabols_control.console.access import AccessPolicy
from cabols_control.console.connections import LimitedHttp
from cabols_control.console.dispatcher import Dispatcher, Viewer
from cabols_control.console.middleware import AccessMiddleware
from cabols_control.console.reports import report_file
from cabols_control.console.uploads import UPLOAD_BYTES
from cabols_control.errors import ConfigError

BODY_BYTES = UPLOAD_BYTES + 100_000
"""Largest upload with its form [bytes]."""
BEHIND = 20
"""Most unacknowledged frames of a page, a second's worth; a slower page gets fewer."""
PING_S = 1.0
PAGES = 12
"""Most pages at once; another one is refused."""
REPORT_HEADERS = {
    "content-security-policy": "sandbox allow-popups; default-src 'none'; img-src 'self' data:; "
    "style-src 'self' 'unsafe-inline'; font-src 'self' data:; frame-ancestors 'none'; "
    "form-action 'none'; base-uri 'none'",
    "cache-control": "no-store",
}
"""A report is a file that anybody may have written: it is shown without scripts, and as of a
site of its own, so that it can ask the rig for nothing."""
UNKNOWN_PAGE, TOO_MANY = 4404, 4429
STATIC = Path(str(files("cabols_control") / "console" / "static"))


def open_socket(host: str, port: int) -> socket.socket:
    """Bind the console's address.

    Args:
        host: address or name to serve at.
        port: TCP port; 0: a free one.

    Raises:
        ConfigError: if it is taken, or not this machine's.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
    except OSError as error:
        found.close()
        raise ConfigError(
            f"console: cannot serve at {host}:{port} ({error.strerror}); choose another port"
        ) from error
    return found


class ConsoleServer:
    """Serves until stop(); run() needs a thread of its own."""

    def __init__(
        self,
        dispatcher: Dispatcher,
        policy: AccessPolicy,
        where: socket.socket,
        tls: tuple[str, str] | None,
    ) -> None:
        """Prepare.

        Args:
            dispatcher: shared by all pages.
            policy: of access.
            where: bound socket.
            tls: paths of certificate and key; None: plain HTTP.
        """
        self._dispatcher = dispatcher
        self._socket = where
        self._secure = tls is not None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wakers: set[asyncio.Event] = set()
        application = self._application()
        config = uvicorn.Config(
            AccessMiddleware(application, policy, BODY_BYTES),
            log_level="warning",
            access_log=False,
            ws_max_size=1_000_000,
            http=LimitedHttp,
            timeout_graceful_shutdown=1,
            ssl_certfile=None if tls is None else tls[0],
            ssl_keyfile=None if tls is None else tls[1],
        )
        self._server = uvicorn.Server(config)

    def run(self) -> None:
        """Serve; returns after stop()."""
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """Let run() return; from any thread."""
        # The server waits for no page: the rig's end must not depend on a browser.
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        self._server.should_exit = self._server.force_exit = True
        self._wake_all()

    def _application(self) -> FastAPI:
        from nicegui import ui

        from cabols_control.console.page import build_page

        @contextlib.asynccontextmanager
        async def lifespan(_: FastAPI) -> Any:
            self._loop = asyncio.get_running_loop()
            self._dispatcher.latest.on_news = self._on_news
            yield
            self._dispatcher.latest.on_news = lambda: None

        application = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
        application.mount("/console", StaticFiles(directory=STATIC))
        application.add_api_websocket_route("/live", self._live)
        application.add_api_route("/api/emergency_stop", self._stop_rig, methods=["POST"])
        application.add_api_route("/reports/{name:path}", self._report, methods=["GET"])
        build_page(self._dispatcher)
        ui.run_with(
            application,
            title="cabols console",
            dark=True,
            language="en-US",
            tailwind=False,
            storage_secret=secrets.token_hex(32),
            session_middleware_kwargs={"same_site": "strict", "https_only": self._secure},
            reconnect_timeout=30.0,
            show_welcome_message=False,
        )
        return application

    async def _stop_rig(self) -> dict[str, Any]:
        """Emergency stop, for every page, in command or not."""
        answer = await self._dispatcher.call("", "emergency_stop")
        return {"success": answer.success, "message": answer.message}

    async def _report(self, name: str) -> FileResponse:
        """A file of a finished campaign."""
        path = report_file(self._dispatcher.settings.campaigns, name)
        if path is None:
            raise HTTPException(404, "no such report")
        return FileResponse(path, headers=REPORT_HEADERS)

    def _on_news(self) -> None:
        """Wake the pages' tasks without waiting; called in the rig's thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            with contextlib.suppress(RuntimeError):  # it is closing
                loop.call_soon_threadsafe(self._wake_all_here)

    def _wake_all(self) -> None:
        self._on_news()

    def _wake_all_here(self) -> None:
        for waker in self._wakers:
            waker.set()

    async def _live(self, wire: WebSocket) -> None:
        """Serve one page's WebSocket."""
        viewer = self._dispatcher.viewers.get(wire.query_params.get("page", ""))
        await wire.accept()
        if viewer is None:
            await wire.close(UNKNOWN_PAGE)
            return
        if len(self._wakers) >= PAGES:
            await wire.close(TOO_MANY)
            return
        waker = asyncio.Event()
        self._wakers.add(waker)
        viewer.tab = wire.query_params.get("tab", "")[:64]
        viewer.sent = viewer.acked = self._dispatcher.latest.frame()[0]
        hearing = asyncio.create_task(self._hear(wire, viewer))
        try:
            await self._tell(wire, viewer, waker, hearing)
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # the page has gone
        finally:
            self._wakers.discard(waker)
            hearing.cancel()
            self._dispatcher.lost(viewer)

    async def _hear(self, wire: WebSocket, viewer: Viewer) -> None:
        """Take a page's acknowledgements."""
        with contextlib.suppress(
            WebSocketDisconnect, ValueError, KeyError, TypeError, RuntimeError
        ):
            while True:
                told = json.loads(await wire.receive_text())
                # A page that answers before its first frame sends 0, which changes nothing.
                viewer.acked = max(viewer.acked, min(int(told["a"]), viewer.sent))
                self._dispatcher.heard(viewer)

    async def _tell(
        self, wire: WebSocket, viewer: Viewer, waker: asyncio.Event, hearing: asyncio.Task[None]
    ) -> None:
        latest = self._dispatcher.latest
        version, number, pinged_s = -1, 0, 0.0
        loop = asyncio.get_running_loop()
        while not hearing.done() and not self._server.should_exit:
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(waker.wait(), PING_S)
            waker.clear()
            behind = viewer.sent - viewer.acked > BEHIND
            if loop.time() - pinged_s >= PING_S:
                pinged_s = loop.time()
                await wire.send_text('{"k":"p"}')
            if behind:
                continue
            newest, state = latest.state_text()
            if newest != version:
                version = newest
                await wire.send_text(state)
            events = latest.events_after(number)
            if events:
                number = events[-1].number
                rows = [event.row() for event in events]
                await wire.send_text(json.dumps({"k": "l", "events": rows}))
            count, frame = latest.frame()
            if count > viewer.sent:
                viewer.sent = count
                await wire.send_text(frame)
