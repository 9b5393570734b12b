# SPDX-License-Identifier: Apache-2.0
"""Where a platform hangs by its cables' slack lengths and its weight: against MuJoCo."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import OutOfRangeError, ShapeError
from cabols_control.forward_kinematics import PoseState
from cabols_control.forward_kinematics.hanging import HangingPlatform
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.tension import distribute

MASS, CENTRE = 4.0, np.array([0.01, -0.01, -0.02])
STIFFNESS = 2200.0


@pytest.fixture
def platform(rig):
    return HangingPlatform(rig.geometry, rig.springs, MASS, CENTRE)


def poses(rig, count, seed):
    random = np.random.default_rng(seed)
    for _ in range(count):
        turn = Rotation.from_rotvec(random.uniform(-0.1, 0.1, 3)).as_matrix()
        yield (
            rig.geometry.reference_position + random.uniform(-0.15, 0.15, 3),
            turn @ rig.geometry.reference_rotation,
        )


def in_mujoco(rig, rest, position, rotation):
    """Pose and pulls of the same body on springs that only pull, once it has come to rest."""
    anchors = sites = tendons = ""
    pairs = zip(rig.geometry.base_points, rig.geometry.platform_points, strict=True)
    for i, (base, point) in enumerate(pairs):
        anchors += f'<site name="a{i}" pos="{base[0]} {base[1]} {base[2]}"/>'
        sites += f'<site name="b{i}" pos="{point[0]} {point[1]} {point[2]}"/>'
        tendons += (
            f'<spatial name="t{i}" stiffness="{STIFFNESS}" springlength="0 {rest[i]:.17g}">'
            f'<site site="a{i}"/><site site="b{i}"/></spatial>'
        )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.001" integrator="implicit" gravity="0 0 -9.80665"/>
        <worldbody>{anchors}<body name="platform"><joint type="free" damping="8"/><inertial
        mass="{MASS}" pos="{" ".join(map(str, CENTRE))}" diaginertia="0.3 0.3 0.3"/>{sites}</body>
        </worldbody><tendon>{tendons}</tendon></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:3] = position
    data.qpos[3:] = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    for _ in range(40_000):
        mujoco.mj_step(model, data)
    turn = Rotation.from_quat(data.qpos[3:], scalar_first=True).as_matrix()
    return data.qpos[:3], turn, STIFFNESS * np.maximum(data.ten_length - rest, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_hangs_where_mujoco_lets_it(rig, platform, seed):
    """Any slack lengths, some cables slack: pose and pulls come out of weight and springs."""
    random = np.random.default_rng(seed)
    position, rotation = next(poses(rig, 1, seed))
    pulls = random.uniform(-10.0, 40.0, 8)
    rest = cable_lengths(rig.geometry, position, rotation) - pulls / STIFFNESS
    found = platform.hang(rest, position, rotation)
    assert found.found
    place, turn, tension = in_mujoco(rig, rest, position, rotation)
    np.testing.assert_allclose(found.position, place, atol=2e-6)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-5)
    np.testing.assert_allclose(found.tension, tension, atol=0.01)


def test_finds_the_pose_that_a_distribution_was_made_for(rig, platform):
    for position, rotation in poses(rig, 30, 1):
        matrix = structure_matrix(rig.geometry, position, rotation)
        pulls = distribute(matrix, -platform.weight_at(rotation), 9.0, 80.0)
        assert pulls.feasible
        rest = cable_lengths(rig.geometry, position, rotation) - pulls.tension / STIFFNESS
        found = platform.hang(rest, position + 0.03, rotation)
        assert found.found
        np.testing.assert_allclose(found.position, position, atol=1e-9)
        np.testing.assert_allclose(found.tension, pulls.tension, atol=1e-5)
        lengths = platform.stretched(rest, found)
        assert platform.certified(found, lengths, 2e-4, 0.05, 0.2) is PoseState.KNOWN


def test_a_softer_cable_when_it_is_longer(rig):
    """With the cables' own compliance the pulls are those of k_e at the present lengths."""
    limbs = replace(rig.limbs, axial_stiffness=15_000.0)
    soft = replace(rig, limbs=limbs)
    platform = HangingPlatform(soft.geometry, soft.springs, MASS, CENTRE)
    position, rotation = next(poses(soft, 1, 4))
    length = cable_lengths(soft.geometry, position, rotation)
    matrix = structure_matrix(soft.geometry, position, rotation)
    pulls = distribute(matrix, -platform.weight_at(rotation), 9.0, 80.0).tension
    rest = length - pulls / soft.springs.stiffness(length)
    found = platform.hang(rest, position + 0.01, rotation)
    assert found.found
    np.testing.assert_allclose(found.position, position, atol=1e-8)
    np.testing.assert_allclose(found.tension, pulls, atol=1e-4)


def test_what_stands_against_a_pose(rig, platform):
    """Lengths of a cable that are 20 mm wrong are no pose's, and no numbers are none."""
    position, rotation = next(poses(rig, 1, 2))
    rest = cable_lengths(rig.geometry, position, rotation) - 15.0 / STIFFNESS
    found = platform.hang(rest, position, rotation)
    lengths = platform.stretched(rest, found)
    lengths[2] += 0.02
    assert platform.certified(found, lengths, 2e-4, 0.05, 0.2) is not PoseState.KNOWN
    assert not platform.hang(np.full(8, np.nan), position, rotation).found
    # Cables that are all slack hold nothing here.
    assert not platform.hang(rest + 5.0, position, rotation).found


def test_refuses_what_is_no_body(rig):
    for mass in (0.0, -1.0, np.nan):
        with pytest.raises(OutOfRangeError):
            HangingPlatform(rig.geometry, rig.springs, mass, CENTRE)
    with pytest.raises(ShapeError):
        HangingPlatform(rig.geometry, rig.springs, MASS, np.zeros(2))
