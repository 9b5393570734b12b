"""Reader of the robot's position stream (EGM): returns the newest packet, counts all.

It never answers: an EgmSensor packet would be a correction to the robot's motion.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from abb_robot_client.egm import EGM
from google.protobuf.message import DecodeError

from cabols_control.checks import FloatArray
from cabols_hw.abb.errors import RobotError

DRAIN_LIMIT = 1000
"""Most packets taken at once: a flood must not block the bridge."""

RESTART_GAP = 250
"""A number farther behind is no late packet but a restarted controller: 1 s of packets."""

CLOCK_DRIFT = 2e-4
"""Largest drift between the two clocks before packets count as late [s/s]."""


@dataclass
class PacketCounter:
    """Counts lost, late, repeated and reordered packets of a numbered stream.

    Attributes:
        late_after_s: a packet is late if its way took longer than the quickest one's by this [s].
        received: packets.
        lost: numbers missing so far.
        late: packets over late_after_s.
        duplicates: packets received twice.
        out_of_order: packets behind a newer one.
        restarts: number of restarts of the numbering.
        newest: newest number; -1 before the first.
    """

    late_after_s: float = 0.010
    received: int = 0
    lost: int = 0
    late: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    restarts: int = 0
    newest: int = -1
    _offset: float = math.inf
    _offset_s: float = 0.0

    def take(self, sequence: int, sent_s: float, received_s: float) -> bool:
        """Count one packet.

        Args:
            sequence: its number, as the controller counts.
            sent_s: its time, by the controller's clock [s].
            received_s: when it came, by any clock of this computer [s].

        Returns:
            Whether it is newer than all before.
        """
        self.received += 1
        behind = self.newest - sequence
        if behind >= RESTART_GAP:
            self.restarts += 1
            self.newest, self._offset = -1, math.inf
        elif behind >= 0:
            self.duplicates += behind == 0
            self.out_of_order += behind > 0
            if behind > 0:
                # It was counted as lost, unless it precedes the first packet or is a duplicate.
                self.lost = max(self.lost - 1, 0)
            return False
        if self.newest >= 0:
            self.lost += sequence - self.newest - 1
        self.newest = sequence
        self._judge_delay(received_s - sent_s, received_s)
        return True

    def _judge_delay(self, offset: float, received_s: float) -> None:
        # The clocks' offset is unknown: the quickest packet so far counts as undelayed.
        self._offset += CLOCK_DRIFT * max(received_s - self._offset_s, 0.0)
        self._offset = min(self._offset, offset)
        self._offset_s = received_s
        self.late += not offset - self._offset <= self.late_after_s


class StreamQuality:
    """Reports when too many of some tens of packets are lost or late.

    Attributes:
        trouble: what is wrong with the newest window; empty for nothing.
    """

    def __init__(
        self, counter: PacketCounter, window: int = 50, lost: float = 0.15, late: float = 0.6
    ) -> None:
        """Watch a counter.

        Args:
            counter: of the stream.
            window: number of packets sent, received or not, that are judged together.
            lost: share of them that may be lost.
            late: share of the received ones that may be late.
        """
        self._counter = counter
        self._window = window
        self._limits = (lost, late)
        self._before = (0, 0, 0)
        self.trouble = ""

    def look(self) -> str:
        """Judge the packets since the last judgement, if there are enough; return trouble."""
        counter = self._counter
        now = (counter.received, counter.lost, counter.late)
        received, lost, late = (a - b for a, b in zip(now, self._before, strict=True))
        if received + lost < self._window:
            return self.trouble
        self._before = now
        lost_share, late_share = lost / (received + lost), late / max(received, 1)
        self.trouble = ""
        if not lost_share <= self._limits[0]:
            self.trouble = f"EGM: {100 * lost_share:.0f} % of the packets are lost"
        elif not late_share <= self._limits[1]:
            self.trouble = (
                f"EGM: {100 * late_share:.0f} % of the packets come more than "
                f"{1e3 * counter.late_after_s:.0f} ms late"
            )
        return self.trouble


@dataclass(frozen=True, eq=False)
class EgmSample:
    """Content of one packet.

    Attributes:
        sequence: the controller's number of it.
        robot_time_ns: the controller's clock.
        joints: (6,) encoders [rad].
        position: (3,) of the program's tool, robot base frame [m].
        quaternion: (4,) x y z w, from tool to robot base axes, of length one.
        motors_on: whether the motors are on.
        rapid_running: whether a RAPID program runs.
        received_s: time.monotonic() when it was taken.
    """

    sequence: int
    robot_time_ns: int
    joints: FloatArray
    position: FloatArray
    quaternion: FloatArray
    motors_on: bool
    rapid_running: bool
    received_s: float


def sample_of(state: Any, received_s: float) -> EgmSample | None:
    """Convert an EGMRobotState; None if it lacks joints or pose, or they are no numbers.

    Args:
        state: EGMRobotState of abb_robot_client.
        received_s: when it came, on the computer's clock [s].
    """
    if state.joint_angles is None or state.cartesian is None:
        return None
    joints = np.deg2rad(np.asarray(state.joint_angles, dtype=np.float64))
    position = 1e-3 * np.asarray(state.cartesian[0], dtype=np.float64)
    w, x, y, z = (float(v) for v in state.cartesian[1])
    quaternion = np.array([x, y, z, w])
    length = float(np.linalg.norm(quaternion))
    finite = joints.shape == (6,) and bool(
        np.isfinite(joints).all() and np.isfinite(position).all()
    )
    if not (finite and abs(length - 1.0) < 1e-3):
        return None
    message = state.robot_message
    clock = message.feedBack.time
    time_ns = int(clock.sec) * 1_000_000_000 + int(clock.usec) * 1000
    if not message.feedBack.HasField("time"):
        time_ns = int(message.header.tm) * 1_000_000
    return EgmSample(
        int(message.header.seqno),
        time_ns,
        joints,
        position,
        quaternion / length,
        bool(state.motors_on),
        bool(state.rapid_running),
        received_s,
    )


class EgmReader:
    """Newest packet of the stream.

    Attributes:
        counter: what was received, lost, late.
        malformed: packets that could not be used.
        foreign: packets from another address than the robot's.
        port: where it listens.
    """

    def __init__(
        self,
        port: int = 6510,
        robot_address: str = "",
        late_after_s: float = 0.010,
        clock_rate: float = 1.0,
    ) -> None:
        """Open the port.

        Args:
            port: UDP port, as set on the controller; 0: any.
            robot_address: IP address of the controller; packets from others are ignored; empty:
                take any.
            late_after_s: see PacketCounter.
            clock_rate: rate of the controller's clock in this computer's: 1, except for a
                simulated one in slow motion.

        Raises:
            RobotError: if the port is taken.
        """
        try:
            self._egm = EGM(port)
        except OSError as error:
            raise RobotError(
                f"egm_port: expected a free UDP port, got {port} ({error.strerror}); "
                "is another bridge running?"
            ) from error
        self.port: int = self._egm.socket.getsockname()[1]
        self._robot_address = robot_address
        self._clock_rate = clock_rate
        self.counter = PacketCounter(late_after_s)
        self.malformed = 0
        self.foreign = 0

    def take(self, timeout_s: float) -> EgmSample | None:
        """Wait for a packet, drain the socket, return the newest; None if none came in time."""
        newest: EgmSample | None = None
        wait = timeout_s
        for _ in range(DRAIN_LIMIT):
            try:
                found, state = self._egm.receive_from_robot(wait)
            except DecodeError:
                self.malformed += 1
                wait = 0.0
                continue
            if not found:
                return newest
            wait = 0.0
            newest = self._accept(state) or newest
        return newest

    def _accept(self, state: Any) -> EgmSample | None:
        sender = self._egm.egm_addr
        if self._robot_address and (sender is None or sender[0] != self._robot_address):
            self.foreign += 1
            return None
        sample = sample_of(state, time.monotonic())
        if sample is None:
            self.malformed += 1
            return None
        received_s = sample.received_s * self._clock_rate
        fresh = self.counter.take(sample.sequence, 1e-9 * sample.robot_time_ns, received_s)
        return sample if fresh else None

    def close(self) -> None:
        """Close the socket."""
        self._egm.close()
