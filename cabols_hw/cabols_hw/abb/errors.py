"""What can go wrong with the robot's controller."""

from __future__ import annotations

from cabols_control.errors import CabolsError


class RobotError(CabolsError):
    """The controller cannot do what was asked; the message says what to do."""


class MoveAbortedError(RobotError):
    """A motion was broken off, on purpose or after its time-out."""
