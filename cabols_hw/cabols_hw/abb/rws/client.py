# SPDX-License-Identifier: Apache-2.0
"""Client of Robot Web Services: one session, several connections, retries within a deadline."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar
from urllib.parse import urlsplit

from cabols_hw.abb.errors import RwsError, RwsFailure
from cabols_hw.abb.rws.answers import value_of
from cabols_hw.abb.rws.dialects import RWS_1, RWS_2, Dialect, RwsCall
from cabols_hw.abb.rws.http_exchange import (
    Deadline,
    HttpAddress,
    HttpAnswer,
    HttpConnection,
    tls_context,
)
from cabols_hw.abb.rws.http_login import Login, Scheme

T = TypeVar("T")

ATTEMPT_SHARE = 0.3
"""Share of an operation's time that one attempt may take: a request that hangs is asked again."""

RETRY_S = 0.05
NO_ANSWER = (RwsFailure.UNREACHABLE, RwsFailure.DROPPED, RwsFailure.TIMED_OUT)
BASIC_OVER_HTTP = "the controller wants the password unencrypted: use its https address as rws_url"


class RwsSession:
    """What all connections to one controller share: password, cookies, version.

    Attributes:
        url: of the controller.
        mastership: whether this client holds the right to write.
    """

    def __init__(self, url: str, user: str, password: str, certificate: str = "") -> None:
        """Prepare; nothing is sent yet.

        Args:
            url: http(s)://host[:port].
            user: of the controller.
            password: its password; never logged.
            certificate: see tls_context.

        Raises:
            RobotError: if the address or the certificate cannot be used.
        """
        self.address = HttpAddress.of(url)
        self.url = url.rstrip("/")
        self._base = urlsplit(url).path.rstrip("/")
        self._context = tls_context(certificate)
        self._login = Login(user, password)
        self._cookies: dict[str, str] = {}
        self._lock = threading.Lock()
        self.mastership = False

    @property
    def dialect(self) -> Dialect | None:
        """The controller's version, known by the log-in that it asks for; None before."""
        if self._login.scheme is None:
            return None
        return RWS_1 if self._login.scheme is Scheme.DIGEST else RWS_2

    @property
    def logged_in(self) -> bool:
        """Whether the controller holds a session for this client."""
        return bool(self._cookies)

    def connection(self) -> HttpConnection:
        """Return a new connection; it opens with its first exchange."""
        return HttpConnection(self.address, self._context)

    def attempt(
        self, connection: HttpConnection, call: RwsCall, deadline: Deadline
    ) -> list[dict[str, str]]:
        """Make a request once; log in on the way where the controller asks for it.

        Args:
            connection: to use.
            call: to make.
            deadline: for the whole of it.

        Raises:
            RwsError: if there is no good answer.
        """
        for _ in range(3):
            path = self._base + call.path
            proof = self._login.header(call.method, path)
            answer = connection.exchange(
                call.method, path, self._headers(call, proof), call.body, deadline
            )
            self._keep(answer)
            if answer.status != 401:
                return value_of(call, answer, self.url)
            if not self._login.challenge(answer.headers.get("www-authenticate", "")):
                break
            if self._login.scheme is Scheme.BASIC:
                self._check_basic(proof)
                if proof:
                    break
        return value_of(call, answer, self.url)

    def identify(self, connection: HttpConnection, deadline: Deadline) -> Dialect:
        """Ask for the version, if it is not known yet.

        Args:
            connection: to use.
            deadline: for the whole of it.

        Raises:
            RwsError: if there is no answer that tells it.
        """
        known = self.dialect
        if known is not None:
            return known
        call = RWS_1.operation_mode()
        headers = {"Accept": f"{RWS_1.accept}, {RWS_2.accept}"}
        answer = connection.exchange("GET", self._base + call.path, headers, b"", deadline)
        self._keep(answer)
        if answer.status == 401 and self._login.challenge(
            answer.headers.get("www-authenticate", "")
        ):
            if self._login.scheme is Scheme.BASIC:
                self._check_basic("")
            return self.dialect or RWS_1
        # A controller that asks for no password: its answer shows the version.
        value_of(call, answer, self.url)
        return RWS_2 if "v=2.0" in answer.headers.get("content-type", "") else RWS_1

    def forget(self) -> None:
        """Drop the cookies, after a log-out."""
        with self._lock:
            self._cookies.clear()
            self.mastership = False

    def _check_basic(self, proof: str) -> None:
        if self.address.scheme == "http" and not self.address.loopback and not proof:
            self._login.scheme = None
            raise RwsError(RwsFailure.CREDENTIALS, f"robot: {self.url}: {BASIC_OVER_HTTP}")

    def _headers(self, call: RwsCall, proof: str) -> dict[str, str]:
        headers = (self.dialect or RWS_1).headers(call)
        if proof:
            headers["Authorization"] = proof
        with self._lock:
            if self._cookies:
                headers["Cookie"] = "; ".join(f"{k}={v}" for k, v in self._cookies.items())
        return headers

    def _keep(self, answer: HttpAnswer) -> None:
        with self._lock:
            for cookie in answer.cookies:
                name, _, value = cookie.partition(";")[0].partition("=")
                self._cookies[name.strip()] = value.strip()


class RwsLane:
    """A connection of a session, with retries; one request at a time.

    Attributes:
        cancelled: set by cancel(); no request begins any more.
    """

    def __init__(self, session: RwsSession, timeout_s: float) -> None:
        """Prepare.

        Args:
            session: of the controller.
            timeout_s: of a request with all its retries.
        """
        self.session = session
        self.cancelled = threading.Event()
        self._connection = session.connection()
        self._timeout_s = timeout_s

    def cancel(self) -> None:
        """End the request under way and refuse all later ones; from any thread."""
        self.cancelled.set()
        self._connection.close()

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def dialect(self) -> Dialect:
        """Return the controller's version; ask for it at first.

        Raises:
            RwsError: if the controller does not answer.
        """
        known = self.session.dialect
        if known is not None:
            return known
        return self._retried("asking for the version", self.session.identify)

    def ask(self, call: RwsCall) -> list[dict[str, str]]:
        """Make a request; again after a failure that may pass, as all of them are idempotent.

        Returns:
            The entries of the answer.

        Raises:
            RwsError: if there is no good answer in time.
        """
        return self._retried(
            call.what,
            lambda connection, deadline: self.session.attempt(connection, call, deadline),
        )

    def _retried(self, what: str, action: Callable[[HttpConnection, Deadline], T]) -> T:
        deadline, attempts = Deadline(self._timeout_s), 0
        while True:
            attempts += 1
            limit = max(ATTEMPT_SHARE * self._timeout_s, 0.05)
            try:
                self._check()
                return action(self._connection, Deadline(min(limit, deadline.left())))
            except RwsError as error:
                self._check()
                if not (error.transient and deadline.left() > RETRY_S):
                    raise self._explained(what, attempts, error) from error
            self.cancelled.wait(RETRY_S)

    def _check(self) -> None:
        if self.cancelled.is_set():
            raise RwsError(RwsFailure.CANCELLED, "robot: the request was given up")

    def _explained(self, what: str, attempts: int, error: RwsError) -> RwsError:
        if error.failure not in NO_ANSWER:
            return error
        return RwsError(
            error.failure,
            f"robot: {what}: no answer from {self.session.url} within {self._timeout_s:g} s "
            f"({attempts} attempts, the last: {error}): check address, cable and controller",
        )
