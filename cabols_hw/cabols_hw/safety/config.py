"""Limits of the safety envelope."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic.dataclasses import dataclass

from cabols_control.configuration import STRICT, load_config, within
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import RigFolder, rig_file

Positive = Annotated[float, within(1e-4, 1e6)]
Large = Annotated[float, within(1e-6, 1e6)]


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
        speed_loaded: of the platform under load [m/s].
        speed_free: of the platform otherwise [m/s].
        rotation_speed_loaded: of the platform under load [rad/s].
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
    """

    wrench_max: list[Large]
    position_range: list[Large]
    tension_max: Positive = 145.0
    cable_speed: Positive = 2.0
    search_speed: Positive = 0.2
    search_length: Positive = 0.06
    current_saturated: Positive = 0.1
    estimate_force: Positive = 30.0
    estimate_torque: Positive = 5.0
    estimate_time: Positive = 0.05
    rotation_range: Positive = 0.7
    speed_loaded: Positive = 0.02
    speed_free: Positive = 0.25
    rotation_speed_loaded: Positive = 0.05
    rotation_speed_free: Positive = 1.0
    pose_age: Positive = 0.1
    pose_jump: Positive = 0.01
    rotation_jump: Positive = 0.02
    state_age: Positive = 0.02
    cable_tension: Positive = 12.0
    cable_time: Positive = 0.01
    switch_payout: Positive = 0.1
    pretension_force: Positive = 40.0
    encoder_jump: Positive = 0.5
    motion_current: Positive = 0.3
    motion_time: Positive = 0.03
    sensor_flat: Annotated[float, within(0.0, 1e3)] = 0.2
    relief_time: Positive = 3.0

    def __post_init__(self) -> None:
        """Check lengths."""
        for name, count in (("wrench_max", 6), ("position_range", 3)):
            values = getattr(self, name)
            if len(values) != count:
                raise ConfigError(f"{name}: expected {count} values, got {len(values)}")


def load_safety(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> SafetyConfig:
    """Read a rig's safety envelope.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's safety.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(SafetyConfig, rig_file("safety.yaml", path, rig))
