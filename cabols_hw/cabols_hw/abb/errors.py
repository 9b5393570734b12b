"""Errors of the robot's controller."""

from __future__ import annotations

from cabols_control.errors import CabolsError


class RobotError(CabolsError):
    """The controller cannot carry out a request; the message says what to do."""


class MoveAbortedError(RobotError):
    """A motion was aborted, on purpose or after its time-out."""
