# SPDX-License-Identifier: Apache-2.0
"""The bridge's lifecycle through the real nodes: inactive it measures, and moves nothing."""

from __future__ import annotations

import pytest
from cabols_msgs.msg import Mode
from cabols_msgs.srv import SetMode
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]
VALUES = {"lockstep": True, "record": False, "activate": False}


def test_amplifiers_stay_off_until_the_bridge_is_active_and_at_rest_they_go_off_again():
    def state(watcher):
        return watcher.call(GetState, "plant/get_state", GetState.Request()).current_state.id

    def change(watcher, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return watcher.call(ChangeState, "plant/change_state", request).success

    def ask(watcher, mode):
        return watcher.call(SetMode, "set_mode", SetMode.Request(mode=mode))

    def scenario(watcher, pids):
        del pids
        seen = watcher.seen["live/limb_state"]
        watcher.wait(lambda: len(seen) > 20, "samples")
        assert state(watcher) == State.PRIMARY_STATE_INACTIVE
        watcher.wait(
            lambda: "plant" in ask(watcher, Mode.PRETIGHTENING).message,
            "a refusal that names the bridge",
        )
        assert max(abs(x) for m in seen for x in m.current) == 0.0

        assert change(watcher, Transition.TRANSITION_ACTIVATE)
        assert state(watcher) == State.PRIMARY_STATE_ACTIVE
        watcher.wait(lambda: ask(watcher, Mode.PRETIGHTENING).success, "PRETIGHTENING granted")
        watcher.wait(lambda: max(seen[-1].current) > 0.0, "limbs that wind in")
        assert not change(watcher, Transition.TRANSITION_DEACTIVATE), "while limbs move"
        assert state(watcher) == State.PRIMARY_STATE_ACTIVE
        watcher.wait(lambda: all(seen[-1].zeroed), "all limbs zeroed")

        watcher.wait(lambda: ask(watcher, Mode.STOPPED).success, "STOPPED granted")
        watcher.wait(lambda: watcher.modes()[-1] == Mode.STOPPED, "STOPPED")
        watcher.wait(lambda: change(watcher, Transition.TRANSITION_DEACTIVATE), "inactive again")
        assert not change(watcher, Transition.TRANSITION_CLEANUP), "the devices stay open"
        assert state(watcher) == State.PRIMARY_STATE_INACTIVE
        count = len(seen)
        watcher.wait(lambda: len(seen) > count + 20, "samples of an inactive bridge")
        assert not ask(watcher, Mode.PRETIGHTENING).success
        assert all(not any(m.current) for m in seen[count + 10 :])
        # Ends the graph, as SIGTERM does.
        change(watcher, Transition.TRANSITION_INACTIVE_SHUTDOWN)

    ended, lines, watcher = run_scenario(
        VALUES, scenario, ("mode", "live/limb_state", "loop_status")
    )
    assert Mode.FAULT not in watcher.modes()
    assert any("expected a rig at rest, got PRETIGHTENING" in line for line in lines)
    assert not [line for line in lines if "Traceback" in line]
    assert ended.codes["plant"] == 0
