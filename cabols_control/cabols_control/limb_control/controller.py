# SPDX-License-Identifier: Apache-2.0
"""The limb controller: from limb state, mode and tension command to currents; pure."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import ShapeError
from cabols_control.limb_control.records import (
    ControlKind,
    Outcome,
    limb_control_work,
    sample_dtypes,
)
from cabols_control.limb_control.step import LONGEST_STEP_S, step_limbs, write_answer
from cabols_control.naming import limb_name, limb_names
from cabols_control.rig import Rig
from cabols_control.supervision.clock import clock_fault
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode

_STOPPED, _LOADING = OperatingMode.STOPPED, OperatingMode.LOADING
_UNLOADING, _COMMISSIONING = OperatingMode.UNLOADING, OperatingMode.COMMISSIONING
_RESTED = Outcome.RESTED
_MEASURED = ("wound_length", "elongation", "tension", "switch_closed", "zeroed")
_GIVEN = (*_MEASURED, "cable_speed", "cable_acceleration")
_PER_CABLE = ("limb", *_GIVEN)


class LimbSample(NamedTuple):
    """One limb state, arrays of (n,).

    Attributes:
        stamp_s: when the card was sampled [s].
        wound_length: [m].
        elongation: [m], NaN before zeroing.
        tension: estimate [N], NaN before zeroing.
        switch_closed: bool.
        zeroed: bool.
        cable_speed: at which the platform's motion lengthens the cables [m/s].
        cable_acceleration: likewise [m/s^2].
    """

    stamp_s: float
    wound_length: FloatArray
    elongation: FloatArray
    tension: FloatArray
    switch_closed: BoolArray
    zeroed: BoolArray
    cable_speed: FloatArray | float = 0.0
    cable_acceleration: FloatArray | float = 0.0


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
        """Return the limb's ControlKind and its value."""

    def take(self, current: float) -> None:
        """Record the limb's current that answers the newest sample [A]."""

    def abort(self, reason: str) -> None:
        """End at once; does nothing when done."""


class LimbController:
    """Pure core of the limb_controller node for all limbs, or a subset.

    Attributes:
        limbs: (m,) indices of the limbs it drives.
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
        n = rig.geometry.cables
        chosen = list(range(n)) if limbs is None else limbs
        self.limbs = np.array(chosen, dtype=np.int64)
        self._cables = n
        self._current_limit = rig.control.current_limit
        self._timeout = command_timeout or rig.control.command_timeout
        self._hold = np.full(len(chosen), rig.holding_tension)
        self._work = limb_control_work(rig, chosen)
        state, answer = sample_dtypes(n, len(chosen))
        self._plain_state, self._plain_answer = np.zeros(1, state), np.zeros(1, answer)
        self._plain_state["limb"] = np.arange(n)
        self._state_dtype = self._answer_dtype = None
        self._last_stamp = -np.inf
        self.fault: Fault | None = None
        self.unloaded = False
        self.excitation: Excitation | None = None

    def trip(self, fault: Fault) -> None:
        """Hold the output at zero for a fault from outside; the first fault stays."""
        self.fault = self.fault or fault

    @property
    def current(self) -> FloatArray:
        """(m,) newest output [A]."""
        current: FloatArray = self._work["limbs"]["current"][0]
        return current

    @property
    def saturated(self) -> BoolArray:
        """(n,) bool, true where the current limit cuts the law's output."""
        law_current: FloatArray = self._work["limbs"]["law_current"][0]
        return np.abs(law_current) >= self._current_limit

    def step(
        self, sample: LimbSample, mode: OperatingMode, setpoint: TensionSetpoint | None
    ) -> FloatArray:
        """Answer one limb state that is given as arrays; see `answer`.

        Args:
            sample: newest state of the m limbs that this controller serves.
            mode: that the supervisor grants.
            setpoint: tensions to hold [N]; None: none has come.

        Returns:
            (m,) current [A]. The same array at every call.
        """
        state = self._plain_state
        for name in _GIVEN:
            state[name] = getattr(sample, name)
        self.answer(sample.stamp_s, mode, setpoint, state, self._plain_answer)
        return self.current

    def answer(
        self,
        stamp_s: float,
        mode: OperatingMode,
        setpoint: TensionSetpoint | None,
        state: Any,
        answer: Any,
    ) -> None:
        """Answer one limb state, from message to message.

        The current is zero in STOPPED, FAULT and after any fault until the mode has been STOPPED.

        Args:
            stamp_s: of the limb state [s].
            mode: present one.
            setpoint: newest tension command.
            state: (1,) record of the LimbState of all n limbs, flags as uint8.
            answer: (1,) record of the MotorCurrent of m limbs, flags as uint8; stamp, sequence,
                current, saturated are set.

        Raises:
            ShapeError: if a record lacks a field or has another length.
        """
        if state.dtype is not self._state_dtype or answer.dtype is not self._answer_dtype:
            self._check_records(state, answer)
        dt_s = stamp_s - self._last_stamp
        if not 0.0 < dt_s <= LONGEST_STEP_S:
            if back := clock_fault("limb_state", dt_s):
                self.trip(back)
            elif not dt_s > 0.0:
                write_answer(state, self._work, answer)
                return
        self._last_stamp = stamp_s
        given = self._hold
        if mode == _LOADING:
            if not self.fault:
                self.fault = self._why_no_command(stamp_s, setpoint)
            if setpoint is not None and setpoint.active:
                given = setpoint.tension
        elif mode == _STOPPED:
            self.fault = None
        if self.excitation is not None:
            self._watch_excitation(self.excitation, mode, dt_s)
        if mode == _COMMISSIONING and not self.fault:
            self._excite(stamp_s, state)
        task = _STOPPED if self.fault else mode
        outcome = step_limbs(state, given, self._work, int(task), dt_s, answer)
        if outcome >= _RESTED:
            self.unloaded = False
            if outcome > _RESTED:
                self._fail(outcome, mode, state)
        elif mode == _UNLOADING:
            self.unloaded = outcome == Outcome.ARRIVED
        elif mode == _COMMISSIONING and self.excitation is not None:
            driven = self.limbs == self.excitation.limb
            self.excitation.take(float(self.current[driven].sum()))

    def _check_records(self, state: Any, answer: Any) -> None:
        """Refuse records whose fields are missing or of other lengths: nothing else checks them."""
        n, m = (self._cables,), (self.limbs.size,)
        for record, shape, names in (
            (state, n, _PER_CABLE),
            (answer, m, ("current", "saturated")),
        ):
            for name in names:
                found = record.dtype[name].shape if name in record.dtype.names else "nothing"
                if record.shape != (1,) or found != shape:
                    raise ShapeError(f"{name}: expected one record with {shape} of it, got {found}")
        self._state_dtype, self._answer_dtype = state.dtype, answer.dtype

    def _why_no_command(self, stamp_s: float, setpoint: TensionSetpoint | None) -> Fault | None:
        """Return why the newest command cannot be followed; None if it can."""
        if setpoint is None:
            reason = "no tension_command has arrived: is the wrench controller running?"
            return Fault(FaultName.TENSION_AGE, reason)
        age_s = stamp_s - setpoint.stamp_s
        # A stamp in the future does not make a command fresh: a clock was set back.
        if not abs(age_s) <= self._timeout:
            return Fault(
                FaultName.TENSION_AGE,
                f"tension_command is stale: {1e3 * age_s:.1f} ms old, "
                f"{1e3 * self._timeout:.1f} ms allowed",
            )
        return None

    def _fail(self, outcome: int, mode: OperatingMode, state: Any) -> None:
        """Return why the compiled step lets the limbs rest."""
        if outcome == Outcome.WRONG_LENGTH:
            raise ShapeError(f"setpoint: expected one tension for each of {self.limbs.size} limbs")
        if outcome == Outcome.WRONG_LIMBS:
            # In STOPPED nothing needs to be held at zero, and no fault stays.
            if mode != OperatingMode.STOPPED:
                reason = (
                    f"limb_state: expected the indices 0 to {self._cables - 1} in order, "
                    f"got {state['limb'][0].tolist()}"
                )
                self.trip(Fault(FaultName.MESSAGE, reason))
        elif outcome == Outcome.UNZEROED:
            missing = self.limbs[state["zeroed"][0][self.limbs] == 0]
            self.trip(Fault(FaultName.NOT_ZEROED, f"not pre-tightened: {limb_names(missing)}"))
        else:
            reason = "not finite: tension_command, or limb_state's elongation or tension"
            self.trip(Fault(FaultName.NOT_FINITE, reason))

    def _watch_excitation(self, excitation: Excitation, mode: OperatingMode, dt_s: float) -> None:
        """End a programme that must not continue; its limbs then rest."""
        if self.fault:
            excitation.abort(self.fault.reason)
        elif excitation.started and mode != OperatingMode.COMMISSIONING:
            excitation.abort(f"the mode became {mode.name}")
        elif excitation.started and not dt_s <= self._timeout:
            excitation.abort(f"no limb state for {1e3 * dt_s:.0f} ms")

    def _excite(self, stamp_s: float, state: Any) -> None:
        """Let the programme drive its limb; the others rest or hold their tension."""
        excitation, task = self.excitation, self._work["tasks"][0, _COMMISSIONING]
        task["programme_place"] = -1
        task["kind_without_zero"] = task["kind_with_zero"] = ControlKind.REST
        if excitation is None or excitation.done:
            return
        place = np.flatnonzero(self.limbs == excitation.limb)
        if place.size == 0:
            excitation.abort(f"{limb_name(excitation.limb)} belongs to another controller")
            return
        kind, value = excitation.step(_sample_of(stamp_s, state[0]))
        if excitation.done:
            return
        if excitation.hold_others:
            task["kind_without_zero"] = task["kind_with_zero"] = ControlKind.TENSION
        task["programme_place"] = place[0]
        task["programme_kind"], task["programme_value"] = kind, value


def _sample_of(stamp_s: float, record: Any) -> LimbSample:
    """View a limb state's record as arrays."""
    flags = (record[name].astype(np.bool_) for name in ("switch_closed", "zeroed"))
    return LimbSample(
        stamp_s, record["wound_length"], record["elongation"], record["tension"], *flags
    )
