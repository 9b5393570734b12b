"""Where a rig's tool, sensor, tracker and reflectors are: one file for all packages."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any

import numpy as np
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config, within
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import RigFolder, find_rig

FRAMES = "frames.yaml"


@dataclass(frozen=True, config=STRICT)
class Frame:
    """A frame in another one; without a rotation their axes are parallel.

    Attributes:
        position: (3,) of its origin, in the other frame [m].
        rotation_xyz_deg: (3,) intrinsic x-y-z Euler angles, from its axes to the other's [deg]; or
        quaternion_wxyz: (4,) the same rotation.
    """

    position: list[float]
    rotation_xyz_deg: list[float] | None = None
    quaternion_wxyz: list[float] | None = None

    def __post_init__(self) -> None:
        """Check shapes, and that there is one rotation."""
        finite_array("position", self.position, (3,))
        if self.rotation_xyz_deg is not None and self.quaternion_wxyz is not None:
            raise ConfigError("expected rotation_xyz_deg or quaternion_wxyz, got both")
        if self.rotation_xyz_deg is not None:
            finite_array("rotation_xyz_deg", self.rotation_xyz_deg, (3,))
        if self.quaternion_wxyz is not None:
            quaternion = finite_array("quaternion_wxyz", self.quaternion_wxyz, (4,))
            length = float(np.linalg.norm(quaternion))
            in_range("length of quaternion_wxyz", length, 1.0 - 1e-6, 1.0 + 1e-6)

    def _turn(self) -> Rotation:
        if self.quaternion_wxyz is not None:
            w, x, y, z = self.quaternion_wxyz
            return Rotation.from_quat([x, y, z, w])
        return Rotation.from_euler("XYZ", self.rotation_xyz_deg or [0.0, 0.0, 0.0], degrees=True)

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) from its axes to the other frame's."""
        return np.asarray(self._turn().as_matrix(), dtype=np.float64)

    @property
    def xyz_deg(self) -> list[float]:
        """(3,) intrinsic x-y-z Euler angles [deg]."""
        if self.rotation_xyz_deg is not None:
            return self.rotation_xyz_deg
        return [float(angle) for angle in self._turn().as_euler("XYZ", degrees=True)]

    @property
    def wxyz(self) -> list[float]:
        """(4,) unit quaternion, w first."""
        if self.quaternion_wxyz is not None:
            return self.quaternion_wxyz
        x, y, z, w = (float(part) for part in self._turn().as_quat())
        return [w, x, y, z]


@dataclass(frozen=True, config=STRICT)
class RigFrames:
    """Nominal places of the devices mounted on a rig.

    Attributes:
        tool_frame: the platform, in the robot's flange.
        tracker_frame: the laser tracker, in the rig's base frame.
        reflectors: a row [x, y, z] for each, in platform axes [m].
        tool_mass: of all that hangs on the force/torque sensor [kg].
        tool_centre_of_mass: (3,) of it, from the platform's origin, platform axes [m].
        sensor_frame: the force/torque sensor, in the platform.
    """

    tool_frame: Frame
    tracker_frame: Frame
    reflectors: list[list[float]]
    tool_mass: Annotated[float, within(0.0, 1000.0)] = 0.0
    tool_centre_of_mass: list[float] = field(default_factory=lambda: [0.0] * 3)
    sensor_frame: Frame = field(default_factory=lambda: Frame([0.0] * 3))

    def __post_init__(self) -> None:
        """Check shapes."""
        finite_array("reflectors", self.reflectors, (None, 3))
        finite_array("tool_centre_of_mass", self.tool_centre_of_mass, (3,))

    def for_card(self) -> dict[str, Any]:
        """Fields of the card's configuration that stand in this file."""
        return {
            "sensor_position": self.sensor_frame.position,
            "sensor_rotation": self.sensor_frame.rotation.tolist(),
            "tool_mass": self.tool_mass,
            "tool_centre_of_mass": self.tool_centre_of_mass,
        }

    def for_robot(self) -> dict[str, Any]:
        """Fields of the robot's configurations that stand in this file."""
        return {
            "tool_position": self.tool_frame.position,
            "tool_quaternion": self.tool_frame.wxyz,
        }

    def for_tracker(self) -> dict[str, Any]:
        """Fields of the tracker's configuration that stand in this file."""
        return {
            "reflectors": self.reflectors,
            "base_position": self.tracker_frame.position,
            "base_rotation_xyz_deg": self.tracker_frame.xyz_deg,
        }

    def for_campaign(self) -> dict[str, Any]:
        """The part `rig` of a campaign, which describes the rig that it is for."""
        return {
            **self.for_robot(),
            "reflectors": self.reflectors,
            "tool_mass": self.tool_mass,
            "tool_centre_of_mass": self.tool_centre_of_mass,
            "tracker_position": self.tracker_frame.position,
            "tracker_rotation_xyz_deg": self.tracker_frame.xyz_deg,
        }


def load_frames(rig: str | RigFolder = "") -> RigFrames:
    """Read a rig's frames; empty: the reference bench's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(RigFrames, find_rig(rig).file(FRAMES))
