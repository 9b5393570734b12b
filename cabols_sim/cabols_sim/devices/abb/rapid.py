# SPDX-License-Identifier: Apache-2.0
"""What cabols.mod does on the controller, as a state machine beside the link to the plant."""

from __future__ import annotations

import json
import threading
from enum import Enum
from typing import Any, Protocol

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError

NO_CONFIGURATION = 1
"""Value of cabols_error for an unknown index."""
RIG_SILENT = 3
"""Value of cabols_error for a motion that stopped, or did not begin, without the heartbeat."""

NO_SUCH_SPEED = 4
"""Value of cabols_error for a leg at a speed that the program does not allow."""
LEAD = -2.0
"""Value of cabols_target that stands for cabols_joint."""
SPEEDS, TURNINGS = (1.0, 100.0), (0.1, 10.0)
"""Least and most of cabols_speed [mm/s] and cabols_turning [deg/s]."""
THERE_RAD = 1e-6
NO_EXTERNAL_AXES = "[9E9, 9E9, 9E9, 9E9, 9E9, 9E9]"


class RapidError(CabolsError):
    """The controller refuses a request."""


class Mover(Protocol):
    """The part of DeviceLink that moves the robot."""

    def move(self, index: int, speed_scale: float = 1.0) -> int:
        """Ask for a motion to a stored configuration; return the command's number.

        Args:
            index: of the configuration, from 0.
            speed_scale: share of the platform's speed limit, above 0, at most 1.
        """

    def lead(self, joints: FloatArray, speed: float) -> int:
        """Ask for a motion to joint angles; return the command's number.

        Args:
            joints: (6,) to move to [rad].
            speed: of the platform's origin [m/s].
        """

    def halt(self) -> int:
        """Ask for a stop; return the command's number."""


class Pointer(Enum):
    """Where the program pointer stands."""

    MAIN = 0
    WAITING = 1
    MOVING = 2


class RapidProgram:
    """Variables, execution and motors of the controller; every method may be called by any thread.

    As on the controller, a start after a stop continues the interrupted motion; after
    reset_pointer() the program starts at main, which drops an old demand.
    """

    def __init__(self, mover: Mover, configurations: int, operation_mode: str = "AUTO") -> None:
        """Run, motors on, waiting for a demand.

        Args:
            mover: moves the robot.
            configurations: number of stored ones.
            operation_mode: AUTO, or MANR, in which RWS may only read.
        """
        self._mover = mover
        self._configurations = configurations
        self._lock = threading.RLock()
        self._variables: dict[str, float | bool | str] = {
            "cabols_target": 0.0,
            "cabols_go": False,
            "cabols_done": True,
            "cabols_error": 0.0,
            "cabols_joint": f"[[0, 0, 0, 0, 0, 0], {NO_EXTERNAL_AXES}]",
            "cabols_speed": 20.0,
            "cabols_turning": 3.0,
        }
        self._leg: FloatArray | None = None
        self._pointer = Pointer.WAITING
        self._command = 0
        self._issued = False
        self._emergency = False
        # Without a watch nothing is known about the rig, and the program moves all the same.
        self._rig_well = True
        self.operation_mode = operation_mode
        self.motors_on = True
        self.running = True

    @property
    def controller_state(self) -> str:
        """RWS' word for the state of motors and emergency stop."""
        if self._emergency:
            return "emergencystop"
        return "motoron" if self.motors_on else "motoroff"

    def get(self, name: str) -> str:
        """Value of a RAPID variable as RAPID writes it; KeyError if there is none."""
        with self._lock:
            value = self._variables[name]
        if isinstance(value, bool):
            return "TRUE" if value else "FALSE"
        return value if isinstance(value, str) else f"{value:g}"

    def set(self, name: str, text: str) -> None:
        """Write a RAPID variable.

        Args:
            name: of the variable.
            text: as RWS receives it: TRUE or FALSE, a num, or a jointtarget.

        Raises:
            KeyError: if there is no such variable.
            RapidError: if the text is of another type.
        """
        with self._lock:
            if isinstance(self._variables[name], bool):
                if text.upper() not in ("TRUE", "FALSE"):
                    raise RapidError(f"{name}: expected TRUE or FALSE, got {text!r}")
                self._variables[name] = text.upper() == "TRUE"
                return
            if isinstance(self._variables[name], str):
                _joint_target(name, text)
                self._variables[name] = text
                return
            try:
                self._variables[name] = float(text)
            except ValueError as error:
                raise RapidError(f"{name}: expected a num, got {text!r}") from error

    @property
    def names(self) -> tuple[str, ...]:
        """The RAPID variables."""
        return tuple(self._variables)

    def start(self) -> None:
        """Start or continue; RapidError with the motors off."""
        with self._lock:
            if not self.motors_on:
                raise RapidError("RAPID cannot start: the motors are off")
            self.running = True
            self._issued = False

    def stop(self) -> None:
        """Stop the program and the motion."""
        with self._lock:
            self.running = False
            self._mover.halt()

    def reset_pointer(self) -> None:
        """Program pointer to main; RapidError while it runs."""
        with self._lock:
            if self.running:
                raise RapidError("program pointer cannot be moved: RAPID is running")
            self._pointer = Pointer.MAIN

    def set_motors(self, on: bool) -> None:
        """Switch the motors; RapidError in an emergency stop."""
        with self._lock:
            if on and self._emergency:
                raise RapidError("motors cannot be switched on: emergency stop")
            if not on:
                self.stop()
            self.motors_on = on

    def hear_rig(self, well: bool) -> None:
        """Hear from the watch whether the rig's heartbeat comes; its end stops a motion."""
        with self._lock:
            self._rig_well = well
            if not well and self._pointer == Pointer.MOVING:
                self._mover.halt()
                self._variables["cabols_error"] = float(RIG_SILENT)
                self._pointer = Pointer.WAITING

    def step(self, truth: Any) -> None:
        """Let the program act on the newest DEVICE_TRUTH."""
        with self._lock:
            self._emergency = bool(truth["robot_stopped"])
            if self._emergency and self.motors_on:
                self.stop()
                self.motors_on = False
            if not self.running:
                return
            if self._pointer == Pointer.MAIN:
                self._variables["cabols_go"] = False
                self._variables["cabols_error"] = 0.0
                self._pointer = Pointer.WAITING
            elif self._pointer == Pointer.WAITING:
                self._wait()
            else:
                self._move(truth)

    def _wait(self) -> None:
        if not self._variables["cabols_go"]:
            return
        self._variables["cabols_go"] = False
        self._variables["cabols_done"] = False
        self._variables["cabols_error"] = 0.0
        wanted = float(self._variables["cabols_target"])
        self._leg = None
        if wanted == LEAD:
            if not (
                SPEEDS[0] <= float(self._variables["cabols_speed"]) <= SPEEDS[1]
                and TURNINGS[0] <= float(self._variables["cabols_turning"]) <= TURNINGS[1]
            ):
                self._variables["cabols_error"] = float(NO_SUCH_SPEED)
                return
            self._leg = _joint_target("cabols_joint", str(self._variables["cabols_joint"]))
        elif not (0.0 <= wanted < self._configurations and wanted == int(wanted)):
            self._variables["cabols_error"] = float(NO_CONFIGURATION)
            return
        if not self._rig_well:
            self._variables["cabols_error"] = float(RIG_SILENT)
            return
        self._index = int(wanted)
        self._issued = False
        self._pointer = Pointer.MOVING

    def _move(self, truth: Any) -> None:
        if not self._issued:
            # A motion that was stopped still brakes: the robot refuses another one until it stands.
            if not truth["moving"]:
                self._command = self._issue()
                self._issued = True
            return
        if int(truth["acknowledged"]) < self._command or truth["moving"]:
            return
        if self._there(truth):
            self._variables["cabols_done"] = True
            self._pointer = Pointer.WAITING
        else:
            self._issued = False

    def _issue(self) -> int:
        """Ask the robot for the motion that is demanded; return the command's number."""
        if self._leg is None:
            return self._mover.move(self._index)
        return self._mover.lead(self._leg, 1e-3 * float(self._variables["cabols_speed"]))

    def _there(self, truth: Any) -> bool:
        if self._leg is None:
            return int(truth["target_index"]) == self._index
        return bool(np.abs(truth["encoders"] - self._leg).max() < THERE_RAD)


def _joint_target(name: str, text: str) -> FloatArray:
    """Read the (6,) angles [rad] of a jointtarget as RAPID writes it.

    Raises:
        RapidError: if it is none.
    """
    try:
        rows = json.loads(text)
        found = np.array(rows, dtype=np.float64)
    except (ValueError, TypeError):
        found = np.zeros(0)
    if found.shape != (2, 6) or not np.isfinite(found).all():
        raise RapidError(f"{name}: expected a jointtarget, got {text!r}")
    angles, _ = found
    return np.asarray(np.deg2rad(angles), dtype=np.float64)
