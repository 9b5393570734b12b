# SPDX-License-Identifier: Apache-2.0
"""The controller's web server: Robot Web Services 1.0 or 2.0 over HTTP or HTTPS, on loopback."""

from __future__ import annotations

import json
import ssl
import sys
import threading
from collections.abc import Callable
from enum import IntEnum
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from cabols_control.errors import CabolsError
from cabols_sim.devices.abb.digest import DigestGuard
from cabols_sim.devices.abb.rapid import RapidProgram
from cabols_sim.devices.abb.rws2 import Rws2
from cabols_sim.devices.abb.rws_resources import Refusal, RwsResources

BODY_LIMIT = 65536
IDLE_S = 30.0
HANG_S = 5.0


class Trouble(IntEnum):
    """What a network or a controller does to a request."""

    NONE = 0
    LOST = 1
    """The connection is closed before the request is obeyed."""
    ANSWER_LOST = 2
    """The request is obeyed, the connection is closed before the answer."""
    BUSY = 3
    """503; not obeyed."""
    HANGS = 4
    """Not obeyed, and no answer for a long time."""


Troubles = Callable[[str, str], Trouble]
"""(method, path with query) to what happens to a request."""


def no_trouble(method: str, path: str) -> Trouble:
    """Let every request through.

    Args:
        method: of the request.
        path: of the request.
    """
    del method, path
    return Trouble.NONE


class RwsServerError(CabolsError):
    """The server's port is not available."""


class Version(Protocol):
    """What the two versions differ in."""

    def challenge(self) -> str:
        """Value of WWW-Authenticate."""

    def allows(self, method: str, path: str, header: str) -> bool:
        """Whether a request may be answered.

        Args:
            method: of it.
            path: of it.
            header: its Authorization.
        """

    def act(
        self, method: str, path: str, query: dict[str, str], body: str, headers: Any
    ) -> tuple[int, Any, dict[str, str]]:
        """Answer a request: status, content, further headers.

        Args:
            method: GET or POST.
            path: without the query.
            query: of the path.
            body: content of a POST.
            headers: of the request.
        """


class Rws1:
    """Robot Web Services 1.0 (IRC5): digest authentication, actions in the query."""

    def __init__(self, resources: RwsResources, user: str, password: str) -> None:
        """Serve one user."""
        self._resources = resources
        self._guard = DigestGuard(user, password)

    def challenge(self) -> str:
        """Value of WWW-Authenticate."""
        return self._guard.challenge()

    def allows(self, method: str, path: str, header: str) -> bool:
        """Whether a request may be answered.

        Args:
            method: of it.
            path: of it.
            header: its Authorization.
        """
        return self._guard.allows(method, path, header)

    def act(
        self, method: str, path: str, query: dict[str, str], body: str, headers: Any
    ) -> tuple[int, Any, dict[str, str]]:
        """Answer a request: status, content, further headers.

        Args:
            method: GET or POST.
            path: without the query.
            query: of the path.
            body: content of a POST.
            headers: of the request.
        """
        links = {"base": {"href": f"http://{headers.get('Host', '')}/"}}
        try:
            if method == "GET":
                state = self._resources.get(path)
                return 200, {"_links": links, "_embedded": {"_state": state}}, {}
            form = {k: v[0] for k, v in parse_qs(body).items()}
            self._resources.post(path, query.get("action", ""), form)
        except Refusal as refusal:
            status = {"code": refusal.code, "msg": str(refusal)}
            return refusal.status, {"_links": links, "_embedded": {"status": status}}, {}
        return 204, None, {}


def _handler(version: Version, server: RwsServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        timeout = IDLE_S
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
            self._serve()

        def do_POST(self) -> None:
            self._serve()

        def _serve(self) -> None:
            # The body is read even if refused, or the next request on this connection would be it.
            body = self._body()
            if body is None:
                self.close_connection = True
                self._answer(400, None)
                return
            trouble = server.troubles(self.command, self.path)
            if trouble == Trouble.HANGS:
                server.stopping.wait(HANG_S)
            if trouble in (Trouble.LOST, Trouble.HANGS):
                self.close_connection = True
            elif trouble == Trouble.BUSY:
                self._answer(503, None)
            else:
                self._obey(body, trouble)

        def _obey(self, body: str, trouble: Trouble) -> None:
            proof = self.headers.get("Authorization") or ""
            if version.allows(self.command, self.path, proof):
                url = urlsplit(self.path)
                query = {k: v[0] for k, v in parse_qs(url.query).items()}
                answer = version.act(self.command, url.path, query, body, self.headers)
            else:
                answer = 401, None, {"WWW-Authenticate": version.challenge()}
            if trouble == Trouble.ANSWER_LOST:
                self.close_connection = True
            else:
                self._answer(*answer)

        def _body(self) -> str | None:
            try:
                length = int(self.headers.get("Content-Length") or 0)
            except ValueError:
                return None
            if not 0 <= length <= BODY_LIMIT:
                return None
            return self.rfile.read(length).decode("utf-8", "replace")

        def _answer(self, status: int, content: Any, headers: dict[str, str] | None = None) -> None:
            raw = b"" if content is None else json.dumps(content).encode()
            self.send_response(status)
            for name, value in (headers or {}).items():
                self.send_header(name, value)
            if status != 204:
                self.send_header("Content-Type", "application/json" if raw else "text/html")
                self.send_header("Content-Length", str(len(raw)))
            self.end_headers()
            self.wfile.write(raw)

        def log_message(self, *_: Any) -> None:
            return

    return Handler


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that has gone; it may have stopped waiting."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class RwsServer:
    """HTTP server in threads of its own, on loopback.

    Attributes:
        port: where it listens.
        url: the same as an address.
        troubles: what happens to requests; may be replaced at any time.
        stopping: set when it ends.
    """

    def __init__(
        self,
        program: RapidProgram,
        user: str,
        password: str,
        port: int = 0,
        version: int = 1,
        certificate: str = "",
    ) -> None:
        """Bind.

        Args:
            program: of the controller.
            user: that may log in.
            password: of the user.
            port: 0 for any.
            version: of Robot Web Services, 1 or 2.
            certificate: PEM file with certificate and key, for https; empty: http.

        Raises:
            RwsServerError: if the port is taken.
        """
        resources = RwsResources(program)
        spoken: Version = (Rws1 if version == 1 else Rws2)(resources, user, password)
        self.troubles: Troubles = no_trouble
        self.stopping = threading.Event()
        handler = _handler(spoken, self)
        try:
            self._server = _Server(("127.0.0.1", port), handler)
        except OSError as error:
            raise RwsServerError(
                f"rws port: expected a free TCP port, got {port} ({error.strerror}); "
                "is another device simulator running?"
            ) from error
        if certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(certificate)
            self._server.socket = context.wrap_socket(self._server.socket, server_side=True)
        self.url = f"http{'s' if certificate else ''}://127.0.0.1:{self._server.server_address[1]}"
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name="rws", daemon=True
        )

    def start(self) -> None:
        """Start to answer."""
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        self.stopping.set()
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join(timeout=1.0)
        self._server.server_close()
