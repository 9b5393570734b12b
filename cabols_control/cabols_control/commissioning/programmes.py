# SPDX-License-Identifier: Apache-2.0
"""Commissioning programmes of one limb: next command, end, record; pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cabols_control.checks import FloatArray, in_range
from cabols_control.errors import CabolsError
from cabols_control.limb_control.records import ControlKind
from cabols_control.naming import limb_name, limb_names
from cabols_control.result_code import ResultCode

if TYPE_CHECKING:
    from cabols_control.limb_control.controller import LimbSample

COLUMNS = ("time", "current", "wound_length", "elongation", "tension")
STEP, RAMP = "step", "ramp"
SLACK_M = 0.005
"""Length paid out beyond the opening of the switch, so that the step starts with a slack cable."""
SETTLE_S = 0.3
STILL_M = 20e-6
"""Largest motion within SETTLE_S of a motor at rest."""
SLOW_ZONE_M = 0.03
"""Last part of the way back, wound at pretension_speed because the cable gets tight there."""
LOW_TENSION_N = 2.0
"""The ramp's lowest tension: "0 N", but never slack."""
GUARD_MARGIN_N = 5.0
"""Margin above the largest command, for noise and overshoot."""


class CommissioningError(CabolsError):
    """A commissioning programme cannot be run, or what it recorded cannot be used.

    Attributes:
        code: why, for programs.
    """

    def __init__(self, reason: str, code: ResultCode = ResultCode.FAILED) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True)
class CommissioningConfig:
    """How a limb is excited.

    Attributes:
        step_current: size of the step [A], applied PAYING OUT (negative): it cannot tighten.
        step_travel: cable length after which the step ends and the motor coasts [m].
        step_time: longest step [s].
        travel: beyond it the motor is braked [m]; half as much again ends the programme.
        ramp_tension: peak of the ramp [N].
        ramp_rate: [N/s].
        timeout: of one programme [s].
    """

    step_current: float = 0.5
    step_travel: float = 0.1
    step_time: float = 2.0
    travel: float = 0.3
    ramp_tension: float = 150.0
    ramp_rate: float = 20.0
    timeout: float = 60.0

    def __post_init__(self) -> None:
        """Check ranges."""
        in_range("step_current", self.step_current, 0.05, 3.0)
        in_range("travel", self.travel, 0.01, 2.0)
        in_range("step_travel", self.step_travel, 0.005, self.travel)
        in_range("step_time", self.step_time, 0.1, 10.0)
        in_range("ramp_tension", self.ramp_tension, 10.0, 1000.0)
        in_range("ramp_rate", self.ramp_rate, 1.0, 200.0)
        in_range("timeout", self.timeout, 1.0, 600.0)


class Programme:
    """Base of both programmes: limb, time, guards, record.

    Attributes:
        limb: index from 0.
        hold_others: whether the other limbs hold the holding tension; else they rest.
        started: whether it has received a sample.
        done: whether it is over.
        fault: why it ended early; empty if it did not.
        phase: present phase, one word.
    """

    kind = ""
    hold_others = False

    def __init__(self, limb: int, config: CommissioningConfig, tension_max: float) -> None:
        """Wait for the first sample.

        Args:
            limb: index from 0.
            config: how to excite.
            tension_max: of the rig [N].
        """
        self.limb = limb
        self.started = False
        self.done = False
        self.fault = ""
        self.phase = "waiting"
        self._config = config
        self._tension_max = tension_max
        self._began_s = self._phase_s = self._now_s = 0.0
        self._recording = False
        dtype = [(name, np.float64) for name in COLUMNS]
        self._row = np.zeros(1, dtype)
        self._data = np.zeros(round(1000.0 * config.timeout) + 1, dtype)
        self._rows = 0

    @property
    def record(self) -> dict[str, FloatArray]:
        """Arrays of (k,) by the names of COLUMNS, SI units; time from the record's start."""
        data = self._data[: self._rows]
        found = {name: data[name].copy() for name in COLUMNS}
        if self._rows:
            found["time"] -= data["time"][0]
        return found

    @property
    def record_start_s(self) -> float:
        """Stamp of the record's first sample [s]; NaN if there is none."""
        return float(self._data["time"][0]) if self._rows else float("nan")

    def step(self, sample: LimbSample) -> tuple[int, float]:
        """Return the limb's ControlKind and its value for one sample."""
        limb = self.limb
        now_s, wound = sample.stamp_s, float(sample.wound_length[limb])
        tension, zeroed = float(sample.tension[limb]), bool(sample.zeroed[limb])
        closed = bool(sample.switch_closed[limb])
        row = self._row
        row["time"], row["wound_length"], row["tension"] = now_s, wound, tension
        row["elongation"] = sample.elongation[limb]
        self._now_s = now_s
        if not self.started:
            self.started = True
            self._began_s = self._phase_s = now_s
            self.begin(sample)
        elif not now_s - self._began_s <= self._config.timeout:
            self.abort(f"not done within {self._config.timeout:g} s, in phase {self.phase}")
        if zeroed and not tension <= self._tension_max + GUARD_MARGIN_N:
            self.abort(f"tension {tension:.1f} N, {self._tension_max:g} N allowed")
        return (ControlKind.REST, 0.0) if self.done else self.advance(wound, closed)

    @property
    def progress(self) -> float:
        """Share that is done, roughly."""
        raise NotImplementedError

    def begin(self, sample: LimbSample) -> None:
        """Take the first sample."""
        raise NotImplementedError

    def advance(self, wound: float, closed: bool) -> tuple[int, float]:
        """Return the command for one sample within the guards.

        Args:
            wound: cable length on the limb's winch, less when paid out [m].
            closed: whether its limit switch is closed, as under a tight cable.

        Returns:
            ControlKind and its value: current [A], speed, positive winds [m/s], or tension [N].
        """
        raise NotImplementedError

    def take(self, current: float) -> None:
        """Record the newest sample with the current that answers it [A]."""
        if self._recording and not self.done and self._rows < self._data.shape[0]:
            self._row["current"] = current
            self._data[self._rows] = self._row[0]
            self._rows += 1

    def abort(self, reason: str) -> None:
        """End at once; does nothing when done."""
        if not self.done:
            self.done, self.fault = True, f"{limb_name(self.limb)}, {self.kind}: {reason}"

    def _enter(self, phase: str) -> None:
        self.phase, self._phase_s = phase, self._now_s

    def _elapsed(self) -> float:
        return self._now_s - self._phase_s


class StepProgramme(Programme):
    """Current step with a slack cable, then coasting to rest, then winding back.

    Slacken (until the switch is open and 5 mm more), stand, step, coast, back to where it was or
    to where the switch closes. Recorded from standing to the end of the coasting: what (3.11) and
    dry friction are identified from, see identify_limb_with_friction. The others rest.
    """

    kind = STEP

    def __init__(
        self,
        limb: int,
        config: CommissioningConfig,
        tension_max: float,
        slow: float,
        fast: float,
    ) -> None:
        """Wait for the first sample.

        Args:
            limb: index from 0.
            config: how to excite.
            tension_max: of the rig [N].
            slow: winding speed near a tight cable [m/s].
            fast: winding speed on the way back [m/s].
        """
        super().__init__(limb, config, tension_max)
        self._slow, self._fast = slow, fast
        self._home = self._open = self._start = np.nan
        self._still_s, self._still_at = 0.0, 0.0

    @property
    def progress(self) -> float:
        """Share that is done, roughly."""
        phases = ("waiting", "slacken", "stand", STEP, "coast", "brake", "back")
        return 1.0 if self.done else phases.index(self.phase) / len(phases)

    def begin(self, sample: LimbSample) -> None:
        """Store the limb's position."""
        self._home = self._open = float(sample.wound_length[self.limb])
        self._enter("slacken")

    def advance(self, wound: float, closed: bool) -> tuple[int, float]:
        """Return the command of the present phase; aborts on a way or a switch that cannot be.

        Args:
            wound: cable length on the winch [m].
            closed: whether the limit switch is closed.
        """
        if not abs(wound - self._home) <= 1.5 * self._config.travel:
            self.abort(
                f"travelled {abs(wound - self._home):.3f} m, {self._config.travel:g} m meant"
            )
            return ControlKind.REST, 0.0
        if self.phase == "slacken":
            return self._slacken(wound, closed)
        if closed and self.phase in ("stand", STEP, "coast", "brake"):
            self.abort("the switch closed while the cable was paid out: switch or cable stuck?")
            return ControlKind.REST, 0.0
        if self.phase == "back":
            return self._back(wound, closed)
        return self._excite(wound)

    def _slacken(self, wound: float, closed: bool) -> tuple[int, float]:
        if closed:
            self._open = wound
        if wound > self._open - SLACK_M:
            return ControlKind.SPEED, -self._slow
        self._enter("stand")
        return ControlKind.CURRENT, 0.0

    def _excite(self, wound: float) -> tuple[int, float]:
        config, elapsed = self._config, self._elapsed()
        if self.phase == "stand":
            # Only the end of the rest is recorded, when the motor has come to a stop.
            self._recording = elapsed >= 0.5 * SETTLE_S
            if elapsed < SETTLE_S:
                return ControlKind.CURRENT, 0.0
            self._start = wound
            self._enter(STEP)
        paid_out = self._start - wound
        if self.phase == STEP:
            if paid_out < config.step_travel and self._elapsed() < config.step_time:
                return ControlKind.CURRENT, -config.step_current
            self._enter("coast")
            self._still_s, self._still_at = self._now_s, wound
        if self.phase == "coast" and paid_out > config.travel:
            self._enter("brake")
        if abs(wound - self._still_at) > STILL_M:
            self._still_s, self._still_at = self._now_s, wound
        if self._now_s - self._still_s >= SETTLE_S:
            self._recording = False
            self._enter("back")
        return (ControlKind.SPEED, 0.0) if self.phase == "brake" else (ControlKind.CURRENT, 0.0)

    def _back(self, wound: float, closed: bool) -> tuple[int, float]:
        if closed or wound >= self._home:
            self.done = True
            return ControlKind.REST, 0.0
        near = min(self._home, self._open) - wound < SLOW_ZONE_M
        return ControlKind.SPEED, self._slow if near else self._fast


class RampProgramme(Programme):
    """Slow ramp of one limb's tension, up and down; the others hold the holding tension.

    All limbs must be pre-tightened. From the holding tension to 2 N, the peak, 2 N and back.

    Attributes:
        peak: highest tension [N].
    """

    kind = RAMP
    hold_others = True

    def __init__(
        self,
        limb: int,
        config: CommissioningConfig,
        tension_max: float,
        hold: float,
        peak: float,
    ) -> None:
        """Wait for the first sample.

        Args:
            limb: index from 0.
            config: how to excite.
            tension_max: of the rig [N].
            hold: holding tension [N].
            peak: highest tension, see rig_programmes.largest_ramp [N].
        """
        super().__init__(limb, config, tension_max)
        self.peak = in_range("peak", peak, 2.0 * hold, tension_max)
        corners = np.array([hold, hold, LOW_TENSION_N, peak, LOW_TENSION_N, hold, hold])
        times = np.abs(np.diff(corners)) / config.ramp_rate
        times[times == 0.0] = SETTLE_S
        self._corners = corners
        self._times = np.concatenate([[0.0], np.cumsum(times)])
        self._wrenches = np.zeros((self._data.size, 6))
        self._wrench_times = np.zeros(self._data.size)
        self._wrench_rows = 0

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """(k,) stamps [s] and (k, 6) wrenches [N, N m] taken during the ramp."""
        taken = slice(self._wrench_rows)
        return self._wrench_times[taken].copy(), self._wrenches[taken].copy()

    def take_wrench(self, stamp_s: float, wrench: FloatArray) -> None:
        """Record one measured wrench, between the programme's first sample and its end.

        Args:
            stamp_s: of its measurement [s].
            wrench: (6,) on the platform, platform axes [N, N m].
        """
        row = self._wrench_rows
        if self._recording and not self.done and row < self._wrenches.shape[0]:
            self._wrench_times[row], self._wrenches[row] = stamp_s, wrench
            self._wrench_rows = row + 1

    @property
    def progress(self) -> float:
        """Share that is done."""
        return 1.0 if self.done else min(self._elapsed() / float(self._times[-1]), 1.0)

    def begin(self, sample: LimbSample) -> None:
        """Check that all limbs have a zero."""
        missing = np.flatnonzero(~np.asarray(sample.zeroed, dtype=np.bool_))
        if missing.size:
            self.abort(f"not pre-tightened: {limb_names(missing)}")
        self._recording = True
        self._enter("ramp")

    def advance(self, wound: float, closed: bool) -> tuple[int, float]:
        """Return the ramp's tension.

        Args:
            wound: not looked at, as the ramp goes by time alone.
            closed: likewise.
        """
        del wound, closed
        elapsed = self._elapsed()
        if elapsed > self._times[-1]:
            self.done = True
            return ControlKind.REST, 0.0
        return ControlKind.TENSION, float(np.interp(elapsed, self._times, self._corners))
