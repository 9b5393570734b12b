# SPDX-License-Identifier: Apache-2.0
"""How a request ended, for programs; the text beside it is for people."""

from __future__ import annotations

from enum import IntEnum


class ResultCode(IntEnum):
    """Same numbers as cabols_msgs/ResultCode, which says what each means."""

    UNKNOWN = 0
    DONE = 1
    BAD_REQUEST = 2
    BUSY = 3
    WRONG_MODE = 4
    FAULT_LATCHED = 5
    FAULT_REPORTED = 6
    NOT_READY = 7
    NOT_ZEROED = 8
    PLATFORM_MOVES = 9
    INFEASIBLE = 10
    CANCELLED = 11
    INTERRUPTED = 12
    TIMED_OUT = 13
    FAILED = 14


REFUSALS = frozenset(range(ResultCode.BAD_REQUEST, ResultCode.INFEASIBLE + 1))
"""Codes of requests of which nothing has begun."""
NOT_YET = frozenset({ResultCode.NOT_READY, ResultCode.NOT_ZEROED, ResultCode.PLATFORM_MOVES})
"""Refusals that the rig lifts by itself, so that asking again makes sense."""
