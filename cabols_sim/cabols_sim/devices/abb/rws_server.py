"""Robot Web Services 1.0, as much of it as a rig uses, over HTTP with digest authentication."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from cabols_control.errors import CabolsError
from cabols_sim.devices.abb.digest import DigestGuard
from cabols_sim.devices.abb.rapid import RapidError, RapidProgram

TASK = "T_ROB1"
MODULE = "cabols"
SYMBOLS = "/rw/rapid/symbol/data/RAPID/"
SYMBOL_NOT_FOUND = -1073442809
REJECTED = -1073445865
NO_RESOURCE = -1073445881
BODY_LIMIT = 65536
IDLE_S = 30.0


class RwsServerError(CabolsError):
    """The server's port is not available."""


class Refusal(Exception):  # noqa: N818
    """An answer other than success: HTTP status, RWS code and message."""

    def __init__(self, status: int, code: int, message: str) -> None:
        super().__init__(message)
        self.status, self.code = status, code


class RwsResources:
    """Path and query to answer; no sockets, no authentication."""

    def __init__(self, program: RapidProgram) -> None:
        """Serve one program on one task."""
        self._program = program

    def get(self, path: str) -> list[dict[str, str]]:
        """Return the state entries of a resource; Refusal if there is none."""
        program = self._program
        if path.startswith(SYMBOLS):
            name = self._symbol(path)
            return [{"_type": "rap-data", "_title": path[1:], "value": program.get(name)}]
        running = "running" if program.running else "stopped"
        known = {
            "/rw/rapid/execution": {
                "_type": "rap-execution",
                "_title": "execution",
                "ctrlexecstate": running,
                "cycle": "forever",
            },
            "/rw/panel/ctrlstate": {
                "_type": "pnl-ctrlstate",
                "_title": "ctrlstate",
                "ctrlstate": program.controller_state,
            },
            "/rw/panel/opmode": {
                "_type": "pnl-opmode",
                "_title": "opmode",
                "opmode": program.operation_mode,
            },
            "/rw/rapid/tasks": {
                "_type": "rap-task-li",
                "_title": TASK,
                "name": TASK,
                "type": "normal",
                "taskstate": "linked",
                "excstate": "started" if program.running else "stopped",
                "active": "On",
                "motiontask": "TRUE",
            },
            "/logout": {"_type": "user-logout", "_title": "logout"},
        }
        if path not in known:
            raise Refusal(404, NO_RESOURCE, f"no such resource: {path}")
        return [known[path]]

    def post(self, path: str, action: str, form: dict[str, str]) -> None:
        """Act; Refusal if that is not possible now, or ever."""
        program = self._program
        if program.operation_mode != "AUTO":
            raise Refusal(403, REJECTED, "operation not allowed in manual mode")
        try:
            if path.startswith(SYMBOLS) and action == "set":
                program.set(self._symbol(path), form.get("value", ""))
            elif (path, action) == ("/rw/rapid/execution", "start"):
                program.start()
            elif (path, action) == ("/rw/rapid/execution", "stop"):
                program.stop()
            elif (path, action) == ("/rw/rapid/execution", "resetpp"):
                program.reset_pointer()
            elif (path, action) == ("/rw/panel/ctrlstate", "setctrlstate"):
                self._switch(form.get("ctrl-state", ""))
            elif path.startswith("/rw/mastership"):
                # Implicit mastership suffices for one client; requesting it is no error.
                return
            else:
                raise Refusal(404, NO_RESOURCE, f"no such resource: {path}?action={action}")
        except RapidError as error:
            raise Refusal(400, REJECTED, str(error)) from error

    def _switch(self, wanted: str) -> None:
        if wanted not in ("motoron", "motoroff"):
            raise Refusal(400, REJECTED, f"ctrl-state: expected motoron or motoroff, got {wanted}")
        self._program.set_motors(wanted == "motoron")

    def _symbol(self, path: str) -> str:
        """Name of the variable of .../T_ROB1/name or .../T_ROB1/module/name."""
        task, *rest = path[len(SYMBOLS) :].split("/")
        modules, name = rest[:-1], rest[-1] if rest else ""
        if task != TASK or modules not in ([], [MODULE]) or name not in self._program.names:
            raise Refusal(400, SYMBOL_NOT_FOUND, f"RAPID symbol was not found: {path}")
        return name


def _handler(resources: RwsResources, guard: DigestGuard) -> type[BaseHTTPRequestHandler]:
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
            elif not guard.allows(self.command, self.path, self.headers.get("Authorization") or ""):
                self._answer(401, None, {"WWW-Authenticate": guard.challenge()})
            else:
                self._act(body)

        def _act(self, body: str) -> None:
            url = urlsplit(self.path)
            query = {k: v[0] for k, v in parse_qs(url.query).items()}
            links = {"base": {"href": f"http://{self.headers.get('Host', '')}/"}}
            try:
                if self.command == "GET":
                    state = resources.get(url.path)
                    self._answer(200, {"_links": links, "_embedded": {"_state": state}})
                else:
                    form = {k: v[0] for k, v in parse_qs(body).items()}
                    resources.post(url.path, query.get("action", ""), form)
                    self._answer(204, None)
            except Refusal as refusal:
                status = {"code": refusal.code, "msg": str(refusal)}
                self._answer(refusal.status, {"_links": links, "_embedded": {"status": status}})

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


class RwsServer:
    """HTTP server in threads of its own, on loopback.

    Attributes:
        port: where it listens.
    """

    def __init__(self, program: RapidProgram, user: str, password: str, port: int = 0) -> None:
        """Bind; 0: any port.

        Raises:
            RwsServerError: if the port is taken.
        """
        handler = _handler(RwsResources(program), DigestGuard(user, password))
        try:
            self._server = _Server(("127.0.0.1", port), handler)
        except OSError as error:
            raise RwsServerError(
                f"rws port: expected a free TCP port, got {port} ({error.strerror}); "
                "is another device simulator running?"
            ) from error
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name="rws", daemon=True
        )

    def start(self) -> None:
        """Start to answer."""
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join(timeout=1.0)
        self._server.server_close()
