"""Rotations as the packages exchange them: quaternions of poses, the matrix of a cross product."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray

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


def read_pose(pose: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Read a pose as it comes in a message.

    Args:
        pose: (7,) position [m], quaternion x y z w.

    Returns:
        (3,) position and (3, 3) rotation, from the moved frame's axes to the fixed frame's; None
        if the pose is not finite, or its quaternion is not of length one.
    """
    if not np.isfinite(pose).all():
        return None
    if not abs(float(np.linalg.norm(pose[3:])) - 1.0) < UNIT_TOLERANCE:
        return None
    return pose[:3], pose_matrix(pose[3:])
