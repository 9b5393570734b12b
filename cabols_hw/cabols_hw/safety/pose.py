# SPDX-License-Identifier: Apache-2.0
"""The safety envelope's rules about the platform's pose: range, jumps, speed, age; pure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rig import Rig
from cabols_control.rotations import angle_between
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import LOADED, OperatingMode
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import AXES, BridgeFault

STANDING = (*LOADED, OperatingMode.PRETIGHTENING)
"""Modes in which the platform stands, but for what the load bends: limbs with zeros go by its pose
there before all zeros are known with which pose and sensor can be compared."""
SPEED_WINDOW_S = 0.02
"""Shortest time over which a speed is averaged [s]: poses come every 4 ms, unevenly."""
LONGEST_WINDOW_S = 0.06
"""Time of arrivals after which a speed is taken by them, whatever the stamps say [s]."""
PATH_HELD_S = 0.4
"""How long an announced path's speeds are allowed: its sender repeats it, and a robot that is
stopped needs some time to brake [s]."""
PATH_MARGIN = 1.1
"""Speeds that are allowed, in announced ones: robots overshoot."""


class PathSpeeds(NamedTuple):
    """What an announced path may do: speed [m/s], rotation speed [rad/s], until when [s]."""

    speed: float
    turning: float
    until_s: float


class PoseWatch:
    """Compares every pose of the platform with the limits; times are of the card's clock.

    Attributes:
        place: newest pose that was used, (3,) [m] and (3, 3); None: none.
        anew: whether a pose at rest did not continue the ones before: the robot was set up anew.
            Its reader sets it back.
    """

    def __init__(self, rig: Rig, config: SafetyConfig) -> None:
        """Start without a pose.

        Args:
            rig: its reference pose.
            config: limits.
        """
        self._config = config
        self._position = np.array(rig.geometry.reference_position)
        self._rotation = np.array(rig.geometry.reference_rotation)
        self._range = np.array(config.position_range)
        self._newest_s = np.nan
        self.place: tuple[FloatArray, FloatArray] | None = None
        self._window: tuple[float, float, FloatArray, FloatArray] | None = None
        self._speed = self._turning = 0.0
        self._fault: BridgeFault | None = None
        self._resting = True
        self._path = PathSpeeds(0.0, 0.0, -np.inf)
        self.anew = False

    def allow_path(self, now_s: float, speed: float, turning: float) -> None:
        """Allow a path's speeds under load, within the limits of the file, for PATH_HELD_S.

        Args:
            now_s: of the newest sample, on the card's clock [s].
            speed: of the platform that is announced [m/s].
            turning: likewise [rad/s].
        """
        most, most_turning = self._config.path_speeds
        # Written so that what is not a number allows nothing.
        if 0.0 < speed < np.inf and 0.0 < turning < np.inf:
            found = min(PATH_MARGIN * speed, most), min(PATH_MARGIN * turning, most_turning)
            self._path = PathSpeeds(*found, now_s + PATH_HELD_S)

    def on_path(self, now_s: float) -> bool:
        """Whether the robot announces a path.

        Args:
            now_s: of the newest sample [s].
        """
        return now_s <= self._path.until_s

    def _allowed(self, now_s: float, mode: OperatingMode) -> tuple[float, float]:
        """Speed [m/s] and rotation speed [rad/s] that are allowed now."""
        config = self._config
        if mode not in STANDING:
            return config.speed_free, config.rotation_speed_free
        allowed = config.speed_loaded, config.rotation_speed_loaded
        if mode not in LOADED or not self.on_path(now_s):
            return allowed
        return max(allowed[0], self._path.speed), max(allowed[1], self._path.turning)

    def hear(
        self,
        now_s: float,
        position: FloatArray,
        rotation: FloatArray,
        stamp_s: float | None = None,
    ) -> bool:
        """Take a platform pose that arrived after the sample at now_s; judged with the next sample.

        Args:
            now_s: on the card's clock, whatever clock the robot has [s].
            position: (3,) base frame [m].
            rotation: (3, 3) platform to base.
            stamp_s: moment of the pose on the card's clock, for its speed alone: poses that a busy
                computer delivers late come in haste afterwards; None: now_s [s].

        Returns:
            Whether it may be used: a pose beyond the limits would make the tension estimates wrong
            with which the limbs are to be unloaded.
        """
        self._fault = self._find_range(position, rotation)
        jump = self._find_jump(now_s, position, rotation)
        if self._fault is None and not self._resting:
            self._fault = jump
        self._newest_s = now_s
        if self._fault is not None:
            return False
        self.anew = self.anew or jump is not None
        self._resting = False
        self.place = np.array(position), np.array(rotation)
        self._measure_speed(now_s, now_s if stamp_s is None else stamp_s, *self.place)
        return True

    def rest(self) -> None:
        """Accept any next pose: at rest a robot may be set up anew, and nothing moves."""
        self._resting = True

    def judge(self, now_s: float, mode: OperatingMode) -> BridgeFault | None:
        """Compare the newest pose, its age and the platform's speed with the limits of a mode.

        Args:
            now_s: now, on the card's clock [s].
            mode: whose limits count.
        """
        if mode == OperatingMode.COMMISSIONING:
            return None
        age = now_s - self._newest_s
        if not age <= self._config.pose_age:
            came = "has never come" if np.isnan(age) else f"is {1e3 * age:.0f} ms old"
            return BridgeFault(
                FaultName.POSE_AGE,
                f"the platform's pose {came}, {1e3 * self._config.pose_age:.0f} ms allowed: "
                "is the robot's bridge running?",
            )
        if self._fault is not None:
            return self._fault
        allowed, turning = self._allowed(now_s, mode)
        if not self._speed <= allowed:
            return BridgeFault(
                FaultName.POSE_SPEED,
                f"the platform moves at {1e3 * self._speed:.0f} mm/s, "
                f"{1e3 * allowed:.0f} mm/s allowed in {mode.name}",
            )
        if not self._turning <= turning:
            return BridgeFault(
                FaultName.POSE_SPEED,
                f"the platform turns at {self._turning:.2f} rad/s, {turning:g} rad/s allowed in "
                f"{mode.name}",
            )
        return None

    def _find_range(self, position: FloatArray, rotation: FloatArray) -> BridgeFault | None:
        config = self._config
        offset = np.abs(position - self._position)
        if not (offset <= self._range).all():
            axis = int(np.argmax(offset / self._range))
            return BridgeFault(
                FaultName.POSE,
                f"the platform is {1e3 * offset[axis]:.0f} mm off its reference in {AXES[axis]}, "
                f"{1e3 * self._range[axis]:.0f} mm allowed",
            )
        angle = angle_between(self._rotation, rotation)
        if not angle <= config.rotation_range:
            return BridgeFault(
                FaultName.POSE,
                f"the platform is turned by {angle:.2f} rad, {config.rotation_range:g} rad allowed",
            )
        return None

    def _find_jump(
        self, now_s: float, position: FloatArray, rotation: FloatArray
    ) -> BridgeFault | None:
        config = self._config
        if self.place is None:
            return BridgeFault(FaultName.POSE, "the platform's first pose")
        elapsed_s = now_s - self._newest_s
        jump = float(np.linalg.norm(position - self.place[0]))
        if not jump <= config.pose_jump + config.speed_free * elapsed_s:
            return BridgeFault(FaultName.POSE, f"the platform's pose jumped by {1e3 * jump:.0f} mm")
        turn = angle_between(self.place[1], rotation)
        if not turn <= config.rotation_jump + config.rotation_speed_free * elapsed_s:
            return BridgeFault(
                FaultName.POSE, f"the platform's pose turned by {turn:.3f} rad at once"
            )
        return None

    def _measure_speed(
        self, now_s: float, stamp_s: float, position: FloatArray, rotation: FloatArray
    ) -> None:
        window = (now_s, stamp_s, position, rotation)
        if self._window is None:
            self._window = window
            return
        arrived_s, began_s, where, turned = self._window
        elapsed_s = stamp_s - began_s
        # Stamps that stand still or run back hide no speed: then the arrivals count.
        if not elapsed_s >= SPEED_WINDOW_S and now_s - arrived_s >= LONGEST_WINDOW_S:
            elapsed_s = now_s - arrived_s
        if elapsed_s >= SPEED_WINDOW_S:
            self._speed = float(np.linalg.norm(position - where)) / elapsed_s
            self._turning = angle_between(turned, rotation) / elapsed_s
            self._window = window
