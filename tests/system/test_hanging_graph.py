# SPDX-License-Identifier: Apache-2.0
"""A platform that hangs on its cables, through the real nodes: up, loaded, stopped, down."""

from __future__ import annotations

import numpy as np
import pytest
from cabols_msgs.srv import SetMode
from geometry_msgs.msg import PoseStamped

from cabols_control.result_code import ResultCode
from cabols_control.rig import load_rig
from cabols_control.ros.rig_client import ActionFailedError, RigClient
from cabols_control.supervision.modes import OperatingMode
from graph_harness import run_scenario

# Alone: where kernels were not compiled yet, it once ended early beside another graph.
pytestmark = [
    pytest.mark.ros,
    pytest.mark.realtime,
    pytest.mark.slow,
    pytest.mark.timeout(300),
]
MODE = OperatingMode
WEIGHT = 4.0 * 9.80665
STAND = np.array(load_rig("hanging").geometry.reference_position)
WATCHED = (
    "limb_state",
    "wrench",
    "platform_pose",
    "true_wrench",
    "true_limb_state",
    "mode",
    "loop_status",
)


def test_lifts_holds_stops_and_sets_down(tmp_path):
    said = {}
    held = tmp_path / "held.csv"
    held.write_text(
        "time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,0,0,0,0,0,0\n1,0,0,5,0,0,0\n300,0,0,5,0,0,0\n"
    )

    def scenario(watcher, pids):
        del pids
        seen = watcher.seen

        def asked(mode):
            return watcher.call(SetMode, "set_mode", SetMode.Request(mode=int(mode)))

        def true_force():
            return seen["true_wrench"][-1].wrench.force.z

        def height():
            return seen["platform_pose"][-1].pose.position.z - STAND[2]

        def rests():
            watcher.wait(lambda: abs(true_force() - WEIGHT) < 0.5, "cables that bear the weight")

        def go(goal, what):
            message = PoseStamped()
            message.header.frame_id = "rig_base"
            place = message.pose.position
            place.x, place.y, place.z = map(float, STAND + np.array([0.0, 0.0, goal]))
            message.pose.orientation.w = 1.0
            watcher.publish_until(poses, message, lambda: abs(height() - goal) < 1e-6, what)

        poses = watcher.publisher("desired_pose")
        with RigClient(domain=watcher.context.get_domain_id(), speed=0.2) as rig:
            rig.wait_running()
            rig.pretighten()
            rig.enter(MODE.LOADING)
            watcher.wait(
                lambda: min(seen["true_limb_state"][-1].tension) > 50.0, "the gears' proof"
            )
            watcher.wait(
                lambda: (
                    max(seen["true_limb_state"][-1].tension) < 40.0 and true_force() > 0.9 * WEIGHT
                ),
                "the weight in the cables",
            )
            go(0.05, "the platform up")
            rests()
            load = rig.start("run_program", program=str(held))
            watcher.wait(lambda: abs(seen["wrench"][-1].wrench.force.z - 5.0) < 0.2, "5 N")
            # It gives way, as nothing is above it: in all the cables bear the weight.
            rests()
            for mode in (MODE.FREE_MOVING, MODE.PRETIGHTENING, MODE.COMMISSIONING):
                said[mode] = asked(mode)
            rig.enter(MODE.STOPPED)
            with pytest.raises(ActionFailedError):
                load.result(even_in_fault=True)

            def told():
                said["hangs"] = asked(MODE.PRETIGHTENING)
                return said["hangs"].fault == "hangs"

            watcher.wait(told, "the notice that it hangs")
            rests()
            rig.enter(MODE.LOADING)
            go(-0.006, "the platform down")
            watcher.wait(lambda: true_force() < 0.9 * WEIGHT, "the stand to bear it")
            rig.enter(MODE.STOPPED)
            watcher.wait(lambda: asked(MODE.PRETIGHTENING).success, "PRETIGHTENING on the stand")
            watcher.wait(lambda: all(seen["limb_state"][-1].zeroed), "the zeros once more")

    values = {"rig": "hanging", "robot": False, "lockstep": True, "truth": True, "console": False}
    ended, lines, watcher = run_scenario(values, scenario, WATCHED)
    assert "hangs" in said, "\n".join([str(ended), *lines[-30:]])
    modes = watcher.modes()
    assert MODE.FAULT not in modes, "\n".join([*watcher.reasons(MODE.FAULT), *lines[-30:]])
    assert MODE.UNLOADING not in modes
    for mode in (MODE.FREE_MOVING, MODE.COMMISSIONING):
        assert said[mode].code == ResultCode.WRONG_MODE, mode
    assert not said[MODE.PRETIGHTENING].success
    assert "let the platform go" in said[MODE.FREE_MOVING].message
    assert "stand" in said["hangs"].message
    # On the way no cable pulled more than the proof of its gear.
    assert max(max(m.tension) for m in watcher.seen["true_limb_state"]) < 80.0
