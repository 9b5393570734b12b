# SPDX-License-Identifier: Apache-2.0
"""The interface of a robot: a stream of its state, motions, a stop, and what it can.

A maker's client implements Robot; the bridge and the contract test know nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Flag, auto
from typing import Protocol

from cabols_control.checks import FloatArray


class Capability(Flag):
    """What a robot's controller can do for the rig."""

    STREAM = auto()
    """Its joints and pose come by themselves, at a steady rate."""
    MOVE = auto()
    """It moves to stored configurations."""
    STOP = auto()
    """A request stops it, whatever it does."""
    LEAD = auto()
    """It moves to any joint angles at a stated speed."""
    HEARTBEAT = auto()
    """It stops by itself if the rig is silent."""


@dataclass(frozen=True)
class RobotInfo:
    """What is known of a robot's controller.

    Attributes:
        maker: of the robot.
        interface: protocols and their versions, as found by asking.
        axes: joints that the stream holds.
        stream_rate: samples a second [Hz].
        capabilities: what it can do.
    """

    maker: str
    interface: str
    axes: int
    stream_rate: float
    capabilities: Capability


@dataclass(frozen=True, eq=False)
class RobotSample:
    """State of the robot at one moment, from its encoders.

    Attributes:
        sequence: the controller's number of it.
        robot_time_ns: the controller's clock.
        joints: (6,) encoders [rad].
        position: (3,) of the program's tool, robot base frame [m].
        quaternion: (4,) x y z w, from tool to robot base axes, of length one.
        motors_on: whether the motors are on.
        rapid_running: whether the robot's program runs.
        received_s: time.monotonic() when it arrived at this computer.
        external: further axes that the controller tells, in its own units [deg or mm].
    """

    sequence: int
    robot_time_ns: int
    joints: FloatArray
    position: FloatArray
    quaternion: FloatArray
    motors_on: bool
    rapid_running: bool
    received_s: float
    external: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Leg:
    """A motion of the loaded robot.

    Attributes:
        joints: (6,) to move to, encoders [rad].
        speed: of the program's tool, at most [m/s].
        rotation_speed: of it, at most [rad/s].
    """

    joints: FloatArray
    speed: float
    rotation_speed: float


class Robot(Protocol):
    """A robot, as the rig sees it. Failures are RobotErrors that say what to do."""

    def info(self) -> RobotInfo:
        """Return what is known of the controller; asks it at first.

        Raises:
            RobotError: if it does not answer.
        """

    def take(self, timeout_s: float) -> RobotSample | None:
        """Wait for the stream; return its newest sample, None if none came in time.

        Args:
            timeout_s: longest wait [s].
        """

    def move(
        self,
        index: int,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move to a stored configuration and wait for the end; stop after any failure.

        Args:
            index: of the configuration.
            timeout_s: for the whole motion [s].
            interrupted: called every poll_s; a reason, to stop for it, or an empty string.
            poll_s: its period [s].

        Raises:
            MoveAbortedError: after an interruption or the time-out; the robot has been stopped.
            RobotError: for everything else.
        """

    def lead(
        self,
        leg: Leg,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move to joint angles at a speed, else as move(): for robots with Capability.LEAD.

        Args:
            leg: where to, and how fast.
            timeout_s: for the whole motion [s].
            interrupted: called every poll_s; a reason, to stop for it, or an empty string.
            poll_s: its period [s].

        Raises:
            MoveAbortedError: after an interruption or the time-out; the robot has been stopped.
            RobotError: for everything else.
        """

    def stop(self) -> None:
        """Stop the robot, from any thread; returns when the controller has confirmed.

        Raises:
            RobotError: if it has not: use its emergency stop.
        """

    def close(self) -> None:
        """Give back what the controller holds for this client."""
