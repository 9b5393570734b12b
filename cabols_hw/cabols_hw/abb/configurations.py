# SPDX-License-Identifier: Apache-2.0
"""The robot's stored configurations and its tool, shared by client, controller, simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.frames import FRAMES, load_frames
from cabols_control.naming import configuration_name
from cabols_control.rig_folder import RigFolder, find_rig, rig_file


@dataclass(frozen=True, config=STRICT)
class RobotConfigurations:
    """Stored configurations and tool; the RAPID program on the controller holds the same values.

    Attributes:
        tool_position: (3,) of the platform's origin, in the flange's axes [m].
        tool_quaternion: (4,) w x y z, from platform to flange axes (ABB's tooldata order).
        speed: of the platform's origin in a motion, as in the RAPID program [m/s].
        brake: how long the robot takes from the decision to stop to standstill [s].
        configurations: joint angles of each configuration, by index from 0 [deg].
    """

    tool_position: list[float]
    tool_quaternion: list[float]
    configurations: list[list[float]]
    speed: float = 0.06
    brake: float = 0.3

    def __post_init__(self) -> None:
        """Check shapes, the quaternion's length and that the angles can be degrees."""
        finite_array("tool_position", self.tool_position, (3,))
        length = np.linalg.norm(finite_array("tool_quaternion", self.tool_quaternion, (4,)))
        in_range("length of tool_quaternion", float(length), 1.0 - 1e-6, 1.0 + 1e-6)
        if not self.configurations:
            raise ConfigError("configurations: expected at least one, got none")
        in_range("speed", self.speed, 1e-3, 0.25)
        in_range("brake", self.brake, 0.0, 2.0)
        angles = finite_array("configurations", self.configurations, (None, 6))
        in_range("largest angle", float(np.abs(angles).max()), 0.0, 400.0)

    def __len__(self) -> int:
        """Number of configurations."""
        return len(self.configurations)

    @property
    def tool_rotation(self) -> FloatArray:
        """(3, 3) from platform to flange axes."""
        w, x, y, z = self.tool_quaternion
        return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)

    def joints(self, index: int) -> FloatArray:
        """(6,) angles of a configuration [rad].

        Raises:
            CabolsError: if there is no such configuration.
        """
        if not 0 <= index < len(self.configurations):
            raise CabolsError(
                f"{configuration_name(index)}: expected one of the "
                f"{len(self.configurations)} that are stored"
            )
        return np.deg2rad(np.array(self.configurations[index], dtype=np.float64))


def load_configurations(
    rig: str | Path | RigFolder = "", path: str | Path | None = None
) -> RobotConfigurations:
    """Read a rig's stored configurations.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's robot.yaml; None or empty: the folder's.

    Raises:
        ConfigError: if the file cannot be used.
    """
    folder = find_rig(rig)
    shared = load_frames(folder).for_robot()
    return load_config(RobotConfigurations, rig_file("robot.yaml", path, folder), shared, FRAMES)
