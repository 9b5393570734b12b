# SPDX-License-Identifier: Apache-2.0
"""A platform that hangs on its cables alone: the real nodes grant no mode with currents."""

from __future__ import annotations

from functools import partial

import pytest
import yaml
from cabols_msgs.srv import SetMode

from cabols_control.result_code import ResultCode
from cabols_control.rig_folder import rig_file
from cabols_control.supervision.modes import MOVING, OperatingMode
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(120)]


def test_nothing_moves_a_platform_that_nothing_holds(tmp_path):
    content = yaml.safe_load(rig_file("safety.yaml").read_text("utf-8"))
    path = tmp_path / "safety.yaml"
    path.write_text(yaml.safe_dump(content | {"platform_held": False}), "utf-8")
    answers = {}

    def asked(watcher, mode):
        return watcher.call(SetMode, "set_mode", SetMode.Request(mode=int(mode)))

    def is_judged(watcher, mode):
        answers[mode] = asked(watcher, mode)
        assert not answers[mode].success
        return answers[mode].code != ResultCode.NOT_READY

    def scenario(watcher, pids):
        del pids
        watcher.wait(
            lambda: any(m.fault == "not_held" for m in watcher.seen["loop_status"]),
            "the bridge's notice",
        )
        for mode in MOVING:
            watcher.wait(partial(is_judged, watcher, mode), "the supervisor to hear all nodes")
        answers[OperatingMode.STOPPED] = asked(watcher, OperatingMode.STOPPED)

    # It asks for a load by itself, as far as it may.
    values = {"safety_file": str(path), "robot": False, "auto_start": True}
    _, lines, watcher = run_scenario(values, scenario)
    assert set(answers) == {*MOVING, OperatingMode.STOPPED}, "\n".join(lines[-30:])
    assert answers[OperatingMode.STOPPED].success
    for mode in MOVING:
        assert not answers[mode].success
        assert (answers[mode].code, answers[mode].fault) == (ResultCode.FAULT_REPORTED, "not_held")
        assert "robot or a stand" in answers[mode].message
    assert set(watcher.modes()) == {OperatingMode.STOPPED}
    assert not any(any(m.current) for m in watcher.seen["limb_state"])
