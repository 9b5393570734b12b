# SPDX-License-Identifier: Apache-2.0
"""Cables as inertial forces on the platform's points.

A cable's kinetic energy depends on its platform point B alone, so its Lagrange equation can be
written for B once and carried to any coordinates by d B / d x. With e the unit vector from A to B,
w = B_dot - l_dot e, a and b the shares of CableModel and m' = d m / d l it reads

    f = N B_ddot + m (a - b) |w|^2 / l e + m' (b l_dot w + (a l_dot^2 - b |w|^2) / 2 e)
        - rho l_dot^2 / 2 e,        N = m (b 1 + (a - b) e e^T)

whose last term is the mass stream (2.28). For MATERIAL a = 1, and it cancels the a l_dot^2 before
it: material that enters at the speed of the cable needs no force along the cable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.dynamics.robot import CableRobot, check_lengths

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector product over the last axis; several times faster than numpy's for a few rows.

    Args:
        a: (..., 3) vectors.
        b: (..., 3) vectors.
    """
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


class CableStates(NamedTuple):
    """Cables of a moving robot, base axes.

    Attributes:
        lever: (n, 3) from the platform's origin to B_i [m].
        axis: (n, 3) unit vectors from A_i to B_i.
        length: (n,) [m].
        velocity: (n, 3) of B_i [m/s].
        rate: (n,) l_dot [m/s].
        across: (n, 3) velocity of B_i across the cable [m/s].
    """

    lever: FloatArray
    axis: FloatArray
    length: FloatArray
    velocity: FloatArray
    rate: FloatArray
    across: FloatArray


def cable_states(
    robot: CableRobot, position: FloatArray, rotation: FloatArray, twist: FloatArray
) -> CableStates:
    """Kinematics (2.2), (2.3) of all cables.

    Args:
        robot: geometry.
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        twist: (6,) [v; omega] at the platform's origin, base axes.

    Raises:
        DegenerateGeometryError: if a cable has no length.
    """
    lever = robot.platform_points @ rotation.T
    span = position + lever - robot.base_points
    length = np.sqrt(np.einsum("ij,ij->i", span, span))
    check_lengths(length)
    axis = span / length[:, None]
    velocity = twist[:3] + cross(twist[3:], lever)
    rate = np.einsum("ij,ij->i", axis, velocity)
    across = velocity - rate[:, None] * axis
    return CableStates(lever, axis, length, velocity, rate, across)


def length_jacobian(cables: CableStates) -> FloatArray:
    """(n, 6) J_l with l_dot = J_l twist: (2.3), minus the transposed structure matrix."""
    return np.hstack([cables.axis, cross(cables.lever, cables.axis)])


def point_jacobians(cables: CableStates) -> FloatArray:
    """(n, 3, 6) from the twist to the velocity of each platform point."""
    n = cables.length.size
    jacobian = np.zeros((n, 3, 6))
    jacobian[:, [0, 1, 2], [0, 1, 2]] = 1.0
    x, y, z = cables.lever.T
    jacobian[:, 0, 4], jacobian[:, 0, 5] = z, -y
    jacobian[:, 1, 3], jacobian[:, 1, 5] = -z, x
    jacobian[:, 2, 3], jacobian[:, 2, 4] = y, -x
    return jacobian


def point_inertias(robot: CableRobot, cables: CableStates) -> FloatArray:
    """(n, 3, 3) N: what a cable adds to the inertia of its platform point [kg].

    Args:
        robot: with the cables' densities and mass law.
        cables: their lengths, directions and rates.
    """
    a, b = robot.cable
    mass = robot.cable_mass(cables.length)[:, None, None]
    along = cables.axis[:, :, None] * cables.axis[:, None, :]
    return np.asarray(mass * (b * np.eye(3) + (a - b) * along))


def point_bias(robot: CableRobot, cables: CableStates) -> FloatArray:
    """(n, 3) velocity terms of f without the mass stream [N].

    Args:
        robot: with the cables' densities and mass law.
        cables: their lengths, directions and rates.
    """
    a, b = robot.cable
    mass, growth = robot.cable_mass(cables.length), robot.mass_per_length
    square = np.einsum("ij,ij->i", cables.across, cables.across)
    along = mass * (a - b) * square / cables.length
    along += 0.5 * growth * (a * cables.rate**2 - b * square)
    sideways = growth * b * cables.rate
    return np.asarray(along[:, None] * cables.axis + sideways[:, None] * cables.across)


def stream_forces(robot: CableRobot, cables: CableStates) -> FloatArray:
    """(n, 3) of the mass stream on the platform's points [N]: d + q^R* of (2.28) for B.

    Args:
        robot: with the cables' densities and mass law.
        cables: their lengths, directions and rates.
    """
    strength = 0.5 * robot.stream_density * cables.rate**2
    return np.asarray(strength[:, None] * cables.axis)


def weight_forces(robot: CableRobot, cables: CableStates) -> FloatArray:
    """(n, 3) of the cables' weight on the platform's points [N]: (2.23) for B.

    Args:
        robot: with the cables' densities and gravity.
        cables: their lengths, directions and rates.
    """
    mass, growth = robot.cable_mass(cables.length), robot.mass_per_length
    height = 0.5 * cables.length * (cables.axis @ robot.gravity)
    if robot.datum == "frame":
        height = height + robot.base_points @ robot.gravity
    along = (growth * height)[:, None] * cables.axis
    return np.asarray(along + 0.5 * mass[:, None] * robot.gravity)


def twist_force(cables: CableStates, forces: FloatArray) -> FloatArray:
    """(6,) wrench at the platform's origin of (n, 3) forces on its points.

    Args:
        cables: with the arms of the platform's points [m].
        forces: (n, 3) on these points [N], base axes.
    """
    return np.concatenate([forces.sum(axis=0), cross(cables.lever, forces).sum(axis=0)])
