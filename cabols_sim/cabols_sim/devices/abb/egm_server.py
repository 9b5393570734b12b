# SPDX-License-Identifier: Apache-2.0
"""EGM as the controller sends it: an EgmRobot packet per truth, by UDP."""

from __future__ import annotations

import random
import socket
from collections import deque
from contextlib import suppress
from typing import Any

import numpy as np
from abb_robot_client._egm_protobuf import egm_pb2
from scipy.spatial.transform import Rotation

from cabols_sim.devices.abb.rapid import RapidProgram
from cabols_sim.devices.robot.kinematics import Arm

DEFAULT_EGM_PORT = 6510


class EgmServer:
    """Position stream: joints [deg] and the tool's pose in the robot's base [mm].

    Both come from the encoders, so neither sees the joints' deflection.

    Attributes:
        sent: packets put on the wire.
        dropped: packets lost on purpose.
    """

    def __init__(
        self,
        program: RapidProgram,
        tool: Arm,
        port: int = DEFAULT_EGM_PORT,
        host: str = "127.0.0.1",
        seed: int = 0,
    ) -> None:
        """Prepare to send to a host and port.

        Args:
            program: for the states of motors and RAPID.
            tool: arm with the tool's transform; its base stays where the robot's is.
            port: of the reader.
            host: of the reader.
            seed: of the packets that get lost.
        """
        self._program = program
        self._arm = tool.at_its_base()
        self._address = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._random = random.Random(seed)
        self._sequence = 0
        self._waiting: deque[tuple[float, bytes]] = deque()
        self.sent = 0
        self.dropped = 0

    def on_truth(self, truth: Any) -> None:
        """Send one packet, or lose or delay it, by the truth's faults.

        Args:
            truth: DEVICE_TRUTH record.
        """
        raw = self._packet(truth)
        now_s = 1e-9 * float(truth["time_ns"])
        if self._random.random() < float(truth["egm_loss"]):
            self.dropped += 1
        else:
            self._waiting.append((now_s + float(truth["egm_delay_s"]), raw))
        # Half a nanosecond of slack: times are sums of milliseconds, in floats.
        while self._waiting and self._waiting[0][0] <= now_s + 5e-7:
            self._send(self._waiting.popleft()[1])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, raw: bytes) -> None:
        # A missing receiver is no error for a sender of a stream.
        with suppress(OSError):
            self._socket.sendto(raw, self._address)
            self.sent += 1

    def _packet(self, truth: Any) -> bytes:
        time_ns = int(truth["time_ns"])
        message = egm_pb2.EgmRobot()
        message.header.seqno = self._sequence
        message.header.tm = (time_ns // 1_000_000) & 0xFFFFFFFF
        message.header.mtype = egm_pb2.EgmHeader.MSGTYPE_DATA
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        joints = np.array(truth["encoders"])
        position, rotation, _ = self._arm.solve(joints)
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        degrees = np.rad2deg(joints).tolist()
        for part in (message.feedBack, message.planned):
            part.joints.joints.extend(degrees)
            pose = part.cartesian
            pose.pos.x, pose.pos.y, pose.pos.z = (1000.0 * position).tolist()
            pose.orient.u0, pose.orient.u1, pose.orient.u2, pose.orient.u3 = w, x, y, z
            part.time.sec = time_ns // 1_000_000_000
            part.time.usec = time_ns % 1_000_000_000 // 1000
        program = self._program
        motors, rapid = egm_pb2.EgmMotorState, egm_pb2.EgmRapidCtrlExecState
        message.motorState.state = motors.MOTORS_ON if program.motors_on else motors.MOTORS_OFF
        message.rapidExecState.state = (
            rapid.RAPID_RUNNING if program.running else rapid.RAPID_STOPPED
        )
        message.mciState.state = egm_pb2.EgmMCIState.MCI_STOPPED
        message.mciConvergenceMet = False
        raw: bytes = message.SerializeToString()
        return raw
