# SPDX-License-Identifier: Apache-2.0
"""Rotations as the packages exchange them: quaternions of poses, the matrix of a cross product."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit

UNIT_TOLERANCE = 1e-3
"""How far the length of a received quaternion may be from 1."""
_CROSS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
"""Row i: the matrix of the cross product with unit vector i, row by row."""


def cross_matrix(vectors: FloatArray) -> FloatArray:
    """Return the matrices S with S @ x = v x x.

    Args:
        vectors: (..., 3) the vectors v.

    Returns:
        (..., 3, 3).
    """
    return np.asarray((vectors @ _CROSS).reshape(*vectors.shape, 3))


def pose_matrix(quaternion: ArrayLike) -> FloatArray:
    """Return the (3, 3) rotation of a quaternion (4,), x y z w, of any length but zero."""
    return np.asarray(Rotation.from_quat(quaternion).as_matrix(), dtype=np.float64)


FARTHEST_M = 1e3
"""No pose of a rig is farther from its base [m]."""


@njit(cache=True)
def _read_pose(pose: FloatArray, rotation: FloatArray) -> bool:
    """Fill rotation (3, 3) of a pose (7,); return whether it is finite, with a unit quaternion."""
    for k in range(7):
        if not abs(pose[k]) <= FARTHEST_M:
            return False
    x, y, z, w = pose[3:]
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) < UNIT_TOLERANCE:
        return False
    x, y, z, w = x / length, y / length, z / length, w / length
    rotation[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    rotation[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    rotation[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    rotation[0, 1], rotation[1, 0] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
    rotation[0, 2], rotation[2, 0] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
    rotation[1, 2], rotation[2, 1] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
    return True


def read_pose(pose: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Read a pose as it comes in a message.

    Args:
        pose: (7,) position [m], quaternion x y z w.

    Returns:
        (3,) position and (3, 3) rotation, from the moved frame's axes to the fixed frame's; None
        if the pose is not finite, or farther than FARTHEST_M, or its quaternion is not of
        length one.
    """
    # A copy: read-only arrays, as of a message's bytes, would need other compiled code.
    own, rotation = np.array(pose, dtype=np.float64), np.empty((3, 3))
    return (own[:3], rotation) if _read_pose(own, rotation) else None


def angle_between(one: FloatArray, other: FloatArray) -> float:
    """Return the angle [rad] between two orientations; NaN if one is not finite.

    By the chord between them: the arc cosine of the trace has no digits left near zero.

    Args:
        one: (3, 3) rotation matrix.
        other: likewise.
    """
    chord = float(np.linalg.norm(other - one)) / np.sqrt(8.0)
    return 2.0 * float(np.arcsin(min(chord, 1.0))) if chord == chord else np.nan
