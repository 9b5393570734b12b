"""What the limb controller does with each limb state: mode, tension command and law to currents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.limb_law import LimbLaw
from cabols_control.modes import OperatingMode
from cabols_control.rig import Rig

LONGEST_STEP_S = 0.010
"""A longer gap between states makes a derivative worthless: the law is reset without a bump."""


@dataclass(frozen=True, eq=False)
class LimbSample:
    """One limb state, arrays of (n,).

    Attributes:
        stamp_s: when the card was sampled [s].
        wound_length: [m].
        elongation: [m], NaN before zeroing.
        tension: estimate [N], NaN before zeroing.
        switch_closed: bool.
        zeroed: bool.
    """

    stamp_s: float
    wound_length: FloatArray
    elongation: FloatArray
    tension: FloatArray
    switch_closed: BoolArray
    zeroed: BoolArray


@dataclass(frozen=True, eq=False)
class TensionSetpoint:
    """Newest tension command: (n,) tension [N] that answers the state stamped stamp_s [s]."""

    stamp_s: float
    tension: FloatArray
    active: bool


@njit(cache=True)
def _references_into(
    zeroed: BoolArray,
    closed: BoolArray,
    wound: FloatArray,
    elongation: FloatArray,
    tension: FloatArray,
    wanted: FloatArray,
    gain: FloatArray,
    tension_limit: float,
    speed: float,
    by_tension: BoolArray,
    changed: BoolArray,
    position: FloatArray,
    reference: FloatArray,
) -> None:
    """Tension control for limbs with a known zero, winding for the others; all (n,)."""
    for i in range(wound.shape[0]):
        changed[i] = by_tension[i] != zeroed[i]
        by_tension[i] = zeroed[i]
        if zeroed[i]:
            limited = min(max(wanted[i], 0.0), tension_limit)
            # 0 * x is NaN for what is not finite, and the law refuses that.
            reference[i] = gain[i] * (limited - tension[i]) + 0.0 * wanted[i]
            position[i] = elongation[i]
        else:
            # A switch that is closed before its zero is known must open first: the zero is set
            # where it closes.
            reference[i] = -speed if closed[i] else speed
            position[i] = wound[i]


class LimbController:
    """Pure core of the limb_controller node for all limbs, or a subset.

    Attributes:
        current: (n,) newest output [A].
        fault: why the output is held at zero; empty while all is well.
    """

    def __init__(
        self, rig: Rig, limbs: list[int] | None = None, command_timeout: float | None = None
    ) -> None:
        """Start with zero current.

        Args:
            rig: configuration.
            limbs: indices of the limbs to drive; None for all.
            command_timeout: replaces the configuration's [s].
        """
        chosen = list(range(rig.geometry.cables)) if limbs is None else limbs
        self.limbs = np.array(chosen, dtype=np.int64)
        self._law = LimbLaw([rig.gains.limbs[i] for i in chosen], rig.control.current_limit)
        self._timeout = command_timeout or rig.control.command_timeout
        self._speed = rig.control.pretension_speed
        self._hold = np.full(len(chosen), 1.3 * rig.limbs.switch_tension)
        self._tension_limit = rig.control.tension_max
        self._reference = np.zeros(len(chosen))
        self._position = np.zeros(len(chosen))
        self._by_tension = np.zeros(len(chosen), dtype=np.bool_)
        self._changed = np.zeros(len(chosen), dtype=np.bool_)
        self._moving = False
        everything = chosen == list(range(rig.geometry.cables))
        self._pick: slice | IntArray = slice(None) if everything else self.limbs
        self._last_stamp = -np.inf
        self.current = np.zeros(len(chosen))
        self.fault = ""

    def trip(self, reason: str) -> None:
        """Hold the output at zero for a reason from outside; the first reason stays."""
        self.fault = self.fault or reason

    @property
    def saturated(self) -> BoolArray:
        """(n,) bool, true where the current limit cuts the law's output."""
        return self._law.saturated

    def step(
        self, sample: LimbSample, mode: OperatingMode, setpoint: TensionSetpoint | None
    ) -> FloatArray:
        """Answer one limb state.

        Returns:
            (n,) current [A]; zero in STOPPED, FAULT and after any fault until the mode has been
            STOPPED. The same array at every call.
        """
        dt_s = sample.stamp_s - self._last_stamp
        if not dt_s > 0.0:
            return self.current
        self._last_stamp = sample.stamp_s
        if mode == OperatingMode.STOPPED:
            self.fault = ""
        if not self.fault and mode == OperatingMode.LOADING:
            self.fault = self._why_not_load(sample, setpoint)
        if self.fault or mode not in (OperatingMode.PRETIGHTENING, OperatingMode.LOADING):
            return self._rest()
        changed = self._set_references(sample, mode, setpoint)
        if not self._moving or dt_s > LONGEST_STEP_S:
            changed[:] = True
            self._moving = True
        if changed.any():
            self._restart(changed)
        if dt_s <= LONGEST_STEP_S:
            if not self._law.advance(self._reference, self._position, dt_s):
                self.fault = "not finite: tension_command, or limb_state's elongation or tension"
                return self._rest()
            self.current[:] = self._law.current
        return self.current

    def _why_not_load(self, sample: LimbSample, setpoint: TensionSetpoint | None) -> str:
        if setpoint is None:
            return "no tension_command has arrived: is the wrench controller running?"
        age = sample.stamp_s - setpoint.stamp_s
        if not age <= self._timeout:
            return (
                f"tension_command is stale: {1e3 * age:.1f} ms old, "
                f"{1e3 * self._timeout:.1f} ms allowed"
            )
        if not sample.zeroed[self._pick].all():
            missing = self.limbs[~sample.zeroed[self.limbs].astype(bool)]
            return f"limbs {missing.tolist()} are not pre-tightened"
        return ""

    def _rest(self) -> FloatArray:
        self.current[:] = 0.0
        self._moving = False
        return self.current

    def _set_references(
        self, sample: LimbSample, mode: OperatingMode, setpoint: TensionSetpoint | None
    ) -> BoolArray:
        """Fill reference and position; return (n,) bool, where the kind of control changes."""
        loading = mode == OperatingMode.LOADING and setpoint is not None and setpoint.active
        wanted = setpoint.tension if loading and setpoint is not None else self._hold
        pick = self._pick
        _references_into(
            sample.zeroed[pick],
            sample.switch_closed[pick],
            sample.wound_length[pick],
            sample.elongation[pick],
            sample.tension[pick],
            wanted,
            self._law.tension_gain,
            self._tension_limit,
            self._speed,
            self._by_tension,
            self._changed,
            self._position,
            self._reference,
        )
        return self._changed

    def _restart(self, which: BoolArray) -> None:
        """Continue from the present currents, at rest, without a bump."""
        for i in np.flatnonzero(which):
            position = float(self._position[i])
            if np.isfinite(position):
                self._law.reset(int(i), position, float(self.current[i]))
