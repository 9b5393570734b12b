# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics and the structure matrix of a cable robot.

One sign convention, everywhere: u_i is the unit vector from the platform point to the base
point of cable i, so a tension tau_i > 0 pulls the platform along +u_i and the cables' wrench
ON the platform is W = A tau with columns A_i = [u_i; (R b_i) x u_i]. The lengths then obey
l_dot = -A^T [v; omega] (virtual work; the source's (3.3), (3.4) with J = -A^T).

Over a pulley, u_i points to where the cable leaves the groove, and the length has the arc from
the base point on (cable_kernels.over_pulley).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import (
    cable_lengths_unchecked,
    over_pulley,
    refuse_short_cable,
    structure_matrix_unchecked,
)
from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.geometry import RigGeometry


def cable_lengths(geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Length of every cable between base and platform point, over its pulley; loop closure (3.1).

    Args:
        geometry: attachment points of n cables.
        position: (3,) platform origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (n,) lengths [m].

    Raises:
        ShapeError: if the pose has another shape, is not finite or is no rotation, or a cable
            cannot leave its pulley there.
    """
    place, turn = finite_array("position", position, (3,)), rotation_matrix("rotation", rotation)
    cables = geometry.records()
    lengths = cable_lengths_unchecked(cables, place, turn)
    if np.isnan(lengths).any():
        refuse_short_cable(cables, place, turn)
    return lengths


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


def direction_gradients(
    geometry: RigGeometry, position: ArrayLike, rotation: ArrayLike
) -> FloatArray:
    """How the cables' directions u turn as their platform points move: -du/dp.

    A cable between points turns by 1 / length in every direction across it. Over a pulley it turns
    by 1 / straight length in the wheel's plane, and with the wheel out of it.

    Args:
        geometry: attachment points and pulleys of n cables.
        position: (3,) platform origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        (n, 3, 3) symmetric [1/m].

    Raises:
        ShapeError: as structure_matrix.
    """
    place, turn = finite_array("position", position, (3,)), rotation_matrix("rotation", rotation)
    directions = structure_matrix(geometry, place, turn)[:3].T
    held = place + geometry.platform_points @ turn.T
    found = np.empty((geometry.cables, 3, 3))
    for i, cable in enumerate(geometry.records()):
        away, u = held[i] - geometry.base_points[i], directions[i]
        if cable["radius"] == 0.0:
            found[i] = (np.eye(3) - np.outer(u, u)) / np.linalg.norm(away)
            continue
        axis = cable["axis"]
        beside = away - (away @ axis) * axis
        out = float(np.linalg.norm(beside))
        e = beside / out
        course = over_pulley(away[0], away[1], away[2], axis.copy(), float(cable["radius"]))
        _, _, _, straight, cosine, sine = course
        w, b = cosine * e + sine * axis, np.cross(axis, e)
        found[i] = np.outer(w, w) / straight + np.outer(b, b) * (sine / out)
    return found
