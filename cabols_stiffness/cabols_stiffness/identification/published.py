# SPDX-License-Identifier: Apache-2.0
"""The source's own regression (4.17): least squares for the joints' stiffness, deflection known."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lstsq

from cabols_control.checks import FloatArray
from cabols_stiffness.measurements.samples import Samples
from cabols_stiffness.model.robot import RobotModel


def regression(samples: Samples, robot: RobotModel) -> tuple[FloatArray, FloatArray]:
    """Both sides of (4.17), A y = b, for all samples.

    A = diag(J^-1 dx) (the source repeats its first entry in the second place), b = J^T w + K_C
    J^-1 dx.

    Args:
        samples: 6-DOF deflections.
        robot: with the tool that they are of.

    Returns:
        (6 k, 6) A and (6 k,) b.
    """
    posture = robot.posture(samples.joints)
    jacobian = posture.jacobian
    deflection = np.linalg.solve(jacobian, samples.deflection[..., None])[..., 0]
    complementary = posture.complementary_stiffness(samples.wrench)
    right = posture.torque(samples.wrench) + np.einsum("kij,kj->ki", complementary, deflection)
    matrix = np.zeros((len(samples), robot.n, robot.n))
    matrix[:, range(robot.n), range(robot.n)] = deflection
    return matrix.reshape(-1, robot.n), right.ravel()


def identify_as_source(samples: Samples, robot: RobotModel) -> FloatArray:
    """(6,) stiffness [N m/rad] by ordinary least squares on (4.17), as table 4.3 was made.

    For comparison: the tracker's noise is in the matrix and pulls the stiffness down.

    Args:
        samples: 6-DOF deflections.
        robot: with the tool that they are of.
    """
    return np.asarray(lstsq(*regression(samples, robot))[0])
