"""Robot target and device link together: what the plant does for its devices at every sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cabols_control.errors import CabolsError
from cabols_sim.device_link import TRUTH_EVERY, Kind, PlantLink
from cabols_sim.robot.robot_target import RobotTarget


@dataclass
class DeviceFaults:
    """What the rig's fault service makes the devices do.

    Attributes:
        egm_loss: share of EGM packets to lose, 0 to 1.
        egm_delay_s: delay of every EGM packet [s], of the rig's time.
        beam_blocked: something stands in the tracker's beam.
        robot_stopped: the robot's own emergency stop.
    """

    egm_loss: float = 0.0
    egm_delay_s: float = 0.0
    beam_blocked: bool = False
    robot_stopped: bool = False


class RobotCoupling:
    """Obeys the devices' commands and tells them the truth.

    Attributes:
        robot: the target.
        faults: read at every truth; set by who injects faults.
    """

    def __init__(self, robot: RobotTarget, link: PlantLink) -> None:
        """Couple the two."""
        self.robot = robot
        self.faults = DeviceFaults()
        self._link = link

    def on_sample(self, time_ns: int, sequence: int) -> None:
        """Obey at every sample; tell the truth at every fourth, in the card's time [ns]."""
        self.robot.disabled = self.faults.robot_stopped
        for command in self._link.receive():
            self._obey(command)
        if sequence % TRUTH_EVERY == 0:
            self._tell(time_ns)

    def _obey(self, command: Any) -> None:
        if command["kind"] == Kind.STOP:
            self.robot.stop()
        elif command["kind"] == Kind.MOVE:
            index = int(command["index"])
            goal = index if index >= 0 else command["joints"]
            try:
                self.robot.move_to(goal, float(command["speed_scale"]))
            except CabolsError:
                # The devices check; the plant must not end because of a stray datagram.
                return

    def _tell(self, time_ns: int) -> None:
        robot, truth, faults = self.robot, self._link.truth, self.faults
        truth["time_ns"] = time_ns
        truth["encoders"] = robot.encoders
        truth["joint_speed"] = robot.joint_speed
        truth["joints"] = robot.joints
        truth["position"] = robot.position
        truth["rotation"] = robot.rotation
        truth["speed"] = robot.platform_speed
        truth["moving"] = robot.moving
        truth["target_index"] = robot.target_index
        truth["egm_loss"] = faults.egm_loss
        truth["egm_delay_s"] = faults.egm_delay_s
        truth["beam_blocked"] = faults.beam_blocked
        truth["robot_stopped"] = faults.robot_stopped
        self._link.send()

    def close(self) -> None:
        """Close the link."""
        self._link.close()
