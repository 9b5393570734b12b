# SPDX-License-Identifier: Apache-2.0
"""The rig's heartbeat to the robot, which stops by itself when it is silent.

The task T_CABOLS on the controller (rapid/cabols_watch.mod) takes one connection and reads bytes;
0.1 s without one, or an end of the connection, stops the robot. The rig sends 50 a second, and only
while it is well: a frozen or dead process, a dead network and a fault all stop the robot alike. A
fault that the rig knows of ends the connection, which saves the robot the silence.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.supervision.modes import OperatingMode
from cabols_control.supervision.senders import make_room

BEAT = b"C"
PERIOD_S = 0.02
SILENCE_S = 0.1
"""Silence after which the robot stops by itself [s]; the controller's program has the same."""
CONNECT_S = 0.2
STATE_AGE_S = 0.15
"""Largest age of the newest limb state; the slow copy comes every 45 ms [s]."""
MODE_AGE_S = 0.3
"""Largest age of the newest mode, which the supervisor repeats [s]."""
WINDOW_S, LONGEST_WINDOW_S = 0.04, 0.5
"""Times between two looks at the robot's joints by which it moves or stands [s]."""
STANDS_RAD_S = 0.003
"""Fastest joint of a robot that stands [rad/s]: a few millimetres a second at its tool."""
REPORT_AGE_S = 1.5
"""Age at which a node's report of a fault counts no longer [s]."""


class Motion:
    """Whether a robot moves, by its joints; pure."""

    def __init__(self) -> None:
        """Start without joints: at rest, as far as is known."""
        self._began_s = np.nan
        self._joints = np.zeros(0)
        self._moves = False

    def hear(self, now_s: float, joints: FloatArray) -> bool:
        """Take newest joints; return whether they move.

        Args:
            now_s: now [s].
            joints: (k,) [rad].
        """
        elapsed_s = now_s - self._began_s
        if not elapsed_s <= LONGEST_WINDOW_S or joints.shape != self._joints.shape:
            # Nothing near enough to compare with: the next ones tell.
            self._began_s, self._joints = now_s, np.array(joints)
        elif elapsed_s >= WINDOW_S:
            turned = float(np.abs(joints - self._joints).max(initial=0.0))
            self._moves = not turned <= STANDS_RAD_S * elapsed_s
            self._began_s, self._joints = now_s, np.array(joints)
        return self._moves


class RigHealth:
    """Whether the rig is well enough for its robot to move; pure. Times are of any steady clock."""

    def __init__(self, slowness: float = 1.0) -> None:
        """Start without any message.

        Args:
            slowness: of a simulated rig in slow motion, at least 1.
        """
        self._slowness = slowness
        self._state_s = self._mode_s = -1e9
        self._mode: OperatingMode | None = None
        self._taut = ""
        self._faults: dict[str, float] = {}

    def hear_state(self, now_s: float, taut: str = "") -> None:
        """Note a limb state.

        Args:
            now_s: now [s].
            taut: names of the limbs that pull; empty if none does.
        """
        self._state_s, self._taut = now_s, taut

    def hear_mode(self, now_s: float, mode: OperatingMode) -> None:
        """Note a mode.

        Args:
            now_s: now [s].
            mode: of the rig.
        """
        self._mode_s, self._mode = now_s, mode

    def hear_report(self, now_s: float, node: str, fault: bool) -> None:
        """Note a node's report.

        Args:
            now_s: now [s].
            node: its name.
            fault: whether it is in FAULT.
        """
        if fault:
            make_room(self._faults, node)
            self._faults[node] = now_s
        else:
            self._faults.pop(node, None)

    def held(self) -> str:
        """Why the robot must not move where no cable follows it; empty if it may.

        In STOPPED the gears hold: 100 N that a cut has left on a cable are 150 N after 11 mm.
        """
        if self._mode != OperatingMode.STOPPED or not self._taut:
            return ""
        return f"{self._taut} pull, and no cable follows in STOPPED: enter FREE_MOVING"

    def trouble(self, now_s: float, moves: bool = False) -> str:
        """Why the robot must not move; empty if it may.

        Args:
            now_s: now [s].
            moves: whether it does; one that stands may be told so by the answer to its next motion.
        """
        if not now_s - self._state_s <= STATE_AGE_S * self._slowness:
            return "no limb state arrives"
        if self._mode is None or not now_s - self._mode_s <= MODE_AGE_S * self._slowness:
            return "no mode arrives"
        if self._mode == OperatingMode.FAULT:
            return "the mode is FAULT"
        if moves and self._taut and self._mode == OperatingMode.STOPPED:
            return self.held()
        recent = [n for n, t in self._faults.copy().items() if now_s - t <= REPORT_AGE_S]
        return f"{' and '.join(recent)} in FAULT" if recent else ""


class Heartbeat:
    """Sends beats while the rig is well; connects again whenever the connection is lost.

    Attributes:
        connected: whether the robot's watch has taken the connection.
    """

    def __init__(self, address: str, port: int, trouble: Callable[[], str]) -> None:
        """Prepare; start() begins.

        Args:
            address: of the controller.
            port: of its watch.
            trouble: why not to beat; empty to beat.
        """
        self._where = (address, port)
        self._trouble = trouble
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self.connected = False

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End; the robot then stops."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(1.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            with suppress(OSError), socket.create_connection(self._where, CONNECT_S) as link:
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                # A full buffer means that nobody reads: no reason to wait.
                link.setblocking(False)
                self.connected = True
                self._beat(link)
            self.connected = False
            self._stop.wait(CONNECT_S)

    def _beat(self, link: socket.socket) -> None:
        due, beaten = time.monotonic(), False
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due = max(due + PERIOD_S, time.monotonic())
            if not self._trouble():
                link.send(BEAT)
                beaten = True
            elif beaten:
                return
            # An end of the connection shows as a byte-less read.
            with suppress(BlockingIOError):
                if not link.recv(16):
                    return
