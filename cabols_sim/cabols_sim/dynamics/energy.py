# SPDX-License-Identifier: Apache-2.0
"""Energy and its sources: the power balance of a robot with a mass stream.

From (2.18) with T quadratic in the velocities, d/dt (T + V) = P_tension + P_wrench + P_stream with

    P_tension = -sum tau_i l_dot_i,   P_stream = 1/2 sum rho_i l_dot_i^3

P_stream is the power of (2.28), and for MATERIAL it is exactly the kinetic energy that mass brings
along when it enters at A_i with the cable's speed: rho l_dot kilograms a second, l_dot^2 / 2 each.
(2.24) alone, -1/2 sum rho l_dot^3, has the other sign: the impact forces (2.26) do twice as much.
"""

from __future__ import annotations

from typing import NamedTuple

from cabols_control.checks import FloatArray
from cabols_sim.dynamics.body import BodyState, equations
from cabols_sim.dynamics.robot import CableRobot


class Power(NamedTuple):
    """Powers that change the energy [W].

    Attributes:
        tension: of the winches.
        wrench: of what else acts on the platform.
        stream: that enters with the cables' mass.
    """

    tension: float
    wrench: float
    stream: float


def kinetic_energy(robot: CableRobot, state: BodyState) -> float:
    """T of (2.16) [J].

    Args:
        robot: with cables and platform.
        state: pose and twist.
    """
    nu = state.twist[list(robot.freedom)]
    return float(0.5 * nu @ equations(robot, state).inertia @ nu)


def potential_energy(robot: CableRobot, state: BodyState) -> float:
    """V of (2.22), the cables' mass counted from the robot's datum [J].

    Args:
        robot: with cables and platform.
        state: pose and twist.
    """
    cables = state.cables(robot)
    centre = state.position + state.rotation @ robot.centre_of_mass
    height = 0.5 * cables.length * (cables.axis @ robot.gravity)
    if robot.datum == "frame":
        height = height + robot.base_points @ robot.gravity
    mass = robot.cable_mass(cables.length)
    return float(-robot.mass * robot.gravity @ centre - mass @ height)


def power(robot: CableRobot, state: BodyState, tension: FloatArray, wrench: FloatArray) -> Power:
    """Return the powers that change T + V.

    Args:
        robot: model.
        state: of the platform.
        tension: (n,) [N].
        wrench: (6,) on the platform at its origin, besides cables and weight [N, N m].
    """
    rate = state.cables(robot).rate
    return Power(
        tension=float(-tension @ rate),
        wrench=float(wrench @ state.twist),
        stream=float(0.5 * robot.stream_density @ rate**3),
    )
