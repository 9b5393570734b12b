# SPDX-License-Identifier: Apache-2.0
"""Errors of the robot's controller."""

from __future__ import annotations

from enum import IntEnum

from cabols_control.errors import CabolsError


class RobotError(CabolsError):
    """The controller cannot carry out a request; the message says what to do."""


class MoveAbortedError(RobotError):
    """A motion was aborted, on purpose or after its time-out."""


class RwsFailure(IntEnum):
    """Why a request over Robot Web Services has no usable answer."""

    UNREACHABLE = 0
    DROPPED = 1
    TIMED_OUT = 2
    BUSY = 3
    CANCELLED = 4
    CREDENTIALS = 5
    FORBIDDEN = 6
    WHITE_LIST = 7
    WRONG_VERSION = 8
    NO_SYMBOL = 9
    REJECTED = 10
    ODD_ANSWER = 11


TRANSIENT = frozenset(
    {
        RwsFailure.UNREACHABLE,
        RwsFailure.DROPPED,
        RwsFailure.TIMED_OUT,
        RwsFailure.BUSY,
        RwsFailure.WHITE_LIST,
        RwsFailure.ODD_ANSWER,
    }
)
"""Failures after which the same request may succeed."""


class RwsError(RobotError):
    """A request over Robot Web Services failed.

    Attributes:
        failure: of which kind.
    """

    def __init__(self, failure: RwsFailure, message: str) -> None:
        super().__init__(message)
        self.failure = failure

    @property
    def transient(self) -> bool:
        """Whether the same request may succeed in a moment."""
        return self.failure in TRANSIENT
