# SPDX-License-Identifier: Apache-2.0
"""EGM packets as a controller sends them (numbers of the kind that abb_libegm#119 shows)."""

from __future__ import annotations

import socket

from abb_robot_client._egm_protobuf import egm_pb2

JOINTS = (0.0, -0.01, 0.04, 0.0, 45.0, -0.07)
POSITION = (1216.9, 0.0, 1187.2)
QUATERNION = (0.3823593, -0.0005404, 0.9240136, -0.0002228)
PERIOD_S = 0.004
START_S = 28397.0


def packet(
    number,
    time_s=START_S,
    joints=JOINTS,
    position=POSITION,
    cartesian=True,
    motors=True,
    rapid=True,
):
    """One serialised EgmRobot message; position in mm, joints in degrees."""
    message = egm_pb2.EgmRobot()
    message.header.seqno, message.header.tm = number % 2**32, round(1e3 * time_s) % 2**32
    message.header.mtype = 2
    message.feedBack.joints.joints.extend(joints)
    if cartesian:
        pose = message.feedBack.cartesian
        pose.pos.x, pose.pos.y, pose.pos.z = position
        turn = pose.orient
        turn.u0, turn.u1, turn.u2, turn.u3 = QUATERNION
    message.feedBack.time.sec = int(time_s)
    message.feedBack.time.usec = int(time_s % 1 * 1e6)
    message.motorState.state = 1 if motors else 2
    message.mciState.state = 2
    message.mciConvergenceMet = False
    message.rapidExecState.state = 2 if rapid else 1
    return message.SerializeToString()


def numbered(k, number=None, **changes):
    """Packet k of a stream of 250 Hz; number: another one in its header."""
    return packet(k if number is None else number, START_S + k * PERIOD_S, **changes)


def udp():
    """A sender's socket."""
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
