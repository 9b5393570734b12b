# SPDX-License-Identifier: Apache-2.0
"""Runs the q8_ati_bridge node on a fake card in real time; test_q8_node.py starts it.

Arguments: how many samples before it interrupts itself; 0 for a machine without the driver. Prints
what became of the card as JSON on the last line.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
import types

import fake_quanser
from cabols_hw.nodes import q8_ati_bridge


class RealTimeBoard(fake_quanser.Board):
    """Its clock is the computer's; it interrupts this process after some samples."""

    def __init__(self, samples):
        super().__init__()
        self.now_ns = time.monotonic_ns()
        self._samples = samples

    def elapse(self, duration_ns):
        time.sleep(1e-9 * duration_ns)
        super().elapse(time.monotonic_ns() - self.now_ns)
        if self.task is not None and self.task.index >= self._samples > 0:
            self._samples = 0
            os.kill(os.getpid(), signal.SIGINT)


def main():
    samples = int(sys.argv[1])
    # Its limbs have no wiring that could be checked.
    sys.argv = [sys.argv[0], "--ros-args", "-p", "power_on_check:=skipped"]
    board = RealTimeBoard(samples)
    package = types.ModuleType("quanser")
    package.hardware = fake_quanser.make_api(board)
    sys.modules["quanser"] = package if samples else None
    sys.modules["quanser.hardware"] = package.hardware if samples else None
    code = q8_ati_bridge.main()
    names = board.names()
    print(
        json.dumps(
            {
                "code": code,
                "first": names[:12],
                "last": names[-6:],
                "reads": names.count("task_read"),
                "volts": board.volts.tolist(),
                "enabled": board.enabled,
            }
        )
    )


if __name__ == "__main__":
    main()
