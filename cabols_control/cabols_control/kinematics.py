"""Inverse kinematics and the structure matrix of a cable robot.

One sign convention, everywhere: u_i is the unit vector from the platform point to the base
point of cable i, so a tension tau_i > 0 pulls the platform along +u_i and the cables' wrench
ON the platform is W = A tau with columns A_i = [u_i; (R b_i) x u_i]. The lengths then obey
l_dot = -A^T [v; omega] (virtual work; the source's (3.3), (3.4) with J = -A^T).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import (
    cable_lengths_unchecked,
    refuse_short_cable,
    structure_matrix_unchecked,
)
from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.geometry import RigGeometry


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
        geometry.records(),
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
        ShapeError: if the pose has another shape, is not finite or is no rotation, or a cable
            has no length there, so no direction.
    """
    place, turn = finite_array("position", position, (3,)), rotation_matrix("rotation", rotation)
    cables = geometry.records()
    matrix = structure_matrix_unchecked(cables, place, turn)
    if not np.isfinite(matrix).all():
        refuse_short_cable(cables, place, turn)
    return matrix
