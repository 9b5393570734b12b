"""Operating modes of the rig (section 4.2.2) and the legal transitions between them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from cabols_control.checks import BoolArray


class OperatingMode(IntEnum):
    """Same numbers as cabols_msgs/Mode."""

    STOPPED = 0
    PRETIGHTENING = 1
    LOADING = 2
    FREE_MOVING = 3
    FAULT = 4
    UNLOADING = 5
    COMMISSIONING = 6


AVAILABLE = (OperatingMode.STOPPED, OperatingMode.PRETIGHTENING, OperatingMode.LOADING)
"""Modes that can be asked for; FAULT is only entered, FREE_MOVING is not built yet."""


@dataclass(frozen=True)
class Verdict:
    """Whether a transition is allowed, and why."""

    allowed: bool
    reason: str


class ModeMachine:
    """The rig's mode: legal transitions, their conditions, the latch of FAULT."""

    def __init__(self) -> None:
        """Start in STOPPED."""
        self.mode = OperatingMode.STOPPED
        self.reason = "start"

    def request(self, wanted: int, zeroed: BoolArray | None, fresh: bool) -> Verdict:
        """Go to another mode if that is legal now.

        Args:
            wanted: number of the mode.
            zeroed: (n,) bool, limbs whose zero is set; None before the first limb state.
            fresh: whether limb states are arriving.
        """
        try:
            mode = OperatingMode(wanted)
        except ValueError:
            return Verdict(
                False, f"mode: expected one of {[int(m) for m in AVAILABLE]}, got {wanted}"
            )
        verdict = self._judge(mode, zeroed, fresh)
        if verdict.allowed and mode != self.mode:
            self.mode, self.reason = mode, verdict.reason
        return verdict

    def _judge(self, mode: OperatingMode, zeroed: BoolArray | None, fresh: bool) -> Verdict:
        if mode not in AVAILABLE:
            return Verdict(False, f"{mode.name} cannot be asked for")
        if self.mode == OperatingMode.FAULT:
            return Verdict(False, f"FAULT is latched ({self.reason}): mend the cause, call reset")
        if mode == OperatingMode.STOPPED or mode == self.mode:
            return Verdict(True, "requested")
        if zeroed is None or not fresh:
            return Verdict(False, "no limb state arrives: is the bridge running?")
        if mode == OperatingMode.LOADING:
            if self.mode != OperatingMode.PRETIGHTENING:
                return Verdict(
                    False, f"LOADING follows PRETIGHTENING, the mode is {self.mode.name}"
                )
            slack = [str(i) for i, done in enumerate(zeroed) if not done]
            if slack:
                return Verdict(False, f"limbs not pre-tightened yet: {', '.join(slack)}")
        elif self.mode == OperatingMode.LOADING:
            return Verdict(False, "leave LOADING by STOPPED first")
        return Verdict(True, "requested")

    def fault(self, reason: str) -> None:
        """Latch FAULT; the first reason stays."""
        if self.mode != OperatingMode.FAULT:
            self.mode, self.reason = OperatingMode.FAULT, reason

    def reset(self) -> Verdict:
        """Leave FAULT for STOPPED."""
        if self.mode != OperatingMode.FAULT:
            return Verdict(False, f"nothing to reset: the mode is {self.mode.name}")
        self.mode, self.reason = OperatingMode.STOPPED, "reset"
        return Verdict(True, "reset")
