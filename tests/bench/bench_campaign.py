# SPDX-License-Identifier: Apache-2.0
"""Whether simulated campaigns find the true stiffness, and whether their intervals hold it.

Campaigns of five configurations run on the whole simulated rig, through all nodes and devices, one
seed after the other; each seed reaches every source of noise: sensor, slack, tracker, lost packets.
Campaigns that are finished are not repeated, one that was cut goes on. `--minutes 5` ends after
the campaign that is running then, and gives the figures so far.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.bringup.processes import executable_path
from cabols_sim.bench.campaign import COMPLETE
from cabols_sim.bench.campaign_kills import short_campaign
from cabols_sim.devices.robot.robot_config import load_robot_truth

CONFIGURATIONS = [0, 9, 8, 4, 3]
PATHS = 3
SEEDS = 20
TARGET = 0.02
COVERAGE = (0.90, 0.98)
"""Of the 95 % intervals, of a campaign that says what it knows."""


def run(seed, folder, campaign):
    """Run one seed's campaign, unless it is finished; whether it has a result."""
    result = folder / "result.yaml"
    if not (result.exists() and (folder / COMPLETE).exists()):
        command = [str(executable_path("cabols_sim", "campaign_bench")), "--output", str(folder)]
        command += ["--campaign", str(campaign), "--seed", str(seed)]
        with (folder.parent / f"{folder.name}.log").open("a", encoding="utf-8") as log:
            subprocess.run(command, check=False, stdout=log, stderr=log)
    return result.exists() and (folder / COMPLETE).exists()


def figures_of(folders, truth):
    """Errors and coverage of the campaigns that have a result."""
    errors, inside, deviations = [], [], []
    for folder in folders:
        joints = yaml.safe_load((folder / "result.yaml").read_text("utf-8"))["joints"]
        found = np.array([joint["stiffness_nm_per_rad"] or np.nan for joint in joints])
        interval = np.array([joint["interval_95_nm_per_rad"] for joint in joints], dtype=float)
        spread = np.array([joint["standard_deviation_nm_per_rad"] or np.nan for joint in joints])
        errors.append(found / truth - 1.0)
        inside.append((interval[:, 0] <= truth) & (truth <= interval[:, 1]))
        deviations.append(spread / truth)
    errors = np.array(errors)
    return {
        "campaigns": len(folders),
        "configurations_each": len(CONFIGURATIONS),
        "largest_error_relative": np.abs(errors).max(axis=0).tolist(),
        "bias_relative": errors.mean(axis=0).tolist(),
        "scatter_relative": (
            errors.std(axis=0, ddof=1) if len(errors) > 1 else 0 * errors[0]
        ).tolist(),
        "stated_deviation_relative": np.mean(deviations, axis=0).tolist(),
        "coverage_95": np.mean(inside, axis=0).tolist(),
        "coverage_95_pooled": float(np.mean(inside)),
        "intervals": int(np.size(inside)),
    }


def show(figures):
    """Print the table, and whether the targets are met."""
    print("joint                          1        2        3        4        5        6")
    for key, label in (
        ("largest_error_relative", "largest error, %"),
        ("bias_relative", "mean error, %"),
        ("scatter_relative", "scatter, %"),
        ("stated_deviation_relative", "stated deviation, %"),
        ("coverage_95", "95 % interval covers, %"),
    ):
        print(f"{label:24s}" + " ".join(f"{100.0 * value:8.2f}" for value in figures[key]))
    pooled, (low, high) = figures["coverage_95_pooled"], COVERAGE
    worst = max(figures["largest_error_relative"])
    print(f"{figures['campaigns']} campaigns: largest error {100 * worst:.2f} %, "
          f"{'met' if worst <= TARGET else 'NOT MET'} ({100 * TARGET:g} %)")  # fmt: skip
    print(f"pooled coverage {100 * pooled:.1f} % of {figures['intervals']} intervals, "
          f"{'met' if low <= pooled <= high else 'NOT MET'} "
          f"({100 * low:g} to {100 * high:g} %)")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--minutes", type=float, default=np.inf, help="then begin no new campaign")
    parser.add_argument("--output", type=Path, default=Path("build/bench_campaign"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    campaign = options.output / "campaign.yaml"
    short_campaign(campaign, CONFIGURATIONS, PATHS)
    truth = np.array(load_robot_truth().stiffness)
    until = time.monotonic() + 60.0 * options.minutes
    done, failed = [], []
    for seed in range(options.seeds):
        if time.monotonic() > until:
            print(f"{seed} of {options.seeds} seeds after {options.minutes:g} min: call again")
            break
        began = time.monotonic()
        folder = options.output / f"seed_{seed:02d}"
        (done if run(seed, folder, campaign) else failed).append(folder)
        print(f"seed {seed}: {time.monotonic() - began:.0f} s", flush=True)
    if not done:
        print("no campaign has a result; see the logs")
        return 1
    figures = figures_of(done, truth)
    show(figures)
    if failed:
        print(f"without a result: {', '.join(folder.name for folder in failed)}")
    write_figures(Path("build/bench/campaign.json"), {**figures, "failed": len(failed)})
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
