# SPDX-License-Identifier: Apache-2.0
"""The same short campaign on each simulated robot controller that cabols speaks with.

A few loads through all nodes: on IRC5's web services and OmniCore's with the bench's arm, where the
same must be measured; then over RTDE with an arm and a rig folder of its own. What is found is held
against the simulated arm's stiffness.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from cabols_control.bringup.processes import executable_path
from cabols_control.rig_folder import find_rig
from cabols_control.rig_tools.new_rig import make_rig
from cabols_sim.bench.campaign_kills import short_campaign

WITHIN = 4.0
"""Deviations by which results may differ, from each other and from the truth."""
UR20 = Path(__file__).resolve().parents[2] / "examples" / "ur20.urdf"


class Found(NamedTuple):
    """Stiffness and deviation of each joint [N m/rad], number of loads."""

    stiffness: np.ndarray
    deviation: np.ndarray
    loads: int


def run(folder, campaign, *words):
    """Run one campaign, unless its result is there."""
    if not (folder / "result.yaml").exists():
        command = [str(executable_path("cabols_sim", "campaign_bench")), "--output", str(folder)]
        command += ["--campaign", str(campaign), "--seed", "5", *words]
        with (folder.parent / f"{folder.name}.log").open("w", encoding="utf-8") as log:
            # A short campaign may miss the target of a long one.
            subprocess.run(command, check=False, stdout=log, stderr=log)
    joints = yaml.safe_load((folder / "result.yaml").read_text("utf-8"))["joints"]
    names = ("stiffness_nm_per_rad", "standard_deviation_nm_per_rad")
    found = [np.array([joint[name] or np.nan for joint in joints]) for name in names]
    with (folder / "samples.csv").open(encoding="utf-8") as stream:
        return Found(*found, len(list(csv.DictReader(stream))))


def table(found, truth):
    """Errors of each campaign, in percent and in stated deviations."""
    lines = [f"{'joint':>5}  " + "  ".join(f"{name:>24}" for name in found)]
    for j, true in enumerate(truth):
        cells = []
        for one in found.values():
            off = one.stiffness[j] - true
            cells.append(f"{100.0 * off / true:+13.2f} % {off / one.deviation[j]:+6.1f} s")
        lines.append(f"{j + 1:5d}  " + "  ".join(f"{cell:>24}" for cell in cells))
    lines.append("loads  " + "  ".join(f"{one.loads:24d}" for one in found.values()))
    return "\n".join(lines)


def main():
    """Print the table; 0 if all agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/campaign_robots"))
    parser.add_argument("--configurations", type=int, nargs="*", default=[0, 9])
    parser.add_argument("--paths", type=int, default=2)
    options = parser.parse_args()
    output = options.output
    output.mkdir(parents=True, exist_ok=True)
    campaign, own = output / "short.yaml", output / "ur_rig"
    short_campaign(campaign, options.configurations, options.paths)
    if not own.exists():
        make_rig(own, robot=UR20)
    robots = {
        "RWS 1, IRB 1600": ("--rws-version", "1"),
        "RWS 2, IRB 1600": ("--rws-version", "2"),
        "RTDE, UR20": ("--rig", str(own), "--robot-maker", "ur"),
    }
    found = {
        name: run(output / f"campaign_{k}", campaign, *words)
        for k, (name, words) in enumerate(robots.items(), start=1)
    }
    truth = np.array(yaml.safe_load(find_rig().file("robot_truth.yaml").read_text())["stiffness"])
    text = "errors of the stiffness found, s: in its stated deviations\n" + table(found, truth)
    one, two, _ = found.values()
    apart = np.abs(one.stiffness - two.stiffness) / np.hypot(one.deviation, two.deviation)
    off = [np.abs(each.stiffness - truth) / each.deviation for each in found.values()]
    same = one.loads == two.loads and bool((apart <= WITHIN).all())
    near = all(bool((each <= WITHIN).all()) for each in off)
    text += f"\nboth versions of RWS {'agree' if same else 'DO NOT AGREE'}; largest "
    text += f"{np.nanmax(apart):.2f} s apart"
    text += f"\nall within {WITHIN:g} s of the truth: {'yes' if near else 'NO'}"
    print(text)
    (output / "table.txt").write_text(text + "\n", encoding="utf-8")
    return 0 if same and near else 1


if __name__ == "__main__":
    sys.exit(main())
