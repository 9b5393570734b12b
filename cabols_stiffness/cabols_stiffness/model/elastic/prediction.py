# SPDX-License-Identifier: Apache-2.0
"""Deflections of an elastic arm under loads, their uncertainty, commands that make up for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.naming import joint_name
from cabols_stiffness.model.elastic.arm import Arm, settle
from cabols_stiffness.model.elastic.blocks import Joints, Statics
from cabols_stiffness.model.elastic.frames import frames_of
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm

DIFFERENCE_N = 1.0
"""Change of a force for a difference [N]; of a torque a tenth [N m]."""

COMMAND_STEPS = 20
COMMAND_ACCURACY = 1e-9
"""Of the pose that a command leads to [m, rad]."""


@dataclass(frozen=True, eq=False)
class ElasticModel:
    """An identified elastic arm.

    Attributes:
        robot: whose kinematics it was identified with.
        arm: what gives way.
        covariance: (p, p) of the arm's values.
        scatter: (n,) of each joint's compliance at one configuration, relative to its scale.
    """

    robot: RobotModel
    arm: Arm
    covariance: FloatArray
    scatter: FloatArray

    def with_tool_of(self, robot: RobotModel) -> ElasticModel:
        """Return the same arm, its identified kinematics, with the flange and tool of a robot."""
        changed = replace(
            self.robot,
            flange=robot.flange,
            flange_position=robot.flange_position,
            flange_rotation=robot.flange_rotation,
            tool_position=robot.tool_position,
            tool_rotation=robot.tool_rotation,
        )
        return replace(self, robot=changed)


@dataclass(frozen=True, eq=False)
class ElasticPrediction:
    """Deflections of k loads.

    Attributes:
        deflection: (k, 6) of the tool's origin, base axes: translation [m], rotation vector [rad].
        covariance: (k, 6, 6) of it.
        joints: (k, n) deflections of the joints [rad, m].
    """

    deflection: FloatArray
    covariance: FloatArray
    joints: FloatArray


def predict_elastic(
    model: ElasticModel, joints: ArrayLike, wrench: ArrayLike, *, follows: bool = False
) -> ElasticPrediction:
    """Deflections under wrenches that are put on the relaxed robot in one way each.

    Args:
        model: identified.
        joints: (k, n) by the encoders [rad, m].
        wrench: (k, 6) on the tool at its origin; base axes, or the tool's if it follows the tool.
        follows: whether it does.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if the wrench is more than the robot can balance.
    """
    at = finite_array("joints", joints, (None, model.robot.n))
    load = finite_array("wrench", wrench, (at.shape[0], 6))
    state = settle(model.robot, model.arm, at, load, follows)
    before, after = frames_of(model.robot, at).posture, state.frames.posture
    turned = logarithm(after.rotation @ before.rotation.swapaxes(1, 2))
    moved = np.concatenate([after.position - before.position, turned], axis=1)
    return ElasticPrediction(moved, covariance_at(model, state), state.deflection)


def covariance_at(model: ElasticModel, state: Statics) -> FloatArray:
    """(k, 6, 6) covariance of the tool's deflections by the arm's uncertainty and scatter.

    Args:
        model: identified.
        state: of the arm.
    """
    columns = model.arm.columns(state)
    found = columns @ model.covariance @ columns.swapaxes(1, 2)
    joints = next(block for block in model.arm.blocks if isinstance(block, Joints))
    own = joints.columns(state) * model.scatter
    return np.asarray(found + own @ own.swapaxes(1, 2))


def cartesian_softness(
    model: ElasticModel, joints: FloatArray, wrench: FloatArray, *, follows: bool = False
) -> FloatArray:
    """(k, 6, 6) deflections by small changes of the wrench, by differences [m/N, rad/(N m)].

    Args:
        model: identified.
        joints: (k, n) as predict_elastic.
        wrench: (k, 6) as predict_elastic.
        follows: as predict_elastic.
    """
    steps = np.repeat([DIFFERENCE_N, 0.1 * DIFFERENCE_N], 3)
    columns = []
    for axis, step in enumerate(steps):
        change = step * np.eye(6)[axis]
        ends = [
            predict_elastic(model, joints, wrench + sign * change, follows=follows).deflection
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=2)


def correct_elastic(
    model: ElasticModel, joints: ArrayLike, wrench: ArrayLike, *, follows: bool = False
) -> FloatArray:
    """(k, n) joint commands at which the loaded tool is where the unloaded one would be.

    Args:
        model: identified, of six joints or more.
        joints: (k, n) of the wanted poses [rad, m].
        wrench: (k, 6) as predict_elastic.
        follows: as predict_elastic.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if no command leads there, or it is beyond a joint's limit.
    """
    robot = model.robot
    at = finite_array("joints", joints, (None, robot.n))
    load = finite_array("wrench", wrench, (at.shape[0], 6))
    wanted, command = frames_of(robot, at).posture, at.copy()
    for _ in range(COMMAND_STEPS):
        there = settle(robot, model.arm, command, load, follows).frames.posture
        turned = logarithm(wanted.rotation @ there.rotation.swapaxes(1, 2))
        error = np.concatenate([wanted.position - there.position, turned], axis=1)
        if np.abs(error).max(initial=0.0) <= COMMAND_ACCURACY:
            break
        command = command + np.einsum("kij,kj->ki", np.linalg.pinv(there.jacobian), error)
    else:
        raise CabolsError(
            f"joints: expected poses that a command reaches, got one that misses by "
            f"{np.abs(error).max():.3g}; move it away from the singular pose"
        )
    lower, upper = robot.limits.T
    outside = np.argwhere((command < lower) | (command > upper))
    if outside.size:
        row, j = outside[0]
        raise CabolsError(
            f"joints: expected a command within {lower[j]:.4f} to {upper[j]:.4f} for "
            f"{joint_name(int(j))}, got {command[row, j]:.4f}; move the pose"
        )
    return command
