"""Compiled kernels of the inverse kinematics: structure matrix and cable lengths, unchecked.

Sign convention and equations: `cabols_control.kinematics`, which checks its arguments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from cabols_control.checks import FloatArray
from cabols_control.errors import ShapeError
from cabols_control.naming import cable_name

CABLE = np.dtype(
    [
        ("base", np.float64, (3,)),  # where it leaves the frame, base frame [m]
        ("platform", np.float64, (3,)),  # where it holds the platform, platform frame [m]
    ],
    align=True,
)
"""One cable, for the kernels; a rig's are an (n,) array of these (RigGeometry.records)."""

CABLE_FLOATS = CABLE.itemsize // 8
"""Numbers in a record."""

MIN_CABLE_LENGTH_M = 1e-3
"""A shorter cable counts as without length: it has no direction that can be trusted."""


def cable_records(base_points: FloatArray, platform_points: FloatArray) -> Any:
    """Build the (n,) records of CABLE of cables between points.

    Args:
        base_points: (n, 3) in the base frame [m].
        platform_points: (n, 3) in the platform frame [m].
    """
    cables = np.zeros(len(base_points), CABLE)
    cables["base"], cables["platform"] = base_points, platform_points
    return cables


@njit(cache=True, error_model="numpy")
def structure_matrix_into(
    cables: Any,
    position: FloatArray,
    rotation: FloatArray,
    matrix: FloatArray,
) -> None:
    """Fill matrix (6, n) with the structure matrix; shapes as in structure_matrix, unchecked.

    A cable shorter than MIN_CABLE_LENGTH_M has no direction: its column is NaN, which every
    judgement that follows counts as failed.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        matrix: (6, n), filled.
    """
    for i in range(cables.shape[0]):
        base, platform = cables[i]["base"], cables[i]["platform"]
        b0, b1, b2 = platform[0], platform[1], platform[2]
        r0 = rotation[0, 0] * b0 + rotation[0, 1] * b1 + rotation[0, 2] * b2
        r1 = rotation[1, 0] * b0 + rotation[1, 1] * b1 + rotation[1, 2] * b2
        r2 = rotation[2, 0] * b0 + rotation[2, 1] * b1 + rotation[2, 2] * b2
        u0 = base[0] - position[0] - r0
        u1 = base[1] - position[1] - r1
        u2 = base[2] - position[2] - r2
        length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
        if not length >= MIN_CABLE_LENGTH_M:
            length = np.nan
        u0, u1, u2 = u0 / length, u1 / length, u2 / length
        matrix[0, i], matrix[1, i], matrix[2, i] = u0, u1, u2
        matrix[3, i] = r1 * u2 - r2 * u1
        matrix[4, i] = r2 * u0 - r0 * u2
        matrix[5, i] = r0 * u1 - r1 * u0


@njit(cache=True, error_model="numpy")
def cable_lengths_into(
    cables: Any,
    position: FloatArray,
    rotation: FloatArray,
    lengths: FloatArray,
) -> None:
    """Fill lengths (n,) [m]; shapes as in cable_lengths, unchecked.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        lengths: (n,), filled [m].
    """
    for i in range(cables.shape[0]):
        base, platform = cables[i]["base"], cables[i]["platform"]
        total = 0.0
        for axis in range(3):
            difference = base[axis] - position[axis]
            for k in range(3):
                difference -= rotation[axis, k] * platform[k]
            total += difference * difference
        lengths[i] = np.sqrt(total)


def structure_matrix_unchecked(
    cables: Any, position: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return structure_matrix without checks, from records.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    matrix = np.empty((6, cables.shape[0]))
    structure_matrix_into(cables, position, rotation, matrix)
    return matrix


def cable_lengths_unchecked(cables: Any, position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return cable_lengths without checks, from records.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    lengths = np.empty(cables.shape[0])
    cable_lengths_into(cables, position, rotation, lengths)
    return lengths


def refuse_short_cable(cables: Any, position: FloatArray, rotation: FloatArray) -> None:
    """Say which cable has no length at a pose; return if every cable has one.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.

    Raises:
        ShapeError: naming the cable.
    """
    lengths = cable_lengths_unchecked(cables, position, rotation)
    if not lengths.min() >= MIN_CABLE_LENGTH_M:
        raise ShapeError(
            f"{cable_name(int(lengths.argmin()))}: expected at least {MIN_CABLE_LENGTH_M} m "
            f"between its points, got {lengths.min():.3g} m at position {position}; the pose is "
            "out of reach"
        )
