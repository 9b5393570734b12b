# SPDX-License-Identifier: Apache-2.0
"""The guard of a platform that hangs on its cables: no sensor, gears that hold; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.naming import limb_name
from cabols_control.rig import Rig
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.braking import STILL_M_S, Braking
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.hanging.bridge import HangingBridge
from cabols_hw.hanging.watch import HangingWatch
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.envelope import SafetyEnvelope
from cabols_hw.safety.faults import BridgeFault
from cabols_hw.safety.guard import BridgeGuard

POSE_EVERY = 4
"""Samples between two poses that the bridge is told, as of a robot."""
LONGEST_STEP_S = 0.010


class HangingEnvelope(SafetyEnvelope):
    """The envelope without the rules that need a force/torque sensor, with those of the watch.

    Attributes:
        watch: where the platform is, and what it may do there.
    """

    def __init__(self, rig: Rig, config: SafetyConfig, current_limit: float) -> None:
        """Start with nothing known.

        Args:
            rig: geometry and limbs, what hangs.
            config: limits; it declares the suspension.
            current_limit: what the bridge limits currents to [A].

        Raises:
            ConfigError: if no suspension is declared.
        """
        super().__init__(rig, config, current_limit)
        if config.suspension is None:
            raise ConfigError("safety.yaml: expected a block suspension, got none")
        self.watch = HangingWatch(rig, config, config.suspension)
        self._entered = OperatingMode.STOPPED

    def _find(
        self, now_s: float, dt_s: float, bridge: Bridge, mode: OperatingMode, recovers: bool
    ) -> BridgeFault | None:
        assert isinstance(bridge, HangingBridge)
        watch, refusal = self.watch, ""
        passed_s = min(dt_s, LONGEST_STEP_S) if dt_s > 0.0 else 0.0
        if mode != self._entered:
            self._entered = mode
            refusal = watch.refusal(mode, bridge)
            watch.begin(mode)
        watch.sample(passed_s, bridge, mode)
        found = super()._find(now_s, dt_s, bridge, mode, recovers)
        if found is not None:
            return found
        if refusal:
            return BridgeFault(FaultName.NOT_HELD, refusal)
        if mode == OperatingMode.LOADING and self.fault is None:
            return watch.judge(passed_s, bridge)
        return None

    def _judge_sensor(self, dt_s: float, bridge: Bridge) -> BridgeFault | None:
        """Nothing is behind the sensor."""
        del dt_s, bridge
        return None

    def _judge_limbs(self, dt_s: float, bridge: Bridge, acts: bool) -> BridgeFault | None:
        found = super()._judge_limbs(dt_s, bridge, acts)
        lost = found is not None and found.name in (FaultName.CABLE, FaultName.SWITCH)
        if found is None or not lost or not bridge.zeroed[found.limb]:
            return found
        return BridgeFault(
            FaultName.CABLE,
            f"{limb_name(found.limb)}: its switch is open, and elongation says "
            f"{bridge.tension[found.limb]:.1f} N: is the cable broken, has it slipped, or has the "
            "encoder lost counts?",
            found.limb,
        )


class StandingStill(Braking):
    """Braking of motors that pay out, too: until they stand they let the platform down."""

    def step(self, now_s: float, speed: FloatArray) -> FloatArray:
        """Return the (n,) currents [A] for one sample; see Braking.step.

        Args:
            now_s: now [s].
            speed: (n,) of the motors, winding in [m/s].
        """
        self.braked = np.abs(speed) > STILL_M_S
        return self.brake(now_s, speed)


class HangingGuard(BridgeGuard):
    """Guard whose reactions are to brake and cut: the gears then hold the platform.

    Attributes:
        watch: where the platform is, and what it may do there.
    """

    def __init__(self, rig: Rig, config: SafetyConfig, watchdog_s: float) -> None:
        """Start with zero currents.

        Args:
            rig: geometry, limbs, limits, what hangs.
            config: the safety envelope; it declares the suspension.
            watchdog_s: age of the newest command of a limb that cuts all currents [s].

        Raises:
            ConfigError: if no suspension is declared.
        """
        super().__init__(rig, config, watchdog_s)
        envelope = HangingEnvelope(rig, config, rig.control.current_limit)
        self.safety, self.watch = envelope, envelope.watch
        self.braking = StandingStill(rig)
        # What it may do, the watch says.
        self._held = True
        self._samples = 0

    def sample(
        self, now_s: float, bridge: Bridge, mode: OperatingMode, card_expired: bool = False
    ) -> bool:
        """Judge one sample; see BridgeGuard.sample.

        Args:
            now_s: of the sample, on the card's clock [s].
            bridge: that took it.
            mode: newest mode.
            card_expired: whether the card's own watchdog has zeroed the outputs.

        Returns:
            Whether the amplifiers need output() at once, without waiting for a command.
        """
        proves = self.watch.proof.running
        acted = super().sample(now_s, bridge, mode, card_expired)
        self._samples += 1
        if self._samples % POSE_EVERY == 0:
            pose = self.watch.hoist.position, self.watch.hoist.rotation
            if self.safety.hear_pose(now_s, *pose, now_s):
                bridge.hear_pose(now_s, *pose)
        return acted or proves != self.watch.proof.running

    def output(self, mode: OperatingMode) -> FloatArray:
        """(n,) currents to put on the amplifiers: none while the gears are proven [A].

        Args:
            mode: newest mode.
        """
        current = super().output(mode)
        if self.watch.proof.running:
            return np.zeros_like(current)
        return current

    def notice(self, bridge: HangingBridge) -> Fault | None:
        """Return what keeps modes from beginning, while the rig rests; None: nothing.

        Args:
            bridge: with the newest sample.
        """
        watch = self.watch
        zeros = watch.refusal(OperatingMode.PRETIGHTENING, bridge)
        load = watch.refusal(OperatingMode.LOADING, bridge)
        if zeros and load:
            return Fault(FaultName.NOT_HELD, f"{zeros}; nor may it be lifted: {load}")
        if zeros:
            return Fault(FaultName.HANGS, zeros)
        return None

    def _react(
        self, fault: BridgeFault, now_s: float, bridge: Bridge, mode: OperatingMode, moved: bool
    ) -> None:
        super()._react(fault, now_s, bridge, mode, moved)
        self.watch.doubt(fault.name)
        # To pay out cables, as other rigs do, would let the platform down, but for one that stands:
        # there the other limbs' pulls would tip it.
        self._unloads = fault.name == FaultName.GEAR and self.watch.standing
        self._yields = False
