"""What the limb controller does with each limb state: mode, tension command and law to currents."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.limb_control.law import LimbLaw
from cabols_control.limb_control.loaded_step import ROWS, loaded_step_into
from cabols_control.limb_control.references import (
    FOLLOW,
    REST,
    SWITCH,
    TENSION,
    override_into,
    ramp_into,
    references_into,
)
from cabols_control.naming import limb_name, limb_names
from cabols_control.rig import Rig
from cabols_control.supervision.clock import clock_fault
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode

LONGEST_STEP_S = 0.010
"""A longer gap between states makes a derivative worthless: the law is reset without a bump."""
UNLOADED_WITHIN_N = 3.0
"""So near the holding tension a limb counts as unloaded: dry friction keeps it off the rest."""


class LimbSample(NamedTuple):
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


class TensionSetpoint(NamedTuple):
    """Newest tension command: (n,) tension [N] that answers the state stamped stamp_s [s]."""

    stamp_s: float
    tension: FloatArray
    active: bool


class Excitation(Protocol):
    """A commissioning programme on one limb; see cabols_control.commissioning.programmes."""

    limb: int
    """Index from 0."""
    hold_others: bool
    """Whether the other limbs hold the holding tension; else they rest."""
    started: bool
    done: bool

    def step(self, sample: LimbSample) -> tuple[int, float]:
        """Return the limb's kind of control (limb_references) and its value."""

    def take(self, current: float) -> None:
        """Record the limb's current that answers the newest sample [A]."""

    def abort(self, reason: str) -> None:
        """End at once; does nothing when done."""


class LimbController:
    """Pure core of the limb_controller node for all limbs, or a subset.

    Attributes:
        limbs: (m,) indices of the limbs it drives.
        current: (m,) newest output [A].
        fault: why the output is held at zero; None while all is well.
        unloaded: in UNLOADING, whether every zeroed limb is at the holding tension, within 3 N.
        excitation: commissioning programme that is waiting, running or over; None: none.
    """

    def __init__(
        self, rig: Rig, limbs: list[int] | None = None, command_timeout: float | None = None
    ) -> None:
        """Start with zero current.

        Args:
            rig: configuration.
            limbs: indices of the limbs to drive; None for all.
            command_timeout: replaces the configuration's [s]; a longer gap between states also
                ends a commissioning programme.
        """
        chosen = list(range(rig.geometry.cables)) if limbs is None else limbs
        n = len(chosen)
        self.limbs = np.array(chosen, dtype=np.int64)
        self._control = rig.control
        self._law = LimbLaw([rig.gains.limbs[i] for i in chosen], rig.control.current_limit)
        self._timeout = command_timeout or rig.control.command_timeout
        self._holding_tension = rig.holding_tension
        self._hold = np.full(n, rig.holding_tension)
        self._wanted = np.zeros(n)
        self._kind = np.zeros((n, 2), dtype=np.int64)
        self._present = np.zeros(n, dtype=np.int64)
        self._changed: BoolArray = np.zeros(n, dtype=np.bool_)
        rows = self._rows = np.zeros((ROWS, n))
        rows[0] = self._law.tension_gain
        self._length, self._rate, self._position, self._reference = rows[1:5]
        self._law.current = rows[5]
        self._moving = False
        self._mode = OperatingMode.STOPPED
        self._ramped = False
        self._all = chosen == list(range(rig.geometry.cables))
        self._pick: slice | IntArray = slice(None) if self._all else self.limbs
        self._last_stamp = -np.inf
        self.current: FloatArray = rows[6]
        self.fault: Fault | None = None
        self.unloaded = False
        self.excitation: Excitation | None = None

    def trip(self, fault: Fault) -> None:
        """Hold the output at zero for a fault from outside; the first fault stays."""
        self.fault = self.fault or fault

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
        if back := clock_fault("limb_state", dt_s):
            self.trip(back)
        elif not dt_s > 0.0:
            return self.current
        self._last_stamp = sample.stamp_s
        if mode == OperatingMode.STOPPED:
            self.fault = None
        if self.fault is None and mode == OperatingMode.LOADING:
            self.fault = self._why_not_load(sample, setpoint)
        entered = mode != self._mode
        self._mode = mode
        if self.excitation is not None:
            self._watch_excitation(self.excitation, mode, dt_s)
        if self.fault or mode not in MOVING:
            return self._rest()
        wanted, speed = self._plan(sample, mode, setpoint, entered, dt_s)
        changed = self._set_references(sample, wanted, speed, min(dt_s, LONGEST_STEP_S))
        if not self._moving or dt_s > LONGEST_STEP_S:
            self._changed[:] = changed = True
            self._moving = True
        if changed:
            self._restart(self._changed)
        if dt_s <= LONGEST_STEP_S:
            if not self._law.advance(self._reference, self._position, dt_s):
                self.fault = Fault(
                    FaultName.NOT_FINITE,
                    "not finite: tension_command, or limb_state's elongation or tension",
                )
                return self._rest()
            self.current[:] = self._law.current
        override_into(self._present, wanted, self._control.current_limit, self.current)
        if mode == OperatingMode.COMMISSIONING and self.excitation is not None:
            where = np.flatnonzero(self.limbs == self.excitation.limb)
            self.excitation.take(float(self.current[where].sum()))
        return self.current

    def step_loaded(
        self,
        stamp_s: float,
        mode: OperatingMode,
        setpoint: TensionSetpoint | None,
        state: Any,
        answer: Any,
    ) -> bool:
        """Do what step does, from message to message, in the usual case of a loaded rig.

        Args:
            stamp_s: of the limb state [s].
            mode: present one.
            setpoint: newest tension command.
            state: (1,) record of the LimbState, flags as uint8; see loaded_step_into.
            answer: (1,) record of the MotorCurrent; stamp, sequence, current, saturated are set.

        Returns:
            Whether it was the usual case. If not, nothing has changed: call step.
        """
        if mode != OperatingMode.LOADING or self._mode != mode or not self._moving:
            return False
        if self.fault or self.excitation is not None or setpoint is None or not self._all:
            return False
        dt_s = stamp_s - self._last_stamp
        age_s = abs(stamp_s - setpoint.stamp_s)
        if not 0.0 < dt_s <= LONGEST_STEP_S or not age_s <= self._timeout:
            return False
        control = self._control
        usual = loaded_step_into(
            state,
            setpoint.tension if setpoint.active else self._hold,
            self._kind,
            self._present,
            self._changed,
            *self._law.arrays,
            self._rows,
            control.tension_max,
            control.pretension_speed,
            control.current_limit,
            dt_s,
            answer,
        )
        if usual:
            self._last_stamp = stamp_s
        return bool(usual)

    def _why_not_load(self, sample: LimbSample, setpoint: TensionSetpoint | None) -> Fault | None:
        if setpoint is None:
            reason = "no tension_command has arrived: is the wrench controller running?"
            return Fault(FaultName.TENSION_AGE, reason)
        age = sample.stamp_s - setpoint.stamp_s
        # A command from the future is no fresher: a clock was set back.
        if not abs(age) <= self._timeout:
            return Fault(
                FaultName.TENSION_AGE,
                f"tension_command is stale: {1e3 * age:.1f} ms old, "
                f"{1e3 * self._timeout:.1f} ms allowed",
            )
        if b"\x00" in sample.zeroed[self._pick].tobytes():
            missing = self.limbs[~sample.zeroed[self.limbs].astype(bool)]
            reason = f"not pre-tightened: {limb_names(missing)}"
            return Fault(FaultName.NOT_ZEROED, reason)
        return None

    def _watch_excitation(self, excitation: Excitation, mode: OperatingMode, dt_s: float) -> None:
        """End a programme that may not go on; its limbs then rest."""
        if self.fault:
            excitation.abort(self.fault.reason)
        elif excitation.started and mode != OperatingMode.COMMISSIONING:
            excitation.abort(f"the mode became {mode.name}")
        elif excitation.started and not dt_s <= self._timeout:
            excitation.abort(f"no limb state for {1e3 * dt_s:.0f} ms")

    def _rest(self) -> FloatArray:
        self.current[:] = 0.0
        self._moving = False
        self.unloaded = False
        return self.current

    def _plan(
        self,
        sample: LimbSample,
        mode: OperatingMode,
        setpoint: TensionSetpoint | None,
        entered: bool,
        dt_s: float,
    ) -> tuple[FloatArray, float]:
        """Set each limb's kinds of control; return what is wanted (n,) and the switches' speed."""
        control, kind = self._control, self._kind
        if mode == OperatingMode.LOADING or mode == OperatingMode.PRETIGHTENING:
            kind[:, 0], kind[:, 1] = SWITCH, TENSION
            commanded = mode == OperatingMode.LOADING and setpoint is not None and setpoint.active
            wanted = setpoint.tension if commanded and setpoint is not None else self._hold
            return wanted, control.pretension_speed
        if mode == OperatingMode.COMMISSIONING:
            self._excite(sample)
            return self._wanted, control.pretension_speed
        free = mode == OperatingMode.FREE_MOVING
        kind[:, 0], kind[:, 1] = (SWITCH, FOLLOW) if free else (REST, TENSION)
        if entered or not self._moving:
            self._wanted[:] = np.nan
        goal = control.free_tension if free else self._holding_tension
        tension = sample.tension[self._pick]
        ramped = ramp_into(goal, control.unload_tension_rate * dt_s, tension, self._wanted)
        if not free:
            near = np.abs(tension - goal) <= UNLOADED_WITHIN_N
            self.unloaded = ramped and bool((near | ~sample.zeroed[self._pick]).all())
        return self._wanted, control.free_speed

    def _excite(self, sample: LimbSample) -> None:
        """Let the programme drive its limb; the others rest, or hold their tension."""
        excitation = self.excitation
        self._kind[:] = REST
        if excitation is None or excitation.done:
            return
        where = np.flatnonzero(self.limbs == excitation.limb)
        if where.size == 0:
            excitation.abort(f"{limb_name(excitation.limb)} belongs to another controller")
            return
        kind, value = excitation.step(sample)
        if excitation.done:
            return
        if excitation.hold_others:
            self._kind[:] = TENSION
            self._wanted[:] = self._holding_tension
        self._kind[where] = kind
        self._wanted[where] = value

    def _set_references(
        self, sample: LimbSample, wanted: FloatArray, speed: float, dt_s: float
    ) -> bool:
        """Fill reference and position; return whether any kind of control changes."""
        pick = self._pick
        changed = references_into(
            self._kind,
            sample.zeroed[pick],
            sample.switch_closed[pick],
            sample.wound_length[pick],
            sample.elongation[pick],
            sample.tension[pick],
            wanted,
            self._law.tension_gain,
            self._control.tension_max,
            speed,
            dt_s,
            self._present,
            self._changed,
            self._length,
            self._rate,
            self._position,
            self._reference,
        )
        return bool(changed)

    def _restart(self, which: BoolArray) -> None:
        """Continue from the present currents, at rest, without a bump."""
        for i in np.flatnonzero(which):
            position = float(self._position[i])
            if np.isfinite(position):
                self._law.reset(int(i), position, float(self.current[i]))
