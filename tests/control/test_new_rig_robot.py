# SPDX-License-Identifier: Apache-2.0
"""A new rig with another arm: its configurations against pinocchio, and arms that cannot do it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from cabols_control.errors import ConfigError, UsageError
from cabols_control.frames import load_frames
from cabols_control.geometry import load_geometry
from cabols_control.rig_folder import find_rig, rig_file
from cabols_control.rig_tools.new_rig import make_rig

UR20 = Path(__file__).resolve().parents[2] / "examples" / "ur20.urdf"
BENCH = rig_file("robot.urdf")


def platform_poses(folder):
    """Poses of the platform in all stored configurations, by pinocchio."""
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromUrdf(str(folder.file("robot.urdf")))
    data, flange = model.createData(), model.getFrameId("tool0")
    tool = load_frames(folder).tool_frame
    offset = pinocchio.SE3(np.asarray(tool.rotation), np.asarray(tool.position))
    poses = []
    for angles in yaml.safe_load(folder.file("robot.yaml").read_text())["configurations"]:
        pinocchio.framesForwardKinematics(model, data, np.deg2rad(angles))
        poses.append((data.oMf[flange] * offset).homogeneous)
    return np.array(poses)


def test_another_arm_holds_the_platform_where_the_bench_s_does(tmp_path):
    make_rig(tmp_path / "ur", robot=UR20)
    found, bench = platform_poses(find_rig(tmp_path / "ur")), platform_poses(find_rig())
    assert len(found) == len(bench) == 13
    # Angles are written with 5 decimals of a degree: 0.2 um at 1.5 m.
    np.testing.assert_allclose(found, bench, atol=2e-6)
    geometry = load_geometry(tmp_path / "ur" / "geometry.yaml")
    np.testing.assert_allclose(found[0][:3, 3], geometry.reference_position, atol=1e-5)


def test_bench_s_own_arm_is_found_again(tmp_path):
    make_rig(tmp_path / "own", robot=BENCH)
    np.testing.assert_allclose(
        platform_poses(find_rig(tmp_path / "own")), platform_poses(find_rig()), atol=2e-6
    )


def test_short_arm_is_refused_with_what_is_missing_and_nothing_is_made(tmp_path):
    short = tmp_path / "short.urdf"
    short.write_text(UR20.read_text().replace("-0.8620", "-0.3").replace("-0.7287", "-0.3"))
    with pytest.raises(ConfigError, match=r"expected an arm that reaches .* got \d+\.\d mm"):
        make_rig(tmp_path / "rig", robot=short)
    assert not (tmp_path / "rig").exists()


def test_five_joints_are_refused(tmp_path):
    five = tmp_path / "five.urdf"
    text = UR20.read_text()
    five.write_text(re.sub(r'(name="wrist_3_joint" type=)"revolute"', r'\1"fixed"', text))
    with pytest.raises(UsageError, match="expected six joints that turn, got 5"):
        make_rig(tmp_path / "rig", robot=five)


def test_named_tip_that_is_missing_is_a_short_error(tmp_path):
    words = [str(tmp_path / "rig"), "--robot", str(UR20), "--tip", "hand"]
    done = subprocess.run(
        [sys.executable, "-m", "cabols_control.rig_tools.new_rig", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "expected a link 'hand'" in done.stderr
    assert "Traceback" not in done.stderr
