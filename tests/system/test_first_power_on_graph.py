# SPDX-License-Identifier: Apache-2.0
"""Before the wiring has been checked nothing else moves; afterwards the rig is as any other."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import yaml
from cabols_msgs.srv import SetMode
from std_srvs.srv import Trigger

from cabols_control.result_code import ResultCode
from cabols_control.rig_folder import rig_file
from cabols_control.supervision.modes import OperatingMode
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(120)]


def slack(folder):
    """A plant whose cables are nearly tight, as hands have left them."""
    content = yaml.safe_load(rig_file("plant.yaml").read_text("utf-8"))
    content["limbs"].update(initial_slack=0.0015, slack_spread=0.0005)
    path = folder / "plant.yaml"
    path.write_text(yaml.safe_dump(content), "utf-8")
    return str(path)


STALLED = ("command_age", "state_age", "tension_age", "mode_age")
"""Faults of a computer that stalls, which is no finding here: the check is made again."""


def asked(watcher, mode):
    return watcher.call(SetMode, "set_mode", SetMode.Request(mode=int(mode)))


def test_nothing_else_moves_before_the_check_has_passed(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    told = []

    def check(watcher):
        """Run the command beside the graph."""
        done = subprocess.run(
            [sys.executable, "-m", "cabols_control.nodes.first_power_on"],
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(sys.path),
                "ROS_DOMAIN_ID": str(watcher.context.get_domain_id()),
            },
            capture_output=True,
            text=True,
            timeout=400,
            check=False,
        )
        told.append(done.stdout + done.stderr)
        return done.returncode

    def passes(watcher):
        """Whether the check passes; what a stalled computer ends is begun again."""
        for _ in range(20):
            if check(watcher) == 0:
                return True
            if watcher.seen["mode"][-1].fault not in STALLED:
                return False
            watcher.wait(
                lambda: watcher.call(Trigger, "reset", Trigger.Request()).success, "the reset"
            )
        return False

    def scenario(watcher, pids):
        watcher.wait(lambda: watcher.seen["limb_state"], "a limb state")
        watcher.wait(
            lambda: any(m.fault == "first_power_on" for m in watcher.seen["loop_status"]),
            "the bridge's notice",
        )
        for mode in ("PRETIGHTENING", "FREE_MOVING"):
            answer = asked(watcher, OperatingMode[mode])
            assert not answer.success
            assert answer.code in (ResultCode.FAULT_REPORTED, ResultCode.NOT_READY)
        assert passes(watcher), told
        answer = asked(watcher, OperatingMode.PRETIGHTENING)
        watcher.wait(lambda: asked(watcher, OperatingMode.PRETIGHTENING).success, "pre-tightening")

    # A stall of a busy machine is no finding here.
    patient = {"watchdog": 0.1, "command_timeout": 0.1, "state_timeout": 2.0}
    values = {"power_on_check": "required", "plant_file": slack(tmp_path), **patient}
    _, lines, watcher = run_scenario(values, scenario)
    assert told, "\n".join(lines[-40:])
    state = json.loads(next((tmp_path / "state").rglob("first_power_on_*.json")).read_text())
    assert state["limbs"] == list(range(8))
    assert "all 8 limbs have passed" in told[-1]
    checked = [m for m in watcher.seen["limb_state"] if m.mode == OperatingMode.COMMISSIONING]
    currents = np.array([m.current for m in checked])
    assert np.abs(currents).max() <= 0.1 + 1e-9
    assert (np.count_nonzero(currents, axis=1) <= 1).all()
