# SPDX-License-Identifier: Apache-2.0
"""(2.29) in the source's coordinates x: D(x) x_dd + c(x, x_d) + G(x) = J_w^T tau + q_nc.

Spatial: x = [position; Euler angles], intrinsic x-y-z in rad, singular at a second angle of 90 deg.
Planar: x = [x, y, phi]. Forces are generalized: virtual work per unit of x.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_sim.dynamics.body import BodyState, Equations, equations
from cabols_sim.dynamics.cables import cross
from cabols_sim.dynamics.robot import CableRobot

MIN_COSINE = 1e-3
"""Of the second Euler angle: closer to 90 deg, angles do not describe angular velocity."""


def mass_matrix(robot: CableRobot, x: ArrayLike) -> FloatArray:
    """D(x) of (2.17).

    Args:
        robot: model.
        x: (m,) coordinates [m, rad].

    Returns:
        (m, m) [kg, kg m, kg m^2].

    Raises:
        ShapeError: if x has another shape or is not finite.
        CabolsError: close to the singularity of the Euler angles.
    """
    return _terms(robot, x)[0].inertia


def bias(robot: CableRobot, x: ArrayLike, x_dot: ArrayLike) -> FloatArray:
    """c(x, x_dot) of (2.30), (m,): centrifugal, Coriolis and mass-variation terms.

    Arguments as in inverse_dynamics; raises as mass_matrix.

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
        x_dot: (m,) their rates [m/s, rad/s].
    """
    return _terms(robot, x, x_dot)[0].bias


def stream(robot: CableRobot, x: ArrayLike, x_dot: ArrayLike) -> FloatArray:
    """Mass stream d + q^R* of (2.28), (m,), which (2.30) subtracts; zero without it in mass_law.

    Arguments as in inverse_dynamics; raises as mass_matrix.

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
        x_dot: (m,) their rates [m/s, rad/s].
    """
    return _terms(robot, x, x_dot)[0].stream


def gravity(robot: CableRobot, x: ArrayLike) -> FloatArray:
    """G(x) of (2.29), (m,): the gradient of the potential energy. Raises as mass_matrix.

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
    """
    return _terms(robot, x)[0].gravity


def transmission(robot: CableRobot, x: ArrayLike) -> FloatArray:
    """J_w^T of (2.21), (m, n): generalized force per tension that pulls. Raises as mass_matrix.

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
    """
    return _terms(robot, x)[0].transmission


def inverse_dynamics(
    robot: CableRobot, x: ArrayLike, x_dot: ArrayLike, x_ddot: ArrayLike
) -> FloatArray:
    """Generalized force J_w^T tau + q_nc that a motion needs: (2.29).

    Args:
        robot: model.
        x: (m,) coordinates [m, rad].
        x_dot: (m,) [m/s, rad/s].
        x_ddot: (m,) [m/s^2, rad/s^2].

    Returns:
        (m,) [N, N m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: close to the singularity of the Euler angles.
    """
    terms, m = _terms(robot, x, x_dot)
    second = finite_array("x_ddot", x_ddot, (m,))
    return np.asarray(terms.inertia @ second + terms.bias + terms.gravity)


def forward_dynamics(
    robot: CableRobot,
    x: ArrayLike,
    x_dot: ArrayLike,
    tension: ArrayLike,
    force: ArrayLike | None = None,
) -> FloatArray:
    """Acceleration x_ddot (m,) of (2.29) under (n,) tensions [N] and generalized force q_nc (m,).

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
        x_dot: (m,) their rates [m/s, rad/s].
        tension: (n,) of the cables [N].
        force: (m,) generalized force q_nc [N, N m]; None: none.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: close to the singularity of the Euler angles.
    """
    terms, m = _terms(robot, x, x_dot)
    pull = finite_array("tension", tension, (robot.cables,))
    other = np.zeros(m) if force is None else finite_array("force", force, (m,))
    drive = terms.transmission @ pull + other
    return np.asarray(np.linalg.solve(terms.inertia, drive - terms.bias - terms.gravity))


def state_at(robot: CableRobot, x: ArrayLike, x_dot: ArrayLike | None = None) -> BodyState:
    """Return pose and twist of coordinates and their rates; raises as mass_matrix.

    Args:
        robot: with cables and platform.
        x: (m,) coordinates: position [m], Euler angles [rad].
        x_dot: (m,) their rates [m/s, rad/s]; None: at rest.
    """
    m = len(robot.freedom)
    place = finite_array("x", x, (m,))
    rate = np.zeros(m) if x_dot is None else finite_array("x_dot", x_dot, (m,))
    position, twist = np.zeros(3), np.zeros(6)
    if robot.planar:
        cosine, sine = np.cos(place[2]), np.sin(place[2])
        position[:2] = place[:2]
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        twist[list(robot.freedom)] = rate
        return BodyState(position, rotation, twist)
    rotation, axes = _euler(place[3:])
    twist[:3], twist[3:] = rate[:3], axes @ rate[3:]
    return BodyState(place[:3].copy(), rotation, twist)


def _terms(
    robot: CableRobot, x: ArrayLike, x_dot: ArrayLike | None = None
) -> tuple[Equations, int]:
    """Equations carried from twist to coordinates, with twist = E x_dot; and m."""
    state = state_at(robot, x, x_dot)
    terms, m = equations(robot, state), len(robot.freedom)
    if robot.planar:
        return terms, m
    angles = np.asarray(x, dtype=np.float64)[3:]
    rates = np.zeros(3) if x_dot is None else np.asarray(x_dot, dtype=np.float64)[3:]
    axes = _euler(angles)[1]
    carry = np.eye(6)
    carry[3:, 3:] = axes
    drift = np.zeros(6)
    drift[3:] = _axes_rate(axes, rates) @ rates
    carried = Equations(
        inertia=carry.T @ terms.inertia @ carry,
        bias=carry.T @ (terms.bias + terms.inertia @ drift),
        gravity=carry.T @ terms.gravity,
        stream=carry.T @ terms.stream,
        transmission=carry.T @ terms.transmission,
    )
    return carried, m


def _euler(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation Rx Ry Rz and (3, 3) J_omega_phi of (2.6), columns the axes of the three turns."""
    (ca, cb, cg), (sa, sb, sg) = np.cos(angles), np.sin(angles)
    if not abs(cb) >= MIN_COSINE:
        raise CabolsError(
            f"x: expected a second Euler angle away from 90 deg, got {np.degrees(angles[1]):.3f} "
            "deg; use cabols_sim.dynamics.simulate, whose velocities know no such pose"
        )
    rotation = np.array(
        [
            [cb * cg, -cb * sg, sb],
            [ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb],
            [sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb],
        ]
    )
    axes = np.array([[1.0, 0.0, sb], [0.0, ca, -sa * cb], [0.0, sa, ca * cb]])
    return rotation, axes


def _axes_rate(axes: FloatArray, rates: FloatArray) -> FloatArray:
    """Time derivative of J_omega_phi: each axis is turned by the turns before it."""
    before = np.zeros(3)
    derivative = np.zeros((3, 3))
    for k in range(3):
        derivative[:, k] = cross(before, axes[:, k])
        before = before + axes[:, k] * rates[k]
    return derivative
