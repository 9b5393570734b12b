# SPDX-License-Identifier: Apache-2.0
"""Smooth joint motions: a quintic along the straight line in joint space, slow enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_sim.devices.robot.kinematics import Arm

PEAK_SPEED = 1.875
"""Largest ds/dt of the quintic, times its duration."""

PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Largest d2s/dt2 of the quintic, times its duration squared."""

SAMPLES = 41


def quintic(phase: float) -> tuple[float, float]:
    """Path 0 to 1 and its slope at a phase 0 to 1; at rest, without acceleration, at both ends."""
    u = min(max(phase, 0.0), 1.0)
    path = u * u * u * (10.0 + u * (6.0 * u - 15.0))
    return path, 30.0 * u * u * (1.0 - u) * (1.0 - u)


def duration_s(
    arm: Arm,
    start: ArrayLike,
    goal: ArrayLike,
    speed: float,
    joint_speed: float,
    joint_acceleration: float,
) -> float:
    """Shortest duration of the motion inside the limits.

    Args:
        arm: for the speed of the platform's origin along the path.
        start: (6,) angles [rad].
        goal: (6,) angles [rad].
        speed: of the platform's origin, at most [m/s].
        joint_speed: of every joint, at most [rad/s].
        joint_acceleration: of every joint, at most [rad/s^2].

    Returns:
        Seconds; 0 if start is goal.

    Raises:
        ShapeError, OutOfRangeError: if an argument cannot be used.
    """
    begin, end = finite_array("start", start, (6,)), finite_array("goal", goal, (6,))
    in_range("speed", speed, 1e-4, 10.0)
    in_range("joint_speed", joint_speed, 1e-4, 10.0)
    in_range("joint_acceleration", joint_acceleration, 1e-4, 100.0)
    way = end - begin
    longest = float(np.abs(way).max())
    if longest == 0.0:
        return 0.0
    by_pose = 0.0
    for phase in np.linspace(0.0, 1.0, SAMPLES):
        path, slope = quintic(float(phase))
        _, _, jacobian = arm.solve(begin + path * way)
        by_pose = max(by_pose, slope * float(np.linalg.norm(jacobian[:3] @ way)) / speed)
    return max(
        by_pose,
        PEAK_SPEED * longest / joint_speed,
        float(np.sqrt(PEAK_ACCELERATION * longest / joint_acceleration)),
    )


class Motion:
    """One motion under way; a stop brakes along the path.

    Attributes:
        duration: without a stop [s].
    """

    def __init__(
        self, start: FloatArray, goal: FloatArray, duration: float, brake_s: float
    ) -> None:
        """Begin at start.

        Args:
            start: (6,) [rad].
            goal: (6,) [rad].
            duration: [s]; positive.
            brake_s: how long a stop takes [s].
        """
        self._start, self._goal = np.array(start), np.array(goal)
        self.duration = in_range("duration", duration, 1e-6, 1e6)
        self._brake_s = brake_s
        self._elapsed = 0.0
        self._rate = 1.0
        self._braking = False

    def stop(self) -> None:
        """Brake from now on."""
        self._braking = True

    @property
    def finished(self) -> bool:
        """Whether it stands, at the goal or after a stop."""
        return self._rate <= 0.0 or self.arrived

    @property
    def arrived(self) -> bool:
        """Whether it stands at the goal."""
        return self._elapsed >= self.duration

    def advance_into(self, dt_s: float, joints: FloatArray, speed: FloatArray) -> None:
        """Let dt_s pass; fill joints (6,) [rad] and speed (6,) [rad/s].

        Args:
            dt_s: time to advance [s].
            joints: (6,) to be filled [rad].
            speed: (6,) to be filled [rad/s].
        """
        if self._braking:
            self._rate = max(self._rate - dt_s / self._brake_s, 0.0)
        self._elapsed = min(self._elapsed + self._rate * dt_s, self.duration)
        path, slope = quintic(self._elapsed / self.duration)
        way = self._goal - self._start
        np.multiply(way, path, out=joints)
        joints += self._start
        np.multiply(way, 0.0 if self.finished else slope * self._rate / self.duration, out=speed)
        if self.arrived:
            joints[:] = self._goal
