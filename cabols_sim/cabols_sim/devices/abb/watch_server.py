# SPDX-License-Identifier: Apache-2.0
"""The simulated controller's task T_CABOLS: without the rig's heartbeat the robot stops."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

from cabols_hw.abb.heartbeat import SILENCE_S
from cabols_sim.devices.abb.rapid import RapidError, RapidProgram

ACCEPT_S = 0.2


class WatchServer:
    """Takes one connection at a time; its silence, or its end, stops the program's motion.

    Attributes:
        port: TCP port that it listens on, on loopback.
    """

    def __init__(self, program: RapidProgram, port: int = 0, silence_s: float = SILENCE_S) -> None:
        """Listen; start() begins. From now on the program moves only with a heartbeat.

        Args:
            program: that moves the robot.
            port: TCP port; 0: any.
            silence_s: longest time between two beats [s].

        Raises:
            RapidError: if the port is taken.
        """
        self._program = program
        self._silence_s = silence_s
        try:
            self._listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise RapidError(f"watch_port: expected a free TCP port, got {port}") from error
        self._listener.settimeout(ACCEPT_S)
        self.port: int = self._listener.getsockname()[1]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        program.hear_rig(False)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(1.0)
        self._listener.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            with suppress(OSError):
                link, _ = self._listener.accept()
                with link:
                    self._watch(link)

    def _watch(self, link: socket.socket) -> None:
        link.settimeout(self._silence_s)
        while not self._stop.is_set():
            try:
                well = bool(link.recv(256))
            except TimeoutError:
                # The connection stays: the rig may be well again.
                self._program.hear_rig(False)
                continue
            except OSError:
                well = False
            self._program.hear_rig(well)
            if not well:
                return
