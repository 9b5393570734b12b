# SPDX-License-Identifier: Apache-2.0
"""Robot Web Services 2.0 (OmniCore), as much of it as a rig uses, over the same RAPID program.

Other than 1.0: basic authentication, other paths, the version in the types of content, state at the
top of the answer, and a mastership that a client has to hold before it writes.
"""

from __future__ import annotations

import base64
import hmac
import secrets
import threading
from typing import Any
from urllib.parse import parse_qs

from cabols_sim.devices.abb.rws_resources import (
    MODULE,
    NO_RESOURCE,
    REJECTED,
    SYMBOLS,
    TASK,
    Refusal,
    RwsResources,
)

ACCEPTED = ("application/hal+json;v=2.0", "application/xhtml+xml;v=2.0")
FORM = "application/x-www-form-urlencoded;v=2.0"
SYMBOLS_2 = "/rw/rapid/symbol/RAPID/"
MASTERSHIP = "/rw/mastership/edit/"
COOKIE = "ABBCX"
GETS = {"/rw/panel/ctrl-state": "/rw/panel/ctrlstate"}
"""Paths of 2.0 whose answer is that of another path of 1.0."""


class BasicGuard:
    """Checks Authorization headers for one user."""

    def __init__(self, user: str, password: str) -> None:
        """Accept this user only."""
        self._expected = base64.b64encode(f"{user}:{password}".encode())

    def challenge(self) -> str:
        """Value of WWW-Authenticate."""
        return 'Basic realm="validusers@robapi.abb"'

    def allows(self, header: str) -> bool:
        """Whether an Authorization header proves the password."""
        scheme, _, proof = header.partition(" ")
        return scheme.lower() == "basic" and hmac.compare_digest(proof.encode(), self._expected)


class Rws2Resources:
    """Requests of 2.0 on the resources of 1.0; sessions and the mastership.

    Attributes:
        holder: session that holds the mastership; empty for none.
    """

    def __init__(self, resources: RwsResources) -> None:
        """Serve the same program."""
        self._resources = resources
        self._lock = threading.Lock()
        self._sessions: set[str] = set()
        self.holder = ""

    def session(self, cookie: str) -> tuple[str, bool]:
        """Return the session of a Cookie header, and whether it is a new one."""
        for part in cookie.split(";"):
            name, _, value = part.strip().partition("=")
            if name == COOKIE and value in self._sessions:
                return value, False
        new = secrets.token_hex(8)
        with self._lock:
            self._sessions.add(new)
        return new, True

    def get(self, path: str, session: str) -> list[dict[str, str]]:
        """Return the state entries of a resource.

        Args:
            path: of the request.
            session: of the client.

        Raises:
            Refusal: if there is none.
        """
        if path == "/logout":
            with self._lock:
                self._sessions.discard(session)
                self.holder = "" if self.holder == session else self.holder
            return [{"_type": "user-logout", "_title": "logout"}]
        return self._resources.get(_symbol(path) if _symbol(path) else GETS.get(path, path))

    def post(self, path: str, form: dict[str, str], session: str) -> None:
        """Act.

        Args:
            path: of the request.
            form: its content.
            session: of the client.

        Raises:
            Refusal: if that is not possible now, or ever.
        """
        if path.startswith(MASTERSHIP):
            self._mastership(path.removeprefix(MASTERSHIP), session)
            return
        if path == "/rw/rapid/execution/stop":
            self._resources.post("/rw/rapid/execution", "stop", form)
            return
        if self.holder != session:
            raise Refusal(403, REJECTED, "the operation needs mastership of edit")
        symbol, (place, _, action) = _symbol(path), path.rpartition("/")
        if symbol:
            self._resources.post(symbol, "set", form)
        elif place == "/rw/rapid/execution":
            self._resources.post(place, action, form)
        elif path == "/rw/panel/ctrl-state":
            self._resources.post("/rw/panel/ctrlstate", "setctrlstate", form)
        else:
            raise Refusal(404, NO_RESOURCE, f"no such resource: {path}")

    def _mastership(self, action: str, session: str) -> None:
        with self._lock:
            if self.holder not in ("", session):
                raise Refusal(403, REJECTED, "mastership is held by another client")
            self.holder = session if action == "request" else ""


def _symbol(path: str) -> str:
    """Return the path of a RAPID variable in 1.0; empty if it is none."""
    start, end = f"{SYMBOLS_2}{TASK}/{MODULE}/", "/data"
    if not (path.startswith(start) and path.endswith(end)):
        return ""
    return f"{SYMBOLS}{TASK}/{MODULE}/{path[len(start) : -len(end)]}"


class Rws2:
    """What the HTTP handler asks a version for: who may, what comes, how it is said."""

    def __init__(self, resources: RwsResources, user: str, password: str) -> None:
        """Serve one user."""
        self.resources = Rws2Resources(resources)
        self._guard = BasicGuard(user, password)

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
        del method, path
        return self._guard.allows(header)

    def act(
        self, method: str, path: str, query: dict[str, str], body: str, headers: Any
    ) -> tuple[int, Any, dict[str, str]]:
        """Answer a request: status, content, further headers.

        Args:
            method: GET or POST.
            path: without the query.
            query: of the path; 2.0 has none that matters.
            body: content of a POST.
            headers: of the request.
        """
        del query
        session, new = self.resources.session(headers.get("Cookie") or "")
        more = {"Set-Cookie": f"{COOKIE}={session}; path=/"} if new else {}
        try:
            if (headers.get("Accept") or "").split(",")[0].strip() not in ACCEPTED:
                raise Refusal(406, NO_RESOURCE, f"expected Accept: {ACCEPTED[0]}")
            if method == "GET":
                content = {"_links": {}, "state": self.resources.get(path, session)}
                return 200, content, more
            if headers.get("Content-Type") != FORM:
                raise Refusal(415, NO_RESOURCE, f"expected Content-Type: {FORM}")
            form = {k: v[0] for k, v in parse_qs(body).items()}
            self.resources.post(path, form, session)
        except Refusal as refusal:
            status = {"code": refusal.code, "msg": str(refusal)}
            return refusal.status, {"status": status}, more
        return 204, None, more
