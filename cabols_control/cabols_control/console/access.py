# SPDX-License-Identifier: Apache-2.0
"""Who may open the console, and which of its pages is in command."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cabols_control.errors import ConfigError

TOKEN_MIN = 16
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
OTHER_SITES = ("cross-site", "same-site")
COOKIE = "cabols_console"
LOCAL_NAMES = ("localhost", "127.0.0.1", "[::1]")


def is_loopback(host: str) -> bool:
    """Whether a server that binds this address can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Request:
    """What the middleware needs to know of a request.

    Attributes:
        method: of HTTP; "GET" for a WebSocket's handshake.
        websocket: whether it opens a WebSocket.
        headers: names in lower case.
        cookies: by name.
        query_token: of the address, `?token=...`; empty if there is none.
    """

    method: str
    websocket: bool
    headers: Mapping[str, str]
    cookies: Mapping[str, str]
    query_token: str = ""


class AccessPolicy:
    """Decides about every request: of pages, commands and WebSockets.

    A console on loopback needs no token unless one is given, but it answers only requests
    for this machine's name, from its own pages: other sites that the operator's browser shows must
    not reach it (by a foreign Origin, or by a name that a foreign DNS points here).
    """

    def __init__(self, host: str, token: str = "") -> None:
        """Check the combination.

        Args:
            host: address that the server binds.
            token: demanded of every request; empty: none.

        Raises:
            ConfigError: if another address than loopback has no token, or a token is too short.
        """
        self.local = is_loopback(host)
        if not self.local and not token:
            raise ConfigError(
                f"console: expected a token_file, as {host} can be reached from other machines; "
                "write a secret into a file that only you can read and name it"
            )
        if token and len(token) < TOKEN_MIN:
            raise ConfigError(
                f"token_file: expected at least {TOKEN_MIN} characters, got {len(token)}"
            )
        self._token = token
        # The cookie is not the token itself, and ends with this server.
        salt = secrets.token_bytes(32)
        self._session = hmac.new(salt, token.encode(), hashlib.sha256).hexdigest()

    @property
    def needs_token(self) -> bool:
        """Whether a token is demanded."""
        return bool(self._token)

    @property
    def session(self) -> str:
        """Cookie of a browser that has shown the token."""
        return self._session

    def knows(self, token: str) -> bool:
        """Whether this is the token; takes the same time for every wrong one."""
        return hmac.compare_digest(token.encode(), self._token.encode())

    def foreign(self, request: Request) -> str:
        """Why a request comes from elsewhere than this console's pages; empty if it does not."""
        host = request.headers.get("host", "")
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        if self.local and name not in LOCAL_NAMES:
            return f"expected a request for {' or '.join(LOCAL_NAMES)}, got one for {host!r}"
        origin = request.headers.get("origin", "")
        if origin and origin.partition("://")[2] != host:
            return f"expected a page of {host}, got a request of {origin}"
        if request.headers.get("sec-fetch-site", "") not in OTHER_SITES:
            return ""
        changes = request.websocket or request.method not in SAFE_METHODS
        # A link on another site may open the page in a tab of its own; nothing else comes in.
        visit = (
            request.headers.get("sec-fetch-mode") == "navigate"
            and request.headers.get("sec-fetch-dest") == "document"
        )
        if changes or not visit:
            return "expected a page of this console, got a request of another site"
        return ""

    def admitted(self, request: Request) -> bool:
        """Whether the token was shown: in a header, in the address, or before, by the cookie."""
        if not self.needs_token:
            return True
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self.knows(given.strip()):
            return True
        if request.query_token and self.knows(request.query_token):
            return True
        return hmac.compare_digest(request.cookies.get(COOKIE, ""), self._session)


@dataclass(frozen=True)
class Holder:
    """The page in command.

    Attributes:
        page: its id.
        identity: its browser's and tab's id; the same for a page that was loaded again.
        name: shown to the others.
    """

    page: str
    identity: str
    name: str


class Lease:
    """One page at a time may command; one that does not answer loses it to the next request."""

    def __init__(self, alive: Callable[[str], bool]) -> None:
        """Start without a page in command; `alive` returns whether a page answers."""
        self._alive = alive
        self.holder: Holder | None = None

    @property
    def attended(self) -> bool:
        """Whether a page is in command and answers."""
        return self.holder is not None and self._alive(self.holder.page)

    def take(self, page: str, identity: str, name: str) -> str:
        """Take command; returns why not, empty if it was granted.

        Args:
            page: identity of the page that asks.
            identity: of the tab, which a page that is loaded again keeps.
            name: of the operator.
        """
        holder = self.holder
        if holder is not None and holder.page != page and self._alive(holder.page):
            return f"{holder.name} is in command: let them release it first"
        self.holder = Holder(page, identity, name)
        return ""

    def adopt(self, page: str, identity: str, name: str) -> bool:
        """Give command to a page that replaces the lost one in the same tab: loaded again.

        Args:
            page: identity of the page that asks.
            identity: of the tab, which a page that is loaded again keeps.
            name: of the operator.
        """
        holder = self.holder
        if holder is None or holder.identity != identity or self._alive(holder.page):
            return False
        self.holder = Holder(page, identity, name)
        return True

    def release(self, page: str) -> bool:
        """Give command up; return whether this page had it."""
        if self.holder is None or self.holder.page != page:
            return False
        self.holder = None
        return True

    def refusal(self, page: str) -> str:
        """Why a page may not command; empty if it may."""
        if self.holder is None:
            return "nobody is in command: take command first"
        if self.holder.page != page:
            return f"{self.holder.name} is in command, this page watches"
        return ""
