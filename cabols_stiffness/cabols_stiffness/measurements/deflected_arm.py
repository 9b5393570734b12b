# SPDX-License-Identifier: Apache-2.0
"""Corrections of the data by a first result, for small errors that the deflection itself causes.

Both are small (a tenth of a percent on the bench) but larger than the noise that a good campaign
leaves, so that intervals are valid only after the correction.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_stiffness.measurements.samples import PointSamples
from cabols_stiffness.model.balance import Law, balance
from cabols_stiffness.model.robot import Posture, RobotModel
from cabols_stiffness.model.screws import turn


def loaded_posture(
    robot: RobotModel, joints: ArrayLike, wrench: ArrayLike, parameters: ArrayLike
) -> Posture:
    """Compute the tool's true poses under small wrenches, such as at the unloaded references.

    The least tension of the cables turns the bench's wrist by some 0.1 mrad. Register the tracker
    with these poses, not with the encoders': a rotation of the tracker's frame mixes the large
    deflections into the small ones.

    Args:
        robot: with the tool that carries the wrench.
        joints: (k, 6) by the encoders [rad].
        wrench: (k, 6) tool axes, as the sensor measures it [N, N m].
        parameters: (12,) of a first result, or a guess: stiffness, then cubic terms.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    at = finite_array("joints", joints, (None, robot.n))
    load = finite_array("wrench", wrench, (at.shape[0], 6))
    return balance(robot, at, load, _law(parameters), follows=True).posture


def without_tool_weight(
    points: PointSamples,
    robot: RobotModel,
    parameters: ArrayLike,
    weight: float,
    centre: ArrayLike = (0.0, 0.0, 0.0),
) -> PointSamples:
    """Subtract the tool's weight from the readings in the tool's true orientation.

    The rig's bridge subtracts it in the orientation of the encoders. A load turns the tool, and
    the remainder, weight times angle, looks like a load.

    Args:
        points: as measured.
        robot: with the tool that the samples are about.
        parameters: (12,) of a first result, or a guess: stiffness, then cubic terms.
        weight: of all that hangs on the sensor, along -z of the base [N].
        centre: (3,) of its mass from the tool's origin, tool axes [m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    rest = balance(robot, points.joints, points.wrench, _law(parameters), follows=True)
    down = np.tile([0.0, 0.0, -weight, 0.0, 0.0, 0.0], (len(points), 1))
    taken = turn(robot.posture(points.joints).rotation.swapaxes(1, 2), down)
    extra = (turn(rest.posture.rotation.swapaxes(1, 2), down) - taken)[:, :3]
    arm = finite_array("centre", centre, (3,))
    error = np.concatenate([extra, np.cross(arm, extra)], axis=1)
    return replace(points, wrench=points.wrench - error)


def _law(parameters: ArrayLike) -> Law:
    values: FloatArray = finite_array("parameters", parameters, (None,))
    n = values.size // 2
    return Law(values[:n], values[n:])
