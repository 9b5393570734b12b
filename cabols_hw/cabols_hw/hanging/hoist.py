# SPDX-License-Identifier: Apache-2.0
"""Where a hanging platform is to be: straight ways at bounded speed and acceleration; pure."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray

ACCELERATION_M_S2 = 0.05
"""Of the way: what the platform, which nothing damps, swings by is a / omega^2, 0.1 mm."""


class Hoist:
    """Moves the commanded pose from where it is to a goal.

    A way's length counts turns by `arm`, so that both limits of speed hold. A new goal is gone to
    once the platform has come to rest on the way before.

    Attributes:
        arm: length by which a turn counts as a way [m].
        position: (3,) commanded, base frame [m].
        rotation: (3, 3) commanded, from platform to base axes.
    """

    def __init__(
        self, position: FloatArray, rotation: FloatArray, speed: float, turning: float
    ) -> None:
        """Rest at a pose.

        Args:
            position: (3,) base frame [m].
            rotation: (3, 3) from platform to base axes.
            speed: largest [m/s].
            turning: largest [rad/s].
        """
        self._speed, self.arm = speed, speed / turning
        self.position, self.rotation = np.zeros(3), np.eye(3)
        self.put(position, rotation)

    def put(self, position: FloatArray, rotation: FloatArray) -> None:
        """Rest at a pose, without a way to it.

        Args:
            position: (3,) base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        self.position[:], self.rotation[:] = position, rotation
        self._start = (self.position.copy(), self.rotation.copy())
        self._way, self._turn = np.zeros(3), np.zeros(3)
        self._length = self._gone = self._rate = 0.0
        self._next: tuple[FloatArray, FloatArray] | None = None
        self._goal = self._start

    @property
    def moving(self) -> bool:
        """Whether it is on its way."""
        return self._rate > 0.0 or self._next is not None

    def go(self, position: FloatArray, rotation: FloatArray) -> None:
        """Go to a pose; one that is gone to already changes nothing, however often it is told.

        Args:
            position: (3,) base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        goal = (np.array(position), np.array(rotation))
        if not all(np.array_equal(new, old) for new, old in zip(goal, self._goal, strict=True)):
            self._next = self._goal = goal

    def step(self, dt_s: float) -> None:
        """Advance.

        Args:
            dt_s: since the step before [s].
        """
        if self._next is not None and not self._rate > 0.0:
            self._begin(*self._next)
            self._next = None
        left = self._length - self._gone
        if not left > 0.0:
            return
        change = ACCELERATION_M_S2 * dt_s
        # The largest speed from which it stops in what is left.
        reach = np.sqrt(2.0 * ACCELERATION_M_S2 * max(left - self._rate * dt_s, 0.0))
        wanted = 0.0 if self._next is not None else min(self._speed, float(reach))
        self._rate += min(max(wanted - self._rate, -change), change)
        if self._next is not None and not self._rate > 0.0:
            return
        self._gone += self._rate * dt_s
        if self._gone >= self._length or (self._rate <= change and left <= self._rate * dt_s):
            self._gone, self._rate = self._length, 0.0
        share = self._gone / self._length
        self.position[:] = self._start[0] + share * self._way
        self.rotation[:] = Rotation.from_rotvec(share * self._turn).as_matrix() @ self._start[1]

    def _begin(self, position: FloatArray, rotation: FloatArray) -> None:
        self._start = (self.position.copy(), self.rotation.copy())
        self._way = position - self.position
        self._turn = Rotation.from_matrix(rotation @ self.rotation.T).as_rotvec()
        far, turn = float(np.linalg.norm(self._way)), float(np.linalg.norm(self._turn))
        self._length, self._gone, self._rate = max(far, self.arm * turn), 0.0, 0.0
