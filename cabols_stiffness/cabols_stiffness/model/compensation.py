# SPDX-License-Identifier: Apache-2.0
"""Joint commands that make up for the robot's giving way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.naming import joint_names
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.elastic.prediction import correct_elastic
from cabols_stiffness.model.identity import UnusableResultError, require_inside
from cabols_stiffness.model.model_words import AS_PUBLISHED
from cabols_stiffness.model.prediction import BEYOND, Prediction, law_of, predict
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import turn

NEWTON_STEPS = 50


@dataclass(frozen=True, eq=False)
class Correction:
    """What to command instead.

    Attributes:
        joints: (6,) to command [rad].
        prediction: deflection without correction.
        covariance: (6, 6) of the tool's pose with it, (dp, dtheta) in base axes: what the
            stiffness's uncertainty leaves.
    """

    joints: FloatArray
    prediction: Prediction
    covariance: FloatArray


def correct(
    result: StiffnessResult,
    robot: RobotModel,
    joints: ArrayLike,
    wrench: ArrayLike,
    *,
    follows: bool = False,
    anywhere: bool = False,
) -> Correction:
    """Compute the command with which the loaded robot reaches the pose meant for the unloaded one.

    The loaded arm is then at `joints`, whose Jacobian is known, so that the balance falls apart
    into one equation for each joint, J(q)^T w = a d^3 + b d, and the command is q - d: exact, no
    matter how far the robot deflects, and the same for a wrench that turns with the tool.

    Args:
        result: an identification, linear or cubic, with all joints identified.
        robot: with the tool that carries the wrench.
        joints: (6,) where the unloaded robot is meant to be [rad].
        wrench: (6,) on the tool at its origin [N, N m]; base axes, or the tool's if it follows it.
        follows: whether the wrench turns with the tool.
        anywhere: allow poses and loads beyond those that the result is from.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a joint was not identified, the model is "as_published", the pose is far
            from the identified ones or the load beyond them, the robot cannot balance the wrench,
            or the command is beyond a joint's limit.
    """
    if result.elastic is not None:
        prediction = predict(result, robot, joints, wrench, follows=follows)
        at, load = np.asarray(joints, np.float64)[None], np.asarray(wrench, np.float64)[None]
        if not anywhere:
            require_inside(result, robot, at[0])
            _require_small(result, robot, prediction)
        model = result.elastic.with_tool_of(robot)
        command = correct_elastic(model, at, load, follows=follows)
        _require_limits(robot, command[0])
        return Correction(command[0], prediction, prediction.covariance)
    if result.model == AS_PUBLISHED or not result.identifiable.all():
        missing = joint_names(np.flatnonzero(~result.identifiable))
        raise CabolsError(
            f"result: expected all joints identified by the linear or cubic model, got "
            f"{result.model}, identified all but {missing}; load them more"
        )
    at = finite_array("joints", joints, (robot.n,))
    prediction = predict(result, robot, at, wrench, follows=follows)
    if not anywhere:
        require_inside(result, robot, at)
        _require_small(result, robot, prediction)
    posture = robot.posture(at[None])
    load = finite_array("wrench", wrench, (6,))[None]
    torque = posture.torque(turn(posture.rotation, load) if follows else load)
    law = law_of(result)
    moved = _solved(law, torque, prediction.joints[None])
    command = at - moved[0]
    _require_limits(robot, command)
    slope = law.slope(moved)[0]
    columns = np.hstack([np.diag(-moved[0] / slope), np.diag(-(moved[0] ** 3) / slope)])
    spread = columns @ result.parameter_covariance @ columns.T
    jacobian = posture.jacobian[0]
    return Correction(command, prediction, np.asarray(jacobian @ spread @ jacobian.T))


def _require_limits(robot: RobotModel, command: FloatArray) -> None:
    """Refuse a command (n,) beyond a joint's limit."""
    command, (lower, upper) = robot.joints_of(command), robot.limits.T
    outside = ~((command >= lower) & (command <= upper))
    if outside.any():
        j = int(np.flatnonzero(outside)[0])
        unit = "m" if robot.slides[j] else "rad"
        raise CabolsError(
            f"joints: expected a command within {robot.limits[j, 0]:.4f} to "
            f"{robot.limits[j, 1]:.4f} {unit} for {robot.joint_names[j]}, got {command[j]:.4f}; "
            "move the pose"
        )


def _require_small(result: StiffnessResult, robot: RobotModel, found: Prediction) -> None:
    """Refuse loads under which a joint deflects farther than it did in the data."""
    most = BEYOND * result.joint_range
    beyond = np.abs(found.joints) > most
    if beyond.any():
        j = int(np.flatnonzero(beyond)[0])
        raise UnusableResultError(
            f"wrench: expected one that deflects {robot.joint_names[j]} by at most {most[j]:.3g}, "
            f"{BEYOND:g} times what it was identified with, got {abs(found.joints[j]):.3g} (rad, "
            "or m); identify with larger loads, or allow it (anywhere=True)"
        )


def _solved(law: Law, torque: FloatArray, start: FloatArray) -> FloatArray:
    """(1, 6) deflections at which the joints carry torques (1, 6); Newton."""
    moved = start
    for _ in range(NEWTON_STEPS):
        step = (torque - law.torque(moved)) / law.slope(moved)
        moved = moved + step
        if not np.abs(step).max() > 1e-14:
            return moved
    raise CabolsError(
        f"wrench: expected torques that the joints' law can carry, got {torque[0].tolist()} N m; "
        "they are far beyond what was identified"
    )
