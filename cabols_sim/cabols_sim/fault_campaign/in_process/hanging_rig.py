# SPDX-License-Identifier: Apache-2.0
"""Bridge, guard, controllers and a platform that hangs on its cables, in lockstep, without ROS."""

from __future__ import annotations

import copy

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.rig import Rig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.hanging import HangingWrenchController
from cabols_hw.bridge.scaling import CLOSINGS
from cabols_hw.card.config import CardConfig
from cabols_hw.force_torque.sensor_bias import SensorBias
from cabols_hw.hanging.bridge import HangingBridge
from cabols_hw.hanging.guard import POSE_EVERY, HangingGuard
from cabols_hw.safety.config import SafetyConfig
from cabols_sim.fault_campaign.in_process.rig import PERIOD_S, LockstepRig
from cabols_sim.plant.config import PlantConfig
from cabols_sim.plant.free_platform import RigidBody
from cabols_sim.plant.stand import DAMPING, Stand, StandingPlatform, hanging_body

PROVE_S, SETTLE_S = 7.0, 1.0


class Body(StandingPlatform):
    """The platform in place of a robot: it tells nobody where it is, and nothing stops it."""

    def stop(self, after_s: float = 0.0) -> None:
        """Do nothing.

        Args:
            after_s: not used.
        """


class HangingRig(LockstepRig):
    """The control path of a rig whose platform hangs on its cables, stepped by a millisecond.

    Attributes:
        body: the true platform.
        guard: of the bridge.
        heights: true heights of the platform's centre of mass, one a sample, since `watch` [m].
        peak: largest true tension since then [N].
    """

    def __init__(
        self,
        rig: Rig,
        card: CardConfig,
        plant: PlantConfig,
        safety: SafetyConfig,
        seed: int,
        body: RigidBody | None = None,
        stand: Stand | None = None,
    ) -> None:
        """Start at rest on the stand, with slack cables.

        Args:
            rig: geometry, limbs, gains, what hangs.
            card: scaling and wiring.
            plant: true parameters; springs and cables get their ends.
            safety: the envelope.
            seed: of the plant.
            body: the true one; None: as the files say.
            stand: None: one without a net.

        Raises:
            ConfigError: if the rig's files do not say what hangs.
        """
        if rig.hanging is None:
            raise ConfigError("the rig's files say nothing of a platform that hangs on its cables")
        made = hanging_body(rig.hanging) if body is None else body
        self.body = Body(rig.geometry, made, DAMPING, stand)
        self._centre = np.array(made.centre)
        super().__init__(rig, card, plant, safety, seed, self.body)  # type: ignore[arg-type]
        self.watch()

    def start_again(self, bias: SensorBias | None) -> None:
        """Start bridge and controllers anew, in STOPPED; the plant stays as it is.

        Args:
            bias: not used: there is no sensor.
        """
        del bias
        super().start_again(None)
        self.bridge: HangingBridge = HangingBridge(self.rig, self._card_config, CLOSINGS)
        self.guard: HangingGuard = HangingGuard(self.rig, self._safety, self._card_config.watchdog)
        self.wrenches: HangingWrenchController = HangingWrenchController(self.rig)

    def fork(self) -> HangingRig:
        """Return a copy that goes its own way."""
        return copy.deepcopy(self)

    def watch(self) -> None:
        """Forget what was highest."""
        self.heights: list[float] = []
        self.peak = 0.0

    @property
    def height(self) -> float:
        """True height of the centre of mass [m]."""
        return float((self.body.position + self.body.rotation @ self._centre)[2])

    def cycle(self) -> None:
        """Advance by one sample."""
        super().cycle()
        self.heights.append(self.height)
        self.peak = max(self.peak, float(self.plant.tension.max()))

    def _tell_pose(self) -> None:
        """The bridge tells itself; the wrench controller hears it."""
        hoist = self.guard.watch.hoist
        if self._tick % POSE_EVERY == 0:
            self.wrenches.hear_pose(self.now_s, hoist.position, hoist.rotation)

    def prepare(self) -> None:
        """Find the zeros, and prove the gears, on the stand.

        Raises:
            RuntimeError: if that fails.
        """
        self.run(0.3)
        self.mode, self.zeroing = OperatingMode.PRETIGHTENING, self.zeroing + 1
        self.run(15.0, lambda: bool(self.bridge.zeroed.all()))
        self.run(0.5)
        self.mode = OperatingMode.LOADING
        self.run(PROVE_S)
        if self.guard.fault is not None or not self.guard.watch.proof.done:
            raise RuntimeError(f"the start failed: {self.guard.fault}")

    def go(self, offset: FloatArray, rotation: FloatArray | None = None) -> None:
        """Move to an offset from the reference pose, and wait until the platform rests there.

        Args:
            offset: (3,) base frame [m].
            rotation: (3, 3); None: the reference one.

        Raises:
            RuntimeError: if it is refused.
        """
        geometry, watch = self.rig.geometry, self.guard.watch
        turn = np.array(geometry.reference_rotation) if rotation is None else rotation
        refused = watch.go(np.array(geometry.reference_position) + offset, turn)
        if refused:
            raise RuntimeError(refused)
        self.run(PERIOD_S)
        self.run(60.0, lambda: not watch.hoist.moving or self.guard.fault is not None)
        self.run(SETTLE_S)
