# SPDX-License-Identifier: Apache-2.0
"""Which source of the pose disagrees: named where data can tell, candidates until then."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.pose_agreement import AgreementMonitor, Fault, Suspect
from cabols_control.pose_agreement.hypotheses import tool_residual

RATE, STIFFNESS = 50.0, 2200.0
RIG = load_geometry()


class Lockstep:
    """A rig of its own: springs within 1 %, noise of all sources, and one thing that goes wrong."""

    def __init__(self, seed, speed=1.0):
        self.rng, self.speed = np.random.default_rng(seed), speed
        self.true_stiffness = STIFFNESS * (1.0 + self.rng.uniform(-0.01, 0.01, 8))
        self.phases = self.rng.uniform(0.0, 2.0 * np.pi, 14)
        self.tool = np.zeros(6)
        self.slip, self.order = np.zeros(8), np.arange(8)
        self.monitor = AgreementMonitor(RIG, np.full(8, STIFFNESS))
        self.now, self.frozen = 0.0, None
        self.l_zero = cable_lengths(RIG, *self.pose())
        position, rotation = self.reported(*self.pose())
        self.shown_zero = cable_lengths(RIG, position, rotation)
        self.monitor.zero(position, rotation, np.zeros(8))

    def pose(self):
        """Out from the reference pose, as far as 60 mm and 9 deg."""
        t = self.now if self.frozen is None else self.frozen
        swing = np.sin(self.speed * t * np.array([0.23, 0.31, 0.17, 0.21, 0.27, 0.19]))
        turn = Rotation.from_rotvec(0.09 * swing[3:]).as_matrix()
        return RIG.reference_position + 0.06 * swing[:3], turn @ RIG.reference_rotation

    def reported(self, position, rotation):
        noise = self.rng.standard_normal(6) * np.repeat([16e-6, 50e-6], 3)
        turn = Rotation.from_rotvec(self.tool[3:] + noise[3:]).as_matrix()
        return position + rotation @ self.tool[:3] + noise[:3], rotation @ turn

    def step(self):
        self.now += 1.0 / RATE
        position, rotation = self.pose()
        tension = 30.0 + 20.0 * np.sin(0.5 * self.now + self.phases[:8])
        wound = tension / self.true_stiffness - (
            cable_lengths(RIG, position, rotation) - self.l_zero
        )
        shown = (wound + self.slip)[self.order] + 5e-6 * self.rng.standard_normal(8)
        place, turn = self.reported(position, rotation)
        stretch = shown + cable_lengths(RIG, place, turn) - self.shown_zero
        wrench = structure_matrix(RIG, position, rotation) @ tension
        # The sensor's axes turn with the platform; the robot's orientation turns them back.
        wrench = (turn @ rotation.T @ wrench.reshape(2, 3).T).T.ravel()
        wrench += self.rng.standard_normal(6) * np.repeat([0.03, 0.003], 3)
        return self.monitor.cables(place, turn, shown, STIFFNESS * stretch, wrench)

    def run(self, seconds):
        for _ in range(round(seconds * RATE)):
            found = self.step()
        return found


@pytest.mark.parametrize("limb", range(8))
def test_slipped_cable_is_named_within_a_second(limb):
    rig = Lockstep(limb)
    assert rig.run(20.0).agree
    rig.slip[limb] = 5e-3
    found = rig.run(1.0)
    assert found.named == Suspect(Fault.SLIPPED_CABLE, (limb,))
    assert rig.run(10.0).named == found.named


def test_at_the_pose_of_the_zeros_no_tool_can_be_wrong():
    rig = Lockstep(3)
    rig.frozen = 0.0
    rig.run(2.0)
    rig.slip[2] = 5e-3
    assert rig.run(1.0).candidates == (Suspect(Fault.SLIPPED_CABLE, (2,)),)


def test_two_things_at_once_are_not_named_as_one():
    rig = Lockstep(4)
    rig.run(15.0)
    rig.slip[[1, 6]] = 5e-3, -8e-3
    found = rig.run(8.0)
    assert not found.agree
    assert found.named is None


@pytest.mark.parametrize("pair", [(0, 1), (0, 4), (2, 7), (5, 6), (1, 3)])
def test_swapped_encoders_are_named(pair):
    rig = Lockstep(sum(pair))
    rig.order[list(pair)] = pair[::-1]
    named_at = None
    for _ in range(round(20.0 * RATE)):
        found = rig.step()
        if found.named is not None:
            assert found.named == Suspect(Fault.SWAPPED_ENCODERS, pair)
            named_at = rig.now if named_at is None else named_at
    # 5 mm of motion are over in less than a second.
    assert named_at is not None
    assert named_at < 2.0


@pytest.mark.parametrize(
    ("tool", "in_time"),
    [
        ([0.02, 0, 0, 0, 0, 0], True),
        ([0, 0, 0.03, 0, 0, 0], True),
        # Partly like one slipped cable: both stay candidates for longer.
        ([0.0, 0.01, 0.01, 0.05, 0, 0], False),
    ],
)
def test_wrong_tool_is_named_after_five_degrees_and_nothing_else_before(tool, in_time):
    rig = Lockstep(11)
    rig.tool[:] = tool
    position, rotation = rig.reported(*rig.pose())
    rig.shown_zero = cable_lengths(RIG, position, rotation)
    rig.monitor.zero(position, rotation, np.zeros(8))
    start, turned_at = rig.pose()[1], None
    for _ in range(round(30.0 * RATE)):
        found = rig.step()
        angle = Rotation.from_matrix(rig.pose()[1] @ start.T).magnitude()
        turned_at = rig.now if turned_at is None and angle > np.deg2rad(5.0) else turned_at
        assert found.named in (None, Suspect(Fault.ROBOT_TOOL))
        if turned_at is not None and rig.now > turned_at + 1.0:
            assert Suspect(Fault.ROBOT_TOOL) in found.candidates
            assert found.named == Suspect(Fault.ROBOT_TOOL) or not in_time
    assert turned_at is not None


def reflector(rig, bump):
    position, rotation = rig.pose()
    place, turn = rig.reported(position, rotation)
    point = np.array([0.1, 0.05, 0.12])
    measured = position + rotation @ point + bump + 1.5e-5 * rig.rng.standard_normal(3)
    rig.monitor.reflector(measured, place + turn @ point, 1.5e-5)


def test_bumped_tracker_is_named_at_its_next_measurement():
    rig = Lockstep(5)
    rig.run(10.0)
    reflector(rig, np.zeros(3))
    assert rig.run(1.0).agree
    reflector(rig, np.array([0.0, 3e-3, 0.0]))
    found = rig.step()
    assert not found.agree
    assert found.named == Suspect(Fault.TRACKER)


def test_tracker_and_tool_are_candidates_where_the_cables_could_not_tell():
    rig = Lockstep(5)
    rig.frozen = 0.0
    rig.run(1.0)
    reflector(rig, np.array([0.0, 3e-3, 0.0]))
    found = rig.step()
    assert found.named is None
    assert set(found.candidates) == {Suspect(Fault.TRACKER), Suspect(Fault.ROBOT_TOOL)}


def test_no_false_alarm_in_ten_minutes_and_the_pose_is_honest():
    rig, errors = Lockstep(21, speed=0.7), []
    for k in range(round(600.0 * 20.0)):
        rig.now += 1.0 / 20.0 - 1.0 / RATE
        found = rig.step()
        assert found.agree, (rig.now, found)
        if k % 200 == 0:
            position, rotation = rig.pose()
            turn = Rotation.from_matrix(found.rotation @ rotation.T).as_rotvec()
            error = np.r_[found.position - position, turn]
            errors.append(error @ np.linalg.solve(found.covariance, error))
    # Six degrees of freedom; the robot here is better than its stated deviations.
    assert np.mean(errors) < 6.0


def test_samples_that_are_not_finite_or_before_the_zeros_say_nothing():
    monitor = AgreementMonitor(RIG, np.full(8, STIFFNESS))
    pose = (RIG.reference_position, RIG.reference_rotation)
    assert monitor.cables(*pose, np.zeros(8), np.zeros(8), np.zeros(6)) is None
    monitor.zero(*pose, np.zeros(8))
    assert monitor.cables(*pose, np.full(8, np.nan), np.zeros(8), np.zeros(6)) is None
    assert monitor.cables(*pose, np.zeros(8), np.zeros(8), np.zeros(6)).agree


def test_a_turn_about_a_wrong_tools_own_offset_hardly_shows():
    """Both poses then differ by what they did at the zeros: only the cables' curvature is left."""
    start, turned = RIG.reference_position, RIG.reference_rotation
    offset = 0.02 * np.array([2.0, -1.0, 2.0]) / 3.0
    shown = []
    for axis in (offset, np.cross(offset, [1.0, 0.0, 0.0])):
        monitor = AgreementMonitor(RIG, np.full(8, STIFFNESS))
        monitor.zero(start, turned, np.zeros(8))
        turn = Rotation.from_rotvec(np.deg2rad(15.0) * axis / np.linalg.norm(axis)).as_matrix()
        monitor.cables(start, turned @ turn, np.zeros(8), np.full(8, 30.0), np.zeros(6))
        tool = np.r_[offset, np.zeros(3)]
        given = (monitor._zero, monitor.stiffness, monitor._cables, tool)
        shown.append(np.linalg.norm(tool_residual([monitor._newest], *given)[:3]))
    assert shown[0] < 0.1 * shown[1]
