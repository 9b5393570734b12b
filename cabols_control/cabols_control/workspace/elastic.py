# SPDX-License-Identifier: Apache-2.0
"""How far a load moves a platform that hangs on springs: stiffness and yield at a pose.

The motors stand, so every limb is a spring of stiffness 1 / (1/k_e + l/EA). A platform that moves
also turns the cables under tension. Where the cables' and the tensions' stiffness together is not
positive definite, the pose is unstable: the platform leaves it without a load.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import (
    FloatArray,
    finite_array,
    in_range,
    one_or_each,
    rotation_matrix,
    shaped_array,
)
from cabols_control.errors import ShapeError
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import cable_lengths, direction_gradients, structure_matrix
from cabols_control.rotations import cross_matrix

from .capacity import NO_WEIGHT, PlatformWeight

MOST_STIFFNESS = 1e12


def tension_stiffness(
    geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike, tension: ArrayLike
) -> FloatArray:
    """Stiffness that constant tensions give the platform: -d(A tau)/dx, its symmetric part.

    The rest is the half turn of the net torque's axes, which has no potential.

    Args:
        geometry: attachment points and pulleys.
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        tension: (n,) [N].

    Returns:
        (6, 6) [N/m, N, N m/rad].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    matrix = structure_matrix(geometry, position, rotation)
    pulls = finite_array("tension", tension, (geometry.cables,))
    turning = direction_gradients(geometry, position, rotation)
    levers = geometry.platform_points @ rotation_matrix("rotation", rotation).T
    stiffness = np.zeros((6, 6))
    for u, lever, tau, turn in zip(matrix[:3].T, levers, pulls, turning, strict=True):
        arm = cross_matrix(lever)
        jacobian = np.hstack([np.eye(3), -arm])
        stiffness += tau * (jacobian.T @ turn @ jacobian)
        stiffness[3:, 3:] -= tau * cross_matrix(u) @ arm
    return 0.5 * (stiffness + stiffness.T)


def weight_stiffness(platform: PlatformWeight, rotation: ArrayLike) -> FloatArray:
    """Stiffness that a platform's weight gives it: it swings where it hangs below its origin.

    Args:
        platform: its weight, and where it acts.
        rotation: (3, 3) from platform to base axes.

    Returns:
        (6, 6) its symmetric part, base axes [N m/rad].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    turned = rotation_matrix("rotation", rotation)
    arm = turned @ finite_array("centre_of_mass", platform.centre_of_mass, (3,))
    down = np.array([0.0, 0.0, -platform.weight])
    stiffness = np.zeros((6, 6))
    stiffness[3:, 3:] = -cross_matrix(down) @ cross_matrix(arm)
    return 0.5 * (stiffness + stiffness.T)


def limb_stiffness(spring: ArrayLike, axial: float, length: ArrayLike) -> FloatArray:
    """(n,) stiffness of limbs whose cables stretch as well [N/m].

    Args:
        spring: k_e of spring and whatever does not depend on the length, a number or (n,) [N/m].
        axial: EA of the cables [N]; inf: they do not stretch.
        length: (n,) of the cables [m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        OutOfRangeError: if a stiffness is not positive.
    """
    lengths = finite_array("length", length, (None,))
    k_e = one_or_each("spring", spring, lengths.size)
    for value in k_e:
        in_range("spring", value, 1e-9, MOST_STIFFNESS)
    if not axial > 0.0:
        in_range("axial", axial, 1e-9, inf)
    return np.asarray(1.0 / (1.0 / k_e + lengths / axial), dtype=np.float64)


def platform_stiffness(
    geometry: RigGeometry,
    position: ArrayLike,
    rotation: ArrayLike,
    tension: ArrayLike,
    spring: ArrayLike,
    axial: float = inf,
    target: ArrayLike | None = None,
    platform: PlatformWeight = NO_WEIGHT,
) -> FloatArray:
    """Stiffness of the platform with the motors standing, and of what holds it besides.

    Args:
        geometry: attachment points and pulleys.
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        tension: (n,) of the cables at the pose [N].
        spring: as in `limb_stiffness`.
        axial: likewise.
        target: (6, 6) stiffness of a robot or target, base axes; None: the platform hangs free.
        platform: its weight, which the tensions carry.

    Returns:
        (6, 6) force before torque, about the platform's origin, base axes.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        OutOfRangeError: if a stiffness is not positive.
    """
    matrix = structure_matrix(geometry, position, rotation)
    each = limb_stiffness(spring, axial, cable_lengths(geometry, position, rotation))
    found = (matrix * each) @ matrix.T
    found += tension_stiffness(geometry, position, rotation, tension)
    found += weight_stiffness(platform, rotation)
    if target is not None:
        found += finite_array("target", target, (6, 6))
    return np.asarray(found, dtype=np.float64)


@dataclass(frozen=True)
class Yield:
    """How a platform gives way at a pose.

    Attributes:
        moved: largest shift of the platform's origin under any of the loads [m]; inf where the
            pose is unstable.
        turned: largest turn [rad]; likewise.
        least: smallest eigenvalue of the stiffness, torques at the length that was given [N/m];
            not positive where the pose is unstable.
    """

    moved: float
    turned: float
    least: float


def yield_under(
    stiffness: ArrayLike, wrenches: ArrayLike, directions: ArrayLike, length: float
) -> Yield:
    """How far any of several loads moves a platform.

    Args:
        stiffness: (6, 6) as platform_stiffness gives it.
        wrenches: (q, 6) loads, base axes [N, N m].
        directions: components along which the platform can move, as Motion.directions.
        length: at which torques count as forces, for the smallest eigenvalue [m].

    Raises:
        ShapeError: if an argument has another shape.
    """
    free = np.asarray(directions, dtype=np.int64)
    loads = finite_array("wrenches", wrenches, (None, 6))[:, free]
    if not len(loads):
        raise ShapeError("wrenches: expected at least one load, got none")
    scale = np.where(free < 3, 1.0, 1.0 / in_range("length", length, 1e-9, 1e6))
    own = shaped_array("stiffness", stiffness, (6, 6))[np.ix_(free, free)]
    if not np.isfinite(own).all():
        return Yield(inf, inf, -inf)
    least = float(np.linalg.eigvalsh(own * np.outer(scale, scale))[0])
    if not least > 0.0:
        return Yield(inf, inf, least)
    motions = np.linalg.solve(own, loads.T)
    shift, turn = motions[free < 3], motions[free >= 3]
    moved = float(np.linalg.norm(shift, axis=0).max()) if shift.size else 0.0
    turned = float(np.linalg.norm(turn, axis=0).max()) if turn.size else 0.0
    return Yield(moved, turned, least)
