# SPDX-License-Identifier: Apache-2.0
"""Momentum of platform and cables by Newton and Euler, a check of the Lagrange equations.

Cable material is followed through its acceleration, independently of variable-mass Lagrange
equations. A cable is straight, of variable mass and MATERIAL: at the distance s from A_i
it moves at l_dot e + s e_dot. Models that move the material otherwise fail these checks.
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rotations import cross_matrix
from cabols_sim.dynamics.body import BodyState, rotated_inertia
from cabols_sim.dynamics.cables import cross
from cabols_sim.dynamics.robot import CableRobot


def momentum(robot: CableRobot, state: BodyState) -> FloatArray:
    """Linear momentum and angular momentum about the frame's origin of platform and cables.

    Args:
        robot: with cables and platform.
        state: pose and twist.

    Returns:
        (6,) [N s, N m s].
    """
    cables = state.cables(robot)
    arm, omega = state.rotation @ robot.centre_of_mass, state.twist[3:]
    platform = robot.mass * (state.twist[:3] + cross(omega, arm))
    spin = cross(state.position + arm, platform)
    spin = spin + rotated_inertia(robot, state.rotation) @ omega
    mass = robot.cable_mass(cables.length)[:, None]
    linear = mass * (cables.rate[:, None] * cables.axis + 0.5 * cables.across)
    about_winch = mass / 3.0 * cross(cables.length[:, None] * cables.axis, cables.across)
    angular = cross(robot.base_points, linear) + about_winch
    return np.concatenate([platform + linear.sum(axis=0), spin + angular.sum(axis=0)])


def momentum_supply(
    robot: CableRobot,
    state: BodyState,
    nu_dot: FloatArray,
    tension: FloatArray,
    wrench: FloatArray,
) -> FloatArray:
    """Rate of `momentum`: weight, winches, wrench on the platform, inflow of the mass stream.

    Args:
        robot: model.
        state: of the platform.
        nu_dot: (m,) accelerations of the degrees of freedom.
        tension: (n,) at the winches [N].
        wrench: (6,) on the platform at its origin [N, N m].

    Returns:
        (6,) [N, N m], about the frame's origin.
    """
    cables = state.cables(robot)
    arm = state.rotation @ robot.centre_of_mass
    weight = robot.mass * robot.gravity
    force = weight + wrench[:3]
    torque = cross(state.position + arm, weight) + cross(state.position, wrench[:3])
    torque = torque + wrench[3:]
    hang = (robot.density * cables.length)[:, None] * robot.gravity
    middle = robot.base_points + 0.5 * cables.length[:, None] * cables.axis
    inflow = (robot.density * cables.rate**2)[:, None] * cables.axis
    at_winch = inflow + end_forces(robot, state, nu_dot, tension)[0]
    force = force + hang.sum(axis=0) + at_winch.sum(axis=0)
    torque = torque + cross(middle, hang).sum(axis=0)
    torque = torque + cross(robot.base_points, at_winch).sum(axis=0)
    return np.concatenate([force, torque])


def end_forces(
    robot: CableRobot, state: BodyState, nu_dot: FloatArray, tension: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Forces on the ends of every cable, at its winch's exit and at the platform.

    At the winch: the tension, and the side load on the guide. The moments about A_i give what the
    platform's end takes across the cable, the sum of forces the rest.

    Args:
        robot: model.
        state: of the platform.
        nu_dot: (m,) accelerations of the degrees of freedom.
        tension: (n,) at the winches [N].

    Returns:
        (n, 3) and (n, 3) [N], base axes.
    """
    cables = state.cables(robot)
    axis, length = cables.axis, cables.length[:, None]
    mass = robot.density[:, None] * length
    coriolis, bend, along = _material_acceleration(robot, state, nu_dot)
    weight_along = (axis @ robot.gravity)[:, None] * axis
    weight_across = robot.gravity - weight_along
    across = mass * (0.5 * coriolis + length * bend / 3.0 - 0.5 * weight_across)
    side = mass * (coriolis + 0.5 * length * bend - weight_across) - across
    pull = tension[:, None] * axis
    return side - pull, across + mass * (along - weight_along) + pull


def platform_imbalance(
    robot: CableRobot, state: BodyState, nu_dot: FloatArray, tension: FloatArray
) -> FloatArray:
    """What Newton's and Euler's laws of the platform miss, (6,) [N, N m]; see end_forces.

    Args:
        robot: with cables and platform.
        state: pose and twist.
        nu_dot: (6,) acceleration [m/s^2, rad/s^2], base axes.
        tension: (n,) of the cables at the platform [N].
    """
    lever = state.cables(robot).lever
    twist_rate = robot.selection @ nu_dot
    arm, omega = state.rotation @ robot.centre_of_mass, state.twist[3:]
    inertia = rotated_inertia(robot, state.rotation)
    moving = twist_rate[:3] + cross(twist_rate[3:], arm) + cross(omega, cross(omega, arm))
    needed = robot.mass * (moving - robot.gravity)
    spin = inertia @ twist_rate[3:] + cross(omega, inertia @ omega) + cross(arm, needed)
    reaction = end_forces(robot, state, nu_dot, tension)[1]
    torque = cross(lever, reaction).sum(axis=0)
    return np.concatenate([needed + reaction.sum(axis=0), spin + torque])


def _material_acceleration(
    robot: CableRobot, state: BodyState, nu_dot: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Acceleration of cable material at s from A: across it p + s q, along it r on average.

    a(s) = l_dd e + 2 l_dot e_dot + s e_dd, with e_dot = w / l. Returns p, q, r, each (n, 3).
    """
    cables = state.cables(robot)
    twist_rate = robot.selection @ nu_dot
    turn = cross_matrix(state.twist[3:])
    point = (cross_matrix(twist_rate[3:]) + turn @ turn) @ cables.lever.T
    point = point.T + twist_rate[:3]
    axis, length = cables.axis, cables.length[:, None]
    axis_rate = cables.across / length
    square = np.einsum("ij,ij->i", axis_rate, axis_rate)[:, None]
    along = np.einsum("ij,ij->i", point, axis)[:, None]
    coriolis = 2.0 * cables.rate[:, None] * axis_rate
    # B_dd = l_dd e + 2 l_dot e_dot + l e_dd, where e_dd has -|e_dot|^2 along e.
    bend = (point - along * axis - coriolis) / length
    return coriolis, bend, (along + 0.5 * length * square) * axis
