# SPDX-License-Identifier: Apache-2.0
"""Content of one EGM packet, in SI units, or why it cannot be used."""

from __future__ import annotations

import numpy as np
from abb_robot_client._egm_protobuf import egm_pb2
from google.protobuf.message import DecodeError

from cabols_hw.abb.egm.stream_quality import Refusal
from cabols_hw.robot.interface import RobotSample

AXES = 6
FARTHEST_JOINT = 100.0
"""No joint is ever there [rad]; NaN fails, too."""
FARTHEST_M = 100.0
"""No robot on a track is ever there [m]."""


EgmSample = RobotSample


def read_packet(raw: bytes, received_s: float) -> EgmSample | tuple[Refusal, str]:
    """Read one packet.

    Args:
        raw: as it came.
        received_s: when it arrived, by time.monotonic() [s].

    Returns:
        Its content, or why it cannot be used and what was seen.
    """
    message = egm_pb2.EgmRobot()
    try:
        message.ParseFromString(raw)
    except DecodeError:
        return Refusal.NOT_EGM, f"{len(raw)} bytes"
    feedback = message.feedBack
    joints = np.deg2rad(np.array(feedback.joints.joints, dtype=np.float64))
    if joints.size != AXES:
        if joints.size == 0 and not message.HasField("feedBack"):
            return Refusal.NOT_EGM, f"{len(raw)} bytes"
        return Refusal.JOINTS, f"{joints.size} joints"
    if not (feedback.HasField("cartesian") and feedback.cartesian.HasField("orient")):
        return Refusal.NO_POSE, f"{joints.size} joints alone"
    pose = feedback.cartesian
    position = 1e-3 * np.array([pose.pos.x, pose.pos.y, pose.pos.z])
    turn = pose.orient
    quaternion = np.array([turn.u1, turn.u2, turn.u3, turn.u0])
    length = float(np.linalg.norm(quaternion))
    possible = bool(
        (np.abs(joints) < FARTHEST_JOINT).all() and (np.abs(position) < FARTHEST_M).all()
    )
    if not (possible and abs(length - 1.0) < 1e-3):
        seen = f"a quaternion of length {length:.4g}" if possible else "numbers of no robot"
        return Refusal.NOT_FINITE, seen
    clock = feedback.time
    time_ns = int(clock.sec) * 1_000_000_000 + int(clock.usec) * 1000
    if not feedback.HasField("time"):
        time_ns = int(message.header.tm) * 1_000_000
    motors, rapid = message.motorState, message.rapidExecState
    return EgmSample(
        sequence=int(message.header.seqno),
        robot_time_ns=time_ns,
        joints=joints,
        position=position,
        quaternion=quaternion / length,
        # What a controller does not tell is not off.
        motors_on=bool(motors.state == motors.MOTORS_ON or not message.HasField("motorState")),
        rapid_running=bool(
            rapid.state == rapid.RAPID_RUNNING or not message.HasField("rapidExecState")
        ),
        received_s=received_s,
        external=tuple(float(axis) for axis in feedback.externalJoints.joints),
    )
