"""Table and claims of the generated campaign; pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cabols_sim.fault_campaign.judgement import SAFE_WITHIN_S

TENSION_N = 150.0
SENSOR_RANGE = (165.0, 165.0, 495.0, 15.0, 15.0, 15.0)
"""Force [N] and torque [N m] along x, y, z."""


BROKEN = (
    "undetected",
    "late",
    "slow_to_safe",
    "beyond_drive",
    "tension_exceeded",
    "robot_exceeded",
    "unusable",
)
"""Counts that must be zero."""


def summarise_generated(trials: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return one row for each kind, and the claims, counted by trials.

    Args:
        trials: as they stand in the log.
    """
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for trial in trials:
        by_kind.setdefault(trial["kind"], []).append(trial)
    judged = [t for t in trials if not t["latent"]]
    found = [t for t in trials if t["detected"]]
    safe = [t["safe_time_s"] for t in found]
    slow = [t for t in found if t["safe_time_s"] > SAFE_WITHIN_S]
    return {
        "rows": [_row(kind, mine) for kind, mine in by_kind.items()],
        "kinds": len(by_kind),
        "trials": len(trials),
        "must_detect": len(judged),
        "undetected": sum(not t["detected"] for t in judged),
        "late": sum(t["detected"] and t["detection_time_s"] > t["within_s"] for t in judged),
        "not_safe_in_time": len(slow),
        "coasting": sum(t["amplifier"] for t in slow),
        "robot_brakes": sum(_by_robot(t) for t in slow),
        "slow_to_safe": sum(not t["amplifier"] and not _by_robot(t) for t in slow),
        "beyond_drive": sum((t["beyond_drive_n"] or 0.0) > 0.0 for t in trials),
        "safe_median_s": float(np.median(safe)) if safe else 0.0,
        "peak_tension_n": max((t["peak_tension_n"] for t in trials), default=0.0),
        "tension_exceeded": sum(t["peak_tension_n"] > TENSION_N for t in trials),
        "tension_exceeded_amplifier": sum(
            t["peak_tension_n"] > TENSION_N for t in trials if t["amplifier"]
        ),
        "robot_exceeded": sum(_beyond(t) for t in trials),
        "unusable": sum(not t["healthy"] for t in trials),
    }


def generated_holds(summary: dict[str, Any]) -> bool:
    """Whether no claim is broken.

    Args:
        summary: of summarise_generated.
    """
    return summary["trials"] > 0 and not any(summary[name] for name in BROKEN)


def _by_robot(trial: dict[str, Any]) -> bool:
    """Whether nothing but the robot's way until it stands makes tensions grow."""
    alone_s = trial.get("safe_but_robot_s")
    return not trial["amplifier"] and alone_s is not None and alone_s <= SAFE_WITHIN_S


def _beyond(trial: dict[str, Any]) -> bool:
    return any(p > most for p, most in zip(trial["peak_axes"], SENSOR_RANGE, strict=True))


def _row(kind: str, trials: list[dict[str, Any]]) -> dict[str, Any]:
    times = [t["detection_time_s"] for t in trials if t["detected"]]
    return {
        "kind": kind,
        "trials": len(trials),
        "latent": trials[0]["latent"],
        "within_s": trials[0]["within_s"],
        "detected": len(times),
        "detection_max_s": max(times, default=None),
        "safe_max_s": max((t["safe_time_s"] for t in trials if t["detected"]), default=None),
        "peak_tension_n": max(t["peak_tension_n"] for t in trials),
        "change_force_n": max(t["change_force_n"] for t in trials),
        "change_torque_nm": max(t["change_torque_nm"] for t in trials),
        "robot_exceeded": sum(_beyond(t) for t in trials),
        "found_by": sorted({t["found_by"] for t in trials if t["found_by"]}),
    }


def generated_text(summary: dict[str, Any]) -> str:
    """Return the table as it is printed; a star marks kinds for which only the bounds hold.

    Args:
        summary: of summarise_generated.
    """
    lines = [
        f"{'kind':48} {'found':>7} {'bound':>6} {'max':>6} {'safe':>5} {'tension':>8} "
        f"{'change of force, torque':>24}  found by",
        f"{'':56} {'[ms]':>6} {'[ms]':>6} {'[ms]':>5} {'[N]':>8} {'[N, N m]':>24}",
    ]
    for row in summary["rows"]:
        bound = "*" if row["latent"] else f"{1e3 * row['within_s']:.0f}"
        lines.append(
            f"{row['kind']:48} {row['detected']:3d}/{row['trials']:<3d} {bound:>6} "
            f"{_ms(row['detection_max_s']):>6} {_ms(row['safe_max_s']):>5} "
            f"{row['peak_tension_n']:8.1f} {row['change_force_n']:14.1f}, "
            f"{row['change_torque_nm']:6.2f}    {', '.join(row['found_by'])}"
        )
    end = (
        f"\n{summary['trials']} trials of {summary['kinds']} kinds in one process; to be detected "
        f"{summary['must_detect']}: undetected {summary['undetected']}, later than the kind's "
        f"bound {summary['late']}.\nNot safe within {1e3 * SAFE_WITHIN_S:.0f} ms of detection "
        f"{summary['not_safe_in_time']}, median {1e3 * summary['safe_median_s']:.1f} ms: in "
        f"{summary['coasting']} a motor coasts after its own amplifier's fault (beyond what 3 ms "
        f"of it give: {summary['beyond_drive']}), in {summary['robot_brakes']} the robot brakes "
        f"and stretches a cable by its way, for other causes {summary['slow_to_safe']}. Beyond "
        f"{TENSION_N:g} N {summary['tension_exceeded']} (of them by an amplifier "
        f"{summary['tension_exceeded_amplifier']}), highest {summary['peak_tension_n']:.1f} N; "
        f"robot beyond the sensor's range {summary['robot_exceeded']}; "
        f"unusable {summary['unusable']}."
    )
    return "\n".join([*lines, end])


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1e3 * seconds:.0f}"
