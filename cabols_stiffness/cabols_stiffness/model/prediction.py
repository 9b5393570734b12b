# SPDX-License-Identifier: Apache-2.0
"""Deflections that an identified robot will show, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_stiffness.model.balance import Balance, Law, balance
from cabols_stiffness.model.elastic.prediction import (
    ElasticModel,
    cartesian_softness,
    predict_elastic,
)
from cabols_stiffness.model.identity import require_usable
from cabols_stiffness.model.model_words import AS_PUBLISHED
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm

BEYOND = 1.2
"""Multiple of a joint's largest deflection in the data beyond which a prediction extrapolates."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deflection of a loaded robot.

    Attributes:
        deflection: (6,) of the tool's origin, base axes: translation [m], rotation vector [rad].
        covariance: (6, 6) of it, from the stiffness's uncertainty and the wrench's.
        joints: (6,) deflections of the joints [rad].
        extrapolated: whether a joint deflects farther than it did in the data.
    """

    deflection: FloatArray
    covariance: FloatArray
    joints: FloatArray
    extrapolated: bool


def law_of(result: StiffnessResult) -> Law:
    """Elastic law of the joints that a result found."""
    parameters = result.parameters
    return Law(parameters[: result.n], parameters[result.n :], None, result.model == AS_PUBLISHED)


def parameter_covariance(result: StiffnessResult, rest: Balance) -> FloatArray:
    """(k, 6, 6) covariance of the joints' deflections by the parameters' uncertainty [rad^2].

    Args:
        result: of an identification.
        rest: the balance whose deflections they are.
    """
    columns = np.concatenate([rest.by_stiffness, rest.by_cubic], axis=2)
    return np.asarray(columns @ result.parameter_covariance @ columns.swapaxes(1, 2))


def predict(
    result: StiffnessResult,
    robot: RobotModel,
    joints: ArrayLike,
    wrench: ArrayLike,
    *,
    wrench_covariance: ArrayLike | None = None,
    follows: bool = False,
) -> Prediction:
    """Deflection under a wrench, with its covariance.

    Args:
        result: an identification.
        robot: with any tool, not only the one that was used to identify.
        joints: (6,) of the unloaded robot, by the encoders [rad].
        wrench: (6,) on the tool at its origin [N, N m]; base axes, or the tool's if it follows it.
        wrench_covariance: (6, 6) in the same axes; None: the wrench is exact.
        follows: whether the wrench turns with the tool.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if the result is of another robot, did not converge or is of a bad fit, or if
            the wrench is more than the robot can balance.
    """
    require_usable(result, robot)
    return predict_anyway(
        result, robot, joints, wrench, wrench_covariance=wrench_covariance, follows=follows
    )


def predict_anyway(
    result: StiffnessResult,
    robot: RobotModel,
    joints: ArrayLike,
    wrench: ArrayLike,
    *,
    wrench_covariance: ArrayLike | None = None,
    follows: bool = False,
) -> Prediction:
    """Do as predict, also for a result that is not to be used: for its report.

    Args:
        result: as predict.
        robot: as predict.
        joints: as predict.
        wrench: as predict.
        wrench_covariance: as predict.
        follows: as predict.

    Raises:
        ShapeError: as predict.
        CabolsError: if the wrench is more than the robot can balance.
    """
    at = finite_array("joints", joints, (robot.n,))[None]
    load = finite_array("wrench", wrench, (6,))[None]
    rest = balance(robot, at, load, law_of(result), follows)
    if not np.abs(rest.deflection).max() < 0.5:
        raise CabolsError(
            f"wrench: expected one that the robot can balance, got {load[0].tolist()} N, N m with "
            f"joint deflections of {np.abs(rest.deflection).max():.3g} rad; check the units"
        )
    before = robot.posture(at)
    if result.elastic is not None:
        return _of_elastic_arm(result, result.elastic, robot, at, load, wrench_covariance, follows)
    covariance = parameter_covariance(result, rest)
    if wrench_covariance is not None:
        noise = finite_array("wrench_covariance", wrench_covariance, (6, 6))
        covariance = covariance + rest.by_wrench @ noise @ rest.by_wrench.swapaxes(1, 2)
    jacobian = rest.posture.jacobian
    moved = np.einsum("kij,kj->ki", jacobian, rest.deflection)[0]
    if result.model != AS_PUBLISHED:
        turned = logarithm(rest.posture.rotation @ before.rotation.swapaxes(1, 2))
        moved = np.concatenate([(rest.posture.position - before.position)[0], turned[0]])
    return Prediction(
        moved,
        np.asarray(jacobian[0] @ covariance[0] @ jacobian[0].T),
        rest.deflection[0],
        bool((np.abs(rest.deflection[0]) > BEYOND * result.joint_range).any()),
    )


def _of_elastic_arm(
    result: StiffnessResult,
    elastic: ElasticModel,
    robot: RobotModel,
    joints: FloatArray,
    wrench: FloatArray,
    wrench_covariance: ArrayLike | None,
    follows: bool,
) -> Prediction:
    """Predict by all that gives way, with any tool of the same robot."""
    model = elastic.with_tool_of(robot)
    found = predict_elastic(model, joints, wrench, follows=follows)
    covariance = found.covariance[0]
    if wrench_covariance is not None:
        noise = finite_array("wrench_covariance", wrench_covariance, (6, 6))
        softness = cartesian_softness(model, joints, wrench, follows=follows)[0]
        covariance = covariance + softness @ noise @ softness.T
    moved = found.joints[0]
    return Prediction(
        found.deflection[0],
        covariance,
        moved,
        bool((np.abs(moved) > BEYOND * result.joint_range).any()),
    )
