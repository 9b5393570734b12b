# SPDX-License-Identifier: Apache-2.0
"""A frame in another one, as configuration files give it."""

from __future__ import annotations

import numpy as np
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT
from cabols_control.errors import ConfigError


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
