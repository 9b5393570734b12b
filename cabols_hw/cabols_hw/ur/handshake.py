# SPDX-License-Identifier: Apache-2.0
"""Registers by which the rig and the robot's program (`program.py`) understand each other."""

from __future__ import annotations

from enum import IntEnum

FIRST = 24
"""Registers below are the field buses'."""
TARGET, REQUEST, STOP, BEAT = (f"input_int_register_{FIRST + k}" for k in range(4))
ACCEPTED, FINISHED, ERROR, STOPPED = (f"output_int_register_{FIRST + k}" for k in range(4))
INPUTS = (TARGET, REQUEST, STOP, BEAT)
OUTPUTS = (ACCEPTED, FINISHED, ERROR, STOPPED)
BEAT_S = 0.02
SILENCE_S = 0.1
"""Silence after which the controller's own watchdog stops the program."""


class ProgramError(IntEnum):
    """Value of the register ERROR when a request is finished."""

    NONE = 0
    NO_CONFIGURATION = 1
    STOPPED = 2
    RIG_SILENT = 3


class RobotMode(IntEnum):
    """Field robot_mode; only RUNNING has power on and brakes released."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


PLAYING = 2
"""Field runtime_state while a program runs."""
