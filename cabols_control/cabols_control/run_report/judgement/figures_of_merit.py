# SPDX-License-Identifier: Apache-2.0
"""Judgement of a recorded bench run: numbers with units, compared with what was designed."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import signal

from cabols_control.checks import FloatArray
from cabols_control.load_programs.preview import smoothed_rise_time
from cabols_control.rig import Rig
from cabols_control.run_report.judgement.acceptance import Check, checks, table
from cabols_control.run_report.judgement.errors_of_wrench import error_numbers
from cabols_control.run_report.judgement.phases import phase_numbers
from cabols_control.run_report.judgement.step_response import Response, analyse_steps, rise_time
from cabols_control.run_report.run import (
    BenchRun,
    ModeInterval,
    NodeHealth,
    RunError,
    join_run,
    load_run,
)
from cabols_control.supervision.modes import OperatingMode

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
        "loading_ended_in_fault": _in_fault(run),
        **_response_numbers(run, rig),
        "current_peak_a": _extreme(np.max, np.abs(run.current[run.loading])),
        "current_limit_a": rig.control.current_limit,
        "tension_min_n": _extreme(np.min, run.tension[settled]),
        "tension_max_n": _extreme(np.max, run.tension[settled]),
        "tension_min_commanded_n": rig.control.tension_min,
        "tension_max_commanded_n": rig.control.tension_max,
        **_health_numbers(run),
        **phase_numbers(run),
    }
    return {key: None if _missing(value) else value for key, value in found.items()}


def _ended_by(run: BenchRun) -> str:
    """Mode that followed the LOADING that was judged, with its reason; `end of bag` if none did."""
    ending = _ending(run)
    return "end of bag" if ending is None else f"{ending.mode.name} ({ending.reason})"


def _ending(run: BenchRun) -> ModeInterval | None:
    """Mode that followed the LOADING that was judged; None if none did."""
    return next((interval for interval in run.modes if interval.start > 0.0), None)


def _in_fault(run: BenchRun) -> bool:
    ending = _ending(run)
    return ending is not None and ending.mode == OperatingMode.FAULT


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
    found = _steps(run, time, desired, measured, rated)
    period = float(np.median(np.diff(time)))
    deviation = measured - designed_response(rig, desired, period)
    later = time >= START_UP_S
    return {
        "steps": len(found.steps),
        **_step_numbers(found, rated),
        "rise_time_designed_s": (
            smoothed_rise_time(rig.control) if run.program.lead else designed_rise_time(rig)
        ),
        **error_numbers(run),
        "deviation_from_design_rms_force_n": _rms(deviation[later, :3]),
        "deviation_from_design_rms_torque_nm": _rms(deviation[later, 3:]),
        "deviation_from_design_percent": 100.0 * _extreme(np.max, np.abs(deviation[later]) / rated),
    }


def _steps(
    run: BenchRun, time: FloatArray, desired: FloatArray, measured: FloatArray, rated: FloatArray
) -> Response:
    """Judge the steps of the reference, or of a previewed programme.

    Its response begins a lead before the step: the command of so much later is what it answers.
    """
    if not run.program.lead:
        return analyse_steps(time, desired, measured, rated)
    ahead = run.program.ahead[run.loading & np.isfinite(run.measured).all(axis=1)]
    ran = np.isfinite(ahead).all(axis=1)
    return analyse_steps(time[ran], ahead[ran], measured[ran], rated)


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
    limb = run.health.get("limb_controller") or none
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
        "limb_work_median_s": limb.work_time,
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
