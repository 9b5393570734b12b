# SPDX-License-Identifier: Apache-2.0
"""A motor that winds in while its encoder stands still: only the force/torque sensor feels it."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_control.compiling import njit

HALVES = (3, 6, 10)
"""Samples of each half of a window: a larger current shows within a shorter one."""
KEPT = 2 * HALVES[-1] + 1
FORCE_N = 1.5
"""What the sensor must feel beyond all estimates, along one cable, within a window [N]."""
FIRST_SHARE, SECOND_SHARE = 0.15, 0.45
"""Of that, in the window's first and second half at least: a motor that speeds up goes on, where a
cable that slips on its pulley, a blow or a new pose makes a single step."""
REST_SHARE = 0.35
"""What may be felt across the cable, as a share of what is felt along it."""
STILL_COUNTS = 2.0
"""By which a count may have changed within the window."""


class UnseenPull:
    """Looks for one cable whose growing pull is felt by the sensor, and counted by no encoder.

    The wrench that the tension estimates do not explain changes along that cable's column of the
    structure matrix alone. No other motion makes it: a platform that moves is followed by limbs,
    whose counts move; a model that does not fit shows where limbs move. Only changes are compared,
    so that no bias is needed.

    Attributes:
        limb: found in the newest sample, from 0; -1: none.
        force: felt along its cable then [N].
    """

    def __init__(self, cables: int) -> None:
        """Start without a sample.

        Args:
            cables: of the rig.
        """
        self._unexplained = np.zeros((KEPT, 6))
        self._wound = np.zeros((KEPT, cables))
        self._state = np.zeros(2, dtype=np.int64)
        self.limb, self.force = -1, 0.0

    def begin(self) -> None:
        """Forget all samples, as after a gap."""
        self._state[:] = 0
        self.limb, self.force = -1, 0.0

    def note(
        self,
        wrench: FloatArray,
        tension: FloatArray,
        matrix: FloatArray,
        rotation: FloatArray,
        wound: FloatArray,
        count_length: float,
    ) -> int:
        """Take one sample; return the limb that is found, from 0, or -1.

        Args:
            wrench: (6,) measured, platform axes [N, N m]; its bias may be unknown.
            tension: (n,) the most that each limb can pull by all that is known of it [N].
            matrix: (6, n) structure matrix, base axes.
            rotation: (3, 3) platform to base.
            wound: (n,) wound length [m].
            count_length: length of one count [m].
        """
        keep(self._state, self._unexplained, wrench, tension, matrix, rotation)
        self._wound[self._state[0]] = wound
        still = STILL_COUNTS * count_length
        self.limb, self.force = find(self._state, self._unexplained, self._wound, matrix, still)
        return self.limb


@njit(cache=True)
def keep(
    state: IntArray,
    unexplained: FloatArray,
    wrench: FloatArray,
    tension: FloatArray,
    matrix: FloatArray,
    rotation: FloatArray,
) -> None:
    """Store what the sensor (6,) feels and the tensions (n,) do not explain, base axes.

    Args:
        state: (2,) newest row and number of rows; updated.
        unexplained: (KEPT, 6) of the last samples, a ring [N, N m]; updated.
        wrench: (6,) measured, platform axes [N, N m].
        tension: (n,) as for UnseenPull.note(); one below zero, or unknown, counts as none [N].
        matrix: (6, n) structure matrix, base axes.
        rotation: (3, 3) platform to base.
    """
    newest = (state[0] + 1) % KEPT
    state[0], state[1] = newest, min(state[1] + 1, KEPT)
    row = unexplained[newest]
    for axis in range(3):
        row[axis] = row[3 + axis] = 0.0
        for k in range(3):
            row[axis] += rotation[axis, k] * wrench[k]
            row[3 + axis] += rotation[axis, k] * wrench[3 + k]
    for i in range(tension.shape[0]):
        if tension[i] > 0.0:
            for axis in range(6):
                row[axis] -= matrix[axis, i] * tension[i]


@njit(cache=True)
def find(
    state: IntArray, unexplained: FloatArray, wound: FloatArray, matrix: FloatArray, still: float
) -> tuple[int, float]:
    """Find the cable along which a growing pull is felt while its count stands still.

    Args:
        state: (2,) newest row and number of rows.
        unexplained: (KEPT, 6) as keep() stores it [N, N m].
        wound: (KEPT, n) wound lengths of the same samples [m].
        matrix: (6, n) structure matrix, base axes.
        still: change of a wound length that is none [m].

    Returns:
        The limb, from 0, and what is felt along its cable [N]; -1 and 0: none.
    """
    newest, forces, torques = state[0], 0.0, 0.0
    for i in range(matrix.shape[1]):
        for axis in range(3):
            forces += matrix[axis, i] ** 2
            torques += matrix[3 + axis, i] ** 2
    # Torques are compared with forces at the mean arm of the cables.
    per_torque = forces / torques
    for half in HALVES:
        if state[1] <= 2 * half:
            return -1, 0.0
        middle, first = (newest - half) % KEPT, (newest - 2 * half) % KEPT
        for i in range(matrix.shape[1]):
            if not abs(wound[newest, i] - wound[first, i]) <= still:
                continue
            size = along = before = whole = 0.0
            for axis in range(6):
                weight = 1.0 if axis < 3 else per_torque
                column = weight * matrix[axis, i]
                change = unexplained[newest, axis] - unexplained[first, axis]
                size += column * matrix[axis, i]
                along += column * change
                before += column * (unexplained[middle, axis] - unexplained[first, axis])
                whole += weight * change * change
            pull, early = along / size, before / size
            if not pull >= FORCE_N:
                continue
            across = whole - pull * along
            if (
                early >= FIRST_SHARE * pull
                and pull - early >= SECOND_SHARE * pull
                and across <= REST_SHARE**2 * pull * along
            ):
                return i, pull
    return -1, 0.0
