# SPDX-License-Identifier: Apache-2.0
"""The safety envelope: the bridge's limits, whatever the controllers command; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.rig import Rig
from cabols_control.supervision.clock import CLOCK_BACK_S
from cabols_control.supervision.faults import OVERLOAD, FaultName
from cabols_control.supervision.modes import LOADED, MOVING, OperatingMode
from cabols_hw.bridge.braking import STILL_M_S, STOP_TIME_S
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety import limb_rules, rules
from cabols_hw.safety.changes import ChangeWatch
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import POSE_LOST, BridgeFault, same_kind
from cabols_hw.safety.limb_faults import (
    alone_missing,
    cable_or_switch,
    limb_fault,
    unseen_fault,
)
from cabols_hw.safety.pose import PoseWatch
from cabols_hw.safety.rules import Rule
from cabols_hw.safety.search import SearchWatch
from cabols_hw.safety.sensor_faults import estimate_fault, sensor_fault, wrench_fault
from cabols_hw.safety.surges import CERTAIN_AS, SURGE_SAMPLES, SURPLUS_AS
from cabols_hw.safety.unseen import UnseenPull

BY_TENSION = (*LOADED, OperatingMode.FREE_MOVING, OperatingMode.PRETIGHTENING)
"""Modes in which the zeroed limbs' estimates decide about currents."""
SEARCHING = (OperatingMode.PRETIGHTENING, OperatingMode.FREE_MOVING)
"""Modes in which limbs without a zero wind in until their switches close."""
MISSED_S = 0.1
"""How long the sensor must miss a limb that its switch calls slack [s]."""
BEHIND_M_S = 0.05
"""By which friction and load keep a motor behind its modelled speed, at most [m/s]."""
LONGEST_STEP_S = 0.005
"""Longest gap between samples over which speeds continue; most time that one sample counts [s]."""


class SafetyEnvelope:
    """Compares every sample and every pose with the rig's limits.

    Attributes:
        fault: first broken rule, or a later one whose reaction is harder; kept until the mode is
            STOPPED; None without one.
    """

    def __init__(self, rig: Rig, config: SafetyConfig, current_limit: float) -> None:
        """Start without any sample.

        Args:
            rig: geometry and limbs.
            config: limits.
            current_limit: what the bridge limits currents to [A].
        """
        n = rig.geometry.cables
        self._config = config
        self._limb_limits = limb_rules.limits_of(config, rig, current_limit)
        self._limbs = limb_rules.watch_of(rig, STOP_TIME_S, current_limit)
        self._wrench_watch = np.zeros(1, rules.WRENCH_WATCH)
        for name in ("wrench_max", "estimate_force", "estimate_torque", "estimate_time"):
            self._wrench_watch[name] = getattr(config, name)
        self._wrench_max = np.array(config.wrench_max)
        self._mode = OperatingMode.STOPPED
        self._relief_left_s = 0.0
        self._search = SearchWatch(n, config.pretension_force)
        self._changes = ChangeWatch(config)
        self._unseen = UnseenPull(n)
        self._last_volts = np.full(6, np.nan)
        self._since_flat = np.zeros(6)
        self._last_s = np.nan
        self._missed_s = 0.0
        self._pose = PoseWatch(rig, config)
        self._pose_lost = False
        self.fault: BridgeFault | None = None

    @property
    def tension_bound(self) -> FloatArray:
        """(n,) the most that each limb can pull by all that is known of it [N].

        With a zero it is the estimate; without one, what the switch showed when it last moved, or
        a slack cable at the start, and the motion since then.
        """
        bound: FloatArray = self._limbs["bound"]
        return bound

    @property
    def last_pose(self) -> tuple[FloatArray, FloatArray] | None:
        """Newest pose of the platform that was used: (3,) [m] and (3, 3); None: none."""
        return self._pose.place

    @property
    def speed(self) -> FloatArray:
        """(n,) of the motors, winding in [m/s]; 0 where it is not known."""
        speed: FloatArray = np.nan_to_num(self._limbs["last_speed"])
        return speed

    @property
    def most_speed(self) -> FloatArray:
        """(n,) from which full current stops a motor that winds in within STOP_TIME_S [m/s]."""
        most: FloatArray = self._limbs["most_speed"]
        return most

    @property
    def allowed_current(self) -> FloatArray:
        """(n,) currents that make no motor faster than that; a view [A]."""
        allowed: FloatArray = self._limbs["allowed"]
        return allowed

    @property
    def doubtful(self) -> BoolArray:
        """(n,) limbs whose motion and current do not fit: their encoders may have stopped."""
        behind = self._limbs["modelled"] - self.speed > BEHIND_M_S
        doubtful: BoolArray = behind | (self._limbs["motion_s"] > 0.0)
        return doubtful

    @property
    def driving(self) -> BoolArray:
        """(n,) motors that go on their own, beyond their current: amplifiers may be the fault.

        One that stays behind its current may be jammed or not be counted: its amplifier is sound.
        So is it where the speed went up in a single sample, as a current cannot make it, unless it
        goes on.
        """
        watch, speed = self._limbs, self.speed
        lasting = watch["motion_s"] > 0.5 * self._config.motion_time
        ahead = lasting & (watch["motion_sign"] * speed > STILL_M_S)
        surges = np.abs(watch["surge"]) >= SURGE_SAMPLES
        charge = np.maximum(watch["surplus"], watch["against"])
        drives = ahead | surges | (charge > SURPLUS_AS)
        found: BoolArray = drives & (watch["stepped"] == 0.0) | (charge > CERTAIN_AS)
        return found

    @property
    def drives_unseen(self) -> bool:
        """Whether the sensor feels a motor that winds in while its encoder stands still."""
        return self._unseen.limb >= 0

    def braking_speed(self, doubted: BoolArray) -> FloatArray:
        """(n,) speeds, winding in: of doubted limbs by the currents, of others by encoders [m/s].

        Args:
            doubted: (n,) limbs whose encoders are not believed.
        """
        return np.where(doubted, self._limbs["modelled"], self.speed)

    def judge(
        self, now_s: float, bridge: Bridge, mode: OperatingMode, recovers: bool = False
    ) -> BridgeFault | None:
        """Compare one sample, just taken by the bridge, with all rules.

        Args:
            now_s: the sample's time on the card's clock [s].
            bridge: with the sample's values and the currents on the amplifiers.
            mode: operating mode. At rest nothing moves: only the sensor is judged then.
            recovers: whether the bridge itself moves limbs, whatever the mode.

        Returns:
            The fault in force.
        """
        dt_s = now_s - self._last_s
        self._last_s = now_s
        fault = self._find(now_s, dt_s, bridge, mode, recovers)
        stopped = mode == OperatingMode.STOPPED
        if stopped:
            self._pose.rest()
            self._pose_lost = False
        if (stopped or self.relieves(mode)) and not same_kind(self.fault, fault):
            self.fault = None
        self.trip(fault)
        return self.fault

    def warm_up(self, bridge: Bridge) -> None:
        """Compile what judge() reaches only in some states, for the bridge's own arrays."""
        self._note_unseen(bridge)
        self._unseen.begin()
        rules.judge_wrench(
            1e-3,
            self._wrench_watch.copy(),
            bridge.wrench,
            bridge.tension,
            bridge.structure,
            bridge.rotation,
            self._limbs,
        )

    def trip(self, fault: BridgeFault | None) -> None:
        """Accept a fault; of two the one with the harder reaction stays, else the first."""
        if fault is not None and (self.fault is None or fault.reaction > self.fault.reaction):
            self.fault = fault
            self._pose_lost = self._pose_lost or fault.name in POSE_LOST

    def _find(
        self, now_s: float, dt_s: float, bridge: Bridge, mode: OperatingMode, recovers: bool
    ) -> BridgeFault | None:
        moving = mode in MOVING or recovers
        if not 0.0 < dt_s <= LONGEST_STEP_S:
            limb_rules.forget_motion(self._limbs)
            self._unseen.begin()
            if moving and dt_s < -CLOCK_BACK_S:
                # Else what is old by the clock before would seem fresh for as long as the step.
                return BridgeFault(
                    FaultName.STATE_AGE, f"the samples' clock went back by {-dt_s:.3g} s"
                )
            if moving and dt_s > self._config.state_age:
                return BridgeFault(
                    FaultName.STATE_AGE,
                    f"{1e3 * dt_s:.0f} ms without a sample, "
                    f"{1e3 * self._config.state_age:.0f} ms allowed",
                )
        self._note_search(bridge, mode)
        sensor = self._judge_sensor(dt_s, bridge)
        if not moving:
            self._note_overload(sensor, bridge)
        if not moving or bridge.tared:
            self._changes.begin()
        if self._pose.anew:
            # As at a start: nothing is known of cables that were held while the robot was set up.
            self._pose.anew = False
            self._limbs["slack_stretch"] = np.nan
        if dt_s <= 0.0:
            return sensor
        dt_s = min(dt_s, LONGEST_STEP_S) if dt_s > 0.0 else LONGEST_STEP_S
        limbs = self._judge_limbs(dt_s, bridge, moving)
        if not moving:
            self._unseen.begin()
            return sensor
        if (unseen := self._judge_unseen(bridge, recovers)) is not None:
            return unseen
        self._relief_left_s -= dt_s
        relieves = self.relieves(mode)
        if relieves and sensor is not None and sensor.name == OVERLOAD:
            sensor = None
        found = limbs or sensor or self._pose.judge(now_s, mode)
        if found is None and not relieves:
            judge = self._judge_wrench if bridge.tared else self._judge_changes
            found = judge(dt_s, bridge, mode)
        return found

    def _note_overload(self, sensor: BridgeFault | None, bridge: Bridge) -> None:
        """Whether, at rest, a load that the gears hold is beyond the sensor's limits."""
        beyond = bridge.tared and bool((np.abs(bridge.wrench) > self._wrench_max).any())
        overloaded = beyond or (sensor is not None and sensor.name == OVERLOAD)
        self._relief_left_s = self._config.relief_time if overloaded else 0.0

    def robot_moves(self, now_s: float, mode: OperatingMode) -> bool:
        """Whether the robot may move: in FREE_MOVING, and on a path that it announces.

        Args:
            now_s: of the sample [s].
            mode: operating mode.
        """
        return mode == OperatingMode.FREE_MOVING or (mode in LOADED and self._pose.on_path(now_s))

    def relieves(self, mode: OperatingMode) -> bool:
        """Whether FREE_MOVING is removing an overload that it found, the only way out of one.

        It lowers the tensions by encoders and switches, and their limits hold all the time. The
        guard lets limbs pay out only, so that no load grows.

        Args:
            mode: operating mode.
        """
        return mode == OperatingMode.FREE_MOVING and self._relief_left_s > 0.0

    def _note_search(self, bridge: Bridge, mode: OperatingMode) -> None:
        """Forget the search of another mode; store where PRETIGHTENING began."""
        if mode == self._mode:
            return
        self._mode = mode
        self._search.begin()
        self._limb_limits["quantum"] = bridge.count_length
        self._limb_limits["searches"] = mode in SEARCHING
        self._limb_limits["follows"] = mode == OperatingMode.FREE_MOVING
        pretightening = mode == OperatingMode.PRETIGHTENING
        self._limbs["began"] = bridge.wound_length if pretightening else np.nan

    def _judge_limbs(self, dt_s: float, bridge: Bridge, acts: bool) -> BridgeFault | None:
        self._limb_limits["acts"] = acts
        rule, i = limb_rules.judge_limbs(
            dt_s,
            self._limb_limits,
            self._limbs,
            bridge.limbs,
            bridge.wound_length,
            bridge.tension,
            bridge.current,
            bridge.switch_closed,
        )
        if rule == Rule.FINE or (rule == Rule.SLACK and not self._is_slack(dt_s, i, bridge)):
            return None
        if rule == Rule.CABLE or rule == Rule.SLACK:
            return cable_or_switch(i, float(self._limbs["bound"][i]), bridge)
        return limb_fault(Rule(rule), i, self._limbs[i], self._limb_limits[0], self._config)

    def _is_slack(self, dt_s: float, i: int, bridge: Bridge) -> bool:
        """Whether the sensor, too, misses a limb whose switch has said for long that it is slack.

        A pose that is some millimetres off leaves a switch open, too.
        """
        missed = bridge.tared and bool(bridge.zeroed.all()) and alone_missing(i, bridge)
        self._missed_s = self._missed_s + dt_s if missed else 0.0
        return self._missed_s > MISSED_S

    def _judge_unseen(self, bridge: Bridge, recovers: bool) -> BridgeFault | None:
        limb = self._note_unseen(bridge)
        # Without a zero, too much is felt that no estimate explains, unless a motor is behind, too.
        felt = limb >= 0 and not self._pose_lost
        if felt and (bridge.zeroed.all() or (recovers and self.doubtful[limb])):
            return unseen_fault(limb, self._unseen.force)
        self._unseen.limb = -1
        return None

    def _note_unseen(self, bridge: Bridge) -> int:
        return self._unseen.note(
            bridge.wrench,
            self._limbs["bound"],
            bridge.structure,
            bridge.rotation,
            bridge.wound_length,
            bridge.count_length,
        )

    def _judge_sensor(self, dt_s: float, bridge: Bridge) -> BridgeFault | None:
        rule, gauge = rules.judge_sensor(
            # A gap proves nothing of the samples that are missing.
            min(max(dt_s, 0.0), LONGEST_STEP_S),
            bridge.gauges,
            self._last_volts,
            bridge.saturated_volts,
            self._config.sensor_flat,
            self._since_flat,
        )
        return sensor_fault(rule, gauge, bridge, self._config)

    def _judge_wrench(self, dt_s: float, bridge: Bridge, mode: OperatingMode) -> BridgeFault | None:
        self._wrench_watch["in_all"] = mode not in LOADED
        rule, axis = rules.judge_wrench(
            dt_s,
            self._wrench_watch,
            bridge.wrench,
            bridge.tension,
            bridge.structure,
            bridge.rotation,
            self._limbs,
        )
        if rule == Rule.WRENCH:
            return wrench_fault(axis, bridge.wrench, self._config)
        if mode in SEARCHING and not bridge.zeroed.all():
            return self._search.judge(bridge, mode)
        if mode not in BY_TENSION or not bridge.zeroed.all():
            self._wrench_watch["apart_s"] = 0.0
            return None
        if rule == Rule.ESTIMATE:
            return estimate_fault(self._config)
        return None

    def _judge_changes(
        self, dt_s: float, bridge: Bridge, mode: OperatingMode
    ) -> BridgeFault | None:
        """Judge what a sensor without a bias can tell."""
        if bridge.zeroed.all():
            return self._changes.judge(dt_s, bridge) if mode in BY_TENSION else None
        self._changes.begin()
        return self._search.judge(bridge, mode) if mode in SEARCHING else None

    def hear_pose(
        self,
        now_s: float,
        position: FloatArray,
        rotation: FloatArray,
        stamp_s: float | None = None,
    ) -> bool:
        """Take a platform pose, to be judged with the next sample; see PoseWatch.hear.

        After a fault of the pose none is used until STOPPED: the limbs would be unloaded by it.

        Args:
            now_s: when it arrived, on the card's clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
            stamp_s: of which moment it is, on that clock; None: now_s [s].
        """
        usable = self._pose.hear(now_s, position, rotation, stamp_s)
        return usable and not self._pose_lost

    def allow_path(self, now_s: float, speed: float, turning: float) -> None:
        """Allow an announced path's speeds under load for a while; see PoseWatch.allow_path.

        Args:
            now_s: of the newest sample [s].
            speed: of the platform [m/s].
            turning: of the platform [rad/s].
        """
        self._pose.allow_path(now_s, speed, turning)
