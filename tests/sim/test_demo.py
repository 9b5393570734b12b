# SPDX-License-Identifier: Apache-2.0
"""The demo as a user starts and interrupts it."""

from __future__ import annotations

import os
import signal
import subprocess

import psutil
import pytest
from cabols_msgs.msg import Mode

from cabols_control.bags.reader import read_bag
from cabols_control.bringup.processes import executable_path
from graph_harness import next_environment

pytestmark = [pytest.mark.ros, pytest.mark.ordinary_start, pytest.mark.timeout(240)]


# Slow motion: a stall of a busy machine must not trip the rig's watchdogs.
@pytest.mark.parametrize(
    ("arguments", "nodes_running", "until", "last_mode"),
    [
        (["--rigid", "--speed", "0.2"], 6, "mode LOADING", Mode.LOADING),
        (["--speed", "0.3"], 8, "robot to configuration 2", Mode.FREE_MOVING),
    ],
    ids=["rigid", "session"],
)
def test_ctrl_c_ends_everything_and_keeps_the_bag(
    tmp_path, arguments, nodes_running, until, last_mode
):
    output = tmp_path / "demo"
    demo = subprocess.Popen(
        [str(executable_path("cabols_sim", "demo")), "--output", str(output), *arguments],
        env={**os.environ, **next_environment()},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    lines = []
    assert demo.stdout is not None
    for line in demo.stdout:
        lines.append(line)
        if until in line:
            break
    assert demo.poll() is None, "".join(lines)
    children = psutil.Process(demo.pid).children(recursive=True)
    timers = [child for child in children if "cabols_sim.bench.bare_timer" in child.cmdline()]
    nodes = [child for child in children if child not in timers]
    assert len(nodes) == nodes_running, "".join(lines)
    assert timers
    demo.send_signal(signal.SIGINT)
    rest = demo.communicate(timeout=300)[0]
    assert demo.returncode == 130, "".join(lines) + rest
    assert "motors at zero" in rest
    assert not [child for child in children if child.is_running()]
    for log in (output / "log").iterdir():
        assert "compiled during operation" not in log.read_text(), f"{log.name}: see warm_up.py"
    bag = read_bag(output / "bag")
    assert len(bag["limb_state"]) > 100
    assert (bag["mode"]["mode"] == last_mode).any()
