# SPDX-License-Identifier: Apache-2.0
"""How a running rig disappoints its client."""

from __future__ import annotations

from typing import Any

from cabols_control.errors import CabolsError
from cabols_control.result_code import ResultCode


def result_code(number: int) -> ResultCode:
    """Return a code by its number; UNKNOWN for a number that this version lacks.

    Args:
        number: as in a message.
    """
    return ResultCode(number) if number in set(ResultCode) else ResultCode.UNKNOWN


class RigError(CabolsError):
    """The rig did not carry out a request."""


class RigTimeoutError(RigError):
    """Something did not happen in time.

    Attributes:
        what: that was waited for; for nodes, the missing ones.
    """

    def __init__(self, what: str, seconds: float, standing: str) -> None:
        super().__init__(f"waited {seconds:g} s in vain for {what}; {standing}")
        self.what = what


class RefusedError(RigError):
    """A service or an action was refused.

    Attributes:
        request: name of the request.
        text: why it was refused, for people.
        code: cabols_control.result_code.ResultCode.
        fault: name of the fault that forbids it; empty if none does.
    """

    def __init__(
        self, request: str, text: str, code: int = ResultCode.UNKNOWN, fault: str = ""
    ) -> None:
        """See the class for the arguments."""
        super().__init__(f"{request} was refused: {text}")
        self.request = request
        self.text = text
        self.code = result_code(code)
        self.fault = fault


class ActionFailedError(RigError):
    """An action has ended without success.

    Attributes:
        action: its name.
        code: cabols_control.result_code.ResultCode.
        result: all that it returned.
    """

    def __init__(self, action: str, result: Any) -> None:
        super().__init__(f"{action}: {result.message or 'it failed'}")
        self.action = action
        self.code = result_code(result.code)
        self.result = result


class RigFaultError(RigError):
    """The rig is in FAULT.

    Attributes:
        cause: one of cabols_msgs/Mode's causes.
        fault: name of the fault, out of cabols_control.supervision.faults.
        reason: the same for people.
    """

    def __init__(self, mode: Any) -> None:
        super().__init__(f"the rig is in FAULT: {mode.reason}")
        self.cause = int(mode.cause)
        self.fault = str(mode.fault)
        self.reason = str(mode.reason)


class AbandonedError(Exception):
    """The client was abandoned by another thread: what is under way ends, and is not repeated."""
