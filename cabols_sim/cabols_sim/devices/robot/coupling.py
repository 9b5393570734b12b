# SPDX-License-Identifier: Apache-2.0
"""Robot target and device link: the plant's part for its devices at every sample."""

from __future__ import annotations

from typing import Any

from cabols_control.errors import CabolsError
from cabols_sim.devices.link import TRUTH_EVERY, Kind, PlantLink
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_sim.faults import PlantFaults

RUNAWAY_GOALS = 5
REACH_M = 1.23
"""Of the platform from the robot's first axis, in the bench's reference pose."""


class RobotCoupling:
    """Carries out the devices' commands and sends them the truth.

    Attributes:
        robot: the target.
        faults: those of the plant; some of them are the robot's and the devices'.
    """

    def __init__(self, robot: RobotTarget, link: PlantLink) -> None:
        """Couple the two."""
        self.robot = robot
        self.faults = PlantFaults(0)
        self._runs_away = False
        self._link = link

    def obey_faults(self, faults: PlantFaults) -> None:
        """Let the plant's faults reach robot and devices, too."""
        self.faults = faults

    def on_sample(self, time_ns: int, sequence: int) -> None:
        """Carry out commands at every sample; send the truth at every fourth; card's time [ns].

        Args:
            time_ns: of the card [ns].
            sequence: number of the sample.
        """
        self.robot.disabled = self.faults.has("robot_stopped")
        if self.faults.any or self._runs_away:
            self._run_away()
        for command in self._link.receive():
            self._obey(command)
        if sequence % TRUTH_EVERY == 0:
            self._tell(time_ns)

    def _run_away(self) -> None:
        """Start an uncommanded motion, once for each such fault."""
        wanted = self.faults.has("platform_runs")
        if wanted and not self._runs_away:
            share = abs(self.faults.value("platform_runs"))
            elsewhere = (self.robot.target_index + 1 + round(1000.0 * share)) % RUNAWAY_GOALS
            goal = elsewhere if elsewhere != self.robot.target_index else RUNAWAY_GOALS
            self.robot.move_to(goal)
        self._runs_away = wanted

    def _obey(self, command: Any) -> None:
        if command["kind"] == Kind.STOP:
            self.robot.stop()
        elif command["kind"] == Kind.MOVE:
            index = int(command["index"])
            goal = index if index >= 0 else command["joints"]
            try:
                self.robot.move_to(goal, float(command["speed_scale"]), float(command["speed"]))
            except CabolsError:
                # The devices check; the plant must not end because of a stray datagram.
                return

    def _tell(self, time_ns: int) -> None:
        robot, truth, faults = self.robot, self._link.truth, self.faults
        truth["time_ns"] = time_ns
        truth["encoders"] = robot.encoders
        if faults.any:
            # The first joint turns the reported platform about the base.
            truth["encoders"][0] += faults.value("pose_offset") / REACH_M
        truth["joint_speed"] = robot.joint_speed
        truth["joints"] = robot.joints
        truth["position"] = robot.position
        truth["rotation"] = robot.rotation
        truth["speed"] = robot.platform_speed
        truth["moving"] = robot.moving
        truth["target_index"] = robot.target_index
        truth["egm_loss"] = 1.0 if faults.has("pose_silent") else faults.value("egm_loss")
        truth["egm_delay_s"] = faults.value("egm_delay")
        truth["beam_blocked"] = faults.has("beam")
        truth["robot_stopped"] = robot.disabled
        self._link.send()

    def close(self) -> None:
        """Close the link."""
        self._link.close()
