# SPDX-License-Identifier: Apache-2.0
"""Equations of motion at a pose, in velocities of the degrees of freedom: no angles, no gimbal.

    D nu_dot + c + G = J_w^T tau + w

with nu the m velocities that CableRobot.freedom keeps of [v; omega], base axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.rotations import cross_matrix
from cabols_sim.dynamics.cables import (
    CableStates,
    cable_states,
    cross,
    length_jacobian,
    point_bias,
    point_inertias,
    point_jacobians,
    stream_forces,
    twist_force,
    weight_forces,
)
from cabols_sim.dynamics.robot import CableRobot


@dataclass(frozen=True, eq=False)
class BodyState:
    """Pose and velocity of the platform.

    Attributes:
        position: (3,) of its origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        twist: (6,) [v; omega] at its origin, base axes [m/s, rad/s].
    """

    position: FloatArray
    rotation: FloatArray
    twist: FloatArray

    @classmethod
    def checked(
        cls,
        position: ArrayLike,
        rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        twist: ArrayLike = (0.0,) * 6,
    ) -> BodyState:
        """Return a state of checked arrays.

        Args:
            position: (3,) of the platform in the base frame [m].
            rotation: (3, 3) from platform to base axes.
            twist: (6,) velocity of the origin [m/s] and angular velocity [rad/s], base axes.

        Raises:
            ShapeError: if one has another shape, is not finite, or rotation is none.
        """
        return cls(
            finite_array("position", position, (3,)),
            rotation_matrix("rotation", rotation),
            finite_array("twist", twist, (6,)),
        )

    def cables(self, robot: CableRobot) -> CableStates:
        """Return the cables' states, computed once for one robot."""
        known: tuple[CableRobot, CableStates] | None = self.__dict__.get("_cables")
        if known is None or known[0] is not robot:
            found = cable_states(robot, self.position, self.rotation, self.twist)
            known = (robot, found)
            object.__setattr__(self, "_cables", known)
        return known[1]


@dataclass(frozen=True, eq=False)
class Equations:
    """The terms of (2.29) at one state.

    Attributes:
        inertia: (m, m) D (2.17).
        bias: (m,) c (2.30), the mass stream in it.
        gravity: (m,) G (2.23).
        stream: (m,) d + q^R* (2.28), as it is subtracted in c.
        transmission: (m, n) J_w^T of (2.21): tension to generalized force; tension > 0 pulls.
    """

    inertia: FloatArray
    bias: FloatArray
    gravity: FloatArray
    stream: FloatArray
    transmission: FloatArray


def equations(robot: CableRobot, state: BodyState) -> Equations:
    """Set up (2.29) at a state.

    Args:
        robot: with cables and platform.
        state: pose and twist.

    Raises:
        DegenerateGeometryError: if a cable has no length.
    """
    cables = state.cables(robot)
    jacobians = point_jacobians(cables)
    inertias = point_inertias(robot, cables)
    omega = state.twist[3:]
    turning = cross(omega, cross(omega, cables.lever))
    stream = stream_forces(robot, cables)
    forces = np.einsum("nij,nj->ni", inertias, turning) + point_bias(robot, cables) - stream
    inertia = _platform_inertia(robot, state.rotation)
    inertia = inertia + np.einsum("nji,njk,nkl->il", jacobians, inertias, jacobians)
    bias = _platform_bias(robot, state.rotation, omega) + twist_force(cables, forces)
    centre = state.rotation @ robot.centre_of_mass
    weight = robot.mass * np.concatenate([robot.gravity, cross(centre, robot.gravity)])
    weight = weight + twist_force(cables, weight_forces(robot, cables))
    keep = list(robot.freedom)
    return Equations(
        inertia=inertia[np.ix_(keep, keep)],
        bias=bias[keep],
        gravity=-weight[keep],
        stream=twist_force(cables, stream)[keep],
        transmission=-length_jacobian(cables).T[keep],
    )


def acceleration(
    robot: CableRobot, state: BodyState, tension: FloatArray, wrench: FloatArray
) -> FloatArray:
    """(m,) nu_dot under (n,) tensions [N] and a (6,) wrench at the platform's origin [N, N m].

    Args:
        robot: with cables and platform.
        state: pose and twist.
        tension: (n,) of the cables at the platform [N].
        wrench: (6,) at the platform's origin [N, N m], base axes.
    """
    terms = equations(robot, state)
    drive = terms.transmission @ tension + wrench[list(robot.freedom)]
    return np.asarray(np.linalg.solve(terms.inertia, drive - terms.bias - terms.gravity))


def rotated_inertia(robot: CableRobot, rotation: FloatArray) -> FloatArray:
    """(3, 3) inertia of the platform about its centre of mass, base axes [kg m^2].

    Args:
        robot: with the platform's inertia in its own axes.
        rotation: (3, 3) from platform to base axes.
    """
    return np.asarray(rotation @ robot.inertia @ rotation.T)


def _platform_inertia(robot: CableRobot, rotation: FloatArray) -> FloatArray:
    arm = cross_matrix(rotation @ robot.centre_of_mass)
    inertia = np.zeros((6, 6))
    inertia[:3, :3] = robot.mass * np.eye(3)
    inertia[:3, 3:], inertia[3:, :3] = -robot.mass * arm, robot.mass * arm
    inertia[3:, 3:] = rotated_inertia(robot, rotation) - robot.mass * arm @ arm
    return inertia


def _platform_bias(robot: CableRobot, rotation: FloatArray, omega: FloatArray) -> FloatArray:
    centre = rotation @ robot.centre_of_mass
    pull = robot.mass * cross(omega, cross(omega, centre))
    spin = cross(omega, rotated_inertia(robot, rotation) @ omega)
    return np.concatenate([pull, spin + cross(centre, pull)])
