# SPDX-License-Identifier: Apache-2.0
"""An ABB robot: EGM for the stream, Robot Web Services of either version for motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cabols_hw.abb.egm.reader import EgmReader
from cabols_hw.abb.rws.motions import RobotMover
from cabols_hw.robot.interface import Capability, Leg, RobotInfo, RobotSample

EGM_RATE = 250.0
AXES = 6


@dataclass(frozen=True)
class AbbAddress:
    """Where an ABB controller is, and how to log in.

    Attributes:
        url: of Robot Web Services, http(s)://host[:port].
        user: of the controller.
        password: its password.
        certificate: PEM file for https; empty: the controller's own is taken as it is.
        timeout_s: of a request with its retries [s].
    """

    url: str
    user: str
    password: str
    certificate: str = ""
    timeout_s: float = 2.0


class AbbRobot:
    """The Robot of ABB controllers IRC5 and OmniCore with rapid/cabols.mod.

    Attributes:
        reader: of the stream, with its counters.
    """

    def __init__(self, address: AbbAddress, reader: EgmReader) -> None:
        """Prepare; nothing is sent yet.

        Args:
            address: of the controller.
            reader: of its stream; closed with the robot.

        Raises:
            RobotError: if the address cannot be used.
        """
        self.reader = reader
        self._mover = RobotMover(
            address.url, address.user, address.password, address.timeout_s, address.certificate
        )

    def info(self) -> RobotInfo:
        """Return what is known of the controller; see Robot."""
        return RobotInfo(
            maker="ABB",
            interface=f"RWS {self._mover.version}, EGM",
            axes=AXES,
            stream_rate=EGM_RATE,
            capabilities=Capability.STREAM | Capability.MOVE | Capability.STOP | Capability.LEAD,
        )

    def take(self, timeout_s: float) -> RobotSample | None:
        """Return the newest sample of the stream; see Robot."""
        return self.reader.take(timeout_s)

    def move(
        self,
        index: int,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move to a stored configuration; see Robot.

        Args:
            index: of the configuration.
            timeout_s: for the whole motion [s].
            interrupted: called every poll_s; a reason, to stop for it, or an empty string.
            poll_s: its period [s].
        """
        self._mover.move(index, timeout_s, interrupted, poll_s)

    def lead(
        self,
        leg: Leg,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move to joint angles at a speed; see Robot.

        Args:
            leg: where to, and how fast.
            timeout_s: for the whole motion [s].
            interrupted: called every poll_s; a reason, to stop for it, or an empty string.
            poll_s: its period [s].
        """
        self._mover.move(leg, timeout_s, interrupted, poll_s)

    def stop(self) -> None:
        """Stop RAPID and with it the robot; see Robot."""
        self._mover.abort()

    def close(self) -> None:
        """Log out and close the stream's port."""
        self._mover.close()
        self.reader.close()
