# SPDX-License-Identifier: Apache-2.0
"""Flexible joints, quasi-static: J(q + dq)^T w = torque(dq), reached with a small first-order lag.

Per joint, torque(dq) = linear dq + cubic dq^3 + Maxwell slip. With cubic = 0 it is the source's
linear model (table 4.3), with linear and cubic the harmonic drive of (4.8). The Maxwell part is
ELEMENTS springs in parallel, each behind a slider that gives at its own friction torque: it
remembers where it slid to, so loading and unloading differ by a loop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.compiling import njit
from cabols_control.naming import joint_name

ELEMENTS = 4
"""Sliders per joint; they give one after the other, so that the loop has no corner."""

NEWTON_STEPS = 60


@njit(cache=True)
def joint_torque(
    deflection: float,
    linear: float,
    cubic: float,
    stiffness: FloatArray,
    friction: FloatArray,
    slip: FloatArray,
) -> float:
    """Torque [N m] of one joint at a deflection, with the sliders where they stand.

    Args:
        deflection: link side minus encoder side [rad].
        linear: stiffness without hysteresis [N m/rad].
        cubic: [N m/rad^3].
        stiffness: (ELEMENTS,) of the sliders' springs [N m/rad].
        friction: (ELEMENTS,) torque at which they give [N m].
        slip: (ELEMENTS,) where they stand [rad].
    """
    torque = (linear + cubic * deflection * deflection) * deflection
    for k in range(stiffness.shape[0]):
        part = stiffness[k] * (deflection - slip[k])
        torque += min(max(part, -friction[k]), friction[k])
    return torque


@njit(cache=True)
def joint_deflection(
    torque: float,
    linear: float,
    cubic: float,
    stiffness: FloatArray,
    friction: FloatArray,
    slip: FloatArray,
) -> float:
    """Solve joint_torque for the deflection [rad].

    The torque rises with the deflection at least as steeply as `linear`, so what the springs take
    lies between the two ends found from the friction alone: Newton steps inside that bracket,
    halved where they leave it.

    Args:
        torque: of the joint [N m].
        linear: stiffness without hysteresis, positive [N m/rad].
        cubic: not negative [N m/rad^3].
        stiffness: (ELEMENTS,) of the sliders' springs [N m/rad].
        friction: (ELEMENTS,) torque at which they give [N m].
        slip: (ELEMENTS,) where they stand [rad]; not moved.
    """
    total = 0.0
    for k in range(stiffness.shape[0]):
        total += friction[k]
    low, high = min(torque - total, 0.0) / linear, max(torque + total, 0.0) / linear
    x = min(max(torque / linear, low), high)
    for _ in range(NEWTON_STEPS):
        error = joint_torque(x, linear, cubic, stiffness, friction, slip) - torque
        if error > 0.0:
            high = x
        else:
            low = x
        slope = linear + 3.0 * cubic * x * x
        for k in range(stiffness.shape[0]):
            if abs(stiffness[k] * (x - slip[k])) < friction[k]:
                slope += stiffness[k]
        wanted = x - error / slope
        if not low <= wanted <= high:
            wanted = 0.5 * (low + high)
        if abs(wanted - x) <= 1e-15 + 1e-13 * abs(x):
            return wanted
        x = wanted
    return x


JointTables = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@njit(cache=True)
def deflect_into(
    jacobian: FloatArray,
    wrench: FloatArray,
    share: float,
    tables: JointTables,
    slip: FloatArray,
    deflection: FloatArray,
) -> None:
    """Advance the deflections (6,) towards the balance by a share of the way; move the sliders.

    Args:
        jacobian: (6, 6) at the platform's origin, of the deflected arm.
        wrench: (6,) on the platform, base axes [N, N m].
        share: 0 to 1, of the way in this step; 1: at once.
        tables: of the joints: linear (6,) [N m/rad], cubic (6,) [N m/rad^3]; of the sliders:
            stiffness (6, ELEMENTS) of their springs [N m/rad], friction (6, ELEMENTS) at which
            they give [N m].
        slip: (6, ELEMENTS) where they stand [rad]; updated.
        deflection: (6,) [rad]; updated.
    """
    linear, cubic, stiffness, friction = tables
    for j in range(6):
        torque = 0.0
        for i in range(6):
            torque += jacobian[i, j] * wrench[i]
        wanted = joint_deflection(torque, linear[j], cubic[j], stiffness[j], friction[j], slip[j])
        deflection[j] += share * (wanted - deflection[j])
        for k in range(stiffness.shape[1]):
            if stiffness[j, k] > 0.0:
                reach = friction[j, k] / stiffness[j, k]
                slip[j, k] = min(max(slip[j, k], deflection[j] - reach), deflection[j] + reach)


class FlexibleJoints:
    """Six flexible joints and their memory.

    Attributes:
        deflection: (6,) of the joints, link side minus encoder side [rad].
        slip: (6, ELEMENTS) where the hysteresis sliders stand [rad].
    """

    def __init__(
        self,
        linear: ArrayLike,
        cubic: ArrayLike = (0.0,) * 6,
        hysteresis_torque: ArrayLike = (0.0,) * 6,
        hysteresis_deflection: ArrayLike = (1e-4,) * 6,
        lag_s: float = 0.005,
    ) -> None:
        """Start unloaded.

        Args:
            linear: (6,) stiffness without hysteresis [N m/rad].
            cubic: (6,) [N m/rad^3].
            hysteresis_torque: (6,) friction of all sliders together [N m]; 0: none.
            hysteresis_deflection: (6,) after which all of them have given [rad].
            lag_s: time constant of the balance [s].

        Raises:
            ShapeError: if one has another shape or is not finite.
            OutOfRangeError: if a value has the wrong sign or is absurd.
        """
        self.linear = finite_array("linear", linear, (6,))
        self.cubic = finite_array("cubic", cubic, (6,))
        torque = finite_array("hysteresis_torque", hysteresis_torque, (6,))
        reach = finite_array("hysteresis_deflection", hysteresis_deflection, (6,))
        for j in range(6):
            in_range(f"linear of {joint_name(j)}", self.linear[j], 1.0, 1e9)
            in_range(f"cubic of {joint_name(j)}", self.cubic[j], 0.0, 1e18)
            in_range(f"hysteresis_torque of {joint_name(j)}", torque[j], 0.0, 1e4)
            in_range(f"hysteresis_deflection of {joint_name(j)}", reach[j], 1e-8, 1.0)
        self.lag_s = in_range("lag_s", lag_s, 1e-4, 1.0)
        fractions = np.arange(1, ELEMENTS + 1) / ELEMENTS
        self.friction = np.repeat(torque[:, None] / ELEMENTS, ELEMENTS, axis=1)
        self.stiffness = self.friction / (reach[:, None] * fractions)
        self.slip = np.zeros((6, ELEMENTS))
        self.deflection = np.zeros(6)

    def torque(self, deflection: ArrayLike) -> FloatArray:
        """(6,) torques [N m] at (6,) deflections [rad], with the sliders where they stand."""
        x = finite_array("deflection", deflection, (6,))
        found = np.empty(6)
        for j in range(6):
            found[j] = joint_torque(
                x[j],
                self.linear[j],
                self.cubic[j],
                self.stiffness[j],
                self.friction[j],
                self.slip[j],
            )
        return found

    def step(self, jacobian: FloatArray, wrench: FloatArray, dt_s: float) -> None:
        """Advance by dt_s under a (6,) wrench with the (6, 6) Jacobian of the deflected arm.

        Args:
            jacobian: (6, 6) of the deflected arm, base axes.
            wrench: (6,) on the flange [N, N m], base axes.
            dt_s: time to advance [s].
        """
        share = 1.0 - np.exp(-dt_s / self.lag_s)
        deflect_into(jacobian, wrench, share, self.tables, self.slip, self.deflection)

    @property
    def tables(self) -> JointTables:
        """Parameters for deflect_into."""
        return self.linear, self.cubic, self.stiffness, self.friction
