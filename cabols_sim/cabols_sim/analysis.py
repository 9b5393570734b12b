"""Judgement of a recorded bench run: numbers with units, compared with what was designed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import signal

from cabols_control.checks import FloatArray
from cabols_control.response import Response, analyse_steps, rise_time
from cabols_control.rig import Rig
from cabols_sim.recorded_run import BenchRun, ModeInterval, NodeHealth, RunError, join_run, load_run

__all__ = [
    "BenchRun",
    "Check",
    "ModeInterval",
    "NodeHealth",
    "RunError",
    "checks",
    "designed_response",
    "designed_rise_time",
    "join_run",
    "load_run",
    "summarise",
    "table",
]

START_UP_S = 0.5
"""After the start of LOADING the limbs change from the pre-tightened to the least tensions."""
RISE_TOLERANCE_S = 0.03
CROSS_COUPLING_MAX_PERCENT = 2.0
STEADY_ERROR_MAX_PERCENT = 1.0
DEVIATION_MAX_PERCENT = 5.0
TENSION_MIN_SHARE = 0.5
"""Of the least tension commanded: below it a cable is as good as slack."""
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


def wrench_poles(rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator, highest power first, of the designed closed loop (3.26)."""
    zero = abs(rig.control.zero)
    denominator = np.real(np.poly(rig.control.poles))
    return denominator[-1] / zero * np.array([1.0, zero]), denominator


def designed_response(rig: Rig, desired: FloatArray, period_s: float) -> FloatArray:
    """Wrench that the designed closed loop (3.26) makes of a desired one, from rest at zero.

    Args:
        rig: configuration, for poles and zero.
        desired: (k, 6) held between samples [N, N m].
        period_s: of the samples [s].

    Returns:
        (k, 6) [N, N m].
    """
    numerator, denominator, _ = signal.cont2discrete(wrench_poles(rig), period_s)
    return np.asarray(signal.lfilter(numerator[0], denominator, desired, axis=0))


def designed_rise_time(rig: Rig) -> float:
    """10 to 90 % rise of the designed closed loop (3.26) [s]."""
    slowest = max(1.0 / abs(np.real(pole)) for pole in rig.control.poles)
    time = np.linspace(0.0, 12.0 * slowest, 4001)
    _, value = signal.step(wrench_poles(rig), T=time)
    return rise_time(time, value, 0.0, 1.0)


def summarise(run: BenchRun, rig: Rig) -> dict[str, Any]:
    """Reduce a run to numbers; every key ends in its unit.

    Args:
        run: from load_run.
        rig: configuration that the run was made with.

    Returns:
        Numbers (None: not measured in this run), `loading_ended_by` as text, `faults` as text by
        node, `bag_lost` by topic.

    Raises:
        RunError: if fewer than two samples of LOADING were recorded.
    """
    rows = np.flatnonzero(run.loading)
    if rows.size < 2:
        raise RunError(f"{run.name}: expected samples in LOADING, got {rows.size}")
    settled = run.loading & (run.time >= START_UP_S)
    found = {
        "samples": int(rows.size),
        "duration_s": float(run.time[rows[-1]] - run.time[rows[0]]),
        "loading_ended_by": _ended_by(run),
        **_response_numbers(run, rig),
        "current_peak_a": _extreme(np.max, np.abs(run.current[run.loading])),
        "current_limit_a": rig.control.current_limit,
        "tension_min_n": _extreme(np.min, run.tension[settled]),
        "tension_max_n": _extreme(np.max, run.tension[settled]),
        "tension_min_commanded_n": rig.control.tension_min,
        "tension_max_commanded_n": rig.control.tension_max,
        **_health_numbers(run),
    }
    return {key: None if _missing(value) else value for key, value in found.items()}


def _ended_by(run: BenchRun) -> str:
    """Mode that followed the LOADING that was judged, with its reason; `end of bag` if none did."""
    later = [m for m in run.modes if m.start > 0.0]
    if not later:
        return "end of bag"
    return f"{later[0].mode.name} ({later[0].reason})"


def _missing(value: Any) -> bool:
    return isinstance(value, float) and not np.isfinite(value)


def _extreme(function: Any, values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(function(finite)) if finite.size else float("nan")


def _usable(run: BenchRun) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, desired and measured wrench in LOADING, without gaps of unanswered samples.

    What is desired holds until the wrench controller answers again.
    """
    rows = np.flatnonzero(run.loading & np.isfinite(run.measured).all(axis=1))
    desired = run.desired[rows]
    known = np.isfinite(desired).all(axis=1)
    newest = np.maximum.accumulate(np.where(known, np.arange(rows.size), -1))
    filled = np.where((newest >= 0)[:, None], desired[np.maximum(newest, 0)], 0.0)
    return run.time[rows], filled, run.measured[rows]


def _response_numbers(run: BenchRun, rig: Rig) -> dict[str, Any]:
    time, desired, measured = _usable(run)
    if time.size < 2:
        raise RunError(f"{run.name}: expected measured wrenches in LOADING, got {time.size}")
    rated = rig.control.rated
    found = analyse_steps(time, desired, measured, rated)
    error = measured - desired
    period = float(np.median(np.diff(time)))
    deviation = measured - designed_response(rig, desired, period)
    later = time >= START_UP_S
    return {
        "steps": len(found.steps),
        **_step_numbers(found, rated),
        "rise_time_designed_s": designed_rise_time(rig),
        "tracking_rms_force_n": _rms(error[:, :3]),
        "tracking_rms_torque_nm": _rms(error[:, 3:]),
        "deviation_from_design_rms_force_n": _rms(deviation[later, :3]),
        "deviation_from_design_rms_torque_nm": _rms(deviation[later, 3:]),
        "deviation_from_design_percent": 100.0 * _extreme(np.max, np.abs(deviation[later]) / rated),
    }


def _rms(values: FloatArray) -> float:
    """Root mean square over the samples of the vector's length."""
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1)))) if values.size else float("nan")


def _step_numbers(found: Response, rated: FloatArray) -> dict[str, float]:
    coupling = 100.0 * float(found.cross_coupling.max())
    rises = found.rise_times[np.isfinite(found.rise_times)]
    errors = [(step.component, float(abs(step.steady_error))) for step in found.steps]
    force = [error for component, error in errors if component < 3]
    torque = [error for component, error in errors if component >= 3]
    nan = float("nan")
    return {
        "rise_time_s": float(np.median(rises)) if rises.size else nan,
        "rise_time_min_s": float(rises.min()) if rises.size else nan,
        "rise_time_max_s": float(rises.max()) if rises.size else nan,
        "overshoot_percent": 100.0 * max((s.overshoot for s in found.steps), default=nan),
        "steady_error_force_n": max(force, default=nan),
        "steady_error_torque_nm": max(torque, default=nan),
        "steady_error_percent": 100.0 * max((e / float(rated[c]) for c, e in errors), default=nan),
        "cross_coupling_percent": coupling if found.steps else nan,
    }


def _health_numbers(run: BenchRun) -> dict[str, Any]:
    nan = float("nan")
    none = NodeHealth(0, 0, 0, 0, nan, nan, nan, nan, nan, fault="")
    bridge = run.health.get("plant") or run.health.get("q8_ati_bridge") or none
    wrench = run.health.get("wrench_controller") or none
    recorder = run.health.get("recorder")
    delay = run.command_delay[run.loading & np.isfinite(run.command_delay)]
    unanswered = run.loading & ~np.isfinite(run.current).all(axis=1)
    infeasible = int((run.loading & run.answered & ~run.feasible).sum())
    return {
        "cycles": bridge.cycles,
        "late_cycles": bridge.late,
        "late_cycles_percent": _percent(bridge.late, bridge.cycles),
        "lost_cycles": bridge.lost,
        "lost_cycles_percent": _percent(bridge.lost, bridge.cycles),
        "round_trip_median_s": bridge.round_trip,
        "round_trip_p99_s": bridge.round_trip_p99,
        "round_trip_worst_s": bridge.round_trip_worst,
        "command_delay_median_cycles": float(np.median(delay)) if delay.size else float("nan"),
        "command_delay_max_cycles": float(delay.max()) if delay.size else float("nan"),
        "infeasible_cycles": max(infeasible, wrench.infeasible),
        "unanswered_samples": int(unanswered.sum()),
        "recorder_lost": recorder.lost if recorder is not None else run.lost["limb_state"],
        "bag_lost": dict(run.lost),
        "faults": {node: health.fault for node, health in run.health.items() if health.fault},
    }


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else float("nan")


def checks(summary: Mapping[str, Any]) -> list[Check]:
    """Compare a summary with what was designed or is allowed."""
    s = summary
    designed = s["rise_time_designed_s"]
    lowest = TENSION_MIN_SHARE * s["tension_min_commanded_n"]
    ended = s["loading_ended_by"]
    return [
        Check(
            "loading ended by", ended.partition(" (")[0], "no FAULT", not ended.startswith("FAULT")
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
    """Return the table to print: what was measured beside what was designed or is allowed."""
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
