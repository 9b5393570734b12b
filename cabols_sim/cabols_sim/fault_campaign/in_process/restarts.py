# SPDX-License-Identifier: Apache-2.0
"""A bridge that starts again while the gears hold a load: what it then says of the wrench."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.trials import Bench

HELD_N = (10.0, 25.0, 28.0, 40.0, 100.0)
"""Loads that a cut leaves on the gears [N]."""
WRONG_N, WRONG_NM = 1.0, 0.1
"""Largest error of a wrench that counts as known."""


def restart_trial(bench: Bench, held_n: float, seed: int, bias_kept: bool) -> dict[str, Any]:
    """Load a rig, cut it, start its bridge again, and compare the wrench with the plant's.

    Args:
        bench: makes the rig.
        held_n: load, in a random direction [N].
        seed: of plant and direction.
        bias_kept: whether the bias of the run before lies on the disk.
    """
    random = np.random.default_rng([seed, round(held_n)])
    rig = bench.zeroed(seed)
    direction = random.normal(size=3)
    rig.mode = OperatingMode.LOADING
    rig.desired[:3] = held_n * direction / np.linalg.norm(direction)
    rig.run(0.8)
    bias = rig.bridge.sensor_tare.proven
    rig.guard.emergency_stop()
    rig.mode = OperatingMode.FAULT
    rig.run(0.3)
    rig.start_again(bias if bias_kept else None)
    rig.run(1.0)
    measured = rig.wrenches.to_base_axes(rig.bridge.wrench)
    error = measured - rig.plant.wrench
    known = rig.bridge.tared
    return {
        "held_n": held_n,
        "seed": seed,
        "bias_kept": bias_kept and bias is not None,
        "known": bool(known),
        "error_n": float(np.linalg.norm(error[:3])) if known else None,
        "error_nm": float(np.linalg.norm(error[3:])) if known else None,
        "true_n": float(np.linalg.norm(rig.plant.wrench[:3])),
    }


def restart_row(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """Count trials of one load, with or without a bias on the disk.

    Args:
        trials: at least one.
    """
    known = [t for t in trials if t["known"]]
    return {
        "held_n": trials[0]["held_n"],
        "bias_kept": trials[0]["bias_kept"],
        "trials": len(trials),
        "usable": len(known),
        "wrong": sum(t["error_n"] > WRONG_N or t["error_nm"] > WRONG_NM for t in known),
        "error_max_n": max((t["error_n"] for t in known), default=0.0),
        "error_max_nm": max((t["error_nm"] for t in known), default=0.0),
    }
