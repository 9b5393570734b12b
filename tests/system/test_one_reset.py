# SPDX-License-Identifier: Apache-2.0
"""One reset lifts a stop, also beside a supervisor that was killed and started again.

The real nodes; tests/control/test_stop_orders.py visits every order of messages in process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

TRIALS = Path(__file__).parents[1] / "bench" / "stop_trials.py"


@pytest.mark.ros
@pytest.mark.long
@pytest.mark.timeout(900)
def test_no_press_is_lost_and_none_needs_a_second_reset(tmp_path):
    output = tmp_path / "trials.jsonl"
    words = ["--presses", "9", "--quiet", "--output", str(output)]
    command = [sys.executable, str(TRIALS), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    found = json.loads(output.with_suffix(".json").read_text())
    assert found["presses"] == 9
    assert found["beside_a_restart"] == 3
    assert found["lost"] == 0
    assert found["reset_more_than_once"] == 0
