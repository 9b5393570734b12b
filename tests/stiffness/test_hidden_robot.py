# SPDX-License-Identifier: Apache-2.0
"""The hidden robot is physics, and what identifies cannot reach its settings."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.rig_folder import rig_file
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_sim.mismatch.hidden_robot import HiddenRobot
from cabols_stiffness import PointSamples
from hidden_campaign import MIDDLE, TOOL, campaign, configurations, hidden_robot, wrenches

CUT_OFF = """
import sys
for name in ("cabols_sim", "cabols_hw", "rclpy"):
    sys.modules[name] = None
import numpy as np
from cabols_stiffness import PointSamples, load_robot
from cabols_stiffness.ladder.identified import identify_ladder
with np.load(sys.argv[1]) as stored:
    samples = PointSamples(**{name: stored[name] for name in stored.files})
found = identify_ladder(samples, load_robot(tool_position=[0.0, 0.0, 0.15]), "joints")
print(*found.result.parameters[:6])
"""


def simplified(robot, **more):
    """The robot with rigid bodies, no weight and no friction, and changes."""
    truth = robot.settings
    nothing = {
        "beams": 0.0 * truth.beams,
        "tilt": 0.0 * truth.tilt,
        "masses": 0.0 * truth.masses,
        "friction": 0.0 * truth.friction,
    }
    nominal = read_serial_arm(rig_file("robot.urdf"))
    return HiddenRobot(replace(truth, **(nothing | more)), nominal, TOOL)


def test_without_what_it_hides_it_is_the_plain_robot():
    nominal = read_serial_arm(rig_file("robot.urdf"))
    robot = simplified(
        hidden_robot(3, "smooth"), origins=nominal.origins, rotations=nominal.rotations
    )
    random = np.random.default_rng(1)
    Q, W = configurations(random, 4), wrenches(random, 4)
    factor = np.ones((4, 6))
    start, held = robot.rest(Q, factor)
    pose, _ = robot.load(Q, W, factor, held)
    chain = arm.Chain()
    for i in range(4):
        other, _ = chain.settle(Q[i], W[i], 1.0 / robot.settings.compliance)
        np.testing.assert_allclose(pose[i], other, atol=2e-9)
        np.testing.assert_allclose(start[i], chain.frames(Q[i])[0] @ arm.TOOL, atol=1e-12)


def test_elastic_bodies_are_reciprocal():
    """Work of one small load along the other's motion, both ways (Maxwell and Betti)."""
    hidden = hidden_robot(4, "smooth")
    truth = hidden.settings
    robot = simplified(hidden, beams=truth.beams, tilt=truth.tilt)
    Q, factor = np.tile(MIDDLE, (6, 1)), np.ones((6, 6))
    start, held = robot.rest(Q, factor)
    size = np.array([1.0] * 3 + [0.1] * 3)
    pose, _ = robot.load(Q, np.diag(size), factor, held)
    turned = start[:, :3, :3].swapaxes(1, 2) @ pose[:, :3, :3]
    moved = np.einsum("kji,kj->ki", start[:, :3, :3], pose[:, :3, 3] - start[:, :3, 3])
    vector = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    compliance = np.hstack([moved, vector]) / size[:, None]
    scale = np.sqrt(np.outer(np.diag(compliance), np.diag(compliance)))
    np.testing.assert_allclose(compliance / scale, (compliance / scale).T, atol=1e-4)
    assert np.linalg.eigvalsh(compliance / scale).min() > 0.0


def test_friction_remembers_the_way():
    robot = hidden_robot(5, "smooth")
    Q, W = MIDDLE[None], np.array([[80.0, -60.0, 90.0, 8.0, 6.0, -9.0]])
    factor = np.ones((1, 6))
    _, held = robot.rest(Q, factor)
    up, held = robot.load(Q, 0.5 * W, factor, held)
    _, held = robot.load(Q, W, factor, held)
    down, _ = robot.load(Q, 0.5 * W, factor, held)
    assert np.abs(up - down)[0, :3, 3].max() > 3e-6


@pytest.mark.parametrize("variety", ["smooth", "scattered"])
def test_truth_is_drawn_by_its_seed(variety):
    one, same, other = (hidden_robot(seed, variety) for seed in (6, 6, 7))
    np.testing.assert_array_equal(one.settings.compliance, same.settings.compliance)
    assert (one.settings.compliance != other.settings.compliance).all()


def test_estimator_needs_nothing_of_the_truth(tmp_path):
    """It runs where the simulator cannot be imported, from what instruments measure alone."""
    samples = campaign(hidden_robot(8, "smooth"), 8, count=5, peaks=3)
    fields = PointSamples.__dataclass_fields__
    np.savez(tmp_path / "samples.npz", **{name: getattr(samples, name) for name in fields})
    command = [sys.executable, "-c", CUT_OFF, str(tmp_path / "samples.npz")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (np.array(done.stdout.split(), dtype=float) > 0.0).all()
