# SPDX-License-Identifier: Apache-2.0
"""The body that holds the platform: interface of the flexible robot."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.geometry import RigGeometry


class Target(Protocol):
    """Holds the platform; deflects under the cables' wrench, or moves.

    One that moves by itself says how fast: `twist`, (6,) of the platform's origin without what the
    wrench does [m/s], [rad/s], base axes. The tool's inertia goes by its changes.
    """

    position: FloatArray
    """(3,) of the platform's origin, base frame [m]."""
    rotation: FloatArray
    """(3, 3) from platform to base axes."""

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Advance under the (6,) cable wrench (base axes); return whether the pose has changed.

        Args:
            wrench: (6,) of the cables on the platform, base axes [N, N m].
            dt_s: length of the step [s].
        """


class RigidTarget:
    """Never moves."""

    def __init__(self, geometry: RigGeometry) -> None:
        """Stand at the reference pose."""
        self.position = np.array(geometry.reference_position)
        self.rotation = np.array(geometry.reference_rotation)

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Stay.

        Args:
            wrench: (6,) of the cables on the platform, base axes [N, N m].
            dt_s: length of the step [s].
        """
        del wrench, dt_s
        return False
