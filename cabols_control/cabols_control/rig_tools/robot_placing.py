# SPDX-License-Identifier: Apache-2.0
"""Joint angles with which an arm holds the platform at given poses: a new rig's configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.serial_arms.arm import SerialArm

TOOL_M = 0.15
"""From the flange to the platform's origin, along the flange's z, unless told otherwise [m]."""
FLANGE_AXIS = np.array([0.0, 0.0, 1.0])
"""The flange's z points out of it."""
STARTS = 100
"""Random joint angles from which the first configuration is searched."""
ARM_M = 0.5
"""Length by which the Jacobian's rows of rotation are weighed against those of position [m]."""
EXACT = 1e-9
"""Largest error of a pose that was reached [m, rad]."""
MARGIN_RAD = 0.05
"""Least distance from a joint's limits [rad]."""
TOLERANCES: dict[str, Any] = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
FREE_RAD = np.pi
"""Range in which a joint without limits, or with more than a turn, is searched [rad]."""


@dataclass(frozen=True, eq=False)
class Placing:
    """An arm's configurations.

    Attributes:
        joints: (k, n) angles [rad].
        tool_position: (3,) of the platform in the flange's axes [m].
        tool_rotation: (3, 3) from the platform's to the flange's axes.
        conditioning: least singular value of the Jacobian at the first configuration, rotations
            weighed with ARM_M [m/rad].
    """

    joints: FloatArray
    tool_position: FloatArray
    tool_rotation: FloatArray
    conditioning: float


def flange_pose(arm: SerialArm, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose of the arm's flange in its base: (3,) [m], (3, 3).

    Args:
        arm: whose joints turn.
        joints: (n,) angles [rad].
    """
    position, rotation, _, _ = _walk(arm, joints, np.zeros(3))
    return position, rotation


def _walk(
    arm: SerialArm, joints: FloatArray, tool: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Point at the tool's end, (3, 3) of the flange, (n, 3) levers of the joints, (n, 3) axes."""
    position, rotation = np.zeros(3), np.eye(3)
    places, axes = np.empty((len(joints), 3)), np.empty((len(joints), 3))
    turns = Rotation.from_rotvec(joints[:, None] * arm.axes).as_matrix()
    for j in range(len(joints)):
        position = position + rotation @ arm.origins[j]
        rotation = rotation @ arm.rotations[j]
        places[j], axes[j] = position, rotation @ arm.axes[j]
        rotation = rotation @ turns[j]
    end = position + rotation @ (arm.flange_position + arm.flange_rotation @ tool)
    return end, rotation @ arm.flange_rotation, end - places, axes


def place_robot(
    arm: SerialArm,
    positions: FloatArray,
    rotations: FloatArray,
    approach: FloatArray,
    tool_m: float = TOOL_M,
    seed: int = 0,
) -> Placing:
    """Find joint angles for poses of the platform, the first as far as can be from singular.

    The flange's z is along `approach` at the first pose; how the platform is turned about it is
    free, and becomes the tool's rotation. The other poses are reached from the first one's angles,
    so that the arm does not change its branch on the way.

    Args:
        arm: of six joints that turn, based at the rig's base frame.
        positions: (k, 3) of the platform's origin in the base frame [m].
        rotations: (k, 3, 3) from platform to base axes.
        approach: (3,) direction of the flange's z, base axes.
        tool_m: from the flange to the platform's origin [m].
        seed: of the search.

    Raises:
        ConfigError: if a pose is out of reach; the message names it and how far it is.
    """
    along = np.asarray(approach, dtype=float) / np.linalg.norm(approach)
    tool = np.array([0.0, 0.0, tool_m])
    low, high = _range(arm)

    def error(joints: FloatArray) -> FloatArray:
        end, rotation, _, _ = _walk(arm, joints, tool)
        return np.concatenate([end - positions[0], rotation @ FLANGE_AXIS - along])

    def slope(joints: FloatArray) -> FloatArray:
        _, rotation, levers, axes = _walk(arm, joints, tool)
        return np.vstack([np.cross(axes, levers).T, np.cross(axes, rotation @ FLANGE_AXIS).T])

    random, found, nearest = np.random.default_rng(seed), list[tuple[float, FloatArray]](), np.inf
    for start in random.uniform(low, high, (STARTS, low.size)):
        solved = least_squares(error, start, slope, bounds=(low, high), **TOLERANCES)
        largest = float(np.abs(solved.fun).max())
        nearest = min(nearest, largest)
        if largest <= EXACT:
            found.append((_conditioning(arm, solved.x, tool), solved.x))
    if not found:
        raise _out_of_reach(arm, positions[0], nearest)
    found.sort(key=lambda one: -one[0])
    missed: ConfigError | None = None
    for conditioning, joints in found:
        tool_rotation = flange_pose(arm, joints)[1].T @ rotations[0]
        try:
            rows = [
                _reach(arm, joints, position, rotation, tool, tool_rotation)
                for position, rotation in zip(positions, rotations, strict=True)
            ]
        except ConfigError as out_of_reach:
            missed = missed or out_of_reach
            continue
        return Placing(np.array(rows), tool, tool_rotation, conditioning)
    assert missed is not None
    raise missed


def _out_of_reach(arm: SerialArm, position: FloatArray, error: float) -> ConfigError:
    return ConfigError(
        f"robot {arm.name}: expected an arm that reaches {_place(position)} m from the base "
        f"frame, got {error * 1000.0:.1f} mm or mrad at the nearest; move the reference pose in "
        "geometry.yaml, or take a longer arm"
    )


def _reach(
    arm: SerialArm,
    start: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
    tool_rotation: FloatArray,
) -> FloatArray:
    """Joint angles of one pose, next to those of the first."""

    def error(joints: FloatArray) -> FloatArray:
        end, turn, _, _ = _walk(arm, joints, tool)
        off = Rotation.from_matrix(turn @ tool_rotation @ rotation.T).as_rotvec()
        return np.concatenate([end - position, off])

    def slope(joints: FloatArray) -> FloatArray:
        # That of the rotation vector is the axes' where the rotation left is small.
        _, _, levers, axes = _walk(arm, joints, tool)
        return np.vstack([np.cross(axes, levers).T, axes.T])

    low, high = _range(arm)
    solved = least_squares(error, start, slope, bounds=(low, high), **TOLERANCES)
    largest = float(np.abs(solved.fun).max())
    if not largest <= EXACT:
        raise _out_of_reach(arm, position, largest)
    return np.asarray(solved.x)


def _range(arm: SerialArm) -> tuple[FloatArray, FloatArray]:
    """Least and largest angles of the search."""
    low, high = np.clip(arm.limits.T, -FREE_RAD, FREE_RAD)
    return low + MARGIN_RAD, high - MARGIN_RAD


def _conditioning(arm: SerialArm, joints: FloatArray, tool: FloatArray) -> float:
    """Least singular value of the weighed Jacobian [m/rad]."""
    _, _, levers, axes = _walk(arm, joints, tool)
    jacobian = np.hstack([np.cross(axes, levers), ARM_M * axes])
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _place(position: FloatArray) -> str:
    return f"({', '.join(f'{value:.3f}' for value in position)})"
