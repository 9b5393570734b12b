# SPDX-License-Identifier: Apache-2.0
"""One HTTP request and its answer, within a deadline for the whole of it.

The usual clients limit the time of each read: a peer that sends a byte now and then holds them for
ever. Here every read gets what is left until the deadline.
"""

from __future__ import annotations

import io
import socket
import ssl
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from http.client import HTTPException, HTTPResponse
from typing import Any
from urllib.parse import urlsplit

from cabols_hw.abb.errors import RobotError, RwsError, RwsFailure

BODY_LIMIT = 1 << 20
DEFAULT_PORTS = {"http": 80, "https": 443}


class Deadline:
    """A moment by which something has to be done."""

    def __init__(self, seconds: float) -> None:
        """Begin to count now."""
        self._at = time.monotonic() + seconds

    def left(self) -> float:
        """Return the time that is left [s]; at least 0."""
        return max(0.0, self._at - time.monotonic())

    def require(self) -> float:
        """Return the time that is left; TimeoutError if there is none."""
        left = self.left()
        if not left > 0.0:
            raise TimeoutError("deadline")
        return left


@dataclass(frozen=True)
class HttpAnswer:
    """An answer, read to its end.

    Attributes:
        status: of HTTP.
        headers: by name in lower case; the last one where a name came twice.
        cookies: values of all Set-Cookie headers.
        body: as it came.
    """

    status: int
    headers: Mapping[str, str]
    cookies: tuple[str, ...]
    body: bytes


@dataclass(frozen=True)
class HttpAddress:
    """Where a server listens."""

    scheme: str
    host: str
    port: int

    @classmethod
    def of(cls, url: str) -> HttpAddress:
        """Read a URL; RobotError unless it is http://host[:port] or https://host[:port]."""
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError:
            port = -1
        if parts.scheme not in DEFAULT_PORTS or not parts.hostname or port == -1:
            raise RobotError(f"rws_url: expected http(s)://host or http(s)://host:port, got {url}")
        return cls(parts.scheme, parts.hostname, port or DEFAULT_PORTS[parts.scheme])

    @property
    def loopback(self) -> bool:
        """Whether it is this computer."""
        return self.host in ("localhost", "::1") or self.host.startswith("127.")

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def tls_context(certificate: str = "") -> ssl.SSLContext:
    """Make the settings of https.

    Args:
        certificate: PEM file that the server's certificate must come from; empty: any is taken, as
            controllers are delivered with certificates that they signed themselves.

    Raises:
        RobotError: if the file cannot be used.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if certificate:
        try:
            context.load_verify_locations(certificate)
        except OSError as error:
            raise RobotError(
                f"rws_certificate: expected a PEM file, got {certificate} ({error})"
            ) from error
        context.verify_mode = ssl.CERT_REQUIRED
    return context


class _TimedReads(io.RawIOBase):
    """Reads of a socket, each with the time that is left."""

    def __init__(self, link: socket.socket, deadline: Deadline) -> None:
        super().__init__()
        self._link = link
        self._deadline = deadline

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        self._link.settimeout(self._deadline.require())
        return self._link.recv_into(buffer)

    def makefile(self, *_: Any) -> io.BufferedReader:
        """What HTTPResponse asks a socket for."""
        return io.BufferedReader(self)


def _connected(address: HttpAddress, deadline: Deadline) -> socket.socket:
    """Connect to the first address of a name that answers; they share the time that is left."""
    found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
    refusal: OSError = ConnectionRefusedError("no address")
    for number, (family, kind, protocol, _, where) in enumerate(found):
        link = socket.socket(family, kind, protocol)
        try:
            link.settimeout(deadline.require() / (len(found) - number))
            link.connect(where)
        except OSError as error:
            link.close()
            refusal = error
        else:
            return link
    raise refusal


class HttpConnection:
    """A connection that is kept open between exchanges; one exchange at a time.

    close() may come from any thread, and ends an exchange under way.
    """

    def __init__(self, address: HttpAddress, context: ssl.SSLContext) -> None:
        """Prepare; nothing is opened yet."""
        self._address = address
        self._context = context
        self._link: socket.socket | None = None
        self._lock = threading.Lock()

    def exchange(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes, deadline: Deadline
    ) -> HttpAnswer:
        """Send a request and read the whole answer.

        Args:
            method: GET or POST.
            path: with its query.
            headers: besides Host and Content-Length.
            body: content of a POST.
            deadline: for all of it.

        Raises:
            RwsError: UNREACHABLE, DROPPED, TIMED_OUT or ODD_ANSWER; the connection is closed.
        """
        try:
            return self._exchange(method, path, headers, body, deadline)
        except TimeoutError as error:
            self.close()
            raise RwsError(RwsFailure.TIMED_OUT, "no answer in time") from error
        except (ConnectionRefusedError, socket.gaierror) as error:
            self.close()
            raise RwsError(RwsFailure.UNREACHABLE, f"no connection ({error})") from error
        except ssl.SSLCertVerificationError as error:
            self.close()
            text = f"the certificate is not the expected one ({error.verify_message})"
            raise RwsError(RwsFailure.CREDENTIALS, text) from error
        except (HTTPException, OSError, ValueError) as error:
            self.close()
            text = f"the connection was dropped ({type(error).__name__})"
            raise RwsError(RwsFailure.DROPPED, text) from error

    def _exchange(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes, deadline: Deadline
    ) -> HttpAnswer:
        link = self._link or self._open(deadline)
        lines = [f"{method} {path} HTTP/1.1", f"Host: {self._address.host}:{self._address.port}"]
        lines += [f"{name}: {value}" for name, value in headers.items()]
        if body or method == "POST":
            lines.append(f"Content-Length: {len(body)}")
        link.settimeout(deadline.require())
        link.sendall("\r\n".join([*lines, "", ""]).encode("latin-1") + body)
        response = HTTPResponse(_TimedReads(link, deadline), method=method)  # type: ignore[arg-type]
        try:
            response.begin()
            content = response.read(BODY_LIMIT + 1)
            if len(content) > BODY_LIMIT:
                raise HTTPException(f"an answer of more than {BODY_LIMIT} bytes")
            named = {name.lower(): value for name, value in response.getheaders()}
            cookies = tuple(response.headers.get_all("set-cookie") or ())
            closes = response.will_close or not response.isclosed()
        finally:
            response.close()
        if closes:
            self.close()
        return HttpAnswer(response.status, named, cookies, content)

    def _open(self, deadline: Deadline) -> socket.socket:
        address = self._address
        link = _connected(address, deadline)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if address.scheme == "https":
            link = self._encrypted(link, deadline)
        with self._lock:
            self._link = link
        return link

    def _encrypted(self, plain: socket.socket, deadline: Deadline) -> socket.socket:
        link = plain
        try:
            link = self._context.wrap_socket(
                plain, server_hostname=self._address.host, do_handshake_on_connect=False
            )
            link.settimeout(deadline.require())
            link.do_handshake()
        except (OSError, ValueError):
            link.close()
            raise
        return link

    def close(self) -> None:
        """Close; the next exchange opens anew."""
        with self._lock:
            link, self._link = self._link, None
        if link is None:
            return
        # Closing alone does not wake a thread that reads.
        with suppress(OSError):
            link.shutdown(socket.SHUT_RDWR)
        link.close()
