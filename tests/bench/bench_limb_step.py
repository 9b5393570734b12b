# SPDX-License-Identifier: Apache-2.0
"""What one step of the limb controller costs in each mode, from message to message.

Usage: python tests/bench/bench_limb_step.py [--output build/bench/limb_step.json] [--steps 5000]

The modes are taken in turn in one run, in blocks, so that whatever else the machine does hits all
alike. Caches are warm; in the running loop they are not. Runs on version 0.1, too.
"""

from __future__ import annotations

import argparse
import gc
import time
from pathlib import Path
from typing import Any

import numpy as np
from record import write_figures

from cabols_control.rig import Rig, load_rig
from cabols_control.ros.messages import topics

try:
    from cabols_control.limb_control.controller import LimbController, TensionSetpoint
    from cabols_control.supervision.modes import OperatingMode
except ImportError:  # version 0.1
    from cabols_control.limb_controller import LimbController, LimbSample, TensionSetpoint
    from cabols_control.modes import OperatingMode

MODES = ("STOPPED", "PRETIGHTENING", "LOADING", "UNLOADING", "FREE_MOVING")
BLOCK = 250
PERIOD_S = 0.001


class Steps:
    """A controller in one mode, and the messages that it gets and gives."""

    def __init__(self, mode: OperatingMode, rig: Rig, layout: Any, answer: Any) -> None:
        self._n = rig.geometry.cables
        self._mode = mode
        self._controller = LimbController(rig)
        self._layout, self._record, self._answer = layout, layout.record(), answer
        self._random = np.random.default_rng(1)
        self._stamp_s = 0.0
        self._step = self._answer_state if hasattr(self._controller, "answer") else self._in_0_1

    def prepare(self, count: int) -> list[tuple[float, bytes, TensionSetpoint]]:
        """Messages and commands of so many steps."""
        prepared = []
        for _ in range(count):
            self._stamp_s += PERIOD_S
            record, tension = self._record, self._random.uniform(9.0, 11.0, self._n)
            record.stamp(round(1e9 * self._stamp_s))
            record["limb"][:] = range(self._n)
            record["zeroed"][:] = record["switch_closed"][:] = True
            record["tension"][:], record["elongation"][:] = tension, tension / 2200.0
            record["wound_length"][:] = 0.01 + tension / 9e4
            setpoint = TensionSetpoint(self._stamp_s, np.full(self._n, 10.0), True)
            prepared.append((self._stamp_s, record.raw(), setpoint))
        return prepared

    def run(self, prepared: list[tuple[float, bytes, TensionSetpoint]]) -> list[int]:
        """Nanoseconds of each step."""
        clock, taken = time.perf_counter_ns, []
        for stamp_s, raw, setpoint in prepared:
            began = clock()
            self._step(stamp_s, raw, setpoint)
            taken.append(clock() - began)
        return taken

    def _answer_state(self, stamp_s: float, raw: bytes, setpoint: TensionSetpoint) -> None:
        state = np.frombuffer(raw, self._layout.compiled_dtype, 1)
        self._controller.answer(stamp_s, self._mode, setpoint, state, self._answer.compiled)

    def _in_0_1(self, stamp_s: float, raw: bytes, setpoint: TensionSetpoint) -> None:
        """Do what the node of version 0.1 did."""
        controller, answer = self._controller, self._answer
        state = np.frombuffer(raw, self._layout.compiled_dtype, 1)
        if controller.step_loaded(stamp_s, self._mode, setpoint, state, answer.compiled):
            return
        record = self._layout.read(raw)
        names = ("wound_length", "elongation", "tension", "switch_closed", "zeroed")
        sample = LimbSample(stamp_s, *(record[name] for name in names))
        current = controller.step(sample, self._mode, setpoint)
        answer.stamp(round(1e9 * stamp_s))
        answer["sequence"][0] = record["sequence"]
        answer["current"][:] = current
        answer["saturated"][:] = controller.saturated


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/limb_step.json"))
    parser.add_argument("--steps", type=int, default=5000, help="for each mode")
    options = parser.parse_args()
    rig = load_rig()
    # One layout for all, as in a node: compiled code takes longer to tell equal ones apart.
    layout = topics.limb_state_layout(rig.geometry)
    answer = topics.motor_current_layout(rig.geometry, rig.geometry.cables).record()
    steps = {name: Steps(OperatingMode[name], rig, layout, answer) for name in MODES}
    taken: dict[str, list[int]] = {name: [] for name in MODES}
    for each in steps.values():
        each.run(each.prepare(BLOCK))
    gc.disable()
    for _ in range(max(1, options.steps // BLOCK)):
        for name, each in steps.items():
            taken[name] += each.run(each.prepare(BLOCK))
    figures = {}
    for name, times in taken.items():
        median, tail = float(np.median(times)), float(np.percentile(times, 99))
        figures[f"{name.lower()}_median_ns"], figures[f"{name.lower()}_p99_ns"] = median, tail
        print(f"{name:14s} median {median:8.0f} ns   p99 {tail:8.0f} ns")
    write_figures(options.output, {"steps": options.steps, **figures})


if __name__ == "__main__":
    main()
