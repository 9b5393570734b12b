"""Which robot a result is of, and what keeps it from being used."""

from __future__ import annotations

from cabols_control.errors import CabolsError
from cabols_stiffness.model.result import Origin, StiffnessResult
from cabols_stiffness.model.robot import RobotModel

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


def _same(origin: Origin, robot: RobotModel) -> bool:
    # Results of version 0.1 name the robot only.
    if not origin.kinematics:
        return origin.robot == robot.name
    return origin.kinematics == robot.kinematics
