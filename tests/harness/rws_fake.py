# SPDX-License-Identifier: Apache-2.0
"""A Robot Web Services 1.0 controller whose answers a test can replace one by one.

Digest log-in, session cookies, RAPID variables, a program that moves.
"""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

from cabols_sim.devices.abb.digest import DigestGuard

USER, PASSWORD = "Default User", "robotics"
SYMBOL = "/rw/rapid/symbol/data/RAPID/T_ROB1/"
DROP = "drop"
"""Answer of `fail` that closes the connection instead of answering."""


def failure_body(code):
    """JSON of an error, as a controller writes it."""
    text = f"rws_resource_rapid.cpp[1] code:{code} icode:-1"
    return {"_embedded": {"status": {"code": code, "msg": text}}}


class FakeController:
    """Serves on loopback until the process ends.

    Attributes:
        variables: RAPID's, by name.
        running: whether RAPID runs.
        requests: (method, path, action) of all that came.
    """

    def __init__(self, max_sessions=70, fail=None, motion_s=0.1):
        """`fail(method, path, action)` may give (status, content) or DROP; None: answer."""
        self.variables = {
            "cabols_target": "0",
            "cabols_done": "TRUE",
            "cabols_go": "FALSE",
            "cabols_error": "0",
        }
        self.running, self.requests = True, []
        self.sessions, self.max_sessions = set(), max_sessions
        self.fail = fail or (lambda *_: None)
        self.guard = DigestGuard(USER, PASSWORD)
        self.until, self.motion_s = 0.0, motion_s
        handler = type("Handler", (_Handler,), {"controller": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self):
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()

    def stops(self):
        """How often RAPID was asked to stop."""
        return sum(action == "stop" for _, _, action in self.requests)


class _Handler(BaseHTTPRequestHandler):
    protocol_version, disable_nagle_algorithm = "HTTP/1.1", True
    controller: FakeController

    def do_GET(self):
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
        url = urlsplit(self.path)
        action = parse_qs(url.query).get("action", [""])[0]
        self.controller.requests.append((self.command, url.path, action))
        odd = self.controller.fail(self.command, url.path, action)
        if odd == DROP:
            self.close_connection = True
            self.connection.close()
        elif odd is not None:
            self._say(*odd)
        else:
            self._answer(url.path, action, parse_qs(body))

    do_POST = do_GET  # noqa: N815

    def _answer(self, path, action, form):
        controller = self.controller
        authorisation = self.headers.get("Authorization") or ""
        if not controller.guard.allows(self.command, self.path, authorisation):
            self._say(401, None, {"WWW-Authenticate": controller.guard.challenge()})
            return
        cookie, head = self.headers.get("Cookie") or "", {}
        if "ABBCX=" in cookie:
            session = cookie.split("ABBCX=")[1].split(";")[0]
        elif len(controller.sessions) >= controller.max_sessions:
            self._say(503, None)
            return
        else:
            session = str(len(controller.requests))
            controller.sessions.add(session)
            head = {"Set-Cookie": f"ABBCX={session}; path=/"}
        if path == "/logout":
            controller.sessions.discard(session)
            self._say(200, {"_embedded": {"_state": [{}]}}, head)
        elif path.startswith(SYMBOL):
            self._variable(path[len(SYMBOL) :], form, head)
        elif self.command == "GET":
            self._say(200, {"_embedded": {"_state": [self._states()[path]]}}, head)
        else:
            if action in ("stop", "start"):
                controller.running = action == "start"
            self._say(204, None, head)

    def _variable(self, name, form, head):
        controller = self.controller
        if name not in controller.variables:
            self._say(400, failure_body(-1073442809), head)
        elif self.command == "GET":
            if controller.until and time.monotonic() > controller.until:
                controller.variables["cabols_done"], controller.until = "TRUE", 0.0
            value = controller.variables[name]
            self._say(200, {"_embedded": {"_state": [{"value": value}]}}, head)
        else:
            controller.variables[name] = form["value"][0]
            if name == "cabols_go" and controller.variables[name] == "TRUE":
                controller.until = time.monotonic() + controller.motion_s
                controller.variables.update(cabols_go="FALSE", cabols_done="FALSE")
            self._say(204, None, head)

    def _states(self):
        execution = "running" if self.controller.running else "stopped"
        task = {"name": "T_ROB1", "type": "normal", "taskstate": "linked"}
        return {
            "/rw/panel/opmode": {"opmode": "AUTO"},
            "/rw/panel/ctrlstate": {"ctrlstate": "motoron"},
            "/rw/rapid/execution": {"ctrlexecstate": execution, "cycle": "forever"},
            "/rw/rapid/tasks": {
                **task,
                "excstate": "started",
                "active": "On",
                "motiontask": "TRUE",
            },
        }

    def _say(self, status, content, head=None):
        as_text = isinstance(content, bytes)
        raw = b"" if content is None else content if as_text else json.dumps(content).encode()
        self.send_response(status)
        for key, value in (head or {}).items():
            self.send_header(key, value)
        if status != 204:
            plain = as_text or not raw
            self.send_header("Content-Type", "text/html" if plain else "application/json")
            self.send_header("Content-Length", str(len(raw)))
        self.end_headers()
        self.wfile.write(raw)

    def log_message(self, *_):
        """Say nothing."""
