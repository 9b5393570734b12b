# SPDX-License-Identifier: Apache-2.0
"""A process with real-time scheduling gives no memory back while it runs."""

from __future__ import annotations

import subprocess
import sys

import pytest

from cabols_control.realtime.scheduling import may_use_fifo

FREED = """
import sys
import numpy as np
from cabols_control.realtime.scheduling import Scheduling, apply_scheduling
apply_scheduling(Scheduling(fifo_priority=int(sys.argv[1])), print)
def resident_mb():
    text = open("/proc/self/status").read()
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024
before = resident_mb()
array = np.ones(5_000_000)
del array
print(resident_mb() - before)
"""


@pytest.mark.skipif(not may_use_fifo(), reason="the kernel grants no SCHED_FIFO here")
@pytest.mark.parametrize(("priority", "kept_mb"), [(1, 38.0), (0, 0.0)])
def test_forty_megabytes_that_are_freed_stay(priority, kept_mb):
    command = [sys.executable, "-c", FREED, str(priority)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert float(done.stdout) == pytest.approx(kept_mb, abs=4.0)
