"""The safety envelope: the bridge's limits, whatever the controllers command; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.naming import limb_name
from cabols_control.rig import Rig
from cabols_control.supervision.faults import OVERLOAD, FaultName
from cabols_control.supervision.modes import LOADED, MOVING, OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety import rules
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import AXES, BridgeFault, same_kind
from cabols_hw.safety.pose import PoseWatch
from cabols_hw.safety.rules import Rule

BY_TENSION = (*LOADED, OperatingMode.FREE_MOVING)
"""Modes in which the zeroed limbs' estimates decide about currents."""
LONGEST_STEP_S = 0.005
"""Longest gap between samples over which speeds continue; most time that one sample counts [s]."""


class SafetyEnvelope:
    """Compares every sample and every pose with the rig's limits.

    Attributes:
        fault: first broken rule, kept until the mode is STOPPED; None without one.
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
        self._limb_limits = np.zeros(1, rules.LIMB_LIMITS)
        self._limb_limits["current_limit"] = current_limit
        for name in set(rules.LIMB_LIMITS.names or ()) - {"current_limit"}:
            self._limb_limits[name] = getattr(config, name)
        self._limbs = np.zeros(n, rules.LIMB_WATCH)
        self._limbs["gain"], self._limbs["time_constant"] = rig.limbs.gain, rig.limbs.time_constant
        self._limbs["last_speed"] = self._limbs["began"] = np.nan
        self._wrench_watch = np.zeros(1, rules.WRENCH_WATCH)
        for name in ("wrench_max", "estimate_force", "estimate_torque", "estimate_time"):
            self._wrench_watch[name] = getattr(config, name)
        self._wrench_max = np.array(config.wrench_max)
        self._pretightening = False
        self._relief_left_s = 0.0
        self._lowest_force = np.inf
        self._last_volts = np.full(6, np.nan)
        self._since_flat = np.zeros(6)
        self._last_s = np.nan
        self._pose = PoseWatch(rig, config)
        self.fault: BridgeFault | None = None

    def judge(self, now_s: float, bridge: Bridge, mode: OperatingMode) -> BridgeFault | None:
        """Compare one sample, just taken by the bridge, with all rules.

        Args:
            now_s: the sample's time on the card's clock [s].
            bridge: with the sample's values and the currents on the amplifiers.
            mode: operating mode. At rest nothing moves: only the sensor is judged then.

        Returns:
            The fault in force.
        """
        dt_s = now_s - self._last_s
        self._last_s = now_s
        fault = self._find(now_s, dt_s, bridge, mode)
        stopped = mode == OperatingMode.STOPPED
        if stopped:
            self._pose.rest()
        if (stopped or self._relieves(mode)) and not same_kind(self.fault, fault):
            self.fault = None
        self.fault = self.fault or fault
        return self.fault

    def warm_up(self, bridge: Bridge) -> None:
        """Compile what judge() reaches only in some states, for the bridge's own arrays."""
        rules.judge_wrench(
            1e-3,
            self._wrench_watch.copy(),
            bridge.wrench,
            bridge.tension,
            bridge.structure,
            bridge.rotation,
        )

    def trip(self, fault: BridgeFault) -> None:
        """Accept a fault that was found elsewhere; the first one stays."""
        self.fault = self.fault or fault

    def _find(
        self, now_s: float, dt_s: float, bridge: Bridge, mode: OperatingMode
    ) -> BridgeFault | None:
        moving = mode in MOVING
        if not moving or not 0.0 < dt_s <= LONGEST_STEP_S:
            rules.forget_motion(bridge.wound_length, self._limbs)
            if not moving:
                for name in ("cable_s", "current_s", "motion_s"):
                    self._limbs[name] = 0.0
            if moving and dt_s > self._config.state_age:
                return BridgeFault(
                    FaultName.STATE_AGE,
                    f"{1e3 * dt_s:.0f} ms without a sample, "
                    f"{1e3 * self._config.state_age:.0f} ms allowed",
                )
        self._note_pretightening(bridge, mode)
        sensor = self._judge_sensor(dt_s, bridge)
        if not moving:
            self._note_overload(sensor, bridge)
        if not moving or not dt_s > 0.0:
            return sensor
        dt_s = min(dt_s, LONGEST_STEP_S)
        self._relief_left_s -= dt_s
        relieves = self._relieves(mode)
        if relieves and sensor is not None and sensor.name == OVERLOAD:
            sensor = None
        found = self._judge_limbs(dt_s, bridge) or sensor or self._pose.judge(now_s, mode)
        if found is None and bridge.tared and not relieves:
            found = self._judge_wrench(dt_s, bridge, mode)
        return found

    def _note_overload(self, sensor: BridgeFault | None, bridge: Bridge) -> None:
        """Whether, at rest, a load that the gears hold is beyond the sensor's limits."""
        beyond = bridge.tared and bool((np.abs(bridge.wrench) > self._wrench_max).any())
        overloaded = beyond or (sensor is not None and sensor.name == OVERLOAD)
        self._relief_left_s = self._config.relief_time if overloaded else 0.0

    def _relieves(self, mode: OperatingMode) -> bool:
        """Whether FREE_MOVING is removing an overload that it found, the only way out of one.

        It lowers the tensions by encoders and switches, and their limits hold all the time.
        """
        return mode == OperatingMode.FREE_MOVING and self._relief_left_s > 0.0

    def _note_pretightening(self, bridge: Bridge, mode: OperatingMode) -> None:
        """Store the limbs' positions at the start of PRETIGHTENING."""
        pretightening = mode == OperatingMode.PRETIGHTENING
        if pretightening != self._pretightening:
            self._limbs["began"] = bridge.wound_length if pretightening else np.nan
            self._lowest_force = np.inf
            self._pretightening = pretightening

    def _judge_limbs(self, dt_s: float, bridge: Bridge) -> BridgeFault | None:
        rule, i = rules.judge_limbs(
            dt_s,
            self._limb_limits,
            self._limbs,
            bridge.wound_length,
            bridge.tension,
            bridge.current,
            bridge.switch_closed,
            bridge.zeroed,
        )
        if rule == Rule.FINE:
            return None
        config, tension = self._config, float(bridge.tension[i])
        if rule == Rule.ENCODER:
            return BridgeFault(
                FaultName.ENCODER,
                f"{limb_name(i)}: jumped to {self._limbs['last_speed'][i]:.1f} m/s",
                i,
            )
        if rule == Rule.TENSION:
            return BridgeFault(
                FaultName.TENSION,
                f"{limb_name(i)} pulls {tension:.1f} N, {config.tension_max:g} N allowed",
            )
        if rule == Rule.CABLE:
            return self._cable_or_switch(i, bridge)
        if rule == Rule.SWITCH:
            payout = 1e3 * config.switch_payout
            return BridgeFault(
                FaultName.SWITCH,
                f"{limb_name(i)}: closed after paying out {payout:.0f} mm: stuck?",
                i,
            )
        if rule == Rule.CURRENT:
            limit = self._limb_limits["current_limit"][0]
            return BridgeFault(
                FaultName.CURRENT,
                f"{limb_name(i)}: at its limit of {limit:g} A for "
                f"{1e3 * config.current_saturated:.0f} ms",
                i,
            )
        return BridgeFault(
            FaultName.MOTION,
            f"{limb_name(i)}: more than {config.motion_current:g} A are not in its motion; "
            "jammed, a slipping encoder or an amplifier's offset?",
            i,
        )

    def _cable_or_switch(self, i: int, bridge: Bridge) -> BridgeFault:
        """Distinguish a broken cable, whose force is missing, from a switch that is stuck open."""
        tension = float(bridge.tension[i])
        column = bridge.structure[:3, i]
        measured = bridge.rotation @ bridge.wrench[:3]
        missing = float(column @ (bridge.structure[:3] @ bridge.tension - measured))
        if missing > 0.5 * tension:
            return BridgeFault(
                FaultName.CABLE,
                f"{limb_name(i)}: elongation says {tension:.1f} N, switch and sensor say none: "
                "broken?",
                i,
            )
        return BridgeFault(
            FaultName.SWITCH, f"{limb_name(i)}: open at an estimated {tension:.1f} N: stuck?", i
        )

    def _judge_sensor(self, dt_s: float, bridge: Bridge) -> BridgeFault | None:
        rule, gauge = rules.judge_sensor(
            max(dt_s, 0.0),
            bridge.gauges,
            self._last_volts,
            bridge.saturated_volts,
            self._config.sensor_flat,
            self._since_flat,
        )
        if rule == Rule.FINE:
            # An axis can be beyond the sensor's range while every gauge is still valid.
            said = bridge.saturation
            return (
                BridgeFault(FaultName.SENSOR_SATURATED, f"force/torque sensor: {said}")
                if said
                else None
            )
        if rule == Rule.SENSOR_INVALID:
            return BridgeFault(
                FaultName.SENSOR_INVALID, f"force/torque sensor: gauge {gauge} is not a number"
            )
        volts = float(bridge.gauges[gauge])
        if rule == Rule.SENSOR_SATURATED:
            return BridgeFault(
                FaultName.SENSOR_SATURATED,
                f"force/torque sensor: a gauge is saturated: {gauge} at {volts:.2f} V",
            )
        return BridgeFault(
            FaultName.SENSOR_FLAT,
            f"force/torque sensor: gauge {gauge} has shown {volts:.4f} V for "
            f"{self._config.sensor_flat:g} s: a broken wire?",
        )

    def _judge_wrench(self, dt_s: float, bridge: Bridge, mode: OperatingMode) -> BridgeFault | None:
        if mode == OperatingMode.PRETIGHTENING:
            return self._judge_pretension(bridge)
        if mode not in BY_TENSION or not bridge.zeroed.all():
            self._wrench_watch["apart_s"] = 0.0
            return None
        rule, axis = rules.judge_wrench(
            dt_s,
            self._wrench_watch,
            bridge.wrench,
            bridge.tension,
            bridge.structure,
            bridge.rotation,
        )
        if rule == Rule.WRENCH:
            kind, unit = ("force", "N") if axis < 3 else ("torque", "N m")
            return BridgeFault(
                FaultName.WRENCH,
                f"{kind} {AXES[axis % 3]} is {bridge.wrench[axis]:.1f} {unit}, "
                f"{self._wrench_max[axis]:g} {unit} allowed",
            )
        if rule == Rule.ESTIMATE:
            return BridgeFault(
                FaultName.ESTIMATE,
                "the force/torque sensor and the tension estimates disagree by more than "
                f"{self._config.estimate_force:g} N or {self._config.estimate_torque:g} N m",
            )
        return None

    def _judge_pretension(self, bridge: Bridge) -> BridgeFault | None:
        """Find a limb that keeps winding in because its switch does not close.

        A load that the gears hold since a cut is present from the start: only the growth over the
        lowest force since then counts.
        """
        force = bridge.rotation @ bridge.wrench[:3]
        size = float(np.linalg.norm(force))
        self._lowest_force = min(self._lowest_force, size)
        if size - self._lowest_force <= self._config.pretension_force or bridge.zeroed.all():
            return None
        # Of the limbs whose switch is still open, the one that pulls in this direction.
        along = np.where(bridge.zeroed, -np.inf, bridge.structure[:3].T @ force)
        i = int(np.argmax(along))
        return BridgeFault(
            FaultName.SWITCH,
            f"{limb_name(i)}: the pull has grown to {size:.0f} N in PRETIGHTENING, by more than "
            f"{self._config.pretension_force:g} N, and its switch is open: stuck?",
            i,
        )

    def hear_pose(self, now_s: float, position: FloatArray, rotation: FloatArray) -> bool:
        """Take a platform pose, to be judged with the next sample; see PoseWatch.hear.

        Args:
            now_s: when it arrived, on the card's clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        return self._pose.hear(now_s, position, rotation)
