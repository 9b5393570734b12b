# SPDX-License-Identifier: Apache-2.0
"""Distances between cables and bodies: against least squares, by hand, and along turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError, ShapeError
from cabols_control.workspace.bodies import Bodies, Capsule, load_bodies
from cabols_control.workspace.interference import clearance_along, free_turn
from cabols_control.workspace.segments import segment_distance

ALONE = Bodies(cable_radius=0.001, clearance=0.005, joint_length=0.05, attachment_length=0.03)


def by_least_squares(p, q, r, s):
    """The same distance as a bounded least-squares problem in the two shares."""
    found = lsq_linear(np.column_stack([q - p, r - s]), r - p, (0.0, 1.0), method="bvls")
    return np.linalg.norm((q - p) * found.x[0] + (r - s) * found.x[1] - (r - p))


def test_segment_distance_is_the_least(random):
    for k in range(400):
        p, q, r, s = random.uniform(-1.0, 1.0, (4, 3))
        if k % 4 == 1:  # parallel
            s = r + random.uniform(-2.0, 2.0) * (q - p)
        if k % 4 == 2:  # meeting
            r = p + random.uniform(0.0, 1.0) * (q - p)
        found = segment_distance(tuple(p), tuple(q), tuple(r), tuple(s))
        assert abs(found - by_least_squares(p, q, r, s)) < 1e-7


def test_segments_that_are_points(random):
    p, q, r = (tuple(v) for v in random.uniform(-1.0, 1.0, (3, 3)))
    assert segment_distance(p, p, r, r) == pytest.approx(np.linalg.norm(np.subtract(p, r)))
    expected = by_least_squares(np.array(p), np.array(q), np.array(r), np.array(r) + 1e-14)
    assert segment_distance(p, q, r, r) == pytest.approx(expected)
    assert segment_distance(r, r, p, q) == pytest.approx(expected)


def test_clearances_by_hand(rig):
    """A capsule in the rig's middle, and one that a cable runs through."""
    geometry = rig.geometry
    centre = geometry.reference_position
    pose = (centre[None], np.eye(3)[None])
    bare = clearance_along(geometry, ALONE, *pose)
    assert np.isinf(bare.platform).all()
    assert np.isinf(bare.target).all()
    apart = []
    held = centre + geometry.platform_points
    for i in range(8):
        for j in range(i):
            ends = [held[i], geometry.base_points[i], held[j], geometry.base_points[j]]
            if not np.allclose(held[i], held[j]):
                apart.append(by_least_squares(*ends))
            else:  # they may touch within 50 mm of the point they share
                u, v = ((e - ends[0]) / np.linalg.norm(e - ends[0]) for e in (ends[1], ends[3]))
                ends[0], ends[2] = held[i] + 0.05 * u, held[j] + 0.05 * v
                apart.append(by_least_squares(*ends))
    assert bare.cables[0] == pytest.approx(min(apart) - 0.002, abs=1e-7)
    middle = 0.5 * (held[0] + geometry.base_points[0])
    ball = Capsule([*middle], [*middle], 0.02, start_frame="base", end_frame="base")
    struck = clearance_along(geometry, replace(ALONE, target=[ball]), *pose)
    assert struck.target[0] == pytest.approx(-0.021)


def test_capsules_move_with_their_frames(rig):
    """A capsule of the platform keeps its place in it; one of the base stays."""
    geometry = rig.geometry
    ball = [0.0, 0.0, 0.3]
    on_platform = replace(ALONE, target=[Capsule(ball, ball, 0.02)])
    place = [*(geometry.reference_position + ball)]
    on_base = replace(
        ALONE, target=[Capsule(place, place, 0.02, start_frame="base", end_frame="base")]
    )
    at_rest = [geometry.reference_position[None], np.eye(3)[None]]
    turned = [at_rest[0], Rotation.from_euler("X", 20, degrees=True).as_matrix()[None]]
    first, second = (clearance_along(geometry, b, *at_rest).target for b in (on_platform, on_base))
    np.testing.assert_allclose(first, second)
    first, second = (clearance_along(geometry, b, *turned).target for b in (on_platform, on_base))
    assert abs(first[0] - second[0]) > 0.005


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 2.0, -1.0)])
def test_free_turn_is_certified_and_tight(rig, axis):
    """No angle inside comes nearer than the clearance; just outside, one does."""
    geometry, bodies = rig.geometry, load_bodies()
    position = np.add(geometry.reference_position, [0.03, -0.02, 0.05])
    low, high = free_turn(geometry, bodies, position, np.eye(3), axis)
    assert -np.pi < low < -0.3
    assert 0.3 < high < np.pi
    direction = np.array(axis) / np.linalg.norm(axis)
    angles = np.linspace(low, high, 400)
    rotations = Rotation.from_rotvec(angles[:, None] * direction).as_matrix()
    inside = clearance_along(geometry, bodies, np.tile(position, (400, 1)), rotations)
    assert inside.least.min() > bodies.clearance - 1e-12
    beyond = Rotation.from_rotvec(np.array([low - 1e-3, high + 1e-3])[:, None] * direction)
    outside = clearance_along(geometry, bodies, np.tile(position, (2, 1)), beyond.as_matrix())
    assert (outside.least < bodies.clearance).all()


def test_the_bench_turns_nearly_as_far_as_the_source_says(rig):
    """ "Up to about 90 deg without cable collision": without a target, 79 deg here."""
    bodies = replace(load_bodies(), target=[])
    geometry = rig.geometry
    low, high = free_turn(geometry, bodies, geometry.reference_position, np.eye(3), (0, 0, 1))
    assert np.rad2deg(high) == pytest.approx(79.5, abs=0.5)
    assert low == pytest.approx(-high, abs=1e-4)


def test_a_forearm_behind_the_tool_would_touch_a_cable(rig):
    pose = (rig.geometry.reference_position[None], np.eye(3)[None])
    found = clearance_along(rig.geometry, _arm_bodies(), *pose)
    assert found.target[0] < 0.0
    turn = free_turn(
        rig.geometry, _arm_bodies(), rig.geometry.reference_position, np.eye(3), (0, 0, 1)
    )
    assert turn == (0.0, 0.0)


def _arm_bodies():
    from cabols_control.rig_folder import rig_file

    return load_bodies(path=rig_file("bodies_arm.yaml"))


def test_unusable_bodies_and_axes_are_named(tmp_path, rig):
    path = tmp_path / "bodies.yaml"
    path.write_text(
        "cable_radius: 0.001\nclearance: .nan\njoint_length: 0.05\nattachment_length: 0.03\n"
    )
    with pytest.raises(ConfigError, match="clearance"):
        load_bodies(path=path)
    path.write_text(
        "cable_radius: 0.001\nclearance: 0.0\njoint_length: 0.05\n"
        "attachment_length: 0.03\nplatfrom: []\n"
    )
    with pytest.raises(ConfigError, match="platfrom"):
        load_bodies(path=path)
    with pytest.raises(ShapeError, match="axis: expected a direction"):
        free_turn(rig.geometry, ALONE, [0, 0, 0], np.eye(3), (0, 0, 0))
