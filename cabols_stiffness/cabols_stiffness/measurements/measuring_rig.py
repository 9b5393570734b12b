# SPDX-License-Identifier: Apache-2.0
"""Robot, tool, reflectors and tracker of a stiffness test: nominal values, checked."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property

import numpy as np
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, beside
from cabols_control.errors import ConfigError
from cabols_control.registration.rigid_fit import RegistrationError, require_spread


@dataclass(frozen=True, config=STRICT)
class MeasuringRig:
    """Robot, tool, reflectors and tracker, as identification needs them; nominal values.

    Attributes:
        tool_position: (3,) of the platform's origin, flange axes [m].
        tool_quaternion: (4,) w x y z, from platform to flange axes.
        reflectors: a row for each, platform axes [m].
        tracker_position: (3,) of the tracker, robot's base [m].
        tracker_rotation_xyz_deg: from tracker to base axes, intrinsic x-y-z.
        tool_mass: of what hangs on the force/torque sensor, whose weight the bridge takes off [kg].
        tool_centre_of_mass: (3,) of it, platform axes [m].
        urdf: of the robot, beside the campaign's file; empty: the bench's IRB 1600-6/1.45.
        register: find the tracker's frame and the reflectors from the campaign's own references.
    """

    tool_position: list[float]
    tool_quaternion: list[float]
    reflectors: list[list[float]]
    tracker_position: list[float]
    tracker_rotation_xyz_deg: list[float]
    tool_mass: float = 0.0
    tool_centre_of_mass: list[float] = field(default_factory=lambda: [0.0] * 3)
    urdf: str = ""
    register: bool = True

    def __post_init__(self) -> None:
        """Check shapes."""
        finite_array("tool_position", self.tool_position, (3,))
        length = np.linalg.norm(finite_array("tool_quaternion", self.tool_quaternion, (4,)))
        in_range("length of tool_quaternion", float(length), 1.0 - 1e-6, 1.0 + 1e-6)
        in_range("tool_mass", self.tool_mass, 0.0, 1e4)
        finite_array("tool_centre_of_mass", self.tool_centre_of_mass, (3,))
        points = finite_array("reflectors", self.reflectors, (None, 3))
        try:
            require_spread("reflectors", points)
        except RegistrationError as error:
            raise ConfigError(str(error)) from error
        finite_array("tracker_position", self.tracker_position, (3,))
        finite_array("tracker_rotation_xyz_deg", self.tracker_rotation_xyz_deg, (3,))
        if self.urdf:
            object.__setattr__(self, "urdf", str(beside(self.urdf)))

    @cached_property
    def tool_rotation(self) -> FloatArray:
        """(3, 3) from platform to flange axes."""
        w, x, y, z = self.tool_quaternion
        return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())

    @cached_property
    def tracker_rotation(self) -> FloatArray:
        """(3, 3) from tracker to base axes."""
        angles = self.tracker_rotation_xyz_deg
        return np.asarray(Rotation.from_euler("XYZ", angles, degrees=True).as_matrix())
