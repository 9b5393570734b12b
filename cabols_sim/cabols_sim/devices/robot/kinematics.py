# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics and geometric Jacobian of a six-joint arm, at the platform's origin.

The arm is the rig's robot.urdf: for the bench ABB's IRB 1600-6/1.45.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.compiling import njit
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import RigFolder, rig_file
from cabols_control.serial_arms.arm import SerialArm, read_serial_arm

JOINTS = 6
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Chain(NamedTuple):
    """Frames of an arm, from {0} over its joints, each of which turns about its z, to the platform.

    Attributes:
        positions: (7, 3) of each frame, in the axes of the one before it [m].
        rotations: (7, 3, 3) from each frame's axes to those of the one before it.
    """

    positions: FloatArray
    rotations: FloatArray


@njit(cache=True)
def _go_on(position: FloatArray, rotation: FloatArray, step: FloatArray, turn: FloatArray) -> None:
    """Go on to the next frame, whose position and rotation in this one are step and turn."""
    turned = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            position[i] += rotation[i, k] * step[k]
            for m in range(3):
                turned[i, m] += rotation[i, k] * turn[k, m]
    rotation[:] = turned


@njit(cache=True)
def kinematics_into(
    joints: FloatArray,
    chain: Chain,
    position: FloatArray,
    rotation: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Fill pose and Jacobian of the platform, unchecked.

    Args:
        joints: (6,) angles [rad].
        chain: of Arm.
        position: (3,) filled with the platform's origin in {0} [m].
        rotation: (3, 3) filled, from platform to {0} axes.
        jacobian: (6, 6) filled, at the platform's origin, {0} axes.
    """
    position[:] = 0.0
    rotation[:] = 0.0
    for i in range(3):
        rotation[i, i] = 1.0
    points, axes = np.empty((JOINTS, 3)), np.empty((JOINTS, 3))
    for j in range(JOINTS):
        _go_on(position, rotation, chain.positions[j], chain.rotations[j])
        cosine, sine = np.cos(joints[j]), np.sin(joints[j])
        for i in range(3):
            points[j, i] = position[i]
            axes[j, i] = rotation[i, 2]
            one, two = rotation[i, 0], rotation[i, 1]
            rotation[i, 0] = cosine * one + sine * two
            rotation[i, 1] = cosine * two - sine * one
    _go_on(position, rotation, chain.positions[JOINTS], chain.rotations[JOINTS])
    for j in range(JOINTS):
        x, y, z = position[0] - points[j, 0], position[1] - points[j, 1], position[2] - points[j, 2]
        jacobian[0, j] = axes[j, 1] * z - axes[j, 2] * y
        jacobian[1, j] = axes[j, 2] * x - axes[j, 0] * z
        jacobian[2, j] = axes[j, 0] * y - axes[j, 1] * x
        for i in range(3):
            jacobian[3 + i, j] = axes[j, i]


def load_arm(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> SerialArm:
    """Read the arm that is simulated.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: URDF in place of the folder's robot.urdf; None or empty: the folder's.

    Raises:
        ConfigError: if it is not a chain of six joints that turn: the simulated controller, its
            configurations and EGM are of such a robot.
    """
    file = rig_file("robot.urdf", path, rig)
    arm = read_serial_arm(file)
    if len(arm.joints) != JOINTS:
        raise ConfigError(
            f"{file}: expected {JOINTS} joints that turn, as the simulated controller has, got "
            f"{len(arm.joints)}: {', '.join(arm.joints)}"
        )
    return arm


class Arm:
    """The arm at its place in the rig, with the platform at its flange.

    Attributes:
        serial: joints and flange.
        base_position: (3,) of the robot's base in {0} [m].
        base_rotation: (3, 3) from robot base to {0} axes.
        tool_position: (3,) of the platform's origin, flange axes [m].
        tool_rotation: (3, 3) from platform to flange axes.
        chain: its frames, with base and tool.
    """

    def __init__(
        self,
        base_position: ArrayLike = (0.0, 0.0, 0.0),
        base_rotation: ArrayLike = IDENTITY,
        tool_position: ArrayLike = (0.0, 0.0, 0.0),
        tool_rotation: ArrayLike = IDENTITY,
        serial: SerialArm | None = None,
    ) -> None:
        """Take the two constant transforms and the joints; None stands for the bench's.

        Raises:
            ConfigError: if the bench's file cannot be used.
            ShapeError: if a transform has another shape or is not finite.
        """
        self.serial = serial or load_arm()
        self.base_position = finite_array("base_position", base_position, (3,))
        self.base_rotation = finite_array("base_rotation", base_rotation, (3, 3))
        self.tool_position = finite_array("tool_position", tool_position, (3,))
        self.tool_rotation = finite_array("tool_rotation", tool_rotation, (3, 3))
        self.chain = self._chain()

    def at_its_base(self) -> Arm:
        """Return the same arm, with {0} in the robot's own base."""
        return Arm(
            tool_position=self.tool_position, tool_rotation=self.tool_rotation, serial=self.serial
        )

    def _chain(self) -> Chain:
        serial = self.serial
        # Of {0}, then of each joint's axes turned so that it turns about its z.
        place, turn = self.base_position, self.base_rotation
        positions, rotations = np.empty((JOINTS + 1, 3)), np.empty((JOINTS + 1, 3, 3))
        for j in range(JOINTS):
            turned = _axes_with_z(serial.axes[j])
            positions[j] = place + turn @ serial.origins[j]
            rotations[j] = turn @ serial.rotations[j] @ turned
            place, turn = np.zeros(3), turned.T
        flange = turn @ serial.flange_rotation
        positions[JOINTS] = turn @ serial.flange_position + flange @ self.tool_position
        rotations[JOINTS] = flange @ self.tool_rotation
        return Chain(positions, rotations)

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
        angles = finite_array("joints", joints, (JOINTS,))
        kinematics_into(angles, self.chain, position, rotation, jacobian)
        return position, rotation, jacobian


def _axes_with_z(axis: FloatArray) -> FloatArray:
    """(3, 3) rotation whose z is a unit vector; exact where that is a coordinate axis."""
    least = int(np.abs(axis).argmin())
    first = np.cross(axis, np.eye(3)[least])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])
