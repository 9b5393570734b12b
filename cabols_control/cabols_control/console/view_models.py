# SPDX-License-Identifier: Apache-2.0
"""What a page shows of the rig's modes, loops and devices, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cabols_control.naming import number, place_name, reflector_name
from cabols_control.supervision.faults import SENSOR_FAULTS, FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode, next_modes
from cabols_control.supervision.supervision_config import SupervisionConfig

SILENT_S = 3.5
"""Longest silence of a node, which reports on /diagnostics once a second [s]."""
BRIDGES = SupervisionConfig.bridges
ROBOT = "abb_tracker_bridge"
OK, WAIT, WARN, BAD, OFF = "ok", "wait", "warn", "fault", "off"
WORDS = {OK: "running", WAIT: "waiting", WARN: "check", BAD: "FAULT", OFF: "silent"}
MODE_TEXT = {
    OperatingMode.STOPPED: "Stopped",
    OperatingMode.PRETIGHTENING: "Pre-tightening",
    OperatingMode.LOADING: "Loading",
    OperatingMode.FREE_MOVING: "Free-moving",
    OperatingMode.FAULT: "Fault",
    OperatingMode.UNLOADING: "Unloading",
    OperatingMode.COMMISSIONING: "Commissioning",
}
OPERATOR_MODES = (
    OperatingMode.STOPPED,
    OperatingMode.FREE_MOVING,
    OperatingMode.PRETIGHTENING,
    OperatingMode.LOADING,
)
"""Modes that an operator requests; the others are entered by the rig or by an action."""


@dataclass(frozen=True)
class LoopReport:
    """Newest LoopStatus of one node.

    Attributes:
        node: its name.
        state: LoopStatus' number.
        reason: why it is so, for people.
        cycles: since its start.
        lost: of them, or of their answers.
        late: of them.
        infeasible: of them.
        work_s: median and 99th percentile of a cycle's work [s].
        round_trip_s: median and 99th percentile from state to command [s].
        received_s: when it was received, monotonic clock [s].
        heard_s: when the node last reported, here or on /diagnostics [s].
        rate_hz: cycles per second since the report before; NaN at first.
        fault: what is not well; None for nothing.
    """

    node: str
    state: int
    reason: str
    cycles: int
    lost: int
    late: int
    infeasible: int
    work_s: tuple[float, float]
    round_trip_s: tuple[float, float]
    received_s: float
    heard_s: float
    rate_hz: float = math.nan
    fault: FaultName | None = None

    @property
    def health(self) -> tuple[int, FaultName | None]:
        """State and fault: a change of these is news."""
        return self.state, self.fault

    def after(self, before: LoopReport | None) -> LoopReport:
        """Return this report with the rate since an earlier one."""
        if before is None:
            return self
        span_s = self.received_s - before.received_s
        known = span_s > 1e-3 and self.cycles >= before.cycles
        rate_hz = (self.cycles - before.cycles) / span_s if known else before.rate_hz
        return replace(self, rate_hz=rate_hz)

    def heard(self, now_s: float) -> LoopReport:
        """Return this report of a node that has just reported on /diagnostics."""
        return replace(self, heard_s=now_s)


def first_report(
    node: str, state: int, reason: str, now_s: float, fault: FaultName | None = None
) -> LoopReport:
    """Return the report of a node that has reported on /diagnostics only.

    Args:
        node: its name.
        state: LoopStatus' number.
        reason: why it is so, for people.
        now_s: when it was heard, monotonic clock [s].
        fault: what is not well; None for nothing.

    Returns:
        No cycles, and NaN for every time that only a LoopStatus tells.
    """
    none = (math.nan, math.nan)
    return LoopReport(node, state, reason, 0, 0, 0, 0, none, none, now_s, now_s, math.nan, fault)


def mode_view(mode: int | None, reason: str, held: str = "", hangs: bool = False) -> dict[str, Any]:
    """Return the mode in words, and the modes that an operator may request.

    Args:
        mode: its number; None: nobody tells it.
        reason: why it was entered.
        held: what load the gears hold; said first where nothing moves.
        hangs: whether the platform hangs on its cables, which some modes would let go.
    """
    if mode is None:
        return {
            "number": -1,
            "name": "NO MODE",
            "text": "No mode",
            "reason": "the supervisor is silent",
            "moving": False,
            "next": [],
        }
    present = OperatingMode(mode)
    following = [m for m in OPERATOR_MODES if m in next_modes(hangs)[present]]
    held = "" if present in MOVING else held
    return {
        "number": int(present),
        "name": present.name,
        "text": f"{MODE_TEXT[present]}, under load" if held else MODE_TEXT[present],
        "reason": f"{held} ({reason})" if held and reason else held or reason,
        "moving": present in MOVING,
        "next": [int(m) for m in following],
    }


def level_of(report: LoopReport, now_s: float) -> str:
    """Return the level of a node's state.

    Args:
        report: newest one of the node.
        now_s: monotonic clock [s].

    Returns:
        OK, WAIT, WARN, BAD, or OFF if it has been silent for longer than SILENT_S.
    """
    if not now_s - report.heard_s <= SILENT_S:
        return OFF
    if report.state == 2:
        return BAD
    if report.state == 0:
        return WAIT
    return WARN if report.fault is not None else OK


def loop_rows(reports: Mapping[str, LoopReport], now_s: float) -> list[dict[str, Any]]:
    """One row for each node that has ever reported, by name.

    Args:
        reports: newest one of each node, by the node's name.
        now_s: monotonic clock [s].

    Returns:
        Numbers as the page shows them: rate [Hz], late [-, %], lost [-], medians of work and round
        trip and the trip's 99th percentile [us].
    """
    rows = []
    for name, report in sorted(reports.items()):
        level = level_of(report, now_s)
        rows.append(
            {
                "node": name,
                "level": level,
                "word": WORDS[level],
                "reason": report.reason if level != OFF else f"no report for {SILENT_S:g} s",
                "rate": rounded(report.rate_hz, 0),
                "late": report.late,
                "late_percent": rounded(100.0 * report.late / max(report.cycles, 1), 2),
                "lost": report.lost,
                "work_us": rounded(1e6 * report.work_s[0], 0),
                "trip_us": rounded(1e6 * report.round_trip_s[0], 0),
                "trip_p99_us": rounded(1e6 * report.round_trip_s[1], 0),
            }
        )
    return rows


@dataclass(frozen=True)
class Measured:
    """Newest measurement of the laser tracker, or why it failed."""

    reflector: int
    success: bool
    reason: str
    rms_m: float


def device_rows(
    reports: Mapping[str, LoopReport], measured: Measured | None, now_s: float
) -> list[dict[str, str]]:
    """Return card, force/torque sensor, robot's stream and tracker's beam as nodes report them.

    Args:
        reports: newest one of each node, by the node's name.
        measured: the tracker's newest measurement; None before the first.
        now_s: monotonic clock [s].

    Returns:
        Rows of device, level (OK, WAIT, WARN, BAD or OFF) and text.
    """
    bridge = next((reports[name] for name in BRIDGES if name in reports), None)
    rows = [_card(bridge, now_s), _sensor(bridge, now_s), _robot(reports.get(ROBOT), now_s)]
    rows.append(_beam(measured))
    return [dict(zip(("device", "level", "text"), row, strict=True)) for row in rows]


def _card(bridge: LoopReport | None, now_s: float) -> tuple[str, str, str]:
    if bridge is None:
        return "Q8 card", OFF, "no bridge has reported"
    level = level_of(bridge, now_s)
    if level == BAD and bridge.fault in SENSOR_FAULTS:
        return "Q8 card", OK, "sampling"
    said = {
        OK: f"sampling, {bridge.late} late cycles",
        WAIT: "sampling, no current commanded yet",
        OFF: "the bridge is silent",
    }
    return "Q8 card", level, bridge.reason if level in (BAD, WARN) else said[level]


def _sensor(bridge: LoopReport | None, now_s: float) -> tuple[str, str, str]:
    if bridge is None or level_of(bridge, now_s) == OFF:
        return "Force/torque sensor", OFF, "no samples"
    if bridge.fault in SENSOR_FAULTS | {FaultName.WRENCH, FaultName.ESTIMATE}:
        return "Force/torque sensor", BAD, bridge.reason
    return "Force/torque sensor", OK, "in range"


def _robot(report: LoopReport | None, now_s: float) -> tuple[str, str, str]:
    if report is None:
        return "Robot (EGM)", OFF, "no robot in this graph"
    level = level_of(report, now_s)
    said = {OFF: "its bridge is silent", WAIT: "no packet yet"}
    packets = f"{report.lost} packets lost, {report.late} late"
    return "Robot (EGM)", level, report.reason or said.get(level, packets)


def _beam(measured: Measured | None) -> tuple[str, str, str]:
    if measured is None:
        return "Tracker's beam", WAIT, "nothing measured yet"
    name = reflector_name(measured.reflector)
    if not measured.success:
        return "Tracker's beam", BAD, f"{name}: {measured.reason}"
    return "Tracker's beam", OK, f"{name}: scatter {1e6 * measured.rms_m:.0f} um"


def rounded(value: float, digits: int) -> float | None:
    """A number for JSON: rounded, None if it is not finite.

    Args:
        value: any number.
        digits: after the decimal point.
    """
    return round(float(value), digits) if math.isfinite(value) else None


def numbers(values: Any, digits: int) -> list[float | None]:
    """Numbers for JSON.

    Args:
        values: any sequence of numbers.
        digits: after the decimal point.
    """
    return [rounded(value, digits) for value in values]


def campaign_view(
    active: bool,
    paused: bool,
    phase: str,
    loads: tuple[int, int, int],
    place: tuple[int, int, int],
    remaining_s: float,
    note: str,
) -> dict[str, Any]:
    """Return the state of a stiffness campaign in words.

    Args:
        active: it runs, or is paused.
        paused: it rests, or will after the present load.
        phase: of campaign_status.
        loads: finished, given up, all.
        place: configuration, reflector and load, from 0.
        remaining_s: estimated; NaN before the first load [s].
        note: what was retried or skipped last.
    """
    done, skipped, total = loads
    text = f"{phase}: {done} of {total} loads" if total else phase
    if skipped:
        text += f", {skipped} given up"
    if active:
        text += f", {duration_text(remaining_s)}; {place_name(*place)}"
    return {
        "active": active,
        "paused": paused,
        "text": f"{text}. {note}" if note else text,
        "progress": done / total if total else 0.0,
    }


LONGEST_S = 1e9
"""A longer time is none."""


def duration_text(seconds: float) -> str:
    """Return the time left in words."""
    if not abs(seconds) <= LONGEST_S:
        return "time left unknown"
    if seconds < 120.0:
        return f"{seconds:.0f} s left"
    return f"{seconds / 60.0:.0f} min left"


def estimate_rows(
    stiffness: Any, deviation: Any, identifiable: Any, loads: int, deviation_max: float
) -> dict[str, Any]:
    """Running stiffness estimate with its 95 % intervals.

    Args:
        stiffness: (6,) [N m/rad].
        deviation: (6,) standard deviations [N m/rad].
        identifiable: (6,) bool.
        loads: that it is from.
        deviation_max: largest relative standard deviation.
    """
    joints = []
    for i in range(6):
        known = (
            bool(identifiable[i]) and math.isfinite(stiffness[i]) and math.isfinite(deviation[i])
        )
        joints.append(
            {
                "number": number(i),
                "stiffness": rounded(stiffness[i], 0) if known else None,
                "low": rounded(stiffness[i] - 1.96 * deviation[i], 0) if known else None,
                "high": rounded(stiffness[i] + 1.96 * deviation[i], 0) if known else None,
                "percent": rounded(196.0 * deviation[i] / stiffness[i], 2) if known else None,
            }
        )
    return {
        "loads": loads,
        "deviation_max_percent": rounded(100.0 * deviation_max, 2),
        "joints": joints,
    }
