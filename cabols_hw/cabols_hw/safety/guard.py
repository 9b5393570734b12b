# SPDX-License-Identifier: Apache-2.0
"""The guard between controllers and amplifiers: watchdog, safety envelope, reactions; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.rig import Rig
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_hw.bridge.braking import Braking, Yielding, pay_out_only
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.unloading import Unloading
from cabols_hw.bridge.watchdog import CommandWatchdog, merge_into
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.envelope import SafetyEnvelope
from cabols_hw.safety.faults import (
    BRAKED,
    DOUBTING,
    FOLLOWED,
    NOT_HELD,
    POSE_LOST,
    BridgeFault,
    Reaction,
)
from cabols_hw.safety.first_power_on import PowerOnBound
from cabols_hw.safety.recovery import RecoveryWatch


class BridgeGuard:
    """Decides about the amplifiers' currents, whatever the controllers command.

    A reaction has up to three parts, for each limb one after the other: motors that wind in are
    braked; the tensions are ramped down; where the platform may move, the limbs give way by their
    switches.

    Attributes:
        safety: the envelope; its `fault` is the one in force.
        braking: of motors that wind in.
        unloading: the bridge's own unloading.
        yielding: to a platform whose pose is lost.
        ending: set to unload at the next sample, because the process is to end.
        power_on: bound of a rig whose wiring has not been checked; None: it has.
    """

    def __init__(self, rig: Rig, config: SafetyConfig, watchdog_s: float) -> None:
        """Start with zero currents.

        Args:
            rig: geometry, limbs, limits.
            config: the safety envelope.
            watchdog_s: age of the newest command of a limb that cuts all currents [s].
        """
        n = rig.geometry.cables
        self.safety = SafetyEnvelope(rig, config, rig.control.current_limit)
        self.braking = Braking(rig)
        self.unloading = Unloading(rig)
        self.yielding = Yielding(rig)
        self._growth = RecoveryWatch()
        self._last_s = np.nan
        self._watchdog = CommandWatchdog(n, watchdog_s)
        self._commanded = np.zeros(n)
        self._allowed = np.zeros(n)
        self._rest = np.zeros(n)
        self._known: BoolArray = np.zeros(n, dtype=np.bool_)
        self._trusted: BoolArray = np.zeros(n, dtype=np.bool_)
        self._doubted: BoolArray = np.zeros(n, dtype=np.bool_)
        self._held = config.platform_held
        self._unloads = self._yields = False
        self._moved = False
        self._emergency = False
        self.ending = False
        self.power_on: PowerOnBound | None = None
        self._pressed = self._brakes = False

    @property
    def enabled(self) -> bool:
        """Whether the amplifiers may be on: in a mode with currents, and for the bridge's own.

        A zero command does not stop an amplifier with an offset.
        """
        if self.braking.active or self.unloading.active or self.yielding.active:
            return True
        return self._moved and not self._emergency and self.fault is None

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
        before, recovers = self.fault, self._recovers
        self._judge_commands(now_s, mode, card_expired)
        self.safety.judge(now_s, bridge, mode, recovers)
        if self.power_on is not None:
            beyond = self.power_on.judge(mode, bridge.wound_length)
            if beyond is not None:
                self.safety.trip(beyond)
        if not self._held and mode in MOVING:
            self.safety.trip(BridgeFault(FaultName.NOT_HELD, NOT_HELD))
        fault, moved = self.fault, self._moved
        self._moved = mode in MOVING
        if mode == OperatingMode.STOPPED and before is not None:
            self._rest_all()
        if mode == OperatingMode.STOPPED:
            self._emergency = self._pressed
        reacts = fault is not None and fault is not before
        if fault is not None and reacts:
            self._react(fault, now_s, bridge, mode, moved or recovers)
        elif moved and not self._moved and fault is None:
            # Also a mode that ends leaves no motor to coast.
            self.braking.begin(now_s)
        elif self._brakes and self._moved and fault is None:
            self.braking.begin(now_s)
        self._brakes = False
        # Silent controllers are the bridge's matter: the card must not expire before it has acted.
        acted = reacts or recovers or self.braking.active or self._watchdog.silent
        if acted:
            self._recover(now_s, bridge)
        return acted

    @property
    def recovering(self) -> bool:
        """Whether the bridge brakes or unloads by itself: its process must not end then."""
        return self.braking.active or self.unloading.active or self._unloads

    @property
    def _recovers(self) -> bool:
        return self.braking.active or self.unloading.active or self.yielding.armed

    def output(self, mode: OperatingMode) -> FloatArray:
        """(n,) currents to put on the amplifiers [A].

        Args:
            mode: newest mode.
        """
        if self._recovers:
            return self._recovery()
        if mode not in MOVING or self.fault is not None or self._emergency:
            self._commanded[:] = 0.0
            return self._rest
        if self.safety.relieves(mode):
            return pay_out_only(self._commanded, self.safety.speed)
        if self.power_on is not None:
            return self.power_on.bounded(mode, self._commanded)
        if mode == OperatingMode.COMMISSIONING:
            return self._commanded
        return np.minimum(self._commanded, self.safety.allowed_current, out=self._allowed)

    def _recovery(self) -> FloatArray:
        """(n,) currents of the bridge's own motions [A].

        No limb waits for another one: those that stand are unloaded while others are braked, and
        those that are unloaded give way, where they have to, while others are not.
        """
        current = self._rest
        if self.yielding.armed:
            current = self.yielding.current
        if self.unloading.active:
            current = np.where(self.unloading.down, current, self.unloading.current)
        if self.braking.active:
            current = np.where(self.braking.braked, self.braking.current, current)
        return current

    def emergency_stop(self) -> None:
        """Cut, also an unloading of another fault; holds until STOPPED."""
        self._emergency = True
        self._rest_all()

    def _rest_all(self) -> None:
        self.braking.stop()
        self.unloading.stop()
        self.yielding.stop()
        self._growth.end()
        self._unloads = self._yields = False
        self._doubted[:] = False

    def press_stop(self) -> None:
        """Cut as emergency_stop() does; holds, in every mode, until release_stop()."""
        self.emergency_stop()
        # The next sample brakes, as after any end of motion.
        self._pressed = self._brakes = True

    def release_stop(self) -> None:
        """Let a reset lift what press_stop() holds."""
        self._pressed = False

    def _judge_commands(self, now_s: float, mode: OperatingMode, card_expired: bool) -> None:
        at_rest = mode not in MOVING
        if self.ending and not at_rest:
            self.safety.trip(BridgeFault(FaultName.ENDING, "asked to end, and nobody unloads"))
        if not self._watchdog.check(now_s, at_rest):
            self.safety.trip(BridgeFault(FaultName.COMMAND_AGE, self._watchdog.fault))
        if card_expired and (self._recovers or not at_rest):
            self.safety.trip(
                BridgeFault(FaultName.CARD, "the card's own watchdog has zeroed the outputs")
            )

    def _react(
        self, fault: BridgeFault, now_s: float, bridge: Bridge, mode: OperatingMode, moved: bool
    ) -> None:
        """Begin the reaction to a new fault, or to a harder one in place of another's.

        Args:
            fault: in force.
            now_s: of the sample [s].
            bridge: that took it.
            mode: newest mode.
            moved: whether limbs moved when it was found.
        """
        self._rest_all()
        if fault.name in POSE_LOST and self.safety.last_pose is not None:
            # What it seemed to do must not go on either.
            bridge.set_pose(*self.safety.last_pose)
        if self._emergency or not (moved or mode in MOVING):
            return
        self._known = np.isfinite(self.safety.tension_bound)
        self._trusted = self._known.copy()
        if fault.limb >= 0 and bridge.zeroed[fault.limb]:
            # Its zero may be wrong. Without one the limb only pays out by its encoder.
            self._trusted[fault.limb] = False
        self._unloads = fault.reaction == Reaction.UNLOAD
        self._doubted[:] = self.safety.doubtful
        if fault.name == FaultName.ENCODER:
            self._doubted[fault.limb] = True
        sound = fault.name in BRAKED
        if fault.name == FaultName.MOTION:
            sound = not (self.safety.drives_unseen or self.safety.driving.any())
        # A robot that may move goes on for a while, and a switch needs neither pose nor sensor.
        follows = self.safety.robot_moves(now_s, mode) and sound
        follows = follows and (self._unloads or fault.name in FOLLOWED)
        self._yields = fault.name in POSE_LOST or follows
        if fault.name == FaultName.MOTION:
            self._trusted &= ~self._doubted
        if sound:
            self.braking.begin(now_s, fault.name == FaultName.WRENCH)
        if fault.name in DOUBTING:
            # After others motors do as they are told: what the sensor does not feel may be its own
            # fault, or without zeros a cable that pulls before its bound says so.
            self._growth.begin(bridge, self.safety.tension_bound)

    def _goes_on(self, fault: BridgeFault) -> bool:
        """Whether a motor goes beyond its current after a fault that no harder one replaces."""
        if fault.reaction != Reaction.CUT:
            return False
        drives = self.safety.driving
        if fault.name != FaultName.MOTION:
            # What an encoder tells that is not believed is no reason.
            drives = drives & ~self._doubted
        return bool(drives.any())

    def _recover(self, now_s: float, bridge: Bridge) -> None:
        """Take the reaction's next step."""
        speed = self.safety.braking_speed(self._doubted)
        fault = self.fault
        if self.safety.drives_unseen or (fault is not None and self._goes_on(fault)):
            self._rest_all()
        dt_s, self._last_s = now_s - self._last_s, now_s
        if self._growth.grows(dt_s, bridge, self.safety.tension_bound):
            # Neither encoders nor currents tell it: nothing that the bridge does may go on.
            self._rest_all()
        braked = self.braking.active
        if braked:
            self.braking.step(now_s, speed)
        tension = self.safety.tension_bound
        elongation = tension / bridge.limbs["stiffness"]
        stands = braked and not self.braking.active and self.unloading.active
        if self._unloads or stands:
            # What was gained until all motors stand is unloaded with the rest.
            self._unloads = False
            self.unloading.begin(now_s, tension, elongation, self._trusted)
        elif self.unloading.active:
            self.unloading.step(now_s, tension, elongation, speed)
        pulls = np.where(self._doubted, np.nan, tension)
        if self._yields:
            self._yields = False
            # It only pays out, by switches: a zero or an encoder that is wrong does no harm.
            self.yielding.begin(now_s, self._known, pulls)
        self.yielding.step(now_s, bridge.switch_closed, pulls, speed)
