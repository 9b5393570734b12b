# SPDX-License-Identifier: Apache-2.0
"""What the scatter of the source's table 4.3 can and cannot be: noise alone, joint by joint.

Ten configurations of a robot with the table's mean stiffness, the same in all, each identified by
itself, many times. The loaded robot is a product of homogeneous matrices; noise as of the source's
devices: reflector 15 um, sensor 0.2 N and 0.02 N m.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import numpy as np
from record import write_figures

import independent_arm as arm
from cabols_control.configuration import packaged
from cabols_stiffness import identify
from cabols_stiffness.measurements.samples import select


def table():
    """(10, 6) stiffness of the source's configurations [N m/rad]."""
    lines = packaged("cabols_stiffness", "table_4_3.csv").read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    return np.array([[float(row[f"c{c}"]) for c in range(1, 11)] for row in rows]).T


def scatter(values):
    """(6,) relative standard deviation over configurations, by quartiles: single ones run away."""
    low, middle, high = np.percentile(values, [25, 50, 75], axis=0)
    return (high - low) / 1.349 / middle


def main():
    """Print, and write build/bench/table_scatter.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=5, help="of ten configurations each")
    options = parser.parse_args()
    found = table()
    mean = found.mean(axis=0)
    chain, single = arm.Chain(), []
    for seed in range(options.campaigns):
        rng = np.random.default_rng(seed)
        Q, W = arm.configurations(rng, 10), arm.loads(rng, 4)
        columns = arm.truth(Q, W, lambda _, q, w: chain.settle(q, w, mean))
        samples = arm.noisy(columns, rng)
        single += [
            identify(select(samples, samples.configuration == i), arm.robot(), judged=False)
            for i in range(10)
        ]
    noise = scatter(np.array([one.parameters[:6] for one in single]) / mean)
    real = found.std(axis=0, ddof=1) / mean
    needed = real / noise
    print(f"{'joint':44s}" + "".join(f"{j:9d}" for j in range(1, 7)))
    for label, row, form in (
        ("table 4.3, scatter of ten configurations", 100.0 * real, "{:7.1f} %"),
        ("noise alone, constant stiffness", 100.0 * noise, "{:7.1f} %"),
        ("noise needed for the table, times that", needed, "{:9.2f}"),
    ):
        print(f"{label:44s}" + "".join(form.format(value) for value in row))
    least, most = int(needed.argmin()), int(needed.argmax())
    print(
        f"No one noise makes the table: joint {most + 1} needs {needed[most]:.1f} times this one, "
        f"with which joint {least + 1} would scatter by {100 * needed[most] * noise[least]:.0f} % "
        f"and not by {100 * real[least]:.1f} %."
    )
    write_figures(
        Path("build/bench/table_scatter.json"),
        {
            "configurations": len(single),
            "table_relative": real.tolist(),
            "noise_relative": noise.tolist(),
            "noise_needed": needed.tolist(),
        },
    )


if __name__ == "__main__":
    main()
