# SPDX-License-Identifier: Apache-2.0
"""Reactions of the supervisor: automatic sequence, time-outs, faults; pure."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.naming import limb_names
from cabols_control.result_code import ResultCode
from cabols_control.supervision.clock import clock_fault
from cabols_control.supervision.faults import ORDERLY_END, OVERLOAD, Fault, FaultName
from cabols_control.supervision.modes import (
    MOVING,
    Condition,
    Entry,
    ModeMachine,
    OperatingMode,
    Verdict,
)
from cabols_control.supervision.senders import NODES as SENDERS
from cabols_control.supervision.stops import LatchedStops
from cabols_control.supervision.supervision_config import SupervisionConfig

FOLLOWED_S = 1.0
"""Longest time from the mode's entry to the first sample that the bridge takes in it."""
COMPLAINT_PERIODS = 3.0
"""A complaint that is not repeated ends after this many report time-outs: its sender has gone."""

BARRED = frozenset({FaultName.NOT_HELD, FaultName.INACTIVE})
"""Notices with which nothing may move."""


class Supervision:
    """Pure core of the supervisor node. Times are stamps of limb states, or the same clock.

    Attributes:
        stops: emergency stops that are latched, and those that resets have lifted.
    """

    def __init__(self, config: SupervisionConfig) -> None:
        """Start in STOPPED, without any message."""
        self._config = config
        self._machine = ModeMachine(config.hangs)
        self._zeroed: BoolArray | None = None
        self._zeroing = 0
        self._free_since_s = np.inf
        self._first_s = np.nan
        self._newest_s = -np.inf
        self._entered_s = -np.inf
        self._started = False
        self._automatic = config.auto_start
        self.stops = LatchedStops()
        self._reports: dict[str, float] = {}
        self._untared: dict[str, str] = {}
        self._unchecked: dict[str, str] = {}
        self._barred: dict[str, Fault] = {}
        self._hanging: dict[str, str] = {}
        self._leaving: dict[str, tuple[str, float]] = {}
        self._recorded_s = np.inf
        self._complaints: dict[str, tuple[Fault, float]] = {}
        self._platform: FloatArray | None = None
        self._platform_s = -np.inf
        self._platform_speed = 0.0

    @property
    def mode(self) -> OperatingMode:
        """Present mode."""
        return self._machine.mode

    @property
    def reason(self) -> str:
        """Why it was entered, for people."""
        return self._machine.reason

    @property
    def entry(self) -> Entry:
        """Present mode and how it was entered."""
        return self._machine.entry

    @property
    def following(self) -> tuple[OperatingMode, ...]:
        """Modes that may be requested in the present one."""
        return self._machine.following[self._machine.mode]

    def hear_state(
        self,
        stamp_s: float,
        zeroed: BoolArray,
        tension: FloatArray | None = None,
        *,
        zeroing: int,
        followed: int,
    ) -> None:
        """Take one limb state.

        Args:
            stamp_s: when the card was sampled [s].
            zeroed: (n,) bool.
            tension: (n,) estimates [N].
            zeroing: number of the pre-tightening that the zeros are of.
            followed: number of the mode that the bridge followed.
        """
        if np.isnan(self._first_s):
            self._first_s = stamp_s
            # Zeros that are not this supervisor's: it was restarted, and starts nothing by itself.
            self._automatic = self._automatic and not zeroing
        if back := clock_fault("limb_state", stamp_s - self._newest_s):
            self._start_anew(stamp_s, back)
        self._newest_s = stamp_s
        self._zeroed, self._zeroing = np.array(zeroed, dtype=np.bool_), zeroing
        self._machine.zeroing_seen = zeroing
        if self.mode == OperatingMode.FREE_MOVING == followed:
            self._free_since_s = min(self._free_since_s, stamp_s)
        if self.mode == OperatingMode.PRETIGHTENING:
            self._watch_pretightening(stamp_s)
        elif self.mode == OperatingMode.UNLOADING:
            self._watch_unloading(stamp_s, tension)
        if self._automatic:
            self._advance(stamp_s)

    def _zeros(self) -> BoolArray | None:
        """(n,) bool, limbs with a zero that counts; None before the first limb state.

        The bridge drops the old zeros when the mode reaches it: zeros of another pre-tightening
        are none of the present one.
        """
        zeroed = self._zeroed
        if self.mode != OperatingMode.PRETIGHTENING or zeroed is None:
            return zeroed
        return zeroed if self._zeroing == self.entry.zeroing else np.zeros_like(zeroed)

    def _start_anew(self, stamp_s: float, fault: Fault) -> None:
        """Drop the times of a clock that was set back; no motion continues."""
        self._reports.clear()
        self._leaving.clear()
        self._first_s = self._entered_s = stamp_s
        self._platform = None
        if self.mode in MOVING:
            self._machine.fault(fault)

    def _watch_pretightening(self, stamp_s: float) -> None:
        late = stamp_s - self._entered_s > self._config.pretension_timeout_s
        zeros = self._zeros()
        if late and zeros is not None and not zeros.all():
            limbs = limb_names(np.flatnonzero(~zeros))
            self._fault(
                FaultName.PRETIGHTENING_TIME,
                f"pre-tightening: {limbs} did not reach their switch within "
                f"{self._config.pretension_timeout_s:g} s",
            )

    def _watch_unloading(self, stamp_s: float, tension: FloatArray | None) -> None:
        limit = self._config.unloaded_tension
        loaded = [] if tension is None else np.flatnonzero(~(tension <= limit)).tolist()
        if not loaded:
            self._machine.unloaded()
            self._note_entry()
        elif stamp_s - self._entered_s > self._config.unload_timeout_s:
            self._fault(
                FaultName.UNLOADING_TIME,
                f"unloading: more than {limit:g} N are still on {limb_names(loaded)} after "
                f"{self._config.unload_timeout_s:g} s",
            )

    def _fault(self, name: FaultName, reason: str) -> None:
        self._machine.fault(Fault(name, reason))

    def _note_entry(self) -> None:
        """Count times from the newest limb state: another mode has been entered."""
        self._entered_s = self._newest_s
        self._free_since_s = np.inf

    def hear_pose(self, stamp_s: float, position: FloatArray) -> None:
        """Take the platform's (3,) position [m]: its speed decides about some transitions.

        Args:
            stamp_s: when it was measured [s].
            position: (3,) of the platform's origin, base frame [m].
        """
        if self._platform is not None and stamp_s > self._platform_s:
            moved = float(np.linalg.norm(position - self._platform))
            self._platform_speed = moved / (stamp_s - self._platform_s)
        self._platform, self._platform_s = np.array(position), stamp_s

    def hear_notice(self, node: str, notice: Fault | None) -> None:
        """Take what a node without a fault says about itself.

        Args:
            node: its name.
            notice: what it says; None for nothing.
        """
        if notice is not None and notice.name in BARRED:
            self._note(self._barred, node, notice)
        else:
            self._barred.pop(node, None)
        for name, notes in (
            (FaultName.FIRST_POWER_ON, self._unchecked),
            (FaultName.NOT_TARED, self._untared),
            (FaultName.HANGS, self._hanging),
        ):
            if notice is not None and notice.name == name:
                self._note(notes, node, notice.reason)
            else:
                notes.pop(node, None)
        if notice is not None and notice.name in ORDERLY_END:
            self._note(self._leaving, node, (notice.reason, self._newest_s))
            self.abandon(f"{node}: {notice.reason}")
        else:
            self._leaving.pop(node, None)

    def hear_report(
        self,
        node: str,
        now_s: float,
        running: bool,
        fault: Fault | None,
        stamp_s: float,
        stop: int = 0,
    ) -> None:
        """Take a node's report.

        A fault stops what moves, latched. At rest there is nothing to stop: the fault only keeps
        the rig from moving while it lasts.

        Args:
            node: its name.
            now_s: present time [s].
            running: whether all its inputs arrive.
            fault: that it reports; None for none.
            stamp_s: of the newest sample that the node has handled [s].
            stop: number of the emergency stop that it holds; 0 for one without a number.
        """
        if node == self._config.recorder:
            self._recorded_s = now_s if running else np.inf
        overload = fault is not None and fault.name == OVERLOAD
        if running or overload:
            self._note(self._reports, node, now_s)
        if fault is None:
            self._complaints.pop(node, None)
            return
        self._note(self._complaints, node, (fault, now_s))
        if fault.name == FaultName.EMERGENCY_STOP:
            # Perhaps pressed while no supervisor ran: the bridge has cut, only a reset lifts it.
            self.emergency_stop(fault.reason, stop)
        elif self.mode in MOVING and not (overload and self._relieves(stamp_s)):
            self._machine.fault(fault, node)

    def _note(self, notes: dict[str, Any], node: str, note: Any) -> None:
        """Keep a node's newest note; of too many nodes, the one that was new first goes."""
        known = (*self._config.controllers, *self._config.bridges)
        if node not in notes and len(notes) >= SENDERS:
            notes.pop(next((name for name in notes if name not in known), node), None)
        notes[node] = note

    def _present_complaints(self, now_s: float) -> dict[str, Fault]:
        """Complaints whose senders still repeat them; the others are dropped."""
        oldest = now_s - COMPLAINT_PERIODS * self._config.report_timeout_s
        for node, (_, heard_s) in list(self._complaints.items()):
            if not heard_s >= oldest:
                del self._complaints[node]
        return {node: fault for node, (fault, _) in self._complaints.items()}

    def _still_leaving(self, now_s: float) -> dict[str, str]:
        """Why nodes end that still say so; one that has ended is missed by its silence."""
        oldest = now_s - COMPLAINT_PERIODS * self._config.report_timeout_s
        return {node: why for node, (why, heard_s) in self._leaving.items() if heard_s >= oldest}

    def _relieves(self, stamp_s: float) -> bool:
        """Whether FREE_MOVING takes off an overload that was found at stamp_s.

        It does if the bridge did not follow FREE_MOVING yet at that sample.
        """
        young = self._newest_s - self._entered_s < FOLLOWED_S
        return self.mode == OperatingMode.FREE_MOVING and young and stamp_s < self._free_since_s

    def check_silence(self, now_s: float) -> None:
        """Latch a fault if limb states have stopped while the rig is not at rest."""
        if self.mode in MOVING and not self.fresh(now_s):
            reason = f"no limb state for {self._config.state_timeout_s:g} s"
            self._fault(FaultName.STATE_AGE, reason)
        if now_s - self._recorded_s > self._config.recorder_timeout_s:
            self._recorded_s = np.inf
            self.abandon(f"{self._config.recorder} is silent: nothing is recorded any more")

    def abandon(self, reason: str) -> None:
        """Unload and stop an unattended rig."""
        before = self.mode
        self._machine.abandon(reason)
        if self.mode != before:
            self._note_entry()

    def request(self, requested: int, now_s: float) -> Verdict:
        """Answer a request for a mode.

        Args:
            requested: number of the mode.
            now_s: now, on the clock of the samples [s].
        """
        before = self.mode
        if requested in MOVING:
            for node, bar in self._barred.items():
                text = f"{node}: {bar.reason}"
                return Verdict(ResultCode.FAULT_REPORTED, text, bar.name)
            for node, reason in self._still_leaving(now_s).items():
                return Verdict(ResultCode.NOT_READY, f"{node}: {reason}")
            # A node with a fault does not count as running: its fault is the better answer.
            for node, complaint in self._present_complaints(now_s).items():
                overload = complaint.name == OVERLOAD
                if overload and requested == OperatingMode.FREE_MOVING:
                    continue
                if self.mode != OperatingMode.FAULT:
                    way_out = "; FREE_MOVING takes a load off" if overload else ""
                    return Verdict(
                        ResultCode.FAULT_REPORTED,
                        f"{node}: {complaint.reason}{way_out}",
                        complaint.name,
                    )
            silent = self._silent(now_s)
            if silent:
                reason = f"no report from {', '.join(silent)}: not running?"
                return Verdict(ResultCode.NOT_READY, reason)
        if requested in MOVING and requested != OperatingMode.COMMISSIONING:
            for node, reason in self._unchecked.items():
                text = f"{node}: {reason}"
                return Verdict(ResultCode.FAULT_REPORTED, text, FaultName.FIRST_POWER_ON)
        if requested == OperatingMode.PRETIGHTENING:
            for node, reason in self._hanging.items():
                return Verdict(ResultCode.FAULT_REPORTED, f"{node}: {reason}", FaultName.HANGS)
        if requested == OperatingMode.LOADING:
            for node, reason in self._untared.items():
                return Verdict(ResultCode.FAULT_REPORTED, f"{node}: {reason}", FaultName.NOT_TARED)
        condition = Condition(self._zeros(), self.fresh(now_s), self._platform_speed)
        verdict = self._machine.request(requested, condition)
        if self.mode != before:
            self._note_entry()
        return verdict

    def emergency_stop(self, reason: str, number: int = 0) -> None:
        """Latch FAULT at once; the bridge cuts, also an unloading under way.

        Args:
            reason: for people.
            number: of the press; one that a reset has lifted is not latched again. 0: has none.
        """
        if self.stops.latch(number):
            self._automatic = False
            self._machine.emergency(reason)

    def reset(self) -> Verdict:
        """Leave FAULT for STOPPED; no motion follows, also no automatic start (ISO 13850)."""
        self._automatic = False
        verdict = self._machine.reset()
        if verdict.allowed:
            self.stops.reset()
        return verdict

    def fresh(self, now_s: float) -> bool:
        """Whether limb states arrive.

        Args:
            now_s: now, on the clock of the samples [s].
        """
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
            and (zeros := self._zeros()) is not None
            and zeros.all()
        ):
            self.request(OperatingMode.LOADING, stamp_s)
