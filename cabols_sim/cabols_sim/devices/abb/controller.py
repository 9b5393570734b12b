# SPDX-License-Identifier: Apache-2.0
"""The simulated controller: program, EGM and RWS on the newest truth of the plant."""

from __future__ import annotations

from typing import Any

from cabols_control.serial_arms.arm import SerialArm
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_hw.abb.heartbeat import SILENCE_S
from cabols_sim.devices.abb.egm_server import DEFAULT_EGM_PORT, EgmServer
from cabols_sim.devices.abb.rapid import RapidProgram
from cabols_sim.devices.abb.rws_server import RwsServer
from cabols_sim.devices.abb.watch_server import WatchServer
from cabols_sim.devices.link import DeviceLink
from cabols_sim.devices.robot.kinematics import Arm
from cabols_sim.devices.truth_thread import TruthThread

USER, PASSWORD = "Default User", "robotics"
"""ABB's own defaults."""


class AbbController:
    """All interfaces of the robot's controller to the rig's computer.

    Attributes:
        program: RAPID, motors, operation mode.
        egm: the position stream.
        rws: the HTTP server; its port is rws.port.
        watch: of the rig's heartbeat; None without one.
    """

    def __init__(
        self,
        link: DeviceLink,
        configurations: RobotConfigurations,
        egm_port: int = DEFAULT_EGM_PORT,
        rws_port: int = 0,
        user: str = USER,
        password: str = PASSWORD,
        seed: int = 0,
        serial: SerialArm | None = None,
        rws_version: int = 1,
        certificate: str = "",
        watch_port: int | None = None,
        silence_s: float = SILENCE_S,
    ) -> None:
        """Prepare; start() begins.

        Args:
            link: to the plant.
            configurations: stored ones, and the tool.
            egm_port: that the position stream is sent to.
            rws_port: of the web server; 0: any.
            user: of the web server.
            password: of the user.
            seed: of lost packets.
            serial: the arm; None: the bench's.
            rws_version: of Robot Web Services, 1 (IRC5) or 2 (OmniCore).
            certificate: PEM file with certificate and key, for https; empty: http.
            watch_port: where a heartbeat must come for the robot to move; 0: any; None: no watch.
            silence_s: longest time between two beats [s].

        Raises:
            RwsServerError: if the port is taken.
        """
        self.program = RapidProgram(link, len(configurations))
        tool = Arm(
            tool_position=configurations.tool_position,
            tool_rotation=configurations.tool_rotation,
            serial=serial,
        )
        self.egm = EgmServer(self.program, tool, egm_port, seed=seed)
        self.rws = RwsServer(self.program, user, password, rws_port, rws_version, certificate)
        self.watch: WatchServer | None = None
        if watch_port is not None:
            self.watch = WatchServer(self.program, watch_port, silence_s)
        self._thread = TruthThread(link, self._step, "abb")

    def start(self) -> None:
        """Begin to serve."""
        self.rws.start()
        if self.watch is not None:
            self.watch.start()
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        self._thread.stop()
        if self.watch is not None:
            self.watch.stop()
        self.rws.stop()
        self.egm.close()

    def _step(self, truth: Any) -> None:
        self.program.step(truth)
        self.egm.on_truth(truth)
