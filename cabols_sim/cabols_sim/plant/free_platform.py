# SPDX-License-Identifier: Apache-2.0
"""A platform that nothing but its cables holds: a rigid body under weight and cables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.compiling import njit
from cabols_control.errors import ShapeError
from cabols_control.geometry import RigGeometry
from cabols_hw.force_torque.ati import STANDARD_GRAVITY


@dataclass(frozen=True, eq=False)
class RigidBody:
    """What hangs on the cables.

    Attributes:
        mass: of platform and tool [kg].
        centre: (3,) of mass, from the platform's origin, platform axes [m].
        inertia: (3, 3) about the centre of mass, platform axes [kg m^2].
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray

    @classmethod
    def checked(cls, mass: float, centre: ArrayLike, inertia: ArrayLike) -> RigidBody:
        """Return a body of checked numbers.

        Args:
            mass: of platform and tool [kg].
            centre: (3,) of mass, from the platform's origin, platform axes [m].
            inertia: (3, 3) about the centre of mass, platform axes [kg m^2].

        Raises:
            ShapeError: if an array has another shape or is not finite, or if no body has such an
                inertia.
            OutOfRangeError: if the mass is none.
        """
        in_range("mass", mass, 1e-6, 1e6)
        tensor = finite_array("inertia", inertia, (3, 3))
        if not np.allclose(tensor, tensor.T, rtol=1e-9, atol=0.0):
            raise ShapeError("inertia: expected a symmetric matrix")
        moments = np.linalg.eigvalsh(tensor)
        # Of any body the largest moment is at most the sum of the two others.
        if not (moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9)):
            raise ShapeError(f"inertia: expected that of a body, got the moments {moments}")
        return cls(float(mass), finite_array("centre", centre, (3,)), tensor)


@njit(cache=True)
def turned(by: FloatArray, rotation: FloatArray) -> FloatArray:
    """(3, 3) rotation after a turn.

    Args:
        by: (3,) rotation vector, base axes [rad].
        rotation: (3, 3) from platform to base axes.
    """
    angle = float(np.sqrt(by @ by))
    cross = np.array([[0.0, -by[2], by[1]], [by[2], 0.0, -by[0]], [-by[1], by[0], 0.0]])
    sine, versine = 1.0, 0.5
    if angle > 1e-6:
        sine, versine = float(np.sin(angle)) / angle, (1.0 - float(np.cos(angle))) / angle**2
    turn: FloatArray = np.eye(3) + sine * cross + versine * (cross @ cross)
    found: FloatArray = turn @ rotation
    return found


@njit(cache=True)
def move_body(
    body: tuple[float, FloatArray, FloatArray],
    pose: tuple[FloatArray, FloatArray],
    momentum: FloatArray,
    wrench: FloatArray,
    dt_s: float,
) -> FloatArray:
    """Advance a free rigid body by a step: momenta first, then the pose, by the middle of its turn.

    Args:
        body: mass [kg]; (3,) centre, platform axes [m]; (3, 3) inertia about it, platform axes.
        pose: (3,) of the platform's origin [m] and (3, 3) to base axes; updated.
        momentum: (6,) linear [kg m/s] and angular about the centre of mass [kg m^2/s]; updated.
        wrench: (6,) of all but the weight, about the origin, base axes [N, N m].
        dt_s: length of the step [s].

    Returns:
        (6,) velocity of the origin [m/s], angular velocity [rad/s], base axes.
    """
    mass, centre, inertia = body
    position, rotation = pose
    arm = rotation @ centre
    force = wrench[:3].copy()
    torque = wrench[3:] - np.cross(arm, force)
    force[2] -= mass * STANDARD_GRAVITY
    momentum[:3] += dt_s * force
    momentum[3:] += dt_s * torque
    speed = momentum[:3] / mass
    spin = np.zeros(3)
    middle = rotation.copy()
    for _ in range(2):
        # By the turn at the step's beginning, then by that at its middle.
        spin[:] = np.linalg.solve(middle @ inertia @ middle.T, momentum[3:])
        middle = turned(0.5 * dt_s * spin, rotation)
    place = position + arm + dt_s * speed
    rotation[:] = turned(dt_s * spin, rotation)
    arm = rotation @ centre
    position[:] = place - arm
    twist = np.empty(6)
    twist[:3] = speed - np.cross(spin, arm)
    twist[3:] = spin
    return twist


class FreePlatform:
    """Hangs on its cables; a stand holds it until it is released.

    The force/torque sensor feels nothing: it sits between platform and robot, and there is none.

    Attributes:
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        twist: (6,) velocity of the origin [m/s], angular velocity [rad/s], base axes.
        held: whether the stand holds it.
    """

    def __init__(
        self, geometry: RigGeometry, body: RigidBody, damping: ArrayLike = (0.0,) * 6
    ) -> None:
        """Stand at the reference pose, held.

        Args:
            geometry: of the rig; its reference pose is where the stand is.
            body: what hangs on the cables.
            damping: (6,) of air and cables, at the origin [N s/m, N m s].

        Raises:
            ShapeError: if damping is not six numbers.
            OutOfRangeError: if one of them is negative.
        """
        self.position = np.array(geometry.reference_position)
        self.rotation = np.array(geometry.reference_rotation)
        self.twist = np.zeros(6)
        self.held = True
        self._damping = finite_array("damping", damping, (6,))
        in_range("damping", float(self._damping.min()), 0.0, 1e9)
        self._body = (body.mass, np.array(body.centre), np.array(body.inertia))
        self._momentum = np.zeros(6)

    def release(self) -> None:
        """Take the stand away."""
        self.held = False

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Advance under the cables' wrench and the weight.

        Args:
            wrench: (6,) of the cables on the platform, base axes [N, N m].
            dt_s: length of the step [s].

        Returns:
            Whether the pose has changed.
        """
        if self.held:
            return False
        total = wrench - self._damping * self.twist
        pose = (self.position, self.rotation)
        self.twist[:] = move_body(self._body, pose, self._momentum, total, dt_s)
        return True

    @property
    def energy(self) -> float:
        """Kinetic energy and that of the weight above the base frame's origin [J]."""
        mass, centre, inertia = self._body
        place = self.position + self.rotation @ centre
        spin = np.linalg.solve(self.rotation @ inertia @ self.rotation.T, self._momentum[3:])
        kinetic = 0.5 * (self._momentum[:3] @ self._momentum[:3] / mass + self._momentum[3:] @ spin)
        return float(kinetic + mass * STANDARD_GRAVITY * place[2])
