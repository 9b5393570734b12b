# SPDX-License-Identifier: Apache-2.0
"""Wrenches and deflections, moved between points and axes of one rigid body.

A wrench (6,) is force [N] then torque [N m]; a deflection (6,) is a translation [m] then a rotation
vector [rad]. Leading dimensions broadcast everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.errors import ShapeError
from cabols_control.rotations import cross_matrix


def exponential(vector: FloatArray) -> FloatArray:
    """(..., 3, 3) rotations of rotation vectors (..., 3) [rad]."""
    flat = Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix()
    return np.asarray(flat.reshape(*vector.shape[:-1], 3, 3))


def logarithm(rotation: FloatArray) -> FloatArray:
    """(..., 3) rotation vectors [rad] of rotations (..., 3, 3)."""
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat.reshape(*rotation.shape[:-2], 3))


def shift_wrench(wrench: ArrayLike, offset: ArrayLike) -> FloatArray:
    """Move wrenches to another point of the same body.

    Args:
        wrench: (..., 6) about P.
        offset: (..., 3) from P to the new point Q, axes of the wrench [m].

    Returns:
        (..., 6) the same wrenches about Q.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    moved = _finite("wrench", wrench, 6)
    arm = _finite("offset", offset, 3)
    torque = moved[..., 3:] - np.cross(arm, moved[..., :3])
    force = np.broadcast_to(moved[..., :3], torque.shape)
    return np.concatenate([force, torque], axis=-1)


def shift_deflection(deflection: ArrayLike, offset: ArrayLike) -> FloatArray:
    """Deflections of another point of the same body, with the lever arm as it ends up, deflected.

    Args:
        deflection: (..., 6) of P.
        offset: (..., 3) from P to the new point Q on the undeflected body, axes of the deflection
            [m].

    Returns:
        (..., 6) of Q: its translation is exact for any rotation, dp + (exp([r]x) - 1) offset.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    moved = _finite("deflection", deflection, 6)
    arm = _finite("offset", offset, 3)
    turned = np.einsum("...ij,...j->...i", exponential(moved[..., 3:]), arm)
    translation = moved[..., :3] + turned - arm
    rotation = np.broadcast_to(moved[..., 3:], translation.shape)
    return np.concatenate([translation, rotation], axis=-1)


def deflected_arm(offset: ArrayLike, deflection: ArrayLike) -> FloatArray:
    """(..., 3) where the lever arm to a point, (..., 3), ends up under deflections (..., 6) [m].

    A wrench that is measured on the loaded robot moves along this arm, not along the unloaded one.

    Args:
        offset: (..., 3) from the tool's origin to the point [m].
        deflection: (..., 6) of the tool [m, rad].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    turned = exponential(_finite("deflection", deflection, 6)[..., 3:])
    return np.asarray(np.einsum("...ij,...j->...i", turned, _finite("offset", offset, 3)))


def turn(rotation: FloatArray, screw: FloatArray) -> FloatArray:
    """(..., 6) wrenches or deflections in other axes, by (..., 3, 3) from the old to the new.

    Args:
        rotation: (..., 3, 3) from the old to the new axes.
        screw: (..., 6) wrench or deflection in the old axes.
    """
    halves = np.reshape(screw, (*screw.shape[:-1], 2, 3))
    turned = np.einsum("...ij,...kj->...ki", rotation, halves)
    return np.asarray(turned.reshape(*turned.shape[:-2], 6))


def turning(rotation: FloatArray) -> FloatArray:
    """(..., 6, 6) matrices of `turn`, for covariances."""
    matrix = np.zeros((*rotation.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = rotation
    return matrix


def point_motion(arm: FloatArray) -> FloatArray:
    """(..., 3, 6) motion of a point at (..., 3) from the origin, by a small deflection (..., 6)."""
    matrix = np.zeros((*arm.shape[:-1], 3, 6))
    matrix[..., :, :3] = np.eye(3)
    matrix[..., :, 3:] = -cross_matrix(arm)
    return matrix


def _finite(name: str, value: ArrayLike, size: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != size or not np.isfinite(array).all():
        raise ShapeError(
            f"{name}: expected finite numbers of shape (..., {size}), got shape {array.shape}"
            + ("" if array.ndim == 0 or array.shape[-1] != size else " with others among them")
        )
    return array
