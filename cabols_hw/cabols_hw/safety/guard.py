"""The guard between controllers and amplifiers: watchdog, safety envelope, reactions; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_control.rig import Rig
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.unloading import Unloading
from cabols_hw.bridge.watchdog import CommandWatchdog, merge_into
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.envelope import SafetyEnvelope
from cabols_hw.safety.faults import BridgeFault, Reaction


class BridgeGuard:
    """Decides about the amplifiers' currents, whatever the controllers command.

    Attributes:
        safety: the envelope; its `fault` is the one in force.
        unloading: the bridge's own unloading.
        ending: set to unload at the next sample, because the process is to end.
    """

    def __init__(self, rig: Rig, config: SafetyConfig, watchdog_s: float) -> None:
        """Start with zero currents.

        Args:
            rig: geometry, limbs, limits.
            config: the safety envelope.
            watchdog_s: age of the newest command of a limb that cuts all currents [s].
        """
        self.safety = SafetyEnvelope(rig, config, rig.control.current_limit)
        self.unloading = Unloading(rig)
        self._watchdog = CommandWatchdog(rig.geometry.cables, watchdog_s)
        self._commanded = np.zeros(rig.geometry.cables)
        self._rest = np.zeros(rig.geometry.cables)
        self._emergency = False
        self.ending = False

    @property
    def enabled(self) -> bool:
        """Whether the amplifiers may be on.

        A cut switches them off: a zero command does not stop an amplifier with an offset.
        """
        fault = self.fault
        return not self._emergency and (fault is None or fault.reaction != Reaction.CUT)

    @property
    def fault(self) -> BridgeFault | None:
        """The fault in force."""
        return self.safety.fault

    def command(self, limbs: IntArray, current: FloatArray, now_s: float) -> bool:
        """Take (k,) currents [A] for (k,) limbs that arrived after the sample at now_s.

        Args:
            limbs: (k,) limbs, from 0.
            current: (k,) [A].
            now_s: of the newest sample, on the card's clock [s].

        Returns:
            False if a limb does not exist or a current is not finite: nothing is changed then.
        """
        return bool(merge_into(limbs, current, now_s, self._commanded, self._watchdog.newest))

    def sample(
        self, now_s: float, bridge: Bridge, mode: OperatingMode, card_expired: bool = False
    ) -> bool:
        """Judge one sample, just taken by the bridge; `now_s` on the card's clock.

        Args:
            now_s: of the sample, on the card's clock [s].
            bridge: that took it.
            mode: newest mode.
            card_expired: whether the card's own watchdog has zeroed the outputs.

        Returns:
            Whether the amplifiers need output() at once, without waiting for a command.
        """
        before = self.fault
        self._judge_commands(now_s, mode, card_expired)
        self.safety.judge(now_s, bridge, mode)
        fault = self.fault
        if mode == OperatingMode.STOPPED:
            self.unloading.stop()
            self._emergency = False
        if fault is not None and before is None:
            self._react(fault, now_s, bridge, mode)
            return True
        if self.unloading.active:
            self.unloading.step(now_s, bridge.tension, bridge.elongation)
            return True
        return False

    def output(self, mode: OperatingMode) -> FloatArray:
        """(n,) currents to put on the amplifiers [A]."""
        if self.unloading.active:
            return self.unloading.current
        if mode not in MOVING or self.fault is not None:
            self._commanded[:] = 0.0
            return self._rest
        return self._commanded

    def emergency_stop(self) -> None:
        """Cut, also an unloading of another fault; holds until STOPPED."""
        self._emergency = True
        self.unloading.stop()

    def _judge_commands(self, now_s: float, mode: OperatingMode, card_expired: bool) -> None:
        at_rest = mode not in MOVING
        if self.ending and not at_rest:
            self.safety.trip(BridgeFault(FaultName.ENDING, "asked to end, and nobody unloads"))
        if not self._watchdog.check(now_s, at_rest):
            self.safety.trip(BridgeFault(FaultName.COMMAND_AGE, self._watchdog.fault))
        if card_expired and not at_rest:
            self.safety.trip(
                BridgeFault(FaultName.CARD, "the card's own watchdog has zeroed the outputs")
            )

    def _react(self, fault: BridgeFault, now_s: float, bridge: Bridge, mode: OperatingMode) -> None:
        if fault.reaction != Reaction.UNLOAD or mode not in MOVING:
            return
        trusted = bridge.zeroed.copy()
        if fault.limb >= 0:
            trusted[fault.limb] = False
        self.unloading.begin(now_s, bridge.tension, bridge.elongation, trusted)
