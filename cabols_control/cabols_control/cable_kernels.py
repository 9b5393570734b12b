# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of the inverse kinematics: structure matrix and cable lengths, unchecked.

Sign convention and equations: `cabols_control.kinematics`, which checks its arguments.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.errors import ShapeError
from cabols_control.naming import cable_name

CABLE = np.dtype(
    [
        ("base", np.float64, (3,)),  # where it leaves the frame, base frame [m]
        ("platform", np.float64, (3,)),  # where it holds the platform, platform frame [m]
        ("axis", np.float64, (3,)),  # unit vector: of the pulley's swivel, the way the cable comes
        ("radius", np.float64),  # of the pulley; 0: the cable leaves the base point itself [m]
    ],
    align=True,
)
"""One cable, for the kernels; a rig's are an (n,) array of these (RigGeometry.records)."""

CABLE_FLOATS = CABLE.itemsize // 8
"""Numbers in a record."""

MIN_CABLE_LENGTH_M = 1e-3
"""A shorter cable counts as without length: it has no direction that can be trusted."""


def cable_records(
    base_points: FloatArray,
    platform_points: FloatArray,
    pulley_radius: FloatArray | float = 0.0,
    pulley_axes: FloatArray | None = None,
) -> Any:
    """Build the (n,) records of CABLE.

    Args:
        base_points: (n, 3) in the base frame [m].
        platform_points: (n, 3) in the platform frame [m].
        pulley_radius: number or (n,) [m].
        pulley_axes: (n, 3) unit vectors; None: along z.
    """
    cables = np.zeros(len(base_points), CABLE)
    cables["base"], cables["platform"] = base_points, platform_points
    cables["axis"] = (0.0, 0.0, 1.0) if pulley_axes is None else pulley_axes
    cables["radius"] = pulley_radius
    return cables


Course = tuple[float, float, float, float, float, float]


@njit(cache=True, error_model="numpy")
def over_pulley(dx: float, dy: float, dz: float, axis: FloatArray, radius: float) -> Course:
    """Course of a cable over a swivelling pulley, in the plane of swivel axis and platform point.

    The cable comes along the axis, meets the groove at the base point and leaves it on a tangent;
    the wheel turns freely about the axis, so it lies in that plane, its centre beside the base
    point on the platform point's side. In the plane, x is away from the axis and h along it,
    both from the wheel's centre; the tangent point stands at the angle theta.

    Args:
        dx: platform point from the base point, base frame [m].
        dy: likewise.
        dz: likewise.
        axis: (3,) unit vector of the swivel.
        radius: of the groove [m].

    Returns:
        (3,) unit vector from the platform point along the cable; straight length [m]; cosine and
        sine of theta. All NaN where the cable has no such course: the platform point is on the
        axis, or nearer than MIN_CABLE_LENGTH_M to the wheel.

    Source:
        Pott, Cable-Driven Parallel Robots (2018), chapter 7: kinematics with pulleys.
    """
    h = dx * axis[0] + dy * axis[1] + dz * axis[2]
    e0, e1, e2 = dx - h * axis[0], dy - h * axis[1], dz - h * axis[2]
    out = np.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    x = out - radius
    square = x * x + h * h
    straight = np.sqrt(square - radius * radius)
    if not (straight >= MIN_CABLE_LENGTH_M and out >= MIN_CABLE_LENGTH_M):
        straight = out = np.nan
    cosine = (x * radius - h * straight) / square
    sine = (h * radius + x * straight) / square
    away = sine / out
    u0 = cosine * axis[0] - away * e0
    u1 = cosine * axis[1] - away * e1
    u2 = cosine * axis[2] - away * e2
    return u0, u1, u2, straight, cosine, sine


@njit(cache=True, error_model="numpy")
def structure_matrix_into(
    cables: Any,
    position: FloatArray,
    rotation: FloatArray,
    matrix: FloatArray,
) -> None:
    """Fill matrix (6, n) with the structure matrix; shapes as in structure_matrix, unchecked.

    A cable shorter than MIN_CABLE_LENGTH_M, or one that cannot leave its pulley, has no
    direction: its column is NaN, which every judgement that follows counts as failed.

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
        if cables[i]["radius"] == 0.0:
            length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
            if not length >= MIN_CABLE_LENGTH_M:
                length = np.nan
            u0, u1, u2 = u0 / length, u1 / length, u2 / length
        else:
            course = over_pulley(-u0, -u1, -u2, cables[i]["axis"], cables[i]["radius"])
            u0, u1, u2 = course[0], course[1], course[2]
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
    """Fill lengths (n,) [m], arcs on pulleys included; shapes as in cable_lengths, unchecked.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        lengths: (n,), filled [m].
    """
    for i in range(cables.shape[0]):
        d0, d1, d2 = _from_base(cables[i], position, rotation)
        radius = cables[i]["radius"]
        if radius == 0.0:
            lengths[i] = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        else:
            course = over_pulley(d0, d1, d2, cables[i]["axis"], radius)
            _, _, _, straight, cosine, sine = course
            lengths[i] = straight + radius * (np.pi - np.arctan2(sine, cosine))


@njit(cache=True, error_model="numpy")
def _from_base(
    cable: Any, position: FloatArray, rotation: FloatArray
) -> tuple[float, float, float]:
    """Vector from a cable's base point to its platform point, base frame [m]."""
    base, held = cable["base"], cable["platform"]
    x, y, z = held[0], held[1], held[2]
    return (
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z - base[0],
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z - base[1],
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z - base[2],
    )


@njit(cache=True, error_model="numpy")
def departures_into(
    cables: Any, position: FloatArray, rotation: FloatArray, points: FloatArray
) -> None:
    """Fill points (n, 3) with where the cables' straight parts begin: on the pulleys, if any.

    Args:
        cables: (n,) records of CABLE.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        points: (n, 3), filled, base frame [m].
    """
    for i in range(cables.shape[0]):
        base, radius = cables[i]["base"], cables[i]["radius"]
        for k in range(3):
            points[i, k] = base[k]
        if radius > 0.0:
            d0, d1, d2 = _from_base(cables[i], position, rotation)
            u0, u1, u2, straight, _, _ = over_pulley(d0, d1, d2, cables[i]["axis"], radius)
            points[i, 0] += d0 + straight * u0
            points[i, 1] += d1 + straight * u1
            points[i, 2] += d2 + straight * u2


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
    if np.isnan(lengths).any():
        raise ShapeError(
            f"{cable_name(int(lengths.argmin()))}: expected a platform point that is on neither "
            f"its pulley nor the pulley's axis, got one at position {position}; the pose is out "
            "of reach"
        )
    if not lengths.min() >= MIN_CABLE_LENGTH_M:
        raise ShapeError(
            f"{cable_name(int(lengths.argmin()))}: expected at least {MIN_CABLE_LENGTH_M} m "
            f"between its points, got {lengths.min():.3g} m at position {position}; the pose is "
            "out of reach"
        )
