# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulated robot."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from pydantic.dataclasses import dataclass

from cabols_control.checks import finite_array, in_range
from cabols_control.configuration import STRICT, load_config
from cabols_control.rig_folder import RigFolder, rig_file
from cabols_sim.devices.robot.flexible import FlexibleJoints


@dataclass(frozen=True, config=STRICT)
class RobotConfig:
    """True physics of the robot, and its motions.

    Attributes:
        base_position: (3,) robot's base in the rig's base frame [m].
        base_rotation_xyz_deg: intrinsic x-y-z Euler angles of the robot's base [deg].
        stiffness: (6,) of the joints, without hysteresis [N m/rad].
        cubic: (6,) stiffening of the joints [N m/rad^3].
        hysteresis_torque: (6,) friction of all hysteresis sliders of a joint [N m].
        hysteresis_deflection: (6,) after which all of them have given [rad].
        lag: time constant of the quasi-static balance [s].
        speed: of the platform's origin, at most [m/s].
        joint_speed: [rad/s].
        joint_acceleration: [rad/s^2].
        brake: how long a stop takes [s].
    """

    stiffness: list[float]
    base_position: list[float] = field(default_factory=lambda: [0.0] * 3)
    base_rotation_xyz_deg: list[float] = field(default_factory=lambda: [0.0] * 3)
    cubic: list[float] = field(default_factory=lambda: [0.0] * 6)
    hysteresis_torque: list[float] = field(default_factory=lambda: [0.0] * 6)
    hysteresis_deflection: list[float] = field(default_factory=lambda: [1e-4] * 6)
    lag: float = 0.005
    speed: float = 0.06
    joint_speed: float = 0.5
    joint_acceleration: float = 2.0
    brake: float = 0.1

    def __post_init__(self) -> None:
        """Check shapes and ranges."""
        finite_array("base_position", self.base_position, (3,))
        finite_array("base_rotation_xyz_deg", self.base_rotation_xyz_deg, (3,))
        in_range("speed", self.speed, 1e-3, 0.25)
        in_range("joint_speed", self.joint_speed, 1e-3, 3.0)
        in_range("joint_acceleration", self.joint_acceleration, 1e-2, 50.0)
        in_range("brake", self.brake, 1e-3, 2.0)
        self.joints()

    def joints(self) -> FlexibleJoints:
        """Return new, unloaded joints."""
        return FlexibleJoints(
            self.stiffness,
            self.cubic,
            self.hysteresis_torque,
            self.hysteresis_deflection,
            self.lag,
        )


def load_robot_truth(
    rig: str | Path | RigFolder = "", path: str | Path | None = None
) -> RobotConfig:
    """Read the physics of a rig's simulated robot.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's robot_truth.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(RobotConfig, rig_file("robot_truth.yaml", path, rig))
