"""How a platform can move: in space, in a plane, or as a point that only shifts."""

from __future__ import annotations

from enum import Enum

import numpy as np

from cabols_control.checks import IntArray


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
    """Three positions; the platform does not turn, or turning it takes no torque."""

    @property
    def directions(self) -> IntArray:
        """(m,) components of a wrench or motion that count: 0 to 2 along x, y, z, 3 to 5 about."""
        return np.array(_DIRECTIONS[self], dtype=np.int64)

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
