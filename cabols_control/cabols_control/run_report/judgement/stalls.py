# SPDX-License-Identifier: Apache-2.0
"""Where a run stood still: the longest pauses of its loop, and what bare timers missed then; pure.

A pause of one process is the software's; one that bare timers shared is the computer's. While the
loop stands still a programme's smoothed command goes on, so that one long pause in a step makes
most of a run's error: it is told beside the error, and not taken for a fault of the control law.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cabols_control.checks import BoolArray
from cabols_control.run_report.judgement.computer import TimerRecord
from cabols_control.run_report.judgement.errors_of_wrench import error_numbers
from cabols_control.run_report.judgement.phases import highest_free_tension
from cabols_control.run_report.run import BenchRun

LONG_S = 0.005
"""Pauses of bare timers from this length on harm the wrench [s]; shorter ones are bridged by the
motors' own dynamics."""
SETTLING_S = 0.5
"""How long after a pause the wrench still shows it: twice the longest designed rise time [s]."""
SHARE_LEFT = 0.5
"""Least share of the load that must be left to judge an error without the pauses."""


def stall_numbers(run: BenchRun, timers: Iterable[TimerRecord]) -> dict[str, Any]:
    """Tell a run's longest pauses, and its error outside those that bare timers shared.

    Args:
        run: from load_run.
        timers: that ran beside it.

    Returns:
        `bridge_pause_max_s` and `bridge_pause_at_s` (from the start of LOADING),
        `timer_pause_then_s`: what the worst timer missed meanwhile; `law_pause_max_s`: longest time
        without a tension command; `undisturbed_percent` of the load, and
        `undisturbed_error_rms_force_n`, `undisturbed_error_rms_torque_nm` against the smoothed
        command there, unless too little is left. Empty without a load.
        `undisturbed_free_moving_tension_max_n`: highest tension estimate of free-moving outside
        such pauses; NaN without any.
    """
    misses = [miss for timer in timers for miss in timer.misses]
    rows = np.flatnonzero(run.loading)
    time = run.time[rows]
    if rows.size < 2:
        return {}
    # A sample that only the recorder missed leaves a hole in the numbers, too: that is no pause.
    gaps = np.where(np.diff(run.sequence[rows]) == 1, np.diff(time), 0.0)
    worst = int(np.argmax(gaps))
    begin, end = float(time[worst]), float(time[worst + 1])
    found: dict[str, Any] = {
        "bridge_pause_max_s": end - begin,
        "bridge_pause_at_s": begin,
        "timer_pause_then_s": _behind(misses, _log_ns(run, begin), _log_ns(run, end)),
        "law_pause_max_s": _longest(~run.answered[rows]) * float(np.median(gaps)),
    }
    calm = ~_disturbed(run, misses)
    left = float(calm[rows].mean())
    found["undisturbed_percent"] = 100.0 * left
    if left >= SHARE_LEFT:
        errors = error_numbers(replace(run, loading=run.loading & calm))
        for key in ("rms_force_n", "rms_torque_nm"):
            found[f"undisturbed_error_{key}"] = errors[f"smoothed_error_{key}"]
    found["undisturbed_free_moving_tension_max_n"] = highest_free_tension(run, calm)
    return found


def _log_ns(run: BenchRun, time_s: float) -> int:
    """Return when a sample was recorded, from its time since the start of LOADING."""
    return run.loading_log_ns[0] + round(1e9 * time_s)


def _behind(misses: Iterable[tuple[int, int]], begin_ns: int, end_ns: int) -> float:
    """Return how long at most a timer stood still at some time of a window [s]."""
    return 1e-9 * max(
        (behind for at, behind in misses if at < end_ns and at + behind > begin_ns), default=0
    )


def _disturbed(run: BenchRun, misses: Iterable[tuple[int, int]]) -> BoolArray:
    """Return the samples (k,) in and shortly after long pauses of bare timers."""
    found = np.zeros(run.time.size, dtype=np.bool_)
    for at, behind in misses:
        if 1e-9 * behind >= LONG_S:
            begin = 1e-9 * (at - run.loading_log_ns[0])
            end = begin + 1e-9 * behind + SETTLING_S
            found |= (run.time >= begin) & (run.time <= end)
    return found


def _longest(flags: BoolArray) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
