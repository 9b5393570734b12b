"""What the supervisor does with what it hears: automatic sequence, time-outs, faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.naming import limb_names
from cabols_control.supervision.clock import clock_fault
from cabols_control.supervision.modes import (
    MOVING,
    OVERLOAD,
    Condition,
    ModeMachine,
    OperatingMode,
    Verdict,
)

EMERGENCY = "emergency stop"
"""How the reason of a FAULT begins that came from the service, or a button: everything is cut."""

RELIEF_S = 1.0
"""So long after FREE_MOVING has begun, reports may still tell of the overload that it takes off."""

FORGET_S = 0.1
"""So long after PRETIGHTENING has begun, limb states may still tell of the zeros before it."""


@dataclass(frozen=True)
class SupervisionConfig:
    """How the supervisor acts.

    Attributes:
        auto_start: go to PRETIGHTENING and LOADING without being asked.
        settle_s: states must have arrived so long before the automatic start, e.g. for the tare.
        pretension_timeout_s: pre-tightening may take so long.
        state_timeout_s: limb states may be silent so long.
        controllers: nodes that must report before the cables may move.
        bridges: one of these must, too: it then gets motor currents; empty for none.
        report_timeout_s: a report counts so long.
        unloaded_tension: below it in all limbs, UNLOADING is over [N].
        unload_timeout_s: it may take so long.
    """

    auto_start: bool = False
    settle_s: float = 0.4
    pretension_timeout_s: float = 15.0
    state_timeout_s: float = 0.2
    controllers: tuple[str, ...] = ("limb_controller", "wrench_controller")
    bridges: tuple[str, ...] = ("plant", "q8_ati_bridge")
    report_timeout_s: float = 1.5
    unloaded_tension: float = 8.0
    unload_timeout_s: float = 5.0


class Supervision:
    """Pure core of the supervisor node. Times are stamps of limb states, or the same clock."""

    def __init__(self, config: SupervisionConfig) -> None:
        """Start STOPPED, having heard nothing."""
        self._config = config
        self._machine = ModeMachine()
        self._zeroed: BoolArray | None = None
        self._first_s = np.nan
        self._newest_s = -np.inf
        self._entered_s = -np.inf
        self._started = False
        self._reports: dict[str, float] = {}
        self._complaints: dict[str, str] = {}
        self._platform: FloatArray | None = None
        self._platform_s = -np.inf
        self._platform_speed = 0.0

    @property
    def mode(self) -> OperatingMode:
        """Present mode."""
        return self._machine.mode

    @property
    def reason(self) -> str:
        """Why it was entered."""
        return self._machine.reason

    def hear_state(
        self, stamp_s: float, zeroed: BoolArray, tension: FloatArray | None = None
    ) -> None:
        """Take one limb state: its stamp, the (n,) bool zeroed and the (n,) tensions [N]."""
        if np.isnan(self._first_s):
            self._first_s = stamp_s
        if back := clock_fault("limb_state", stamp_s - self._newest_s):
            self._start_anew(stamp_s, back)
        self._newest_s = stamp_s
        self._zeroed = np.array(zeroed, dtype=np.bool_)
        if self.mode == OperatingMode.PRETIGHTENING:
            self._watch_pretightening(stamp_s)
        elif self.mode == OperatingMode.UNLOADING:
            self._watch_unloading(stamp_s, tension)
        if self._config.auto_start:
            self._advance(stamp_s)

    def _start_anew(self, stamp_s: float, reason: str) -> None:
        """Forget times of a clock that has been set back; no motion goes on."""
        self._reports.clear()
        self._first_s = self._entered_s = stamp_s
        self._platform = None
        if self.mode in MOVING:
            self._machine.fault(reason)

    def _watch_pretightening(self, stamp_s: float) -> None:
        late = stamp_s - self._entered_s > self._config.pretension_timeout_s
        if late and self._zeroed is not None and not self._zeroed.all():
            limbs = limb_names(np.flatnonzero(~self._zeroed))
            self._machine.fault(
                f"pre-tightening: {limbs} did not reach their switch within "
                f"{self._config.pretension_timeout_s:g} s"
            )

    def _watch_unloading(self, stamp_s: float, tension: FloatArray | None) -> None:
        limit = self._config.unloaded_tension
        loaded = [] if tension is None else np.flatnonzero(~(tension <= limit)).tolist()
        if not loaded:
            self._machine.unloaded()
            self._entered_s = stamp_s
        elif stamp_s - self._entered_s > self._config.unload_timeout_s:
            self._machine.fault(
                f"unloading: more than {limit:g} N are still on {limb_names(loaded)} after "
                f"{self._config.unload_timeout_s:g} s"
            )

    def hear_pose(self, stamp_s: float, position: FloatArray) -> None:
        """Take the platform's (3,) position [m]: its speed decides about some transitions."""
        if self._platform is not None and stamp_s > self._platform_s:
            moved = float(np.linalg.norm(position - self._platform))
            self._platform_speed = moved / (stamp_s - self._platform_s)
        self._platform, self._platform_s = np.array(position), stamp_s

    def hear_report(self, node: str, now_s: float, running: bool, fault: str) -> None:
        """Take a node's report: whether all its inputs arrive; fault is empty if there is none.

        A fault stops what moves, latched. At rest there is nothing to stop: the fault only keeps
        the rig from moving while it lasts.
        """
        overload = fault.startswith(OVERLOAD)
        if running or overload:
            self._reports[node] = now_s
        if not fault:
            self._complaints.pop(node, None)
            return
        self._complaints[node] = fault
        young = self._newest_s - self._entered_s < RELIEF_S
        relieved = overload and self.mode == OperatingMode.FREE_MOVING and young
        if self.mode in MOVING and not relieved:
            self._machine.fault(f"{node}: {fault}")

    def check_silence(self, now_s: float) -> None:
        """Latch a fault if limb states have stopped while the rig is not at rest."""
        if self.mode in MOVING and not self._fresh(now_s):
            self._machine.fault(f"no limb state for {self._config.state_timeout_s:g} s")

    def abandon(self, reason: str) -> None:
        """Unload and stop, as nobody watches any more."""
        before = self.mode
        self._machine.abandon(reason)
        if self.mode != before:
            self._entered_s = self._newest_s

    def request(self, wanted: int, now_s: float) -> Verdict:
        """Answer a request for a mode."""
        before = self.mode
        if wanted in MOVING:
            # A node with a complaint does not count as running: the complaint says more.
            for node, complaint in self._complaints.items():
                overload = complaint.startswith(OVERLOAD)
                if overload and wanted == OperatingMode.FREE_MOVING:
                    continue
                if self.mode != OperatingMode.FAULT:
                    way_out = "; FREE_MOVING takes a load off" if overload else ""
                    return Verdict(False, f"{node}: {complaint}{way_out}")
            silent = self._silent(now_s)
            if silent:
                return Verdict(False, f"no report from {', '.join(silent)}: not running?")
        zeroed = self._zeroed
        # The bridge forgets the old zeros when it hears of the mode: older news do not count.
        young = not self._newest_s - self._entered_s >= FORGET_S
        if self.mode == OperatingMode.PRETIGHTENING and young and zeroed is not None:
            zeroed = np.zeros_like(zeroed)
        condition = Condition(zeroed, self._fresh(now_s), self._platform_speed)
        verdict = self._machine.request(wanted, condition)
        if self.mode != before:
            self._entered_s = self._newest_s
        return verdict

    def emergency_stop(self, reason: str) -> None:
        """Latch FAULT at once; a reason that begins with EMERGENCY cuts unloading short, too."""
        self._machine.emergency(reason)

    def reset(self) -> Verdict:
        """Leave FAULT for STOPPED; the automatic sequence does not start again."""
        return self._machine.reset()

    def _fresh(self, now_s: float) -> bool:
        return now_s - self._newest_s <= self._config.state_timeout_s

    def _silent(self, now_s: float) -> list[str]:
        """Nodes that are needed and have not reported lately."""
        oldest = now_s - self._config.report_timeout_s
        lively = {name for name, report_s in self._reports.items() if report_s >= oldest}
        missing = [name for name in self._config.controllers if name not in lively]
        if self._config.bridges and not lively & set(self._config.bridges):
            missing.append("the bridge")
        return missing

    def _advance(self, stamp_s: float) -> None:
        settled = stamp_s - self._first_s >= self._config.settle_s
        if self.mode == OperatingMode.STOPPED and settled and not self._started:
            self._started = self.request(OperatingMode.PRETIGHTENING, stamp_s).allowed
        elif (
            self.mode == OperatingMode.PRETIGHTENING
            and self._started
            and self._zeroed is not None
            and self._zeroed.all()
            and stamp_s - self._entered_s >= self._config.settle_s
        ):
            self.request(OperatingMode.LOADING, stamp_s)
