"""Operating modes of the rig (section 4.2.2) and the legal transitions between them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from cabols_control.checks import BoolArray
from cabols_control.naming import limb_names


class OperatingMode(IntEnum):
    """Same numbers as cabols_msgs/Mode."""

    STOPPED = 0
    PRETIGHTENING = 1
    LOADING = 2
    FREE_MOVING = 3
    FAULT = 4
    UNLOADING = 5
    COMMISSIONING = 6


MOVING = (
    OperatingMode.PRETIGHTENING,
    OperatingMode.LOADING,
    OperatingMode.FREE_MOVING,
    OperatingMode.UNLOADING,
    OperatingMode.COMMISSIONING,
)
"""Modes in which currents may flow."""

UNATTENDED = "unattended"
"""How the reason begins of a mode that was entered because no operator's console answers."""

OVERLOAD = "sensor_saturated"
"""How a bridge's complaint begins of a load that is beyond the sensor: FREE_MOVING takes it off."""

LOADED = (OperatingMode.LOADING, OperatingMode.UNLOADING)
"""Modes in which the tensions are the wrench's, or on their way down from it."""

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
"""Where a mode may go when asked: from LOADING through UNLOADING; FAULT is left by reset."""


@dataclass(frozen=True)
class Verdict:
    """Whether a transition is allowed, and why."""

    allowed: bool
    reason: str


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
"""Slower than this the platform stands still: a pose's noise, not a motion."""


class ModeMachine:
    """The rig's mode: legal transitions, their conditions, the latch of FAULT.

    Attributes:
        mode: present mode.
        reason: why it was entered.
        pending: where UNLOADING leads; None in other modes.
    """

    def __init__(self) -> None:
        """Start in STOPPED."""
        self.mode = OperatingMode.STOPPED
        self.reason = "start"
        self.pending: OperatingMode | None = None

    def request(self, wanted: int, condition: Condition) -> Verdict:
        """Go to another mode if that is legal now; `wanted` is its number."""
        try:
            mode = OperatingMode(wanted)
        except ValueError:
            known = ", ".join(f"{m.value} {m.name}" for m in OperatingMode)
            return Verdict(False, f"mode: expected one of {known}, got {wanted}")
        verdict = self._judge(mode, condition)
        if not verdict.allowed or mode == self.mode:
            return verdict
        if self.mode in LOADED:
            self.pending = mode
            self.mode, self.reason = OperatingMode.UNLOADING, f"on the way to {mode.name}"
            return Verdict(True, f"unloading, then {mode.name}")
        self.mode, self.reason = mode, verdict.reason
        return verdict

    def abandon(self, reason: str) -> None:
        """Bring a rig that nobody watches to rest: through UNLOADING if it is loaded."""
        if self.mode in LOADED:
            self.pending = OperatingMode.STOPPED
            self.mode, self.reason = OperatingMode.UNLOADING, reason
        elif self.mode in MOVING:
            self.mode, self.reason = OperatingMode.STOPPED, reason

    def unloaded(self) -> None:
        """Go from UNLOADING to where it leads."""
        if self.pending is not None:
            told = self.reason if self.reason.startswith(UNATTENDED) else "unloaded"
            self.mode, self.reason, self.pending = self.pending, told, None

    def _judge(self, mode: OperatingMode, condition: Condition) -> Verdict:
        if mode in (OperatingMode.FAULT, OperatingMode.UNLOADING):
            return Verdict(False, f"{mode.name} cannot be asked for")
        if self.mode == OperatingMode.FAULT:
            return Verdict(False, f"FAULT is latched ({self.reason}): mend the cause, call reset")
        if mode == self.mode:
            return Verdict(True, "requested")
        if mode not in NEXT[self.mode]:
            before = [m.name for m, following in NEXT.items() if mode in following]
            return Verdict(
                False, f"{mode.name} follows {' or '.join(before)}, the mode is {self.mode.name}"
            )
        if mode == OperatingMode.STOPPED:
            return Verdict(True, "requested")
        return self._judge_motion(mode, condition)

    def _judge_motion(self, mode: OperatingMode, condition: Condition) -> Verdict:
        """Judge a mode in which currents flow."""
        if condition.zeroed is None or not condition.fresh:
            return Verdict(False, "no limb state arrives: is the bridge running?")
        slack = [i for i, done in enumerate(condition.zeroed) if not done]
        after_tightening = self.mode == OperatingMode.PRETIGHTENING
        needs_zeros = mode == OperatingMode.LOADING or (
            mode == OperatingMode.COMMISSIONING and after_tightening
        )
        if needs_zeros and slack:
            return Verdict(False, f"not pre-tightened yet: {limb_names(slack)}")
        stands = condition.platform_speed <= STANDSTILL_M_PER_S
        if mode != OperatingMode.FREE_MOVING and not stands:
            return Verdict(
                False,
                f"{mode.name} needs a platform that stands still; it moves at "
                f"{1e3 * condition.platform_speed:.0f} mm/s",
            )
        return Verdict(True, "requested")

    def fault(self, reason: str) -> None:
        """Latch FAULT; the first reason stays."""
        if self.mode != OperatingMode.FAULT:
            self.mode, self.reason, self.pending = OperatingMode.FAULT, reason, None

    def emergency(self, reason: str) -> None:
        """Latch FAULT; the reason is told also if another fault came before."""
        self.pending = None
        if self.mode == OperatingMode.FAULT and not self.reason.startswith(reason):
            reason = f"{reason}, after {self.reason}"
        self.mode, self.reason = OperatingMode.FAULT, reason

    def reset(self) -> Verdict:
        """Leave FAULT for STOPPED."""
        if self.mode != OperatingMode.FAULT:
            return Verdict(False, f"nothing to reset: the mode is {self.mode.name}")
        self.mode, self.reason = OperatingMode.STOPPED, "reset"
        return Verdict(True, "reset")
