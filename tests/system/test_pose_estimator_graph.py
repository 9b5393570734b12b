# SPDX-License-Identifier: Apache-2.0
"""The pose estimator beside the real nodes: it judges, and nothing disagrees."""

from __future__ import annotations

import numpy as np
import pytest
from cabols_msgs.msg import PoseAgreement

from cabols_control.topics import RECORDED
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.long, pytest.mark.timeout(400)]
JUDGED = 60


@pytest.mark.parametrize("robot", [False, True])
def test_all_sources_agree_through_pretightening_and_load(robot):
    """Also beside a robot, whose controller has its own pace and is starved on a busy computer."""

    def agreed(messages):
        return sum(message.state == PoseAgreement.AGREE for message in messages)

    def scenario(watcher, pids):
        del pids
        seen = watcher.seen["pose_agreement"]
        watcher.wait(lambda: agreed(seen) >= JUDGED, f"{JUDGED} samples that agree", 240.0)

    values = {
        "lockstep": True,
        "robot": robot,
        "stale_after": 2.0 if robot else 0.05,
        "record": False,
        "pose_estimator": True,
        "auto_start": True,
        "program": "steps",
    }
    watched = ("mode", "pose_agreement", "estimated_pose", "loop_status")
    _, lines, watcher = run_scenario(values, scenario, watched)
    agreements, poses = watcher.seen["pose_agreement"], watcher.seen["estimated_pose"]
    assert {message.state for message in agreements} == {PoseAgreement.UNKNOWN, PoseAgreement.AGREE}
    assert any("zeros" in message.reason for message in agreements)
    judged = [message for message in agreements if message.state == PoseAgreement.AGREE]
    square = np.array([m.residual / m.deviation for m in judged])
    assert np.abs(square).max() < 3.0
    assert len(poses) >= JUDGED
    assert all(0.0 < pose.pose.covariance[0] < 1e-4 for pose in poses)
    reports = [
        message for message in watcher.seen["loop_status"] if message.node == "pose_estimator"
    ]
    assert {message.fault for message in reports} == {""}
    assert not [line for line in lines if "pose_estimator" in line and "rror" in line]
    assert {"pose_agreement", "estimated_pose"} <= set(RECORDED)
