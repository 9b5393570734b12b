# SPDX-License-Identifier: Apache-2.0
"""Measured static compliance of the robot at its mechanical interface, as ISO 9283 asks.

No model of the joints: at each configuration the interface's displacement is fitted as a symmetric
6 x 6 compliance times the measured wrench, by the numbers measured there alone. ISO 9283:1998, 10:
displacement along a force, in each direction of the base's axes, per unit of force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.measurements.usable import usable_rows
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import point_motion, shift_wrench

DETERMINED = 1e-6
"""Relative singular value below which the loads of a configuration say nothing of a direction."""

WORST = 0.5
"""Standard deviation of a compliance, relative, beyond which the loads do not show it."""


@dataclass(frozen=True, eq=False)
class MeasuredCompliance:
    """At one configuration.

    Attributes:
        configuration: its number.
        joints: (n,) of it [rad].
        compliance: (3,) displacement along a force in x, y, z of the base, per force; NaN where the
            loads do not show it [m/N].
        deviation: (3,) standard deviation of it [m/N].
        largest_force: (3,) that was applied along each axis [N].
    """

    configuration: int
    joints: FloatArray
    compliance: FloatArray
    deviation: FloatArray
    largest_force: FloatArray


def measured_compliance(
    result: StiffnessResult, samples: PointSamples | Samples, robot: RobotModel
) -> list[MeasuredCompliance]:
    """Fit each configuration's own compliance.

    Args:
        result: of an identification; only the noise that reaches the residual is taken from it.
        samples: that it is from.
        robot: with its tool; the interface is its flange.
    """
    observations = Observations(usable_rows(samples).samples, robot)
    mine = observations.samples
    stiff = Law(np.full(robot.n, 1e12), np.zeros(robot.n))
    soft = observations.linearise(Law(result.parameters[: robot.n], np.zeros(robot.n)))
    line = observations.linearise(stiff)
    posture = soft.balance.posture
    turned = posture.rotation @ robot.tool_rotation.T
    to_flange = -np.einsum("kij,j->ki", turned, robot.tool_position)
    wrench = shift_wrench(soft.balance.wrench, to_flange)
    motion = point_motion(_point(observations, posture.rotation) - to_flange)
    if isinstance(mine, Samples):
        motion = np.zeros((len(mine), 6, 6))
        motion[:, :3], motion[:, 3:, 3:] = point_motion(-to_flange), np.eye(3)
    first, second = np.triu_indices(6)
    columns = motion[:, :, first] * wrench[:, None, second]
    columns += np.where(first != second, motion[:, :, second] * wrench[:, None, first], 0.0)
    line = type(line)(line.residual, line.motion, soft.covariance, line.balance, line.partial)
    rows = whiten(line, columns, mine, np.ones(len(mine)))
    axes = [int(np.flatnonzero((first == a) & (second == a))[0]) for a in range(3)]
    found = []
    for configuration in np.unique(mine.configuration):
        here = mine.configuration == configuration
        matrix = rows.columns[here].reshape(-1, first.size)
        value, spread, known = _fitted(matrix, rows.residual[here].ravel())
        found.append(
            MeasuredCompliance(
                configuration=int(configuration),
                joints=mine.joints[here][0],
                compliance=np.where(known[axes], value[axes], np.nan),
                deviation=np.where(known[axes], np.sqrt(spread[axes]), np.nan),
                largest_force=np.abs(wrench[here, :3]).max(axis=0),
            )
        )
    return found


def _point(observations: Observations, rotation: FloatArray) -> FloatArray:
    samples = observations.samples
    if isinstance(samples, Samples):
        return np.zeros((len(samples), 3))
    return np.asarray(np.einsum("kij,kj->ki", rotation, samples.offset))


def _fitted(matrix: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Values, variances, and which of them the rows determine."""
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    left, singular, right = np.linalg.svd(matrix / scale, full_matrices=False)
    good = singular > DETERMINED * float(singular[0])
    value = right[good].T @ ((left.T @ target)[good] / singular[good]) / scale
    spread = np.sum((right[good] / singular[good, None]) ** 2, axis=0) / scale**2
    freedom = max(target.size - int(good.sum()), 1)
    variance = max(float(np.sum((target - matrix @ value) ** 2)) / freedom, 1.0)
    known = np.sum(right[good] ** 2, axis=0) > 1.0 - DETERMINED
    known &= np.sqrt(variance * spread) < WORST * np.abs(value)
    return value, variance * spread, np.asarray(known)
