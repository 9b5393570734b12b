# SPDX-License-Identifier: Apache-2.0
"""Table and claims of the generated campaign; pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cabols_sim.fault_campaign.in_process.rig import BRAKE_S, HEARTBEAT_S
from cabols_sim.fault_campaign.judgement import SAFE_WITHIN_S, TOLERANCE_N

TENSION_N = 150.0
SENSOR_RANGE = (165.0, 165.0, 495.0, 15.0, 15.0, 15.0)
"""Force [N] and torque [N m] along x, y, z."""
MEDIAN_S = 0.005
"""Longest median of the time from detection to a safe rig [s]."""
COAST_S = 0.65
"""Longest coasting of a motor whose amplifier was switched off, as nothing else can stop it [s]."""
BLIND_N = 10.0
"""Most that a cable gains while motors coast whose encoders are wired to others [N]."""
UNCOUNTED_N = 35.0
"""The same where an encoder stands still: its motor may wind in until the sensor feels it [N]."""
ROBOT_S = HEARTBEAT_S + BRAKE_S + 0.01
"""Longest time until the robot stands [s]: the cable of a motor that cannot turn is safe then."""

BROKEN = (
    "undetected",
    "late",
    "slow_to_safe",
    "coasting_too_long",
    "beyond_drive",
    "blind_too_long",
    "beyond_blind",
    "robot_too_long",
    "beyond_robot",
    "median_too_long",
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
    single = [t for t in trials if not t.get("pair", False)]
    found = [t for t in single if t["detected"]]
    safe = [t["safe_time_s"] for t in found]
    coasts = [t for t in found if t["amplifier"]]
    robots = [t for t in found if t["by_robot"] and not t["amplifier"]]
    blind = [t for t in found if t["blind"]]
    cables = [t for t in found if not (t["amplifier"] or t["by_robot"] or t["blind"])]
    median = float(np.median(safe)) if safe else 0.0
    return {
        "rows": [_row(kind, mine) for kind, mine in by_kind.items()],
        "kinds": len(by_kind),
        "trials": len(trials),
        "must_detect": len(judged),
        "undetected": sum(not t["detected"] for t in judged),
        "late": sum(t["detected"] and t["detection_time_s"] > t["within_s"] for t in judged),
        "by_cables": len(cables),
        "slow_to_safe": _slower(cables, SAFE_WITHIN_S),
        "by_amplifier": len(coasts),
        "coasting": _slower(coasts, SAFE_WITHIN_S),
        "coasting_max_s": _longest(coasts),
        "coasting_max_n": max((t["growth_n"] for t in coasts), default=0.0),
        "coasting_too_long": _slower([t for t in coasts if not t["by_robot"]], COAST_S),
        "beyond_drive": sum((t["beyond_drive_n"] or 0.0) > 0.0 for t in single),
        "blind": len(blind),
        "blind_coasting": _slower(blind, SAFE_WITHIN_S),
        "blind_max_n": max((t["growth_n"] for t in blind), default=0.0),
        "blind_too_long": _slower(blind, COAST_S),
        "beyond_blind": sum(t["growth_n"] > _coasts_n(t, BLIND_N) for t in blind),
        "by_robot": len(robots),
        "robot_brakes": _slower(robots, SAFE_WITHIN_S),
        "robot_max_s": _longest(robots),
        "robot_max_n": max((t["growth_n"] for t in robots), default=0.0),
        "robot_too_long": _slower(robots, ROBOT_S),
        "beyond_robot": sum(t["beyond_robot_n"] > _coasts_n(t, TOLERANCE_N) for t in robots),
        "safe_median_s": median,
        "median_too_long": int(not median <= MEDIAN_S),
        "peak_tension_n": max((t["peak_tension_n"] for t in trials), default=0.0),
        "tension_exceeded": sum(t["peak_tension_n"] > TENSION_N for t in trials if not t["full"]),
        "tension_exceeded_full": sum(t["peak_tension_n"] > TENSION_N for t in trials if t["full"]),
        "robot_exceeded": sum(_beyond(t) for t in trials),
        "pairs": len(trials) - len(single),
        "unusable": sum(not t["healthy"] for t in trials),
    }


def generated_holds(summary: dict[str, Any]) -> bool:
    """Whether no claim is broken.

    Args:
        summary: of summarise_generated.
    """
    return summary["trials"] > 0 and not any(summary[name] for name in BROKEN)


def _slower(trials: Sequence[dict[str, Any]], most_s: float) -> int:
    return sum(t["safe_time_s"] > most_s for t in trials)


def _coasts_n(trial: dict[str, Any], else_n: float) -> float:
    return UNCOUNTED_N if trial.get("uncounted", False) else else_n


def _longest(trials: Sequence[dict[str, Any]]) -> float:
    return max((t["safe_time_s"] for t in trials), default=0.0)


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
    within = f"{1e3 * SAFE_WITHIN_S:.0f} ms"
    end = (
        f"\n{summary['trials']} trials of {summary['kinds']} kinds in one process; to be detected "
        f"{summary['must_detect']}: undetected {summary['undetected']}, later than the kind's "
        f"bound {summary['late']}.\nSafe after detection: median "
        f"{1e3 * summary['safe_median_s']:.1f} ms.\n"
        f"- where limbs can answer, {summary['by_cables']} trials: later than {within} "
        f"{summary['slow_to_safe']};\n"
        f"- where an amplifier itself drives, {summary['by_amplifier']}: its motor coasts for "
        f"longer than {within} in {summary['coasting']}, for at most "
        f"{1e3 * summary['coasting_max_s']:.0f} ms and {summary['coasting_max_n']:.1f} N; beyond "
        f"k_e k i t_off {summary['beyond_drive']}, longer than {1e3 * COAST_S:.0f} ms "
        f"{summary['coasting_too_long']};\n"
        f"- where a motor has another one's encoder, or none, {summary['blind']}: coasting for "
        f"longer than {within} in {summary['blind_coasting']}, at most "
        f"{summary['blind_max_n']:.1f} N; beyond {BLIND_N:g} or {UNCOUNTED_N:g} N "
        f"{summary['beyond_blind']};\n"
        f"- where a motor cannot turn and the robot has to brake, {summary['by_robot']}: longer "
        f"than {within} in {summary['robot_brakes']}, at most "
        f"{1e3 * summary['robot_max_s']:.0f} ms and {summary['robot_max_n']:.1f} N; "
        f"longer than the robot's own {1e3 * ROBOT_S:.0f} ms {summary['robot_too_long']}, "
        f"beyond k_e times its way {summary['beyond_robot']}.\n"
        f"Of {summary['pairs']} pairs of faults only these bounds are judged:\n"
        f"Beyond {TENSION_N:g} N {summary['tension_exceeded']}, and "
        f"{summary['tension_exceeded_full']} by an amplifier that delivers all; highest "
        f"{summary['peak_tension_n']:.1f} N. Robot beyond the sensor's range "
        f"{summary['robot_exceeded']}. Unusable {summary['unusable']}."
    )
    return "\n".join([*lines, end])


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1e3 * seconds:.0f}"
