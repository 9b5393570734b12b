# SPDX-License-Identifier: Apache-2.0
"""Acceptance table of a run: measured values beside the designed or allowed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cabols_control.run_report.judgement.computer import is_computers
from cabols_control.run_report.judgement.phases import FREE_TENSION_MAX_N

RISE_TOLERANCE_S = 0.03
OVERSHOOT_MAX_PERCENT = {False: 5.0, True: 8.0}
"""By feedback alone, and with preview, whose steps rise three times as fast."""
CROSS_COUPLING_MAX_PERCENT = 2.0
STEADY_ERROR_MAX_PERCENT = 1.0
DEVIATION_MAX_PERCENT = 5.0
TENSION_MIN_SHARE = 0.5
"""Share of the least commanded tension; below it a cable counts as slack."""
SMOOTHED_FORCE_MAX_N, SMOOTHED_TORQUE_MAX_NM = 0.6, 0.08
"""Error against the smoothed command of a previewed programme, rms. A rigid target leaves 0.2 N and
0.02 N m, a robot that gives way twice as much."""
LATE_MAX_PERCENT = 1.0
LOST_MAX_PERCENT = 0.1
WORK_MAX_MS = 0.5
"""Half of a cycle."""


@dataclass(frozen=True)
class Check:
    """One line of the table.

    Attributes:
        quantity: what.
        measured: value with unit.
        expected: designed or allowed value with unit; empty if there is none.
        met: whether measured is as expected; None where nothing is expected or measured.
        by_computer: not met, but only by what bare timers beside the run missed, too.
    """

    quantity: str
    measured: str
    expected: str
    met: bool | None
    by_computer: bool = False

    @property
    def verdict(self) -> str:
        """Return the verdict's word; empty where there is none."""
        if self.by_computer:
            return "this computer"
        return {True: "met", False: "NOT MET", None: ""}[self.met]


def checks(summary: Mapping[str, Any]) -> list[Check]:
    """Compare a summary with the designed or allowed values."""
    s = summary
    designed = s["rise_time_designed_s"]
    preview = bool(s.get("preview_lead_s"))
    lowest = TENSION_MIN_SHARE * s["tension_min_commanded_n"]
    ended = s["loading_ended_by"]
    return [
        *_error_checks(s),
        Check(
            "loading ended by",
            ended.partition(" (")[0],
            "no FAULT",
            not s["loading_ended_in_fault"],
        ),
        _check(
            "rise time 10-90 %, median of the steps",
            s["rise_time_s"],
            "s",
            3,
            f"{designed:.3f} s designed, +-{RISE_TOLERANCE_S:g} s",
            (designed - RISE_TOLERANCE_S, designed + RISE_TOLERANCE_S),
        ),
        _most("overshoot", s["overshoot_percent"], "%", 1, OVERSHOOT_MAX_PERCENT[preview]),
        _most(
            "steady error, of rated", s["steady_error_percent"], "%", 2, STEADY_ERROR_MAX_PERCENT
        ),
        _plain("steady error of force", s["steady_error_force_n"], "N", 3),
        _plain("steady error of torque", s["steady_error_torque_nm"], "N m", 4),
        _most(
            "cross-coupling, of rated",
            s["cross_coupling_percent"],
            "%",
            2,
            CROSS_COUPLING_MAX_PERCENT,
        ),
        _most(
            "deviation from the designed response, of rated",
            s["deviation_from_design_percent"],
            "%",
            2,
            DEVIATION_MAX_PERCENT,
        ),
        _most("peak current", s["current_peak_a"], "A", 2, s["current_limit_a"]),
        _check(
            "lowest tension estimate, after 0.5 s",
            s["tension_min_n"],
            "N",
            2,
            f"at least {lowest:g} N",
            (lowest, np.inf),
        ),
        _most(
            "highest tension estimate, after 0.5 s",
            s["tension_max_n"],
            "N",
            1,
            s["tension_max_commanded_n"],
        ),
        _most("infeasible cycles", s["infeasible_cycles"], "", 0, 0),
        *_computer_checks(s),
        *_timing_checks(s),
        *_phase_checks(s),
    ]


def _error_checks(s: Mapping[str, Any]) -> list[Check]:
    """What users ask first: how far the wrench was from the command."""
    found = []
    for kind, unit, digits in (("force", "N", 2), ("torque", "N m", 3)):
        key = f"{kind}_{unit.replace(' ', '').lower()}"
        for what, name in (
            ("error against the command", "command"),
            ("in axes commanded", "asked"),
            ("in idle axes", "idle"),
        ):
            values = [s.get(f"{name}_error_{part}_{key}") for part in ("rms", "p95", "max")]
            shown = " / ".join("-" if v is None else f"{v:.{digits}f}" for v in values)
            expected = "rms / 95 % / largest"
            found.append(Check(f"{what}, {kind}", f"{shown} {unit}", expected, None))
        known = [s.get(f"uncertainty_{part}_{key}") for part in ("p95", "max")]
        if None not in known:
            shown = " / ".join(f"{value:.{digits}f}" for value in known if value is not None)
            what = f"uncertainty of the measured {kind}, worst axis"
            found.append(Check(what, f"{shown} {unit}", "95 % / largest", None))
    if s.get("preview_lead_s"):
        limits = ((SMOOTHED_FORCE_MAX_N, "N", 3), (SMOOTHED_TORQUE_MAX_NM, "N m", 4))
        for kind, (limit, unit, digits) in zip(("force", "torque"), limits, strict=True):
            key = f"error_rms_{kind}_{unit.replace(' ', '').lower()}"
            what = f"rms against the smoothed command, {kind}"
            check = _most(what, s[f"smoothed_{key}"], unit, digits, limit)
            found += _outside_pauses(check, (s.get(f"undisturbed_{key}"), limit, unit, digits))
    return found


def _phase_checks(s: Mapping[str, Any]) -> list[Check]:
    """Rows of the times before and after the load; empty without free-moving."""
    if not s["free_moving_s"]:
        return []
    return [
        *_outside_pauses(
            _most(
                "free-moving: highest tension estimate",
                s["free_moving_tension_max_n"],
                "N",
                1,
                FREE_TENSION_MAX_N,
            ),
            (s.get("undisturbed_free_moving_tension_max_n"), FREE_TENSION_MAX_N, "N", 1),
        ),
        _check(
            "free-moving: lowest tension estimate",
            s["free_moving_tension_min_n"],
            "N",
            2,
            "above 0 N: no slack",
            (np.nextafter(0.0, 1.0), np.inf),
        ),
        _plain(
            "free-moving: highest platform speed",
            _scaled(s["free_moving_speed_max_m_per_s"], 1e3),
            "mm/s",
            1,
        ),
        _plain("free-moving: robot's way", s["free_moving_way_m"], "m", 3),
        _most(
            "after unloading: highest tension estimate",
            s["unloaded_tension_max_n"],
            "N",
            1,
            FREE_TENSION_MAX_N,
        ),
        _check(
            "reflectors measured by the tracker",
            s["reflectors_measured"],
            "",
            0,
            "",
            None,
        ),
        _shared(
            _most("pose packets lost", s["pose_packets_lost"], "", 0, 0),
            (s["pose_packets_lost"], 0, s.get("timer_lost_cycles")),
        ),
    ]


def failures(summary: Mapping[str, Any]) -> list[Check]:
    """Return what the software did not meet: not what only this computer is to blame for."""
    return [check for check in checks(summary) if check.met is False and not check.by_computer]


def by_computer(summary: Mapping[str, Any]) -> list[Check]:
    """Return what was not met only because of this computer."""
    return [check for check in checks(summary) if check.by_computer]


def _shared(check: Check, figure: tuple[float | None, float, float | None]) -> Check:
    """Blame this computer for a figure that is not met, as far as bare timers missed as much.

    Args:
        check: of the figure.
        figure: measured, its limit, and what the timers missed.
    """
    return replace(check, by_computer=check.met is False and is_computers(*figure))


def _outside_pauses(check: Check, calm: tuple[float | None, float, str, int]) -> list[Check]:
    """Blame this computer for a figure that is met outside the pauses of bare timers.

    Args:
        check: of the figure, in the whole run.
        calm: the figure outside the pauses, its limit, unit and digits.
    """
    value, limit, unit, digits = calm
    if check.met is not False or value is None or not value <= limit:
        return [check]
    outside = _plain("  outside pauses of bare timers", value, unit, digits)
    return [replace(check, by_computer=True), outside]


def _computer_checks(s: Mapping[str, Any]) -> list[Check]:
    """What a stall of this computer harms as well as slow software."""
    late, lost, recorder = s["late_cycles_percent"], s["lost_cycles_percent"], s["recorder_lost"]
    work = _scaled(s.get("limb_work_median_s") or None, 1e3)
    # A median: stalls of the computer do not move it.
    working = _most("work of a limb controller's cycle, median", work, "ms", 3, WORK_MAX_MS)
    # A law that works for so long loses cycles by itself, and leaves the timers beside it no time.
    slow = working.met is False
    timer_late, timer_lost = (
        None if slow else s.get(name) for name in ("timer_late_percent", "timer_lost_percent")
    )
    return [
        _shared(
            _most("late cycles", late, "%", 2, LATE_MAX_PERCENT),
            (late, LATE_MAX_PERCENT, timer_late),
        ),
        _shared(
            _most("lost cycles", lost, "%", 3, LOST_MAX_PERCENT),
            (lost, LOST_MAX_PERCENT, timer_lost),
        ),
        working,
        _shared(
            _most("samples lost by the recorder", recorder, "", 0, 0),
            (recorder, 0, s.get("timer_lost_cycles")),
        ),
        *_timer_rows(s),
    ]


def _timer_rows(s: Mapping[str, Any]) -> list[Check]:
    """What bare timers missed in the same run; empty without any."""
    if s.get("timer_late_percent") is None:
        return []
    return [
        _plain("bare timer beside: late", s["timer_late_percent"], "%", 2),
        _plain("bare timers beside: lost", s["timer_lost_percent"], "%", 3),
        *_pause_rows(s),
    ]


def _pause_rows(s: Mapping[str, Any]) -> list[Check]:
    """Longest pauses, and when; empty where they are not known."""
    if s.get("bridge_pause_max_s") is None:
        return []
    bridge, timer, law = (
        1e3 * s[key] for key in ("bridge_pause_max_s", "timer_pause_then_s", "law_pause_max_s")
    )
    shown = f"{bridge:.1f} ms at {s['bridge_pause_at_s']:.2f} s"
    return [
        Check("longest pause of the bridge", shown, f"bare timers then: {timer:.1f} ms", None),
        Check("longest time without a tension command", f"{law:.1f} ms", "", None),
    ]


def _timing_checks(s: Mapping[str, Any]) -> list[Check]:
    if s["round_trip_p99_s"] == 0.0:
        return [Check("round trip", "not measured in lockstep", "", None)]
    return [
        _plain("round trip, median", _scaled(s["round_trip_median_s"], 1e3), "ms", 2),
        _plain("round trip, 99th percentile", _scaled(s["round_trip_p99_s"], 1e3), "ms", 2),
    ]


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _check(
    quantity: str,
    value: float | None,
    unit: str,
    digits: int,
    expected: str,
    limits: tuple[float, float] | None,
) -> Check:
    if value is None:
        return Check(quantity, "not measured", expected, None)
    met = None if limits is None else bool(limits[0] <= value <= limits[1])
    return Check(quantity, f"{value:.{digits}f} {unit}".rstrip(), expected, met)


def _most(quantity: str, value: float | None, unit: str, digits: int, limit: float) -> Check:
    expected = f"at most {limit:g} {unit}".rstrip()
    return _check(quantity, value, unit, digits, expected, (-np.inf, limit))


def _plain(quantity: str, value: float | None, unit: str, digits: int) -> Check:
    return _check(quantity, value, unit, digits, "", None)


def table(summary: Mapping[str, Any]) -> str:
    """Return the table to print: measured values beside the designed or allowed ones."""
    rows = [("", "measured", "expected", "")]
    rows += [(c.quantity, c.measured, c.expected, c.verdict) for c in checks(summary)]
    text = "\n".join(_lines(rows))
    faults = "".join(f"\nfault of {node}: {why}" for node, why in summary["faults"].items())
    return text + faults


def _lines(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
