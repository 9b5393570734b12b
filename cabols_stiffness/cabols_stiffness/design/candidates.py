# SPDX-License-Identifier: Apache-2.0
"""What could be measured: configurations near the reference pose, tensions at their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from cabols_control.cable_kernels import departures_into, structure_matrix_unchecked
from cabols_control.checks import FloatArray, IntArray, finite_array, in_range
from cabols_control.errors import CabolsError
from cabols_control.geometry import RigGeometry
from cabols_control.naming import configuration_name
from cabols_stiffness.model.robot import JOINTS, RobotModel
from cabols_stiffness.model.screws import exponential, logarithm, turning

SEGMENT_PARTS = 24
"""Points per cable in the search for the nearest approach of two."""

ATTEMPTS = 400
"""Draws per wanted configuration before giving up."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Loads to choose from.

    Attributes:
        configurations: (c, 6) joints [rad].
        configuration: (n,) which of them each load belongs to.
        tension: (n, cables) [N].
        wrench: (n, 6) on the tool, base axes, of the undeflected robot [N, N m].
    """

    configurations: FloatArray
    configuration: IntArray
    tension: FloatArray
    wrench: FloatArray


def candidate_configurations(
    robot: RobotModel,
    geometry: RigGeometry,
    reference: ArrayLike,
    count: int,
    *,
    position_range: float = 0.12,
    rotation_range: float = 0.25,
    clearance: float = 0.02,
    seed: int = 0,
) -> FloatArray:
    """Draw configurations at which the cables can hold the platform.

    A pose is drawn near the rig's reference pose, uniform in the box and the ball of the two
    ranges, and reached by Newton steps from the reference joints, so that the arm keeps its
    posture. Poses beyond joint limits, or where cables come too near each other, are left out.

    Args:
        robot: with the platform as its tool; its base is the rig's base frame.
        geometry: of the rig.
        reference: (6,) joints at the rig's reference pose or near it [rad].
        count: how many.
        position_range: of the platform along each axis [m].
        rotation_range: of its rotation's angle [rad].
        clearance: least distance of two cables that do not share a platform point [m].
        seed: of the draws.

    Returns:
        (count, 6) joints [rad].

    Raises:
        ShapeError: if reference has another shape or is not finite.
        CabolsError: if hardly any pose is possible.
    """
    start = finite_array("reference", reference, (JOINTS,))
    in_range("position_range", position_range, 0.0, 1.0)
    in_range("rotation_range", rotation_range, 0.0, 1.0)
    random = np.random.default_rng(seed)
    found: list[FloatArray] = []
    for _ in range(ATTEMPTS * count):
        if len(found) == count:
            break
        offset = position_range * random.uniform(-1.0, 1.0, 3)
        axis = random.standard_normal(3)
        # Uniform in a ball: the cube root of a uniform number is its radius.
        angle = rotation_range * np.cbrt(random.uniform())
        position = geometry.reference_position + offset
        rotation = exponential(angle * axis / np.linalg.norm(axis)) @ geometry.reference_rotation
        joints = _reached(robot, start, position, rotation)
        if joints is not None and _clear(geometry, position, rotation, clearance):
            found.append(joints)
    if len(found) < count:
        raise CabolsError(
            f"configurations: expected {count} possible ones, found {len(found)} in "
            f"{ATTEMPTS * count} draws; narrow the ranges or the clearance"
        )
    return np.array(found)


def candidate_loads(
    robot: RobotModel,
    geometry: RigGeometry,
    configurations: FloatArray,
    count: int,
    *,
    tension: tuple[float, float],
    wrench_limit: ArrayLike,
    levels: tuple[float, ...] = (1.0,),
    seed: int = 0,
) -> Candidates:
    """Tensions that pull as hard as the limits allow, in many directions, at each configuration.

    Information grows with the wrench's square, so the best loads are vertices of what is possible:
    a linear programme finds the farthest one along each random direction of the scaled wrench.

    Args:
        robot: with the platform as its tool.
        geometry: of the rig.
        configurations: (c, 6) joints [rad].
        count: directions at each.
        tension: least and greatest of every cable [N]; the least is held in the unloaded state.
        wrench_limit: (6,) of the sensor, platform axes [N, N m].
        levels: shares of the way from the unloaded state to the vertex, each one a candidate.
        seed: of the directions.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a configuration cannot be held at all.
    """
    limit = finite_array("wrench_limit", wrench_limit, (6,))
    joints = finite_array("configurations", configurations, (None, JOINTS))
    low, high = tension
    random = np.random.default_rng(seed)
    posture = robot.posture(joints)
    which, tensions, wrenches = [], [], []
    cables = geometry.records()
    for index in range(joints.shape[0]):
        position, rotation = posture.position[index], posture.rotation[index]
        matrix = structure_matrix_unchecked(cables, position, np.ascontiguousarray(rotation))
        scaled = turning(rotation.T) @ matrix / limit[:, None]
        for direction in random.standard_normal((count, 6)):
            peak = _farthest(scaled, direction, low, high)
            if peak is None:
                where = configuration_name(index)
                raise CabolsError(
                    f"{where}: expected tensions of {low:g} to {high:g} N within "
                    "the wrench limit, found none; narrow the range of poses"
                )
            for level in levels:
                drawn = low + level * (peak - low)
                which.append(index)
                tensions.append(drawn)
                wrenches.append(matrix @ drawn)
    return Candidates(joints, np.array(which), np.array(tensions), np.array(wrenches))


def _farthest(
    scaled: FloatArray, direction: FloatArray, low: float, high: float
) -> FloatArray | None:
    cables = scaled.shape[1]
    answer = linprog(
        -(direction @ scaled),
        A_ub=np.vstack([scaled, -scaled]),
        b_ub=np.ones(12),
        bounds=[(low, high)] * cables,
        method="highs",
    )
    return np.clip(answer.x, low, high) if answer.success else None


def _reached(
    robot: RobotModel, start: FloatArray, position: FloatArray, rotation: FloatArray
) -> FloatArray | None:
    """(6,) joints at a pose, by Newton steps; None if they do not lead there or past a limit."""
    joints = start
    for _ in range(20):
        posture = robot.posture(joints[None])
        error = np.concatenate(
            [position - posture.position[0], logarithm(rotation @ posture.rotation[0].T)]
        )
        if np.abs(error).max() < 1e-10:
            lower, upper = robot.limits.T
            inside = (joints >= lower) & (joints <= upper)
            return joints if inside.all() else None
        step, *_ = np.linalg.lstsq(posture.jacobian[0], error, rcond=1e-6)
        joints = joints + np.clip(step, -0.5, 0.5)
    return None


def _clear(
    geometry: RigGeometry, position: FloatArray, rotation: FloatArray, clearance: float
) -> bool:
    """Whether cables that do not share a platform point keep their distance."""
    ends = position + geometry.platform_points @ rotation.T
    share = np.linspace(0.0, 1.0, SEGMENT_PARTS)[:, None]
    starts = np.empty_like(ends)
    departures_into(
        geometry.records(), np.ascontiguousarray(position), np.ascontiguousarray(rotation), starts
    )
    lines = ends[:, None, :] + share * (starts - ends)[:, None, :]
    for i in range(geometry.cables):
        for j in range(i):
            if np.allclose(geometry.platform_points[i], geometry.platform_points[j]):
                continue
            between = lines[i][:, None, :] - lines[j][None, :, :]
            if not np.linalg.norm(between, axis=-1).min() >= clearance:
                return False
    return True
