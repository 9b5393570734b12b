# SPDX-License-Identifier: Apache-2.0
"""Reader of the robot's position stream (EGM): returns the newest packet, counts all.

It never answers: an EgmSensor packet would be a correction to the robot's motion. Packets carry the
time at which the kernel received them, so that what has waited in the socket is not taken for the
present. The first sender is the robot.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import time

from cabols_control.naming import number
from cabols_hw.abb.egm.packet_counter import PacketCounter
from cabols_hw.abb.egm.sample import EgmSample, read_packet
from cabols_hw.abb.egm.stream_quality import MALFORMED, CountedStream, Refusal, StreamQuality
from cabols_hw.abb.errors import RobotError

__all__ = ["EgmReader", "EgmSample", "PacketCounter", "StreamQuality"]

DRAIN_LIMIT = 1000
"""Most packets taken at once: a flood must not block the bridge."""

SILENCE_S = 0.02
"""A sender that was not there before may follow one that has been silent for this long [s]."""

OTHER_ADDRESS_S = 1.0
"""The same for one with another IP address, where none is set [s]."""

EXTERNAL_AXIS_LIMIT = 0.05
"""Noise of an axis that stands [deg or mm, as the controller gives it]."""

KNOWN_SENDERS = 64
PACKET_LIMIT = 65536
SO_TIMESTAMPNS = 35
"""Of Linux; Python has no name for it."""

TIMESPEC = struct.Struct("@ll")


class SenderGuard:
    """Decides who is the robot: the first sender, as long as it sends.

    A new connection of the same robot comes from a new port after a silence. Whoever was heard
    while the robot was sending is somebody else, and stays so.

    Attributes:
        sender: address and port of the robot; None before the first packet.
    """

    def __init__(self, robot_address: str = "") -> None:
        """Watch; robot_address: IP address of the controller, empty for any."""
        self._robot_address = robot_address
        self._heard_s = -math.inf
        self._strangers: set[tuple[str, int]] = set()
        self.sender: tuple[str, int] | None = None

    def admits(self, sender: tuple[str, int], received_s: float) -> Refusal | None:
        """Return why a sender is refused; None for the robot.

        Args:
            sender: address and port.
            received_s: when its packet arrived [s].
        """
        if self._robot_address and sender[0] != self._robot_address:
            return Refusal.ADDRESS
        if sender == self.sender or self.sender is None or self._follows(sender, received_s):
            return None
        if len(self._strangers) < KNOWN_SENDERS:
            self._strangers.add(sender)
        return Refusal.SECOND_SENDER

    def _follows(self, sender: tuple[str, int], received_s: float) -> bool:
        if self.sender is None or sender in self._strangers:
            return False
        silence = SILENCE_S if sender[0] == self.sender[0] else OTHER_ADDRESS_S
        return received_s - self._heard_s > silence

    def hear(self, sender: tuple[str, int], received_s: float) -> bool:
        """Note a packet of the robot; return whether its sender is a new one.

        Args:
            sender: address and port.
            received_s: when its packet arrived [s].
        """
        new = self.sender is not None and sender != self.sender
        self.sender, self._heard_s = sender, received_s
        return new


class EgmReader:
    """Newest packet of the stream.

    Attributes:
        counter: what was received, lost, late, refused.
        port: where it listens.
    """

    def __init__(
        self,
        port: int = 6510,
        robot_address: str = "",
        late_after_s: float = 0.010,
        clock_rate: float = 1.0,
        max_age_s: float = 0.2,
    ) -> None:
        """Open the port.

        Args:
            port: UDP port, as set on the controller; 0: any.
            robot_address: IP address of the controller; packets from others are ignored; empty:
                take any.
            late_after_s: see PacketCounter.
            clock_rate: rate of the controller's clock in this computer's: 1, except for a
                simulated one in slow motion.
            max_age_s: a packet that has waited longer in this computer is counted, not returned.

        Raises:
            RobotError: if the port is taken.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("", port))
        except OSError as error:
            self._socket.close()
            raise RobotError(
                f"egm_port: expected a free UDP port, got {port} ({error.strerror}); "
                "is another bridge running?"
            ) from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.port: int = self._socket.getsockname()[1]
        self._guard = SenderGuard(robot_address)
        self._external: tuple[float, ...] | None = None
        self._clock_rate = clock_rate
        self._max_age_s = max_age_s
        self.counter = CountedStream(late_after_s)

    @property
    def malformed(self) -> int:
        """Packets that could not be used."""
        return sum(self.counter.refused[reason] for reason in MALFORMED)

    @property
    def foreign(self) -> int:
        """Packets of others than the robot."""
        refused = self.counter.refused
        return refused[Refusal.ADDRESS] + refused[Refusal.SECOND_SENDER]

    def take(self, timeout_s: float) -> EgmSample | None:
        """Wait for a packet, drain the socket, return the newest; None if none came in time."""
        give_up = time.monotonic() + timeout_s
        while True:
            newest = self._drain()
            left = give_up - time.monotonic()
            if newest is not None or not left > 0.0:
                return newest
            select.select([self._socket], [], [], left)

    def _drain(self) -> EgmSample | None:
        newest: EgmSample | None = None
        for _ in range(DRAIN_LIMIT):
            try:
                raw, extra, _, sender = self._socket.recvmsg(PACKET_LIMIT, 64)
            except OSError:
                break
            newest = self._accept(raw, sender, _arrival_s(extra)) or newest
        if newest is not None and not time.monotonic() - newest.received_s <= self._max_age_s:
            self.counter.refuse(Refusal.OLD, f"{time.monotonic() - newest.received_s:.2f} s")
            return None
        return newest

    def _accept(self, raw: bytes, sender: tuple[str, int], received_s: float) -> EgmSample | None:
        refusal = self._guard.admits(sender, received_s)
        if refusal is not None:
            self.counter.refuse(refusal, f"{sender[0]}:{sender[1]}")
            return None
        sample = read_packet(raw, received_s)
        if not isinstance(sample, EgmSample):
            self.counter.refuse(*sample)
            return None
        if moved := self._moved_axis(sample.external):
            self.counter.refuse(Refusal.EXTERNAL_AXIS, moved)
            return None
        if self._guard.hear(sender, received_s):
            self.counter.renew()
        fresh = self.counter.take(
            sample.sequence, 1e-9 * sample.robot_time_ns, received_s * self._clock_rate
        )
        return sample if fresh else None

    def _moved_axis(self, external: tuple[float, ...]) -> str:
        """Say which external axis is not where it was in the first packet; empty if none is.

        A positioner may stand anywhere, but what carries the robot's base must stand still: poses
        are relative to it.
        """
        if self._external is None:
            self._external = external
        if len(external) != len(self._external):
            return f"{len(external)} external axes, {len(self._external)} before"
        for index, (now, first) in enumerate(zip(external, self._external, strict=True)):
            if not abs(now - first) <= EXTERNAL_AXIS_LIMIT:
                return f"axis {number(index)} went from {first:.4g} to {now:.4g}"
        return ""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _arrival_s(extra: list[tuple[int, int, bytes]]) -> float:
    """When the kernel received a packet, by time.monotonic() [s]; now, if it does not tell."""
    now_s = time.monotonic()
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) >= TIMESPEC.size:
            seconds, nanoseconds = TIMESPEC.unpack_from(data)
            age_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            return now_s - 1e-9 * max(int(age_ns), 0)
    return now_s
