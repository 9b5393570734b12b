# SPDX-License-Identifier: Apache-2.0
"""The compensation node answers with the numbers of its library."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cabols_msgs.srv import CorrectJoints

from cabols_stiffness import identify
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.result_file import write_result
from graph_harness import Watcher, next_environment
from stiffness_bench import Bench, bench_configurations, bench_robot, optimal_peaks, ramps

EXECUTABLE = Path(sys.prefix) / "lib" / "cabols_stiffness" / "compensation"


@pytest.mark.ros
def test_node_serves_corrected_joints(tmp_path):
    robot, configurations = bench_robot(), bench_configurations()[[0, 1, 3, 7]]
    peaks, _ = optimal_peaks(configurations, 2)
    result = identify(Bench(robot, ramps(configurations, peaks, (1.0,))).draw(0), robot)
    path = tmp_path / "result.yaml"
    write_result(path, result, robot)
    environment = next_environment()
    node = subprocess.Popen(
        [EXECUTABLE, "--ros-args", "-p", f"result_file:={path}"],
        env={**os.environ, **environment},
        stderr=subprocess.PIPE,
        text=True,
    )
    watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), ())
    try:
        joints, wrench = configurations[0], np.array([40.0, 30.0, -20.0, 3.0, 2.0, 1.0])
        request = CorrectJoints.Request(joints=joints, wrench=wrench)
        answer = watcher.call(CorrectJoints, "correct_joints", request)
        expected = correct(result, robot, joints, wrench)
        assert answer.success, answer.message
        np.testing.assert_allclose(answer.joints, expected.joints, atol=1e-12)
        np.testing.assert_allclose(answer.deflection, expected.prediction.deflection, atol=1e-12)
        np.testing.assert_allclose(
            np.reshape(answer.covariance, (6, 6)), expected.prediction.covariance, rtol=1e-9
        )
        refused = watcher.call(
            CorrectJoints,
            "correct_joints",
            CorrectJoints.Request(joints=joints, wrench=[np.nan] + [0.0] * 5),
        )
        assert not refused.success
        assert "finite" in refused.message
    finally:
        node.send_signal(signal.SIGINT)
        code = node.wait(10.0)
        watcher.close()
    assert code == 0, node.stderr.read()


@pytest.mark.ros
def test_node_without_its_result_says_so(tmp_path):
    ended = subprocess.run(
        [EXECUTABLE, "--ros-args", "-p", f"result_file:={tmp_path / 'none.yaml'}"],
        env={**os.environ, **next_environment()},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert ended.returncode == 2
    assert "none.yaml" in ended.stderr
