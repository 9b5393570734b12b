# SPDX-License-Identifier: Apache-2.0
"""A platform that vibrates in the compiled closed loop: linear, about its first pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_sim.dynamics.vibration import VibrationModel


class Platform(NamedTuple):
    """The platform between two integration steps of the limbs.

    Attributes:
        active: whether it moves at all.
        transition: (12, 12) of displacement and velocity over a step.
        drive: (12, 6) by a wrench held over the step.
        inertia: (6, 6) from the wrench to the part that accelerates what is before the sensor.
        restoring: (6, 12) the same, from displacement and velocity.
    """

    active: bool
    transition: FloatArray
    drive: FloatArray
    inertia: FloatArray
    restoring: FloatArray


def make_platform(vibration: VibrationModel | None, dt_s: float) -> Platform:
    """Discretise a vibrating platform for steps of dt_s [s]; None: one that never moves.

    The springs' stiffness is left out: the limbs' physics has the springs.

    Args:
        vibration: of the platform; None: it never moves.
        dt_s: length of a step [s].
    """
    if vibration is None:
        none = np.zeros((6, 12))
        return Platform(False, np.zeros((12, 12)), np.zeros((12, 6)), np.zeros((6, 6)), none)
    lighter = np.linalg.inv(vibration.mass)
    holding = lighter @ np.hstack([vibration.target + vibration.tension, vibration.damping()])
    whole = np.zeros((18, 18))
    whole[:6, 6:12] = np.eye(6)
    whole[6:12, :12], whole[6:12, 12:] = -holding, lighter
    step = expm(whole * dt_s)
    return Platform(
        active=True,
        transition=np.ascontiguousarray(step[:12, :12]),
        drive=np.ascontiguousarray(step[:12, 12:]),
        inertia=vibration.platform_mass @ lighter,
        restoring=vibration.platform_mass @ holding,
    )


@njit(cache=True)
def move_platform(
    platform: Platform,
    change: FloatArray,
    matrix: FloatArray,
    at_rest: FloatArray,
    state: FloatArray,
    length: FloatArray,
) -> None:
    """Advance by one step and set the cables' lengths.

    Args:
        platform: from make_platform.
        change: (6,) cables' wrench minus that of the first sample [N, N m].
        matrix: (6, n) structure matrix.
        at_rest: (n,) lengths at the first sample [m].
        state: (12,) displacement and velocity; updated.
        length: (n,) output [m].
    """
    moved = np.zeros(12)
    for row in range(12):
        for column in range(12):
            moved[row] += platform.transition[row, column] * state[column]
        for column in range(6):
            moved[row] += platform.drive[row, column] * change[column]
    state[:] = moved
    for i in range(length.size):
        length[i] = at_rest[i]
        for row in range(6):
            length[i] -= matrix[row, i] * state[row]


@njit(cache=True)
def subtract_inertia(
    platform: Platform, change: FloatArray, state: FloatArray, wrench: FloatArray
) -> None:
    """Take from the cables' wrench what accelerates the platform: the sensor sees the rest.

    Args:
        platform: from make_platform.
        change: (6,) cables' wrench minus that of the first sample [N, N m].
        state: (12,) displacement and velocity of move_platform [m, rad, m/s, rad/s].
        wrench: (6,) of the cables, then of the sensor, base axes [N, N m].
    """
    for row in range(6):
        for column in range(6):
            wrench[row] -= platform.inertia[row, column] * change[column]
        for column in range(12):
            wrench[row] += platform.restoring[row, column] * state[column]
