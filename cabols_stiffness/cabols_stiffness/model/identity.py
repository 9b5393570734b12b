# SPDX-License-Identifier: Apache-2.0
"""Which robot a result is of, and what keeps it from being used."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.model.result import Origin, StiffnessResult
from cabols_stiffness.model.robot import RobotModel

MARGIN = (0.35, 0.1)
"""Beyond the joint positions of the data that a pose may be, or a quarter of their span if that is
more: a joint that turns [rad], one that slides [m]."""

SPAN = 0.25

WORST_RMS = 3.0
"""Normalised residual beyond which a result without a verdict is not used."""


class UnusableResultError(CabolsError):
    """A result that must not be used: of another robot, not converged, or of a bad fit."""


def require_usable(result: StiffnessResult, robot: RobotModel) -> None:
    """Refuse a result that does not belong to a robot, or that is not to be used at all.

    Args:
        result: of an identification, or of a file.
        robot: that it is to be used with.

    Raises:
        UnusableResultError: saying why.
    """
    origin = result.origin
    if result.n != robot.n:
        raise UnusableResultError(
            f"result: expected one of a robot of {robot.n} joints, got one of {result.n}"
        )
    if origin is not None and not _same(origin, robot):
        raise UnusableResultError(
            f"result: expected one of the robot {robot.name!r}, got one of {origin.robot!r} "
            f"(its joints: {', '.join(origin.joint_names) or 'not named'}) with other kinematics; "
            "identify this robot, or give the URDF that the result was identified with"
        )
    if not result.converged:
        raise UnusableResultError("result: expected one that converged, got one that did not")
    if result.verdict is not None and not result.verdict.adequate:
        raise UnusableResultError(
            f"result: expected an adequate model, got the verdict {result.verdict.grade.value}: "
            f"{result.verdict.reason}"
        )
    if result.verdict is None and not result.residual_rms <= WORST_RMS:
        raise UnusableResultError(
            f"result: expected a normalised residual of at most {WORST_RMS:g}, got "
            f"{result.residual_rms:.3g}: the model does not explain the data"
        )


def require_inside(result: StiffnessResult, robot: RobotModel, joints: FloatArray) -> None:
    """Refuse a pose far from those that a result is from.

    Args:
        result: of an identification; without a range (an old file) nothing is known to be outside.
        robot: that it is of.
        joints: (n,) of the pose [rad, m].

    Raises:
        UnusableResultError: naming the joint.
    """
    where = None if result.origin is None else result.origin.joints
    if where is None:
        return
    low, high = where.T
    margin = np.maximum(SPAN * (high - low), np.where(robot.slides, MARGIN[1], MARGIN[0]))
    # A joint that turns is where it is, whole turns or not.
    turns = np.where(robot.slides, 0.0, np.round((joints - 0.5 * (low + high)) / (2.0 * np.pi)))
    at = joints - 2.0 * np.pi * turns
    inside = (at >= low - margin) & (at <= high + margin)
    if inside.all():
        return
    j = int(np.flatnonzero(~inside)[0])
    unit = "m" if robot.slides[j] else "rad"
    raise UnusableResultError(
        f"joints: expected {robot.joint_names[j]} near the identified configurations, "
        f"{low[j] - margin[j]:.3g} to {high[j] + margin[j]:.3g} {unit}, got {at[j]:.3g}; identify "
        "there, too, or allow it (anywhere=True)"
    )


def _same(origin: Origin, robot: RobotModel) -> bool:
    # Results of version 0.1 name the robot only.
    if not origin.kinematics:
        return origin.robot == robot.name
    return origin.kinematics == robot.kinematics
