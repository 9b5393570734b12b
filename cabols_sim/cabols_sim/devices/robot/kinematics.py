"""IRB 1600-6/1.45: forward kinematics and geometric Jacobian at the platform's origin.

At zero the arm is as on ABB's drawing: lower arm up, forearm and flange along x of the robot's
base. Joints turn about z, y, y, x, y, x; the flange's z (ABB's tool0) is the forearm's x.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array

D1, A1, A2, D4, D6 = 0.4865, 0.150, 0.700, 0.600, 0.065
"""Lengths of the arm [m]."""

AXES = np.array([2, 1, 1, 0, 1, 0], dtype=np.int64)
"""Axis of every joint, in the frame of the link before it."""

OFFSETS = np.array(
    [[0.0, 0.0, 0.0], [A1, 0.0, D1], [0.0, 0.0, A2], [0.0, 0.0, 0.0], [D4, 0.0, 0.0], [0.0] * 3]
)
"""(6, 3) where every joint sits, in the frame of the link before it [m]."""

FLANGE_OFFSET = np.array([D6, 0.0, 0.0])
FLANGE_ROTATION = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""From flange to last link's axes."""

JOINT_LIMITS_DEG = np.array(
    [
        [-180.0, 180.0],
        [-90.0, 150.0],
        [-245.0, 65.0],
        [-200.0, 200.0],
        [-115.0, 115.0],
        [-400.0, 400.0],
    ]
)
"""(6, 2) working range."""


@njit(cache=True)
def kinematics_into(
    joints: FloatArray,
    base_position: FloatArray,
    base_rotation: FloatArray,
    tool_position: FloatArray,
    tool_rotation: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Fill pose and Jacobian of the platform; shapes as in Arm.solve, unchecked."""
    p, r = base_position.copy(), base_rotation.copy()
    points, axes = np.empty((6, 3)), np.empty((6, 3))
    for j in range(6):
        for i in range(3):
            for k in range(3):
                p[i] += r[i, k] * OFFSETS[j, k]
        axis = AXES[j]
        for i in range(3):
            points[j, i] = p[i]
            axes[j, i] = r[i, axis]
        # A turn about one axis mixes the two columns that follow it.
        first, second = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = np.cos(joints[j]), np.sin(joints[j])
        for i in range(3):
            one, two = r[i, first], r[i, second]
            r[i, first] = cosine * one + sine * two
            r[i, second] = cosine * two - sine * one
    turned = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            p[i] += r[i, k] * FLANGE_OFFSET[k]
            for m in range(3):
                turned[i, m] += r[i, k] * FLANGE_ROTATION[k, m]
    for i in range(3):
        position[i] = p[i]
        for m in range(3):
            position[i] += turned[i, m] * tool_position[m]
            rotation[i, m] = 0.0
            for k in range(3):
                rotation[i, m] += turned[i, k] * tool_rotation[k, m]
    for j in range(6):
        x, y, z = position[0] - points[j, 0], position[1] - points[j, 1], position[2] - points[j, 2]
        jacobian[0, j] = axes[j, 1] * z - axes[j, 2] * y
        jacobian[1, j] = axes[j, 2] * x - axes[j, 0] * z
        jacobian[2, j] = axes[j, 0] * y - axes[j, 1] * x
        for i in range(3):
            jacobian[3 + i, j] = axes[j, i]


class Arm:
    """The arm at its place in the rig, with the platform at its flange.

    Attributes:
        base_position: (3,) of the robot's base in {0} [m].
        base_rotation: (3, 3) from robot base to {0} axes.
        tool_position: (3,) of the platform's origin, flange axes [m].
        tool_rotation: (3, 3) from platform to flange axes.
    """

    def __init__(
        self,
        base_position: ArrayLike = (0.0, 0.0, 0.0),
        base_rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        tool_position: ArrayLike = (0.0, 0.0, 0.0),
        tool_rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ) -> None:
        """Take the two constant transforms.

        Raises:
            ShapeError: if one has another shape or is not finite.
        """
        self.base_position = finite_array("base_position", base_position, (3,))
        self.base_rotation = finite_array("base_rotation", base_rotation, (3, 3))
        self.tool_position = finite_array("tool_position", tool_position, (3,))
        self.tool_rotation = finite_array("tool_rotation", tool_rotation, (3, 3))

    @property
    def frames(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The constant transforms for kinematics_into."""
        return self.base_position, self.base_rotation, self.tool_position, self.tool_rotation

    def solve(self, joints: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pose of the platform and Jacobian at its origin.

        Args:
            joints: (6,) angles [rad].

        Returns:
            (3,) position in {0} [m]; (3, 3) rotation from platform to {0} axes; (6, 6) Jacobian
            from joint rates [rad/s] to velocity [m/s] then angular velocity [rad/s], {0} axes.

        Raises:
            ShapeError: if joints has another shape or is not finite.
        """
        position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 6))
        angles = finite_array("joints", joints, (6,))
        kinematics_into(angles, *self.frames, position, rotation, jacobian)
        return position, rotation, jacobian
