# SPDX-License-Identifier: Apache-2.0
"""Frames of an arm whose joints deflect and whose bodies give way, for many samples at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rotations import cross_matrix
from cabols_stiffness.model.robot import Posture, RobotModel
from cabols_stiffness.model.screws import exponential


@dataclass(frozen=True, eq=False)
class Frames:
    """Where the arm is, in the robot's base axes.

    Attributes:
        posture: of joints and tool, as deflected.
        body_rotation: (k, n + 1, 3, 3) from the axes of each body to base axes: the base, then the
            link behind each joint.
        body_position: (k, n + 1, 3) of each body's origin: the base's own, then that of its joint
            [m].
    """

    posture: Posture
    body_rotation: FloatArray
    body_position: FloatArray

    @property
    def twists(self) -> FloatArray:
        """(k, n + 1, 6, 6) from a small motion of each body, in its axes, to that of the tool.

        Transposed, from a wrench on the tool to that at each body's origin, in the body's axes.
        """
        arms = self.posture.position[:, None, :] - self.body_position
        k, bodies = arms.shape[:2]
        matrix = np.zeros((k, bodies, 6, 6))
        matrix[..., :3, :3] = matrix[..., 3:, 3:] = self.body_rotation
        matrix[..., :3, 3:] = -cross_matrix(arms) @ self.body_rotation
        return matrix


def frames_of(robot: RobotModel, joints: FloatArray, moved: FloatArray | None = None) -> Frames:
    """Place the arm.

    Args:
        robot: with its tool.
        joints: (k, n) positions, deflections included [rad, m].
        moved: (k, n + 1, 6) small motions of the bodies in their own axes [m, rad]; None: none.
    """
    k, n = joints.shape[0], robot.n
    turned = None if moved is None else exponential(moved[..., 3:])
    position, rotation = np.zeros((k, 3)), np.broadcast_to(np.eye(3), (k, 3, 3))
    points, axes = np.empty((k, n, 3)), np.empty((k, n, 3))
    body_rotation, body_position = np.empty((k, n + 1, 3, 3)), np.empty((k, n + 1, 3))

    def give_way(body: int) -> None:
        nonlocal position, rotation
        body_rotation[:, body], body_position[:, body] = rotation, position
        if moved is not None and turned is not None:
            position = position + np.einsum("kij,kj->ki", rotation, moved[:, body, :3])
            rotation = rotation @ turned[:, body]

    give_way(0)
    for j in range(n):
        position = position + rotation @ robot.origins[j]
        rotation = rotation @ robot.rotations[j]
        points[:, j], axes[:, j] = position, rotation @ robot.joint_axes[j]
        if robot.slides[j]:
            position = position + joints[:, j, None] * axes[:, j]
        else:
            cross = cross_matrix(robot.joint_axes[j])
            sine = np.sin(joints[:, j])[:, None, None]
            versine = (1.0 - np.cos(joints[:, j]))[:, None, None]
            rotation = rotation @ (np.eye(3) + sine * cross + versine * (cross @ cross))
        give_way(j + 1)
    position = position + rotation @ robot.flange_position
    rotation = rotation @ robot.flange_rotation
    position = position + rotation @ robot.tool_position
    slides = robot.slides if robot.slides.any() else None
    posture = Posture(
        position, rotation @ robot.tool_rotation, axes, position[:, None, :] - points, slides
    )
    return Frames(posture, body_rotation, body_position)
