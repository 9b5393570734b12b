# SPDX-License-Identifier: Apache-2.0
"""A platform on a stand, from which its cables lift it, and on which they set it down; a net."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, in_range
from cabols_control.geometry import RigGeometry
from cabols_control.rig import HangingLoad
from cabols_control.rotations import angle_between
from cabols_hw.force_torque.ati import STANDARD_GRAVITY
from cabols_sim.plant.free_platform import FreePlatform, RigidBody

DAMPING = (2.0, 2.0, 2.0, 0.02, 0.02, 0.02)
"""Of air and cables [N s/m, N m s], chosen by this project."""
GYRATION_M = 0.08
"""Radius of gyration of the simulated platform, about any axis."""
CAUGHT_M, CAUGHT_RAD = 0.01, 0.05
"""Misses that the stand's pins still centre."""
NET_N_PER_M = 2000.0


@dataclass(frozen=True)
class Stand:
    """A seat with pins: it bears weight, holds sideways, and turns the platform into place.

    Attributes:
        radius: of its edge, over which a platform tips [m].
        net_depth: how far below it a net stops a fall [m]; inf: there is none.
    """

    radius: float = 0.15
    net_depth: float = np.inf


class StandingPlatform(FreePlatform):
    """A platform that stands until its cables lift it, and again once they set it down.

    A landing is without a rebound.
    """

    def __init__(
        self,
        geometry: RigGeometry,
        body: RigidBody,
        damping: ArrayLike = (0.0,) * 6,
        stand: Stand | None = None,
    ) -> None:
        """Stand at the reference pose.

        Args:
            geometry: of the rig; its reference pose is where the stand is.
            body: what hangs on the cables.
            damping: (6,) of air and cables, at the origin [N s/m, N m s].
            stand: None: one without a net.

        Raises:
            ShapeError: if damping is not six numbers.
            OutOfRangeError: if a number has no meaning.
        """
        super().__init__(geometry, body, damping)
        self.stand = stand or Stand()
        in_range("radius", self.stand.radius, 1e-3, 100.0)
        self._seat = (self.position.copy(), self.rotation.copy())
        self._mass, self._centre = body.mass, np.array(body.centre)
        self._net = 2.0 * np.sqrt(NET_N_PER_M * body.mass)

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Advance under the cables' wrench, the weight, the stand and the net.

        Args:
            wrench: (6,) of the cables on the platform, base axes [N, N m].
            dt_s: length of the step [s].

        Returns:
            Whether the pose has changed.
        """
        if self.held and self._lifted(wrench):
            self.release()
        total = wrench
        below = self._seat[0][2] - self.stand.net_depth - self.position[2]
        if not self.held and below > 0.0:
            total = wrench.copy()
            total[2] += max(NET_N_PER_M * below - self._net * self.twist[2], 0.0)
        moved = super().step(total, dt_s)
        if moved and self._lands():
            self.position[:], self.rotation[:] = self._seat
            self._momentum[:] = self.twist[:] = 0.0
            self.held = True
        return moved

    def _lifted(self, wrench: FloatArray) -> bool:
        """Whether the cables lift it, or tip it over the stand's edge."""
        arm = self.rotation @ self._centre
        weight = self._mass * STANDARD_GRAVITY
        borne = weight - wrench[2]
        tipping = np.hypot(wrench[3] - arm[1] * weight, wrench[4] + arm[0] * weight)
        return bool(not borne * self.stand.radius > tipping)

    def _lands(self) -> bool:
        away = self.position - self._seat[0]
        near = float(np.hypot(away[0], away[1])) <= CAUGHT_M
        turned = angle_between(self._seat[1], self.rotation) <= CAUGHT_RAD
        return bool(away[2] <= 0.0 and away[2] > -CAUGHT_M and self.twist[2] <= 0.0) and (
            near and turned
        )


def hanging_body(load: HangingLoad, share: float = 1.0) -> RigidBody:
    """Build the simulated body of what a rig's files say.

    Args:
        load: of the files.
        share: of their mass that it truly has.
    """
    mass = share * load.mass
    return RigidBody.checked(mass, load.centre, mass * GYRATION_M**2 * np.eye(3))
