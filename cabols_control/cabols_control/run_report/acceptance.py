"""Acceptance table of a run: measured values beside the designed or allowed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.run_report.phases import FREE_TENSION_MAX_N

RISE_TOLERANCE_S = 0.03
CROSS_COUPLING_MAX_PERCENT = 2.0
STEADY_ERROR_MAX_PERCENT = 1.0
DEVIATION_MAX_PERCENT = 5.0
TENSION_MIN_SHARE = 0.5
"""Share of the least commanded tension; below it a cable counts as slack."""
LATE_MAX_PERCENT = 1.0
LOST_MAX_PERCENT = 0.1


@dataclass(frozen=True)
class Check:
    """One line of the table.

    Attributes:
        quantity: what.
        measured: value with unit.
        expected: designed or allowed value with unit; empty if there is none.
        met: whether measured is as expected; None where nothing is expected or measured.
    """

    quantity: str
    measured: str
    expected: str
    met: bool | None


def checks(summary: Mapping[str, Any]) -> list[Check]:
    """Compare a summary with the designed or allowed values."""
    s = summary
    designed = s["rise_time_designed_s"]
    lowest = TENSION_MIN_SHARE * s["tension_min_commanded_n"]
    ended = s["loading_ended_by"]
    return [
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
        _most("overshoot", s["overshoot_percent"], "%", 1, 5.0),
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
        _most("late cycles", s["late_cycles_percent"], "%", 2, LATE_MAX_PERCENT),
        _most("lost cycles", s["lost_cycles_percent"], "%", 3, LOST_MAX_PERCENT),
        *_timing_checks(s),
        _most("samples lost by the recorder", s["recorder_lost"], "", 0, 0),
        *_phase_checks(s),
    ]


def _phase_checks(s: Mapping[str, Any]) -> list[Check]:
    """Rows of the times before and after the load; empty without free-moving."""
    if not s["free_moving_s"]:
        return []
    return [
        _most(
            "free-moving: highest tension estimate",
            s["free_moving_tension_max_n"],
            "N",
            1,
            FREE_TENSION_MAX_N,
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
        _most("pose packets lost", s["pose_packets_lost"], "", 0, 0),
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
    words = {True: "met", False: "NOT MET", None: ""}
    rows = [("", "measured", "expected", "")]
    rows += [(c.quantity, c.measured, c.expected, words[c.met]) for c in checks(summary)]
    text = "\n".join(_lines(rows))
    faults = "".join(f"\nfault of {node}: {why}" for node, why in summary["faults"].items())
    return text + faults


def _lines(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
