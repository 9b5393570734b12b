# SPDX-License-Identifier: Apache-2.0
"""How a platform can move: in space, in a plane, or as a point that only shifts."""

from __future__ import annotations

from enum import Enum

import numpy as np

from cabols_control.checks import FloatArray, IntArray


class Motion(str, Enum):
    """Freedom of a platform; the value is what files say."""

    SPATIAL = "spatial"
    """Three positions and three turns."""
    PLANAR_XY = "planar_xy"
    """x, y, and a turn about z."""
    PLANAR_XZ = "planar_xz"
    """x, z, and a turn about y."""
    PLANAR_YZ = "planar_yz"
    """y, z, and a turn about x."""
    POINT = "point"
    """Three positions; the cables meet in a point, or the platform does not turn."""

    @property
    def directions(self) -> IntArray:
        """(m,) components of a wrench or motion that count: 0 to 2 along x, y, z, 3 to 5 about."""
        return np.array(_DIRECTIONS[self], dtype=np.int64)

    @property
    def across(self) -> int | None:
        """Axis across the plane of a planar motion: 0 to 2; None for the others."""
        return {Motion.PLANAR_XY: 2, Motion.PLANAR_XZ: 1, Motion.PLANAR_YZ: 0}.get(self)

    @property
    def freedom(self) -> int:
        """Number m of them: 6 or 3."""
        return len(_DIRECTIONS[self])


_DIRECTIONS = {
    Motion.SPATIAL: (0, 1, 2, 3, 4, 5),
    Motion.PLANAR_XY: (0, 1, 5),
    Motion.PLANAR_XZ: (0, 2, 4),
    Motion.PLANAR_YZ: (1, 2, 3),
    Motion.POINT: (0, 1, 2),
}
FLAT = 1e-9
"""Largest offset of points from one plane, or from each other, of the frame's size."""


def motion_of(
    base_points: FloatArray, platform_points: FloatArray, position: FloatArray, rotation: FloatArray
) -> Motion:
    """Return the motion that a robot's points leave: in a plane of the base, as a point, or all.

    Args:
        base_points: (n, 3) in the base frame [m].
        platform_points: (n, 3) in the platform frame [m].
        position: (3,) of the platform at the reference pose, base frame [m].
        rotation: (3, 3) from platform to base axes there.
    """
    held = position + platform_points @ rotation.T
    points = np.concatenate([base_points, held])
    size = FLAT * max(float(np.ptp(points, axis=0).max()), 1e-300)
    flat = np.ptp(points, axis=0) <= size
    if flat.sum() == 1:
        return (Motion.PLANAR_YZ, Motion.PLANAR_XZ, Motion.PLANAR_XY)[int(flat.argmax())]
    if (np.ptp(platform_points, axis=0) <= size).all():
        return Motion.POINT
    return Motion.SPATIAL
