# SPDX-License-Identifier: Apache-2.0
"""The q8_ati_bridge node itself, on a fake card."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import graph_harness
from graph_harness import next_environment

pytestmark = pytest.mark.ros


def run_child(samples):
    child = Path(graph_harness.__file__).with_name("q8_child.py")
    ended = subprocess.run(
        [sys.executable, str(child), str(samples)],
        env={**os.environ, **next_environment()},
        capture_output=True,
        text=True,
        timeout=400.0,
        check=False,
    )
    assert ended.stdout.strip(), ended.stderr
    return json.loads(ended.stdout.strip().splitlines()[-1]), ended.stderr


def test_node_samples_the_card_and_leaves_it_safe():
    report, errors = run_child(300)
    assert report["code"] == 0, errors
    assert report["reads"] >= 100
    assert report["first"][0] == "open"
    assert report["first"].index("watchdog_start") < report["first"].index("write_analog")
    assert report["last"] == [
        "write_analog",
        "write_digital",
        "task_stop",
        "task_delete",
        "watchdog_stop",
        "close",
    ]
    assert report["volts"] == [0.0] * 8
    assert report["enabled"] == []


def test_node_without_the_driver_says_what_to_do():
    report, errors = run_child(0)
    assert report["code"] == 2
    assert "simulated bench" in errors
