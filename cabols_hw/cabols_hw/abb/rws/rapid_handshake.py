# SPDX-License-Identifier: Apache-2.0
"""Demands to the RAPID program rapid/cabols.mod, as variables over Robot Web Services.

The handshake: the rig writes cabols_target, cabols_done := FALSE and cabols_go := TRUE; the program
takes cabols_go back, moves, and sets cabols_done, or cabols_error. Before it starts the program the
rig sets cabols_error := -1 and waits until main has cleared it: only then has the program dropped
old demands and accepts new ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from cabols_hw.abb.errors import RobotError
from cabols_hw.abb.rws.client import RwsLane
from cabols_hw.abb.rws.dialects import TASK, Dialect
from cabols_hw.robot.interface import Leg

STARTING = -1
WITHDRAWN = -1
"""Target of a demand that is taken back: no such configuration, so that nothing moves."""

LEAD = -2
"""Target that stands for the joint angles in cabols_joint, at the stated speeds."""

LEAD_VARIABLES = ("cabols_joint", "cabols_speed", "cabols_turning")
VARIABLES = ("cabols_target", "cabols_go", "cabols_done", "cabols_error")
NO_EXTERNAL_AXES = "[9E9, 9E9, 9E9, 9E9, 9E9, 9E9]"
REASONS = {
    1: "the RAPID program has no such configuration: are both files of the same version?",
    2: "the motion failed on the controller: read its event log",
    3: "it stopped by itself, as the rig's heartbeat was silent",
    4: "the RAPID program allows no motion under load at this speed",
}


def judge_motion(error: int, done: bool, running: bool) -> bool:
    """Whether the demanded motion is complete.

    Args:
        error: cabols_error.
        done: cabols_done.
        running: whether RAPID runs.

    Raises:
        RobotError: if it can no longer be completed.
    """
    if error:
        raise RobotError(f"robot: {REASONS.get(error, f'RAPID program reports error {error}')}")
    if done:
        return True
    if not running:
        raise RobotError(
            "robot: RAPID has stopped before the motion was done (emergency stop, operator or a "
            "program error): clear it on the controller, then ask again"
        )
    return False


class RapidHandshake:
    """The program's variables and execution, over one lane.

    Attributes:
        lane: that it uses.
    """

    def __init__(self, lane: RwsLane, start_timeout_s: float) -> None:
        """Prepare; nothing is sent yet.

        Args:
            lane: to the controller.
            start_timeout_s: longest time that the program may take to answer [s].
        """
        self.lane = lane
        self.start_timeout_s = start_timeout_s

    @property
    def _dialect(self) -> Dialect:
        return self.lane.dialect()

    def _value(self, name: str) -> str:
        return self.lane.ask(self._dialect.read(name))[0]["value"].strip()

    def number(self, name: str) -> float:
        """Return a variable of type num."""
        value = self._value(name)
        try:
            return float(value)
        except ValueError as error:
            raise RobotError(f"robot: {name}: expected a number, got {value!r}") from error

    def flag(self, name: str) -> bool:
        """Return a variable of type bool."""
        return self._value(name).upper() == "TRUE"

    def write(self, name: str, value: str) -> None:
        """Write a variable.

        Args:
            name: of the variable.
            value: as RAPID writes it.
        """
        self.lane.ask(self._dialect.write(name, value))

    def running(self) -> bool:
        """Whether RAPID runs."""
        return self.lane.ask(self._dialect.execution())[0]["ctrlexecstate"] == "running"

    def check_ready(self) -> None:
        """Raise RobotError unless the controller is in AUTO with its motors on."""
        mode = self.lane.ask(self._dialect.operation_mode())[0]["opmode"]
        if mode != "AUTO":
            raise RobotError(f"robot: controller is in {mode}: turn its key to AUTO")
        state = self.lane.ask(self._dialect.controller_state())[0]["ctrlstate"]
        if state != "motoron":
            raise RobotError(
                f"robot: controller is in state {state}: release emergency stops, press motors on"
            )

    def demand(self, index: int | Leg, begin: Callable[[], None] = lambda: None) -> bool:
        """Demand a motion; starts the program where it does not run.

        Args:
            index: of the stored configuration, or a leg of a path.
            begin: called before the first request that may move the robot.

        Returns:
            Whether the program was started for it; else another program may run.

        Raises:
            RobotError: if the controller cannot be reached or refuses; see check_ready.
        """
        # First of all: without the module somebody else's program runs.
        leg = None if isinstance(index, int) else index
        for name in VARIABLES if leg is None else VARIABLES + LEAD_VARIABLES:
            self._value(name)
        self.take_mastership()
        started = not self.running()
        if started:
            self._start(begin)
        if leg is not None:
            self._write_leg(leg)
        self.write("cabols_target", str(LEAD if leg is not None else index))
        self.write("cabols_done", "FALSE")
        self.write("cabols_error", "0")
        begin()
        self.write("cabols_go", "TRUE")
        return started

    def _write_leg(self, leg: Leg) -> None:
        """Write a leg's angles [deg] and speeds [mm/s, deg/s]; the program bounds them itself."""
        angles = ", ".join(f"{angle:.6f}" for angle in np.rad2deg(leg.joints))
        self.write("cabols_joint", f"[[{angles}], {NO_EXTERNAL_AXES}]")
        self.write("cabols_speed", f"{1e3 * leg.speed:.3f}")
        self.write("cabols_turning", f"{np.rad2deg(leg.rotation_speed):.3f}")

    def _start(self, begin: Callable[[], None]) -> None:
        """Start the program from main: continuing would complete the aborted motion."""
        self._check_tasks()
        self.write("cabols_error", str(STARTING))
        self.lane.ask(self._dialect.pointer_to_main())
        begin()
        self.lane.ask(self._dialect.start())
        give_up = time.monotonic() + self.start_timeout_s
        while self.number("cabols_error") == STARTING:
            if time.monotonic() > give_up:
                raise RobotError(
                    f"robot: the RAPID program did not begin within {self.start_timeout_s:g} s; "
                    "is cabols.mod loaded, with its main?"
                )
            time.sleep(0.05)

    def _check_tasks(self) -> None:
        """Raise RobotError unless the one motion task is the robot's: a start starts all."""
        rows = self.lane.ask(self._dialect.tasks())
        motion = [row["name"] for row in rows if row.get("motiontask", "").upper() == "TRUE"]
        if motion != [TASK]:
            raise RobotError(
                f"robot: expected {TASK} as the only motion task, got {', '.join(motion) or 'none'}"
                "; several arms or another robot's name are not supported"
            )

    def done(self) -> bool:
        """Whether the demanded motion is complete.

        Raises:
            RobotError: if it can no longer be completed.
        """
        # Read done before running: the motion may end, and RAPID stop, between the two reads.
        done = self.flag("cabols_done")
        return judge_motion(int(self.number("cabols_error")), done, done or self.running())

    def take_back(self) -> bool:
        """Withdraw a demand that stands; return whether it had not been obeyed."""
        self.write("cabols_target", str(WITHDRAWN))
        # Not taken until now: whoever takes it from here on finds no configuration.
        untaken = self.flag("cabols_go")
        self.write("cabols_go", "FALSE")
        return untaken

    def withdraw(self) -> None:
        """Withdraw the demand after a stop."""
        self.take_mastership()
        self.write("cabols_go", "FALSE")

    def take_mastership(self) -> None:
        """Take the right to write, where the controller's version has one."""
        session = self.lane.session
        if self._dialect.mastership and not session.mastership:
            self.lane.ask(self._dialect.take_mastership())
            session.mastership = True

    def give_mastership(self) -> None:
        """Give the right to write back, as the FlexPendant is locked out by it."""
        session = self.lane.session
        if session.mastership:
            session.mastership = False
            self.lane.ask(self._dialect.release_mastership())
