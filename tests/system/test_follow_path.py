# SPDX-License-Identifier: Apache-2.0
"""The robot is led along a path while the cables hold a load, through all nodes."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.result_code import ResultCode
from cabols_control.ros.rig_client import ActionFailedError, RefusedError, RigClient
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.abb.configurations import load_configurations
from graph_harness import Watcher, run_scenario

pytestmark = pytest.mark.ros

FORCE_N = 40.0
SPEED = 0.03
"""Beyond what is allowed without an announced path, 20 mm/s."""


def test_a_loaded_robot_follows_a_path_and_stops_with_the_cables(tmp_path):
    held = tmp_path / "held.csv"
    held.write_text(
        "time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,0,0,0,0,0,0\n"
        f"1,0,0,{FORCE_N},0,0,2\n200,0,0,{FORCE_N},0,0,2\n"
    )
    joints = load_configurations().configurations
    half = 0.5 * (np.array(joints[0]) + np.array(joints[1]))
    path = tmp_path / "path.csv"
    rows = [half, joints[0]]
    header = ",".join(f"joint_{i}" for i in range(1, 7))
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    found = {}

    def scenario(watcher: Watcher, pids: dict[str, int]) -> None:
        del pids
        with RigClient(domain=watcher.context.get_domain_id(), speed=0.2) as rig:
            rig.wait_running()
            rig.pretighten()
            with pytest.raises(RefusedError):
                # In PRETIGHTENING no robot is led.
                rig.run("follow_path", accept_s=0.1, index=[1], speed=SPEED)
            rig.enter(OperatingMode.LOADING)
            load = rig.start("run_program", program=str(held), frame="platform")
            rig.pause(2.0)
            for bad in (
                {"index": [1], "speed": 0.2},
                {"index": [1], "speed": float("nan")},
                {"index": [99], "speed": SPEED},
                {"index": [], "speed": SPEED},
                {"index": [1], "path_file": str(path), "speed": SPEED},
                {"index": [1], "speed": 0.095},
            ):
                with pytest.raises(RefusedError):
                    rig.run("follow_path", accept_s=0.1, **bad)
            seen = watcher.seen["frame_wrench"]
            before = len(seen)
            found["file"] = rig.run("follow_path", path_file=str(path), speed=SPEED)
            found["stored"] = rig.run("follow_path", index=[1], speed=SPEED)
            found["wrenches"] = list(seen[before:])
            found["mode"] = rig.mode
            running = rig.start("follow_path", index=[4], speed=SPEED)
            rig.pause(1.0)
            rig.enter(OperatingMode.STOPPED)
            with pytest.raises(ActionFailedError) as failed:
                running.result(even_in_fault=True)
            found["stopped"] = failed.value.result
            found["last"] = rig.mode
            del load

    # A busy machine may hold up the stream of poses, which is not what is tried here.
    # The rig's time stands still while a process stalls, these two count on the computer's clock.
    patience = {"stale_after": 5.0, "state_timeout": 5.0}
    values = {"robot": True, "lockstep": True, "console": False, **patience}
    topics = ("mode", "loop_status", "frame_wrench")
    run_scenario(values, scenario, topics)
    for name in ("file", "stored"):
        assert found[name].success, found[name].message
        assert found[name].code == ResultCode.DONE
    assert found["mode"] == OperatingMode.LOADING
    assert not found["stopped"].success
    assert found["stopped"].code in (ResultCode.INTERRUPTED, ResultCode.FAILED)
    assert found["last"] == OperatingMode.STOPPED
    wrenches = found["wrenches"]
    assert len(wrenches) > 20
    assert {each.header.frame_id for each in wrenches} == {"platform"}
    errors = [
        [each.measured.force.x, each.measured.force.y, each.measured.force.z - FORCE_N]
        for each in wrenches
    ]
    assert np.sqrt(np.mean(np.square(errors))) < 1.0
