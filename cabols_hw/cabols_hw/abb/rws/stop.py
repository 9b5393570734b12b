# SPDX-License-Identifier: Apache-2.0
"""Stopping RAPID over a bad connection: attempts that overlap, each on its own connection.

A request may be lost, refused for a moment or hang; to stop twice does no harm. So an attempt
begins every 0.1 s, whatever became of those before, until one is answered. With a share p of
requests lost the chance that none of the n attempts of a second arrives is p**n: 6e-6 for p = 0.3
and n = 10.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from cabols_hw.abb.errors import RobotError, RwsError
from cabols_hw.abb.rws.client import RwsSession
from cabols_hw.abb.rws.http_exchange import Deadline

EVERY_S = 0.1
"""Longest time between the beginnings of two attempts."""

ATTEMPT_S = 1.0
STOP_S = 2.0
"""Longest time that is tried."""

FINAL_REFUSALS = 5
"""Answers that would not change, after which it is given up."""


class StopAttempts:
    """The attempts of one stop.

    Attributes:
        made: number of attempts.
    """

    def __init__(self, session: RwsSession) -> None:
        """Prepare.

        Args:
            session: of the controller, best with a log-in that is already made: an attempt is then
                one request.
        """
        self._session = session
        self._condition = threading.Condition()
        self._arrived = False
        self._failed = 0
        self._refused = 0
        self._error: RwsError | None = None
        self.made = 0

    def run(self, seconds: float = STOP_S, every_s: float = EVERY_S) -> None:
        """Try until the controller confirms.

        Args:
            seconds: longest time [s].
            every_s: longest time between the beginnings of two attempts [s].

        Raises:
            RobotError: if it did not confirm.
        """
        deadline = Deadline(seconds)
        with self._condition:
            while deadline.left() > 0.0:
                self._begin(deadline)
                failed = self._failed
                # A failure that is known already leaves no reason to wait; but no more than
                # four attempts at once, which a refusal within a millisecond would make.
                self._wait(lambda: self._arrived, min(0.25 * every_s, deadline.left()))
                self._wait(self._news(failed), min(0.75 * every_s, deadline.left()))
                if self._arrived:
                    return
                if self._refused >= FINAL_REFUSALS:
                    break
            self._wait(lambda: self._arrived or self._refused >= FINAL_REFUSALS, deadline.left())
            if self._arrived:
                return
        raise RobotError(
            f"robot: stopping RAPID: no answer from {self._session.url} to {self.made} attempts "
            f"within {seconds:g} s (the last: {self._error or 'none ended'})"
        )

    def _news(self, failed: int) -> Callable[[], bool]:
        return lambda: self._arrived or self._failed > failed

    def _wait(self, condition: Callable[[], bool], seconds: float) -> None:
        self._condition.wait_for(condition, seconds)

    def _begin(self, deadline: Deadline) -> None:
        self.made += 1
        limit = Deadline(min(ATTEMPT_S, deadline.left()))
        threading.Thread(target=self._attempt, args=(limit,), name="rws_stop", daemon=True).start()

    def _attempt(self, limit: Deadline) -> None:
        connection = self._session.connection()
        error: RwsError | None = None
        try:
            call = self._session.identify(connection, limit).stop()
            self._session.attempt(connection, call, limit)
        except RwsError as failure:
            error = failure
        finally:
            connection.close()
        with self._condition:
            if error is None:
                self._arrived = True
            else:
                self._failed += 1
                self._refused += not error.transient
                self._error = error
            self._condition.notify_all()
