# SPDX-License-Identifier: Apache-2.0
"""Where loaded joints come to rest: the exact balance, the published one, and their derivatives.

Exact: J(q + d)^T w(q + d) = A d^3 + B d + friction, for the deflections d of the joints; q are the
encoders' angles. The source's identification (4.15) instead multiplies the tangent stiffness by the
whole deflection, J(q)^T w + K_C d = 3 A d^3 + B d, and moves the tool by J(q) d. With A = 0 the two
agree to first order: that is (4.17).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.model.robot import Posture, RobotModel
from cabols_stiffness.model.screws import turn, turning

_NEAR = 1e-3
"""How far, likewise, a Newton step may lead and keep the matrix."""

NEWTON_STEPS = 30
_ACCURACY = 1e-12
"""Of the deflections, relative to the largest of each joint."""


@dataclass(frozen=True, eq=False)
class Law:
    """Torque of the joints over their deflection, (4.8) and a friction torque.

    Attributes:
        stiffness: (6,) b [N m/rad].
        cubic: (6,) a [N m/rad^3].
        friction: (k, 6) torque that hysteresis adds in each sample [N m]; None: none.
        published: whether to take (4.15) instead of the exact balance.
    """

    stiffness: FloatArray
    cubic: FloatArray
    friction: FloatArray | None = None
    published: bool = False

    @property
    def factor(self) -> float:
        """On the cubic torque: 1, or 3 as published."""
        return 3.0 if self.published else 1.0

    def torque(self, deflection: FloatArray) -> FloatArray:
        """(k, 6) torque [N m] at deflections (k, 6) [rad]."""
        found = self.factor * self.cubic * deflection**3 + self.stiffness * deflection
        return found if self.friction is None else found + self.friction

    def slope(self, deflection: FloatArray) -> FloatArray:
        """(k, 6) derivative of torque by deflection [N m/rad]."""
        return np.asarray(3.0 * self.factor * self.cubic * deflection**2 + self.stiffness)


@dataclass(frozen=True, eq=False)
class Balance:
    """k robots at rest under their loads.

    Attributes:
        deflection: (k, 6) of the joints [rad].
        posture: of the deflected arm; as published: of the undeflected one.
        wrench: (k, 6) on the tool, base axes, turned with the tool if it follows it.
        softness: (k, 6, 6) from an added joint torque [N m] to joint deflections [rad].
        factor: on the cubic torque, of the law.
        follows: whether the wrench turns with the tool.
    """

    deflection: FloatArray
    posture: Posture
    wrench: FloatArray
    softness: FloatArray
    factor: float
    follows: bool

    @property
    def by_stiffness(self) -> FloatArray:
        """(k, 6, 6) derivatives of the deflections by b."""
        return -self.softness * self.deflection[:, None, :]

    @property
    def by_cubic(self) -> FloatArray:
        """(k, 6, 6) derivatives of the deflections by a."""
        return -self.factor * self.softness * self.deflection[:, None, :] ** 3

    @property
    def by_wrench(self) -> FloatArray:
        """(k, 6, 6) derivatives of the deflections by the wrench, in the axes it was given in."""
        found = self.softness @ self.posture.jacobian.swapaxes(1, 2)
        return found @ turning(self.posture.rotation) if self.follows else found


def balance(
    robot: RobotModel,
    joints: FloatArray,
    wrench: FloatArray,
    law: Law,
    follows: bool,
    start: FloatArray | None = None,
) -> Balance:
    """Deflect the joints until they balance the wrench; Newton steps, unchecked input.

    Args:
        robot: with its tool.
        joints: (k, 6) by the encoders [rad].
        wrench: (k, 6) on the tool at its origin; tool axes if it follows the tool, else base axes.
        law: of the joints.
        follows: whether the wrench turns with the tool.
        start: (k, 6) deflections to begin with [rad]; None: of the undeflected arm's torques.

    Returns:
        The balance. Where none exists (a wrench beyond buckling) numbers grow without bound.
    """
    if law.published:
        return _published(robot, joints, wrench, law, follows)
    moved, tangent = start, None
    if moved is None:
        posture = robot.posture(joints)
        moved = posture.torque(_in_base(posture, wrench, follows)) / law.stiffness
    for _ in range(NEWTON_STEPS):
        posture = robot.posture(joints + moved)
        load = _in_base(posture, wrench, follows)
        if tangent is None:
            # Newton's matrix hardly changes on the way: the one at the start serves until the end.
            at = moved
            tangent = -posture.complementary_stiffness(load, follows)
            tangent[:, range(robot.n), range(robot.n)] += law.slope(moved)
            softness = np.asarray(np.linalg.inv(tangent), dtype=np.float64)
        error = posture.torque(load) - law.torque(moved)
        step = np.einsum("kij,kj->ki", softness, error)
        moved = moved + step
        largest = np.abs(moved).max(axis=0, initial=0.0)
        size = np.abs(step).max(axis=0, initial=0.0)
        if not (size > _ACCURACY * (largest + 1e-9)).any():
            break
        if (np.abs(moved - at).max(axis=0, initial=0.0) > _NEAR * (largest + 1e-9)).any():
            tangent = None
    return Balance(moved, posture, load, softness, law.factor, follows)


def _published(
    robot: RobotModel, joints: FloatArray, wrench: FloatArray, law: Law, follows: bool
) -> Balance:
    posture = robot.posture(joints)
    load = _in_base(posture, wrench, follows)
    torque, complementary = posture.torque(load), posture.complementary_stiffness(load)
    moved = torque / law.stiffness
    for _ in range(NEWTON_STEPS):
        tangent = -complementary
        tangent[:, range(robot.n), range(robot.n)] += law.slope(moved)
        error = torque + np.einsum("kij,kj->ki", complementary, moved) - law.torque(moved)
        step = np.linalg.solve(tangent, error[..., None])[..., 0]
        moved = moved + step
        if not np.abs(step).max(initial=0.0) > _ACCURACY * np.abs(moved).max(initial=1e-9):
            break
    softness = np.asarray(np.linalg.inv(tangent), dtype=np.float64)
    return Balance(moved, posture, load, softness, law.factor, follows)


def _in_base(posture: Posture, wrench: FloatArray, follows: bool) -> FloatArray:
    return turn(posture.rotation, wrench) if follows else wrench
