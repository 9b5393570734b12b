"""Inverse kinematics and the structure matrix of a cable robot.

One sign convention, everywhere: u_i is the unit vector from the platform point to the base
point of cable i, so a tension tau_i > 0 pulls the platform along +u_i and the cables' wrench
ON the platform is W = A tau with columns A_i = [u_i; (R b_i) x u_i]. The lengths then obey
l_dot = -A^T [v; omega] (virtual work; the source's (3.3), (3.4) with J = -A^T).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, rotation_matrix

if TYPE_CHECKING:
    from cabols_control.geometry import RigGeometry


@njit(cache=True)
def structure_matrix_into(
    base_points: FloatArray,
    platform_points: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    matrix: FloatArray,
) -> None:
    """Fill matrix (6, n) with the structure matrix; shapes as in structure_matrix, unchecked."""
    for i in range(base_points.shape[0]):
        b0, b1, b2 = platform_points[i, 0], platform_points[i, 1], platform_points[i, 2]
        r0 = rotation[0, 0] * b0 + rotation[0, 1] * b1 + rotation[0, 2] * b2
        r1 = rotation[1, 0] * b0 + rotation[1, 1] * b1 + rotation[1, 2] * b2
        r2 = rotation[2, 0] * b0 + rotation[2, 1] * b1 + rotation[2, 2] * b2
        u0 = base_points[i, 0] - position[0] - r0
        u1 = base_points[i, 1] - position[1] - r1
        u2 = base_points[i, 2] - position[2] - r2
        length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
        u0, u1, u2 = u0 / length, u1 / length, u2 / length
        matrix[0, i], matrix[1, i], matrix[2, i] = u0, u1, u2
        matrix[3, i] = r1 * u2 - r2 * u1
        matrix[4, i] = r2 * u0 - r0 * u2
        matrix[5, i] = r0 * u1 - r1 * u0


@njit(cache=True)
def cable_lengths_into(
    base_points: FloatArray,
    platform_points: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    lengths: FloatArray,
) -> None:
    """Fill lengths (n,) [m]; shapes as in cable_lengths, unchecked."""
    for i in range(base_points.shape[0]):
        total = 0.0
        for axis in range(3):
            difference = base_points[i, axis] - position[axis]
            for k in range(3):
                difference -= rotation[axis, k] * platform_points[i, k]
            total += difference * difference
        lengths[i] = np.sqrt(total)


def structure_matrix_unchecked(
    base_points: FloatArray, platform_points: FloatArray, position: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return structure_matrix without checks, from plain arrays."""
    matrix = np.empty((6, base_points.shape[0]))
    structure_matrix_into(base_points, platform_points, position, rotation, matrix)
    return matrix


def cable_lengths_unchecked(
    base_points: FloatArray, platform_points: FloatArray, position: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return cable_lengths without checks, from plain arrays."""
    lengths = np.empty(base_points.shape[0])
    cable_lengths_into(base_points, platform_points, position, rotation, lengths)
    return lengths


def cable_lengths(geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Distance between base and platform point of every cable; loop closure (3.1).

    Args:
        geometry: attachment points of n cables.
        position: (3,) platform origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (n,) lengths [m].

    Raises:
        ShapeError: if the pose has another shape, is not finite or is no rotation.
    """
    return cable_lengths_unchecked(
        geometry.base_points,
        geometry.platform_points,
        finite_array("position", position, (3,)),
        rotation_matrix("rotation", rotation),
    )


def structure_matrix(geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Structure matrix A with W = A @ tension: statics (3.4).

    Args:
        geometry: attachment points of n cables.
        position: (3,) platform origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (6, n); W is the wrench of the cables on the platform, force [N] then torque [N m],
        about the platform's origin, in base axes.

    Raises:
        ShapeError: if the pose has another shape, is not finite or is no rotation.
    """
    return structure_matrix_unchecked(
        geometry.base_points,
        geometry.platform_points,
        finite_array("position", position, (3,)),
        rotation_matrix("rotation", rotation),
    )
