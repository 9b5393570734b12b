"""The same short campaign on the simulated controllers of both versions of Robot Web Services.

A few loads through all nodes, first on IRC5's web services, then on OmniCore's: the same must be
measured, and the stiffness found must agree within its deviations.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml

from cabols_control.bringup.processes import executable_path
from cabols_sim.bench.campaign_kills import short_campaign

WITHIN = 4.0
"""Deviations by which two campaigns' results may differ."""


def run(version, folder, campaign):
    """Run one campaign; its stiffness, deviations and number of loads."""
    command = [str(executable_path("cabols_sim", "campaign_bench")), "--output", str(folder)]
    command += ["--campaign", str(campaign), "--rws-version", str(version), "--seed", "5"]
    with (folder.parent / f"{folder.name}.log").open("w", encoding="utf-8") as log:
        # A short campaign may miss the target of a long one.
        subprocess.run(command, check=False, stdout=log, stderr=log)
    joints = yaml.safe_load((folder / "result.yaml").read_text("utf-8"))["joints"]
    names = ("stiffness_nm_per_rad", "standard_deviation_nm_per_rad")
    found = [[joint[name] or np.nan for joint in joints] for name in names]
    with (folder / "samples.csv").open(encoding="utf-8") as stream:
        loads = len(list(csv.DictReader(stream)))
    return np.array(found[0]), np.array(found[1]), loads


def main():
    """Print the table; 0 if both agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/campaign_versions"))
    parser.add_argument("--configurations", type=int, nargs="*", default=[0, 9])
    parser.add_argument("--paths", type=int, default=2)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    campaign = options.output / "short.yaml"
    short_campaign(campaign, options.configurations, options.paths)
    one, two = (run(v, options.output / f"rws_{v}", campaign) for v in (1, 2))
    print("joint    RWS 1 [Nm/rad]   RWS 2 [Nm/rad]   difference in deviations")
    apart = np.abs(one[0] - two[0]) / np.hypot(one[1], two[1])
    for j, (a, b, d) in enumerate(zip(one[0], two[0], apart, strict=True), start=1):
        print(f"{j:5d}  {a:15.0f}  {b:15.0f}  {d:8.2f}")
    same = one[2] == two[2] and bool((np.isnan(apart) | (apart <= WITHIN)).all())
    print(f"loads: {one[2]} and {two[2]}; {'agree' if same else 'DO NOT AGREE'}")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
