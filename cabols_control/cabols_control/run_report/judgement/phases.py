# SPDX-License-Identifier: Apache-2.0
"""Figures of the times before and after the load: free-moving, robot's motion, unloading."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.run_report.run import BenchRun, ModeInterval
from cabols_control.supervision.modes import OperatingMode

FREE_TENSION_MAX_N = 15.0
"""Largest tension of a cable that follows the robot [N]."""
SWITCHING_S = 0.05
"""Start of a mode that is left out [s]: the supervisor reads 50 times a second, so that a mode's
first samples may belong to the mode before."""


def phases(run: BenchRun, mode: OperatingMode) -> tuple[ModeInterval, ...]:
    """Return the intervals of one mode.

    Args:
        run: that was recorded.
        mode: whose intervals are asked for.
    """
    return tuple(interval for interval in run.modes if interval.mode == mode)


def samples_in(run: BenchRun, intervals: tuple[ModeInterval, ...]) -> BoolArray:
    """Return (k,) whether a sample is in one of the intervals.

    Args:
        run: that was recorded, with k samples.
        intervals: from begin to end, both included.
    """
    inside = np.zeros(run.time.size, dtype=np.bool_)
    for interval in intervals:
        inside |= (run.time >= interval.start) & (run.time < interval.end)
    return inside


def phase_numbers(run: BenchRun) -> dict[str, Any]:
    """Reduce free-moving and unloading to numbers; every key ends in its unit.

    Returns:
        Of free-moving: duration, highest and lowest tension estimate (where zeros are known: before
        them it is NaN), highest speed and way of the platform's origin. Of unloading: how long it
        took, and the highest estimate after it. Packets lost of the robot's stream. NaN or None:
        not in this run.
    """
    free = phases(run, OperatingMode.FREE_MOVING)
    tension = run.tension[samples_in(run, free)]
    known = np.isfinite(tension)
    moves = [run.motion.within(interval.start, interval.end) for interval in free]
    speeds = [move.speed()[1] for move in moves]
    unloading = [m for m in phases(run, OperatingMode.UNLOADING) if m.start > 0.0]
    return {
        "free_moving_s": float(sum(interval.end - interval.start for interval in free)),
        "free_moving_tension_max_n": _reduce(np.max, tension[known]),
        "free_moving_tension_min_n": _reduce(np.min, tension[known]),
        "free_moving_speed_max_m_per_s": _reduce(np.max, np.concatenate([np.zeros(0), *speeds])),
        "free_moving_way_m": float(sum(move.way() for move in moves)) if free else np.nan,
        "unloading_s": unloading[0].end - unloading[0].start if unloading else np.nan,
        "unloaded_tension_max_n": _unloaded(run, unloading),
        "reflectors_measured": int(run.motion.measured_time.size),
        "pose_packets_lost": run.motion.packets_lost,
    }


def highest_free_tension(run: BenchRun, chosen: BoolArray) -> float:
    """Return the highest tension estimate of free-moving among chosen samples [N]; NaN: none.

    Args:
        run: that was recorded, with k samples.
        chosen: (k,) samples to look at.
    """
    free = samples_in(run, phases(run, OperatingMode.FREE_MOVING))
    tension = run.tension[free & chosen]
    return _reduce(np.max, tension[np.isfinite(tension)])


def _unloaded(run: BenchRun, unloading: list[ModeInterval]) -> float:
    """Highest estimate from the end of UNLOADING to the end of the mode that followed [N]."""
    if not unloading:
        return float("nan")
    end = unloading[0].end
    after = [interval for interval in run.modes if interval.start >= end]
    until = after[0].end if after else np.inf
    rows = (run.time >= end + SWITCHING_S) & (run.time <= until)
    tension = run.tension[rows]
    return _reduce(np.max, tension[np.isfinite(tension)])


def _reduce(function: Any, values: FloatArray) -> float:
    return float(function(values)) if values.size else float("nan")
