# SPDX-License-Identifier: Apache-2.0
"""Static compliance of a robot as a table, after ISO 9283, section 9 (static compliance)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_stiffness.model.prediction import predict_anyway
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel

SHARE = 0.1
"""Step of the force, of the rated load: ISO 9283 raises it in steps of 10 %."""


@dataclass(frozen=True, eq=False)
class ComplianceRow:
    """Displacement along a force in one direction of the base.

    Attributes:
        direction: "+x" to "-z".
        force: (n,) [N].
        displacement: (n,) of the tool's origin along the force [m].
        deviation: (n,) its standard deviation [m].
        compliance: displacement by force at the largest one [m/N].
    """

    direction: str
    force: FloatArray
    displacement: FloatArray
    deviation: FloatArray
    compliance: float


def compliance_table(
    result: StiffnessResult, robot: RobotModel, joints: ArrayLike, rated_load: float
) -> list[ComplianceRow]:
    """Displacements under forces of 10 to 100 % of a load, along both senses of the base's axes.

    Args:
        result: an identification.
        robot: with its tool.
        joints: (6,) [rad].
        rated_load: largest force [N]; ISO 9283: the weight of the rated load.

    Raises:
        ShapeError: if joints has another shape or is not finite.
        CabolsError: if the robot cannot balance the load.
    """
    at = finite_array("joints", joints, (robot.n,))
    steps = np.arange(1, round(1.0 / SHARE) + 1, dtype=np.float64)
    forces = np.asarray(rated_load * SHARE * steps, dtype=np.float64)
    rows = []
    for axis, sense in [(axis, sense) for axis in range(3) for sense in (1.0, -1.0)]:
        found = []
        for force in forces:
            wrench = np.zeros(6)
            wrench[axis] = sense * force
            predicted = predict_anyway(result, robot, at, wrench)
            variance = predicted.covariance[axis, axis]
            found.append((sense * predicted.deflection[axis], np.sqrt(variance)))
        displacement, deviation = np.array(found).T
        name = f"{'+' if sense > 0 else '-'}{'xyz'[axis]}"
        compliance = float(displacement[-1] / forces[-1])
        rows.append(ComplianceRow(name, forces, displacement, deviation, compliance))
    return rows


def cartesian_compliance(
    result: StiffnessResult, robot: RobotModel, joints: ArrayLike
) -> FloatArray:
    """(6, 6) deflection of the unloaded tool by a small wrench, J B^-1 J^T [m/N, rad/(N m)].

    Args:
        result: of an identification.
        robot: with the tool.
        joints: (6,) of the unloaded robot [rad].

    Raises:
        ShapeError: if joints has another shape or is not finite.
    """
    jacobian = robot.jacobian(joints)
    return np.asarray(jacobian / result.parameters[: result.n] @ jacobian.T)
