# SPDX-License-Identifier: Apache-2.0
"""What the robot's program does on the controller, as a state machine on the plant's truth."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

from cabols_hw.ur.handshake import (
    ACCEPTED,
    ERROR,
    FINISHED,
    INPUTS,
    OUTPUTS,
    REQUEST,
    SILENCE_S,
    STOP,
    STOPPED,
    TARGET,
    ProgramError,
    RobotMode,
)
from cabols_sim.devices.abb.rapid import Mover


class UrProgram:
    """Registers, motors and the program; any thread may call.

    Attributes:
        motors_on: whether power is on and the brakes are released.
        running: whether the program plays.
        inputs: registers as the client writes them, by name.
        outputs: registers that the program writes, by name.
    """

    def __init__(self, mover: Mover, configurations: int, silence_s: float = SILENCE_S) -> None:
        """Play, motors on, waiting for a request.

        Args:
            mover: moves the robot.
            configurations: number of stored ones.
            silence_s: of the client, after which a motion ends [s].
        """
        self._mover = mover
        self._configurations = configurations
        self._silence_s = silence_s
        self._lock = threading.RLock()
        self.inputs = dict.fromkeys(INPUTS, 0)
        self.outputs = dict.fromkeys(OUTPUTS, 0)
        self.motors_on = self.running = True
        self._watched = False
        self._beat_s = 0.0
        self._moving = self._issued = False
        self._stopping: int | None = None
        self._command = 0
        self._index = 0

    @property
    def mode(self) -> RobotMode:
        """Field robot_mode."""
        return RobotMode.RUNNING if self.motors_on else RobotMode.POWER_OFF

    def write(self, values: Mapping[str, int]) -> None:
        """Take the client's registers.

        Args:
            values: by name; others stay.
        """
        with self._lock:
            # The watchdog looks at whether packages come, not at what is in them.
            self._watched, self._beat_s = True, time.monotonic()
            self.inputs.update(values)

    def set_motors(self, on: bool) -> None:
        """Switch the motors.

        Args:
            on: whether they are to be on.
        """
        with self._lock:
            if not on:
                self._end(ProgramError.STOPPED)
                self._mover.halt()
            self.motors_on = on

    def step(self, truth: Any) -> None:
        """Let the program act on the newest truth.

        Args:
            truth: DEVICE_TRUTH record.
        """
        with self._lock:
            if bool(truth["robot_stopped"]) and self.motors_on:
                self.set_motors(False)
            if not (self.running and self.motors_on):
                return
            silent = self._watched and time.monotonic() - self._beat_s > self._silence_s
            if self._moving and silent:
                self._mover.halt()
                self._end(ProgramError.RIG_SILENT)
            request, stop = self.inputs[REQUEST], self.inputs[STOP]
            if stop != self.outputs[STOPPED]:
                self._halt(stop, truth)
            elif self._moving:
                self._move(truth)
            elif request != self.outputs[FINISHED]:
                self._begin(request)

    def _halt(self, stop: int, truth: Any) -> None:
        """Stop; confirmed when the robot stands."""
        if self._stopping != stop:
            self._stopping = stop
            self._command = self._mover.halt()
            self._end(ProgramError.STOPPED)
        elif int(truth["acknowledged"]) >= self._command and not truth["moving"]:
            self._stopping = None
            self.outputs[STOPPED] = stop

    def _begin(self, request: int) -> None:
        self.outputs[ACCEPTED] = request
        self._index = self.inputs[TARGET]
        if not 0 <= self._index < self._configurations:
            self.outputs[FINISHED], self.outputs[ERROR] = (
                request,
                int(ProgramError.NO_CONFIGURATION),
            )
            return
        self._moving, self._issued = True, False

    def _end(self, error: ProgramError) -> None:
        if self._moving:
            self._moving = False
            self.outputs[FINISHED], self.outputs[ERROR] = self.outputs[ACCEPTED], int(error)

    def _move(self, truth: Any) -> None:
        if not self._issued:
            if not truth["moving"]:
                self._command = self._mover.move(self._index)
                self._issued = True
            return
        if int(truth["acknowledged"]) < self._command or truth["moving"]:
            return
        if int(truth["target_index"]) == self._index:
            self._end(ProgramError.NONE)
        else:
            self._issued = False
