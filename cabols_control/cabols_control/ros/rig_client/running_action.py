# SPDX-License-Identifier: Apache-2.0
"""A running action."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Any

from cabols_control.result_code import REFUSALS
from cabols_control.ros.rig_client.connection import RigConnection
from cabols_control.ros.rig_client.errors import (
    AbandonedError,
    ActionFailedError,
    RigTimeoutError,
)

JUDGED = frozenset({"run_program", "move_to_configuration", "follow_path", "measure_reflector"})
"""Actions whose servers accept a refused goal and end it at once, to say why."""
JUDGED_S = 1.0
"""Longest wait for a goal's first feedback, or for its refusal [s]."""
TURN_S = 0.005
"""Between two looks for either [s]."""
CANCEL_S = 10.0
"""Longest wait for the end of a cancelled action [s]."""
LEAVE_S = 3.0
"""The same where another error is on its way to the caller [s]."""


class RunningAction:
    """An accepted goal.

    Attributes:
        name: of the action.
    """

    def __init__(self, client: RigConnection, name: str, handle: Any) -> None:
        """Ask for the result of a goal; result() waits for it."""
        self.name = name
        self._client = client
        self._handle = handle
        self._future = client.watched(client.calls.result(handle))

    @property
    def done(self) -> bool:
        """Whether the result has come."""
        return bool(self._future.done())

    @property
    def newest_result(self) -> Any:
        """The action's result; only when `done`."""
        return self._future.result().result

    def result(self, timeout_s: float = 3600.0, even_in_fault: bool = False) -> Any:
        """Wait for the end.

        Args:
            timeout_s: longest wait [s]; after it the goal is cancelled.
            even_in_fault: do not give up in FAULT.

        Returns:
            The action's result, whose `success` is true.

        Raises:
            ActionFailedError: if the action ended without success.
            RigFaultError: if the rig came into FAULT before.
            RigTimeoutError: after `timeout_s`.
        """
        try:
            what = f"the end of {self.name}"
            self._client.wait(lambda: self.done, what, timeout_s, even_in_fault)
        except BaseException:
            # Waited for, too: a client that leaves at once takes the unsent request with it.
            with suppress(RigTimeoutError, AbandonedError):
                self.cancel(LEAVE_S)
            raise
        result = self._future.result().result
        if not result.success:
            raise ActionFailedError(self.name, result)
        return result

    def cancel(self, timeout_s: float = CANCEL_S) -> Any:
        """End it, and wait for its result.

        Returns:
            The action's result; a cancelled action has no success.

        Raises:
            RigTimeoutError: if the result does not come in time.
        """
        if not self.done:
            self._client.calls.cancel(self._handle)
        self._client.wait(
            lambda: self.done, f"the end of {self.name}", timeout_s, even_in_fault=True
        )
        return self._future.result().result


def refusal(running: RunningAction, began: threading.Event) -> Any:
    """Return the result of a goal that was ended before anything began; None for another one.

    Args:
        running: the goal.
        began: set by its first feedback.
    """
    give_up = time.monotonic() + JUDGED_S
    while not (running.done or began.is_set()) and time.monotonic() < give_up:
        time.sleep(TURN_S)
    if not running.done:
        return None
    result = running.newest_result
    return None if result.success or result.code not in REFUSALS else result
