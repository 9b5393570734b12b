# SPDX-License-Identifier: Apache-2.0
"""The campaign's table, its figures and whether its claims hold; pure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cabols_sim.fault_campaign.judgement import SAFE_WITHIN_S

PEAK_TENSION_N = 150.0


def read_trials(path: Path) -> list[dict[str, Any]]:
    """Read the trials done so far, one JSON object a line; a torn last line is left out."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    found = []
    for line in lines:
        with suppress(json.JSONDecodeError):
            found.append(json.loads(line))
    return found


def summarise(trials: Sequence[dict[str, Any]], order: Sequence[str]) -> dict[str, Any]:
    """Return one row for each kind, in order, and the claims.

    Args:
        trials: as they stand in the log, in any order.
        order: kinds of fault, as the rows are to follow.
    """
    rows = []
    for kind in order:
        mine = [trial for trial in trials if trial["kind"] == kind]
        if mine:
            rows.append(_row(kind, mine))
    return {
        "rows": rows,
        "trials": len(trials),
        "undetected": sum(not trial["detected"] for trial in trials),
        "slow_to_safe": sum(
            trial["safe_time_s"] is None or trial["safe_time_s"] > SAFE_WITHIN_S for trial in trials
        ),
        "peak_tension_n": max((trial["peak_tension_n"] for trial in trials), default=0.0),
    }


def holds(summary: dict[str, Any]) -> bool:
    """Whether nothing was undetected, slow or beyond the peak tension."""
    return bool(
        summary["trials"] > 0
        and summary["undetected"] == 0
        and summary["slow_to_safe"] == 0
        and summary["peak_tension_n"] < PEAK_TENSION_N
    )


def _row(kind: str, trials: list[dict[str, Any]]) -> dict[str, Any]:
    def values(name: str) -> list[float]:
        return [t[name] if t[name] is not None else np.inf for t in trials]

    # Trials of version 0.1 lack it.
    names = sorted({t.get("found_by", "not told") for t in trials if t["detected"]})
    return {
        "kind": kind,
        "trials": len(trials),
        "detected": sum(t["detected"] for t in trials),
        "found_by": names,
        "detection_median_s": float(np.median(values("detection_time_s"))),
        "detection_max_s": max(values("detection_time_s")),
        "safe_max_s": max(values("safe_time_s")),
        "peak_tension_n": max(values("peak_tension_n")),
        "peak_force_n": max(values("peak_force_n")),
        "peak_torque_nm": max(values("peak_torque_nm")),
    }


def text(summary: dict[str, Any]) -> str:
    """Return the table as it is printed."""
    head = [
        f"{'fault':34} {'found':>7} {'detection [ms]':>16} {'safe [ms]':>10} "
        f"{'tension':>8} {'force':>7} {'torque':>7}  found by",
        f"{'':42} {'median':>8}{'max':>8} {'max':>10} {'max [N]':>8} {'[N]':>7} {'[N m]':>7}",
    ]
    rows = [
        f"{row['kind']:34} {row['detected']:3d}/{row['trials']:<3d} "
        f"{1e3 * row['detection_median_s']:8.0f}{1e3 * row['detection_max_s']:8.0f} "
        f"{1e3 * row['safe_max_s']:10.0f} {row['peak_tension_n']:8.1f} "
        f"{row['peak_force_n']:7.1f} {row['peak_torque_nm']:7.2f}  {', '.join(row['found_by'])}"
        for row in summary["rows"]
    ]
    end = (
        f"\n{summary['trials']} trials: undetected {summary['undetected']}, not safe within "
        f"{1e3 * SAFE_WITHIN_S:.0f} ms of detection {summary['slow_to_safe']}, "
        f"highest tension {summary['peak_tension_n']:.1f} N"
    )
    return "\n".join([*head, *rows, end])
