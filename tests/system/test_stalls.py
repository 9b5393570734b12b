# SPDX-License-Identifier: Apache-2.0
"""What a busy machine keeps a process from is told apart from what the process takes itself."""

from __future__ import annotations

import os
import subprocess
import sys

from stalls import Stalls

COMPUTES = "import time\nwhile time.process_time() < 0.6: pass"
SLEEPS = "import time; time.sleep(0.6)"
BURNS = "while True: pass"


def kept_s(code, beside):
    """Seconds that a process was kept from running, beside others on one core."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        burners = [subprocess.Popen([sys.executable, "-c", BURNS]) for _ in range(beside)]
        child = subprocess.Popen([sys.executable, "-c", code])
    finally:
        os.sched_setaffinity(0, cores)
    try:
        with Stalls(child.pid) as stalls:
            child.wait()
        return 1e-9 * sum(last - first for first, last in stalls._waited_ns.values())
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def test_a_process_that_computes_beside_others_is_excused():
    assert kept_s(COMPUTES, beside=2) > 0.4


def test_a_process_that_sleeps_is_not():
    assert kept_s(SLEEPS, beside=0) < 0.3
