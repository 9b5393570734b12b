# SPDX-License-Identifier: Apache-2.0
"""Limits of the safety envelope."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic.dataclasses import dataclass

from cabols_control.configuration import STRICT, load_config, within
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import RigFolder, rig_file

Force = Annotated[float, within(1e-3, 2e4)]
Torque = Annotated[float, within(1e-6, 1e4)]
Length = Annotated[float, within(1e-4, 10.0)]
Way = Annotated[float, within(1e-4, 1e3)]
Speed = Annotated[float, within(1e-4, 20.0)]
Angle = Annotated[float, within(1e-4, 3.2)]
Turning = Annotated[float, within(1e-4, 20.0)]
Current = Annotated[float, within(1e-4, 100.0)]
Time = Annotated[float, within(1e-4, 10.0)]
"""Ranges in which a limit still limits: no rig like this one, however large, needs more."""


SMALLER = (
    ("cable_tension", "tension_max"),
    ("pretension_force", "tension_max"),
    ("estimate_force", "tension_max"),
    ("search_speed", "cable_speed"),
    ("speed_loaded", "speed_path"),
    ("speed_path", "speed_free"),
    ("rotation_speed_loaded", "rotation_speed_path"),
    ("rotation_speed_path", "rotation_speed_free"),
    ("rotation_jump", "rotation_range"),
    ("encoder_jump", "cable_speed"),
)
"""Pairs of limits of which the first must not be larger than the second."""


@dataclass(frozen=True, config=STRICT)
class SuspensionConfig:
    """What a site declares of a platform that hangs on its cables; see docs/safety.md.

    Its stand is where the reference pose is.

    Attributes:
        sinking_speed: at which the weight may sink with the amplifiers off [m/s].
        proof_pull: at which each gear is proven, at every start, on the stand [N].
        net_depth: below the stand, at which a net ends a fall [m]; None: there is none, and no
            cable may be needed.
        deviation: of where the platform hangs from where it should [m].
        turn: likewise [rad].
    """

    sinking_speed: Speed
    proof_pull: Force
    net_depth: Length | None = None
    deviation: Length = 0.01
    turn: Angle = 0.06


@dataclass(frozen=True, config=STRICT)
class SafetyConfig:
    """Limits of the rig; beyond them the bridge unloads or cuts by itself.

    Attributes:
        tension_max: of a limb's estimate, also of the one that it will reach before its motor can
            be stopped [N].
        cable_speed: of any limb [m/s].
        search_speed: at which a limb without a zero winds in [m/s].
        search_length: that a limb whose switch has not moved since the start may wind in [m].
        current_saturated: longest time of a current at its limit [s].
        wrench_max: (6,) of the sensor, platform axes; without load also of force and torque in
            all [N, N m].
        estimate_force: largest difference between sensor and tension estimates [N].
        estimate_torque: likewise [N m].
        estimate_time: longest time of a larger difference [s].
        position_range: (3,) of the platform about the reference position [m].
        rotation_range: angle from the reference orientation [rad].
        speed_loaded: of the platform under load and in PRETIGHTENING [m/s].
        speed_path: of the platform under load while a path is announced, at most [m/s];
            speed_loaded where the file has none.
        speed_free: of the platform otherwise [m/s].
        rotation_speed_loaded: of the platform under load and in PRETIGHTENING [rad/s].
        rotation_speed_path: as speed_path [rad/s].
        rotation_speed_free: of the platform otherwise [rad/s].
        pose_age: of the newest platform pose [s].
        pose_jump: between two poses, beyond what speed_free allows [m].
        rotation_jump: between two poses, beyond what rotation_speed_free allows [rad].
        state_age: between two samples of the card [s].
        cable_tension: an estimate above it with an open switch is a broken cable or switch [N].
        cable_time: longest time of such an estimate [s].
        switch_payout: a switch that is still closed after so much cable was paid out in
            PRETIGHTENING is stuck [m].
        pretension_force: growth of the sensor's force while limbs search for their switches; more
            means that a switch does not close and its limb keeps winding in [N].
        encoder_jump: change of a cable's speed between two samples [m/s].
        motion_current: part of the current that the motor's motion does not explain [A].
        motion_time: longest time of motion_current [s].
        sensor_flat: longest time of a gauge at the same number [s]; 0: no limit.
        relief_time: longest time for FREE_MOVING to remove an overload that it found [s].
        platform_held: whether a robot or a stand holds the platform whatever the cables do. False:
            it hangs on them, and no current flows but under the conditions of `suspension`.
        suspension: what is declared of a platform that hangs on its cables; None: nothing.
    """

    wrench_max: list[Force]
    position_range: list[Way]
    tension_max: Force = 145.0
    cable_speed: Speed = 2.0
    search_speed: Speed = 0.2
    search_length: Length = 0.06
    current_saturated: Time = 0.1
    estimate_force: Force = 30.0
    estimate_torque: Torque = 5.0
    estimate_time: Time = 0.05
    rotation_range: Angle = 0.7
    speed_loaded: Speed = 0.02
    speed_free: Speed = 0.25
    rotation_speed_loaded: Turning = 0.05
    rotation_speed_free: Turning = 1.0
    pose_age: Time = 0.1
    pose_jump: Length = 0.01
    rotation_jump: Angle = 0.02
    state_age: Time = 0.02
    cable_tension: Force = 12.0
    cable_time: Time = 0.01
    switch_payout: Length = 0.1
    pretension_force: Force = 40.0
    encoder_jump: Speed = 0.5
    motion_current: Current = 0.3
    motion_time: Time = 0.03
    sensor_flat: Annotated[float, within(0.0, 10.0)] = 0.2
    relief_time: Time = 3.0
    speed_path: Speed | None = None
    rotation_speed_path: Turning | None = None
    platform_held: bool = True
    suspension: SuspensionConfig | None = None

    def __post_init__(self) -> None:
        """Check lengths, and the limits against each other."""
        for name, count in (("wrench_max", 6), ("position_range", 3)):
            values = getattr(self, name)
            if len(values) != count:
                raise ConfigError(f"{name}: expected {count} values, got {len(values)}")
        for smaller, larger in SMALLER:
            small, large = getattr(self, smaller), getattr(self, larger)
            if small is None or large is None:
                continue
            if not small <= large:
                raise ConfigError(
                    f"{smaller}: expected at most {larger}, {large:g}, got {small:g}; a limit that "
                    "another one always meets first protects nothing"
                )

    @property
    def path_speeds(self) -> tuple[float, float]:
        """Most speed [m/s] and rotation speed [rad/s] under load while a path is announced."""
        speed = self.speed_loaded if self.speed_path is None else self.speed_path
        turning = self.rotation_speed_path
        return speed, self.rotation_speed_loaded if turning is None else turning


def load_safety(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> SafetyConfig:
    """Read a rig's safety envelope.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's safety.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(SafetyConfig, rig_file("safety.yaml", path, rig))
