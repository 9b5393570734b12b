# SPDX-License-Identifier: Apache-2.0
"""What extrapolated poses, backlash and uncertainty add to a control cycle, in turn with them off.

Wrench controller and limb controller answer made-up samples of a rig that holds a load on a moving
platform, with each feature on and off in turn, a block at a time. Given is what a cycle of the
fastest block took with and without, which other work on the machine disturbs least, and their
ratio.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.frames import load_wrench_frames, load_wrench_uncertainty
from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.rig import Rig, load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController

BLOCK, POSE_EVERY, TOLD_EVERY = 100, 4, 10
HELD = np.array([30.0, 0.0, 0.0, 0.0, 0.0, 2.0])


class Cycle:
    """Both controllers on samples that are made up, on a platform that moves at 50 mm/s."""

    def __init__(self, rig: Rig, tells: bool = False) -> None:
        self.wrenches, self.limbs, self.rig = WrenchController(rig), LimbController(rig), rig
        self.known = load_wrench_uncertainty(load_wrench_frames(rig.geometry)) if tells else None
        n = rig.geometry.cables
        self.length, self.flags, self.count = np.full(n, 0.01), np.ones(n, dtype=np.bool_), 0
        self.turn, self.measured = np.array(rig.geometry.reference_rotation), HELD.copy()

    def step(self) -> None:
        """Answer one sample."""
        self.count += 1
        now_s = 1e-3 * self.count
        if self.count % POSE_EVERY == 0:
            place = np.array(self.rig.geometry.reference_position)
            place[:1] += 0.01 * np.sin(now_s)
            self.wrenches.hear_pose(now_s - 0.006, place, self.turn)
        self.wrenches.place(now_s)
        wanted = DesiredWrench(now_s, HELD)
        tension = self.wrenches.step(now_s, self.measured, OperatingMode.LOADING, wanted)
        if self.known is not None and self.count % TOLD_EVERY == 0:
            self.known.of("", None, self.turn, self.wrenches.acceleration, self.measured)
        length = self.length + 1e-5 * np.sin(now_s)
        sample = LimbSample(now_s, length, length, length, self.flags, self.flags)
        setpoint = TensionSetpoint(now_s, tension, True)
        self.limbs.step(sample, OperatingMode.LOADING, setpoint)


def block(cycle: Cycle) -> float:
    """Mean time of a cycle in a block [us]."""
    start = time.perf_counter_ns()
    for _ in range(BLOCK):
        cycle.step()
    return 1e-3 * (time.perf_counter_ns() - start) / BLOCK


def main() -> None:
    """Print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/cycle_cost.json"))
    parser.add_argument("--blocks", type=int, default=100)
    options = parser.parse_args()
    rig = load_rig()
    without = replace(rig, control=replace(rig.control, pose_horizon=0.0))
    allowed = replace(rig, limbs=replace(rig.limbs, backlash=0.00015))
    pairs = {
        "poses extrapolated and filtered": (Cycle(rig), Cycle(without)),
        "backlash known": (Cycle(allowed), Cycle(rig)),
        "uncertainty of the wrench told": (Cycle(rig, tells=True), Cycle(rig)),
    }
    figures = {}
    for name, pair in pairs.items():
        rounds = [[block(cycle) for cycle in pair] for _ in range(options.blocks)][5:]
        on, off = np.min(rounds, axis=0)
        ratio = float(on / off)
        figures[name] = {"with_us": float(on), "without_us": float(off), "ratio": ratio}
        print(f"{name:34} {on:7.2f} us with, {off:7.2f} us without, ratio {ratio:.3f}")
    write_figures(options.output, figures)


if __name__ == "__main__":
    main()
