# SPDX-License-Identifier: Apache-2.0
"""Operating modes of the rig (section 4.2.2) and the legal transitions between them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from cabols_control.checks import BoolArray
from cabols_control.naming import limb_names
from cabols_control.result_code import ResultCode
from cabols_control.supervision.faults import Fault, FaultName


class OperatingMode(IntEnum):
    """Same numbers as cabols_msgs/Mode."""

    STOPPED = 0
    PRETIGHTENING = 1
    LOADING = 2
    FREE_MOVING = 3
    FAULT = 4
    UNLOADING = 5
    COMMISSIONING = 6


class Cause(IntEnum):
    """Why a mode was entered; same numbers as the CAUSE_* of cabols_msgs/Mode."""

    UNKNOWN = 0
    START = 1
    REQUEST = 2
    ON_THE_WAY = 3
    UNLOADED = 4
    UNATTENDED = 5
    RESET = 6
    FAULT = 7
    EMERGENCY_STOP = 8


MOVING = (
    OperatingMode.PRETIGHTENING,
    OperatingMode.LOADING,
    OperatingMode.FREE_MOVING,
    OperatingMode.UNLOADING,
    OperatingMode.COMMISSIONING,
)
"""Modes in which currents may flow."""

LOADED = (OperatingMode.LOADING, OperatingMode.UNLOADING)
"""Modes in which the tensions give the wrench, or are ramped down from it."""

NEXT: dict[OperatingMode, tuple[OperatingMode, ...]] = {
    OperatingMode.STOPPED: (
        OperatingMode.PRETIGHTENING,
        OperatingMode.FREE_MOVING,
        OperatingMode.COMMISSIONING,
    ),
    OperatingMode.FREE_MOVING: (OperatingMode.STOPPED, OperatingMode.PRETIGHTENING),
    OperatingMode.PRETIGHTENING: (
        OperatingMode.STOPPED,
        OperatingMode.FREE_MOVING,
        OperatingMode.LOADING,
        OperatingMode.COMMISSIONING,
    ),
    OperatingMode.LOADING: (
        OperatingMode.STOPPED,
        OperatingMode.FREE_MOVING,
        OperatingMode.PRETIGHTENING,
    ),
    OperatingMode.UNLOADING: (
        OperatingMode.STOPPED,
        OperatingMode.FREE_MOVING,
        OperatingMode.PRETIGHTENING,
    ),
    OperatingMode.COMMISSIONING: (OperatingMode.STOPPED,),
    OperatingMode.FAULT: (),
}
"""Modes that may be requested in each mode: LOADING is left through UNLOADING, FAULT by reset."""

NEXT_HANGING: dict[OperatingMode, tuple[OperatingMode, ...]] = {
    **{mode: (OperatingMode.STOPPED,) for mode in NEXT if mode != OperatingMode.FAULT},
    OperatingMode.STOPPED: (OperatingMode.PRETIGHTENING, OperatingMode.LOADING),
    OperatingMode.PRETIGHTENING: (OperatingMode.STOPPED, OperatingMode.LOADING),
    OperatingMode.FAULT: (),
}
"""The same where the platform hangs on its cables: what would let it go is not to be had, and from
LOADING gears take it over at once, by which it may be loaded again."""


def next_modes(hangs: bool) -> dict[OperatingMode, tuple[OperatingMode, ...]]:
    """Modes that may be requested in each mode.

    Args:
        hangs: whether the platform hangs on its cables.
    """
    return NEXT_HANGING if hangs else NEXT


@dataclass(frozen=True)
class Verdict:
    """Whether a transition is allowed, and why.

    Attributes:
        code: DONE, or why not.
        reason: the same for people.
        fault: that keeps the rig from it, if one does.
    """

    code: ResultCode
    reason: str
    fault: FaultName | None = None

    @property
    def allowed(self) -> bool:
        """Whether the transition is allowed."""
        return self.code == ResultCode.DONE


class Entry(NamedTuple):
    """How the present mode was entered: the content of message Mode.

    Attributes:
        mode: present mode.
        cause: why it was entered.
        reason: the same for people.
        fault: in FAULT, which; None otherwise.
        zeroing: counts entries into PRETIGHTENING.
    """

    mode: OperatingMode
    cause: Cause
    reason: str
    fault: FaultName | None
    zeroing: int


@dataclass(frozen=True)
class Condition:
    """What a transition depends on.

    Attributes:
        zeroed: (n,) bool, limbs whose zero is set; None before the first limb state.
        fresh: whether limb states are arriving.
        platform_speed: of the platform's origin [m/s]; 0 where nothing reports it.
    """

    zeroed: BoolArray | None
    fresh: bool
    platform_speed: float = 0.0


STANDSTILL_M_PER_S = 0.005
"""Highest speed of a platform at rest, as the noise of its pose shows it [m/s]."""


ZEROINGS = 2**32
"""Mode.zeroing is a uint32."""


class ModeMachine:
    """The rig's mode: legal transitions, their conditions, the latch of FAULT.

    Attributes:
        entry: present mode and how it was entered; replaced as a whole.
        pending: the mode after UNLOADING; None in other modes.
        hangs: whether the platform hangs on its cables.
        following: modes that may be requested in each mode.
        zeroing_seen: newest LimbState.zeroing; the next pre-tightening gets a number beyond it, so
            that a restarted supervisor does not accept its predecessor's zeros.
    """

    def __init__(self, hangs: bool = False) -> None:
        """Start in STOPPED.

        Args:
            hangs: whether the platform hangs on its cables.
        """
        self.hangs = hangs
        self.following = next_modes(hangs)
        self.entry = Entry(OperatingMode.STOPPED, Cause.START, "start", None, 0)
        self.pending: OperatingMode | None = None
        self.zeroing_seen = 0

    @property
    def mode(self) -> OperatingMode:
        """Present mode."""
        return self.entry.mode

    @property
    def reason(self) -> str:
        """Why it was entered, for people."""
        return self.entry.reason

    def _enter(
        self, mode: OperatingMode, cause: Cause, reason: str, fault: FaultName | None = None
    ) -> None:
        zeroing = self.entry.zeroing
        if mode == OperatingMode.PRETIGHTENING and self.mode != mode:
            zeroing = (max(zeroing, self.zeroing_seen) + 1) % ZEROINGS or 1
        if mode != OperatingMode.UNLOADING:
            self.pending = None
        self.entry = Entry(mode, cause, reason, fault, zeroing)

    def request(self, requested: int, condition: Condition) -> Verdict:
        """Go to another mode if that is legal now; `requested` is its number.

        Args:
            requested: number of the mode.
            condition: of the rig, which decides what is legal.
        """
        try:
            mode = OperatingMode(requested)
        except ValueError:
            known = ", ".join(f"{m.value} {m.name}" for m in OperatingMode)
            return Verdict(
                ResultCode.BAD_REQUEST, f"mode: expected one of {known}, got {requested}"
            )
        verdict = self._judge(mode, condition)
        if not verdict.allowed or mode == self.mode:
            return verdict
        if self.mode in LOADED and not self.hangs:
            self.pending = mode
            self._enter(OperatingMode.UNLOADING, Cause.ON_THE_WAY, f"on the way to {mode.name}")
            return Verdict(ResultCode.DONE, f"unloading, then {mode.name}")
        self._enter(mode, Cause.REQUEST, verdict.reason)
        return verdict

    def abandon(self, reason: str) -> None:
        """Bring an unattended rig to rest: through UNLOADING if it is loaded."""
        if self.mode in LOADED and not self.hangs:
            self.pending = OperatingMode.STOPPED
            self._enter(OperatingMode.UNLOADING, Cause.UNATTENDED, reason)
        elif self.mode in MOVING:
            self._enter(OperatingMode.STOPPED, Cause.UNATTENDED, reason)

    def unloaded(self) -> None:
        """Go from UNLOADING to the pending mode."""
        if self.pending is None:
            return
        if self.entry.cause == Cause.UNATTENDED:
            self._enter(self.pending, Cause.UNATTENDED, self.reason)
        else:
            self._enter(self.pending, Cause.UNLOADED, "unloaded")

    def _judge(self, mode: OperatingMode, condition: Condition) -> Verdict:
        if mode in (OperatingMode.FAULT, OperatingMode.UNLOADING):
            return Verdict(ResultCode.BAD_REQUEST, f"{mode.name} cannot be asked for")
        if self.mode == OperatingMode.FAULT:
            return Verdict(
                ResultCode.FAULT_LATCHED,
                f"FAULT is latched ({self.reason}): mend the cause, call reset",
                self.entry.fault,
            )
        if mode == self.mode:
            return Verdict(ResultCode.DONE, "requested")
        if mode not in self.following[self.mode]:
            before = [m.name for m, following in self.following.items() if mode in following]
            if not before:
                return Verdict(
                    ResultCode.WRONG_MODE,
                    f"{mode.name} would let the platform go, which hangs on its cables",
                )
            return Verdict(
                ResultCode.WRONG_MODE,
                f"{mode.name} follows {' or '.join(before)}, the mode is {self.mode.name}",
            )
        if mode == OperatingMode.STOPPED:
            return Verdict(ResultCode.DONE, "requested")
        return self._judge_motion(mode, condition)

    def _judge_motion(self, mode: OperatingMode, condition: Condition) -> Verdict:
        """Judge a mode in which currents flow."""
        if condition.zeroed is None or not condition.fresh:
            return Verdict(ResultCode.NOT_READY, "no limb state arrives: is the bridge running?")
        slack = [i for i, done in enumerate(condition.zeroed) if not done]
        after_tightening = self.mode == OperatingMode.PRETIGHTENING
        needs_zeros = mode == OperatingMode.LOADING or (
            mode == OperatingMode.COMMISSIONING and after_tightening
        )
        if needs_zeros and slack:
            return Verdict(ResultCode.NOT_ZEROED, f"not pre-tightened yet: {limb_names(slack)}")
        stands = condition.platform_speed <= STANDSTILL_M_PER_S
        if mode != OperatingMode.FREE_MOVING and not stands:
            return Verdict(
                ResultCode.PLATFORM_MOVES,
                f"{mode.name} needs a platform that stands still; it moves at "
                f"{1e3 * condition.platform_speed:.0f} mm/s",
            )
        return Verdict(ResultCode.DONE, "requested")

    def fault(self, fault: Fault, reporter: str = "") -> None:
        """Latch FAULT; the first fault stays.

        Args:
            fault: what is not well.
            reporter: node that found it; empty: the supervisor.
        """
        if self.mode != OperatingMode.FAULT:
            reason = f"{reporter}: {fault.reason}" if reporter else fault.reason
            self._enter(OperatingMode.FAULT, Cause.FAULT, reason, fault.name)

    def emergency(self, reason: str) -> None:
        """Latch FAULT; the new fault is reported also if another one came before."""
        if self.entry.cause == Cause.EMERGENCY_STOP:
            return
        if self.mode == OperatingMode.FAULT:
            reason = f"{reason}, after {self.reason}"
        self._enter(OperatingMode.FAULT, Cause.EMERGENCY_STOP, reason, FaultName.EMERGENCY_STOP)

    def reset(self) -> Verdict:
        """Leave FAULT for STOPPED."""
        if self.mode != OperatingMode.FAULT:
            return Verdict(ResultCode.WRONG_MODE, f"nothing to reset: the mode is {self.mode.name}")
        self._enter(OperatingMode.STOPPED, Cause.RESET, "reset")
        return Verdict(ResultCode.DONE, "reset")
