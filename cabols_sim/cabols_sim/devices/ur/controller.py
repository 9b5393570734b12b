# SPDX-License-Identifier: Apache-2.0
"""The simulated controller: program and RTDE on the newest truth of the plant."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.serial_arms.arm import SerialArm
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_hw.ur.handshake import INPUTS, PLAYING, SILENCE_S
from cabols_sim.devices.link import DeviceLink
from cabols_sim.devices.robot.kinematics import Arm
from cabols_sim.devices.truth_thread import TruthThread
from cabols_sim.devices.ur.program import UrProgram
from cabols_sim.devices.ur.rtde_server import RtdeServer

NORMAL_SAFETY = 1
ON_AND_PLAYING = 0b11
"""Bits of robot_status_bits: power is on, a program runs."""


class UrController:
    """All interfaces of the robot's controller to the rig's computer.

    Attributes:
        program: motors and the program.
        rtde: the server; its port is rtde.port.
    """

    def __init__(
        self,
        link: DeviceLink,
        configurations: RobotConfigurations,
        rtde_port: int = 0,
        serial: SerialArm | None = None,
        silence_s: float = SILENCE_S,
    ) -> None:
        """Prepare; start() begins.

        Args:
            link: to the plant.
            configurations: stored ones, and the tool.
            rtde_port: of the server; 0: any.
            serial: the arm; None: the bench's.
            silence_s: of the rig, after which a motion ends [s].

        Raises:
            RtdeServerError: if the port is taken.
        """
        self.program = UrProgram(link, len(configurations), silence_s)
        arm = Arm(
            tool_position=configurations.tool_position,
            tool_rotation=configurations.tool_rotation,
            serial=serial,
        )
        self._arm = arm.at_its_base()
        self._values: dict[str, Any] = {}
        self.rtde = RtdeServer(self._value, self._take, rtde_port)
        self._thread = TruthThread(link, self._step, "ur")

    def start(self) -> None:
        """Begin to serve."""
        self.rtde.start()
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        self._thread.stop()
        self.rtde.stop()

    def _step(self, truth: Any) -> None:
        self.program.step(truth)
        self._values = self._fields(truth)
        self.rtde.on_truth()

    def _fields(self, truth: Any) -> dict[str, Any]:
        """Output fields that are not zero."""
        program = self.program
        joints = np.array(truth["encoders"])
        position, rotation, _ = self._arm.solve(joints)
        pose = (*position.tolist(), *Rotation.from_matrix(rotation).as_rotvec().tolist())
        speeds = tuple(truth["joint_speed"].tolist())
        return {
            "timestamp": 1e-9 * float(truth["time_ns"]),
            "actual_q": tuple(joints.tolist()),
            "target_q": tuple(joints.tolist()),
            "actual_qd": speeds,
            "actual_TCP_pose": pose,
            "target_TCP_pose": pose,
            "robot_mode": int(program.mode),
            "safety_mode": NORMAL_SAFETY,
            "safety_status_bits": 1,
            "robot_status_bits": ON_AND_PLAYING * program.motors_on,
            "runtime_state": PLAYING if program.running else 1,
            "speed_scaling": 1.0,
            **program.outputs,
        }

    def _value(self, name: str) -> Any:
        if name.endswith(("_q", "_qd", "_pose", "_speed", "_force")):
            return self._values.get(name, (0.0,) * 6)
        return self._values.get(name, 0)

    def _take(self, values: dict[str, int]) -> None:
        self.program.write({name: value for name, value in values.items() if name in INPUTS})
