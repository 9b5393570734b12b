# SPDX-License-Identifier: Apache-2.0
"""A launch tells by its exit code that a node failed; runs where ROS 2's launch is installed."""

from __future__ import annotations

import sys

import pytest

from cabols_control.bringup_nodes import LOAD_PROGRAM

launch = pytest.importorskip("launch")
pytest.importorskip("launch_ros")


@pytest.mark.parametrize("code", [0, 3])
def test_a_failed_node_fails_its_launch_after_the_others_have_ended(code, tmp_path):
    from launch.actions import ExecuteProcess, RegisterEventHandler
    from launch.event_handlers import OnProcessExit

    from cabols_control.bringup.launching import end_all

    ready, done = tmp_path / "ready", tmp_path / "unloaded"
    text = f"import os\nwhile not os.path.exists({str(ready)!r}): pass\nraise SystemExit({code})"
    fails = ExecuteProcess(cmd=[sys.executable, "-c", text])
    loop = f"trap 'touch {done}; exit 0' INT; touch {ready}; while true; do sleep 0.05; done"
    unloads = ExecuteProcess(cmd=["bash", "-c", loop])
    handler = RegisterEventHandler(
        OnProcessExit(target_action=fails, on_exit=end_all(LOAD_PROGRAM))
    )
    service = launch.LaunchService(noninteractive=True)
    service.include_launch_description(launch.LaunchDescription([unloads, fails, handler]))
    assert service.run() == (1 if code else 0)
    assert done.exists()
