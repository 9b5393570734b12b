# SPDX-License-Identifier: Apache-2.0
"""Private link between plant and device simulator: fixed records in UDP datagrams on loopback.

The plant owns the physics and one known port. The devices request their truth from it with HELLO,
repeatedly, so that either side may start first or restart. Datagrams may get lost: a
command is repeated until a truth acknowledges its sequence number.
"""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from enum import IntEnum
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError

HOST = "127.0.0.1"
DEFAULT_LINK_PORT = 6520
TRUTH_EVERY = 4
"""Samples between truths: 4 ms of the rig's time, the rate of EGM."""

DEVICE_TRUTH = np.dtype(
    [
        ("sequence", "<u8"),  # counts truths from 1
        ("time_ns", "<i8"),  # of the card's clock
        ("encoders", "<f8", (6,)),  # rad; do not see the deflection
        ("joint_speed", "<f8", (6,)),  # rad/s, of the encoders
        ("joints", "<f8", (6,)),  # rad, true
        ("position", "<f8", (3,)),  # m, true platform origin
        ("rotation", "<f8", (3, 3)),  # true, from platform to base axes
        ("speed", "<f8"),  # m/s, of the platform's origin
        ("moving", "u1"),
        ("target_index", "<i4"),  # configuration that it stands at or moves to; -1: none
        ("egm_loss", "<f8"),  # fault: share of EGM packets to lose, 0 to 1
        ("egm_delay_s", "<f8"),  # fault: delay of every EGM packet
        ("beam_blocked", "u1"),  # fault: something stands in the tracker's beam
        ("robot_stopped", "u1"),  # fault: the robot's own emergency stop
        ("acknowledged", "<u8"),  # sequence of the newest command that was obeyed or refused
    ]
)
ROBOT_COMMAND = np.dtype(
    [
        ("kind", "u1"),
        ("index", "<i4"),  # stored configuration; -1: the joints below
        ("joints", "<f8", (6,)),  # rad
        ("speed_scale", "<f8"),  # of the speed limit
        ("speed", "<f8"),  # of the platform's origin, in place of the limit [m/s]; 0: the limit
        ("sequence", "<u8"),  # counts commands from 1
    ]
)
HELLO_EVERY_S = 0.1
REPEAT_EVERY_S = 0.02
CLIENTS = 4


class Kind(IntEnum):
    """Request of a RobotCommand."""

    HELLO = 0
    MOVE = 1
    STOP = 2


class LinkError(CabolsError):
    """The link's port is not available."""


def _bind(port: int) -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        link.bind((HOST, port))
    except OSError as error:
        link.close()
        raise LinkError(
            f"link_port: expected a free UDP port, got {port} ({error.strerror}); "
            "is another bench running?"
        ) from error
    return link


class PlantLink:
    """The plant's end; never blocks.

    Attributes:
        port: where it listens.
        truth: record to fill before send().
    """

    def __init__(self, port: int = DEFAULT_LINK_PORT) -> None:
        """Open a loopback port; 0: any.

        Raises:
            LinkError: if the port is taken.
        """
        self._socket = _bind(port)
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.truth: Any = np.zeros(1, dtype=DEVICE_TRUTH)[0]
        self._clients: dict[Any, float] = {}
        self._newest: dict[Any, int] = {}

    @property
    def clients(self) -> int:
        """Number of devices that have requested the truth lately."""
        return len(self._clients)

    def receive(self) -> list[Any]:
        """Return the commands that have arrived, oldest first, each once."""
        found: list[Any] = []
        while True:
            try:
                raw, address = self._socket.recvfrom(4096)
            except ConnectionError:
                # A reader that has gone may be reported by the next call.
                continue
            except OSError:
                return found
            if len(raw) != ROBOT_COMMAND.itemsize:
                continue
            if address not in self._clients and len(self._clients) >= CLIENTS:
                continue
            self._clients[address] = time.monotonic()
            command = np.frombuffer(raw, ROBOT_COMMAND, 1)[0]
            sequence = int(command["sequence"])
            if command["kind"] == Kind.HELLO or sequence <= self._newest.get(address, 0):
                continue
            self._newest[address] = sequence
            found.append(command)

    def send(self) -> None:
        """Send `truth`, numbered, to all devices that requested it within the last second."""
        self.truth["sequence"] += 1
        oldest = time.monotonic() - 10.0 * HELLO_EVERY_S
        for address in [a for a, heard in self._clients.items() if heard < oldest]:
            del self._clients[address]
            self._newest.pop(address, None)
        for address in self._clients:
            self.truth["acknowledged"] = self._newest.get(address, 0)
            with suppress(OSError):
                self._socket.sendto(self.truth.tobytes(), address)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()


class DeviceLink:
    """The devices' end: a reader thread keeps the newest truth and repeats commands."""

    def __init__(self, port: int = DEFAULT_LINK_PORT) -> None:
        """Talk to the plant at a loopback port; start() begins."""
        self._plant = (HOST, port)
        self._socket = _bind(0)
        self._socket.settimeout(REPEAT_EVERY_S)
        self._condition = threading.Condition()
        self._truth: Any = None
        self._pending: bytes | None = None
        self._sequence = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, name="device_link", daemon=True)

    def start(self) -> None:
        """Begin to ask and read."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread, within a second, and close."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)
        self._socket.close()

    def newest(self) -> Any:
        """Newest DEVICE_TRUTH record; None before the first."""
        with self._condition:
            return self._truth

    def wait(self, after: int, timeout_s: float) -> Any:
        """Return a truth whose sequence differs from `after`; None after the time-out.

        Args:
            after: sequence of the truth that is known already.
            timeout_s: longest wait [s].
        """
        with self._condition:
            self._condition.wait_for(
                lambda: self._truth is not None and int(self._truth["sequence"]) != after, timeout_s
            )
            truth = self._truth
        if truth is None or int(truth["sequence"]) == after:
            return None
        return truth

    def move(self, index: int, speed_scale: float = 1.0, joints: FloatArray | None = None) -> int:
        """Ask for a motion to a configuration (or to (6,) joints [rad]); return its number.

        Args:
            index: of a stored configuration, from 0.
            speed_scale: share of the robot's speed.
            joints: (6,) angles [rad]; None: the configuration's.
        """
        return self._command(Kind.MOVE, -1 if joints is not None else index, joints, speed_scale)

    def lead(self, joints: FloatArray, speed: float) -> int:
        """Ask for a motion to joint angles; return its number.

        Args:
            joints: (6,) to move to [rad].
            speed: of the platform's origin [m/s].
        """
        return self._command(Kind.MOVE, -1, joints, 1.0, speed)

    def halt(self) -> int:
        """Ask the robot to stop; return the command's number."""
        return self._command(Kind.STOP, -1, None, 1.0)

    def _command(
        self,
        kind: Kind,
        index: int,
        joints: FloatArray | None,
        speed_scale: float,
        speed: float = 0.0,
    ) -> int:
        record: Any = np.zeros(1, dtype=ROBOT_COMMAND)[0]
        record["kind"], record["index"], record["speed_scale"] = kind, index, speed_scale
        record["speed"] = speed
        if joints is not None:
            record["joints"] = joints
        with self._condition:
            self._sequence += 1
            record["sequence"] = self._sequence
            self._pending = record.tobytes()
            raw = self._pending
        self._send(raw)
        return int(record["sequence"])

    def _send(self, raw: bytes) -> None:
        with suppress(OSError):
            self._socket.sendto(raw, self._plant)

    def _read(self) -> None:
        hello = np.zeros(1, dtype=ROBOT_COMMAND).tobytes()
        asked = repeated = -np.inf
        while not self._stop.is_set():
            now = time.monotonic()
            if now - asked >= HELLO_EVERY_S:
                self._send(hello)
                asked = now
            with self._condition:
                pending = self._pending
            if pending is not None and now - repeated >= REPEAT_EVERY_S:
                self._send(pending)
                repeated = now
            try:
                raw = self._socket.recv(4096)
            except OSError:
                # A time-out, or a plant that is not there (yet).
                continue
            if len(raw) == DEVICE_TRUTH.itemsize:
                self._take(np.frombuffer(raw, DEVICE_TRUTH, 1)[0])

    def _take(self, truth: Any) -> None:
        with self._condition:
            self._truth = truth
            if int(truth["acknowledged"]) >= self._sequence:
                self._pending = None
            self._condition.notify_all()
