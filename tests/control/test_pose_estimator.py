# SPDX-License-Identifier: Apache-2.0
"""The pose estimator on a rig's raw data: who is wrong is named, and nobody is while all agree."""

from __future__ import annotations

import numpy as np
import pytest
from cabols_msgs.msg import ReflectorMeasurement
from scipy.spatial.transform import Rotation

from cabols_control.nodes.pose_estimator import reading_of
from cabols_control.pose_agreement import Fault, LimbSample, Measured, State, Suspect
from pose_sources import PERIOD_S, Sources


def until_named(sources, seconds):
    """Steps until something is named; what and when, or None."""
    for _ in range(round(seconds / PERIOD_S)):
        found = sources.step()
        if found.state is State.NAMED:
            return found.agreement.named, sources.now
    return None, sources.now


@pytest.mark.parametrize("limb", [0, 3, 6])
def test_slipped_cable_is_named_within_a_second(limb):
    sources = Sources(limb)
    assert sources.run(6.0 + limb).state is State.AGREE
    sources.slip[limb] = 5e-3
    began = sources.now
    named, when = until_named(sources, 2.0)
    assert named == Suspect(Fault.SLIPPED_CABLE, (limb,))
    assert when <= began + 1.0 + PERIOD_S


@pytest.mark.parametrize("pair", [(0, 1), (2, 7)])
def test_swapped_encoders_are_named_a_second_after_five_millimetres(pair):
    sources = Sources(sum(pair))
    sources.order[list(pair)] = pair[::-1]
    start = sources.commanded(0.0)[0]
    while np.linalg.norm(sources.commanded(sources.now)[0] - start) < 5e-3:
        found = sources.step()
        assert found.agreement is None or found.agreement.named in (
            None,
            Suspect(Fault.SWAPPED_ENCODERS, pair),
        )
    began = sources.now
    named, when = until_named(sources, 2.0)
    assert named == Suspect(Fault.SWAPPED_ENCODERS, pair)
    assert when <= began + 1.0 + PERIOD_S


def test_encoders_exchanged_while_it_runs_are_named_too():
    sources = Sources(9)
    sources.run(9.0)
    sources.order[[1, 6]] = 6, 1
    assert until_named(sources, 1.0)[0] == Suspect(Fault.SWAPPED_ENCODERS, (1, 6))


@pytest.mark.parametrize("tool", [[0.02, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, -0.015, 0.02, 0, 0, 0]])
def test_wrong_tool_is_named_a_second_after_five_degrees(tool):
    sources = Sources(3, tool=tool, swing_rad=0.15, tension=(12.0, 5.0))
    start = sources.commanded(0.0)[1]
    angle = 0.0
    while angle < np.deg2rad(5.0):
        found = sources.step()
        assert found.agreement is None or found.agreement.named in (None, Suspect(Fault.ROBOT_TOOL))
        angle = Rotation.from_matrix(sources.commanded(sources.now)[1] @ start.T).magnitude()
    assert Suspect(Fault.ROBOT_TOOL) in found.suspects
    began = sources.now
    named, when = until_named(sources, 2.0)
    assert named == Suspect(Fault.ROBOT_TOOL)
    assert when <= began + 1.0 + PERIOD_S


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("bump", [[1e-3, 0, 0], [0, 0, -1e-3]])
def test_tracker_bumped_by_a_millimetre_is_named_at_its_next_measurement(seed, bump):
    """Cables just tight, as where references are taken: the load hides nothing."""
    sources = Sources(40 + seed, tension=(12.0, 5.0))
    sources.stop()
    for reflector in range(3):
        assert sources.measure(reflector, 0.3).state is State.AGREE
    sources.bump[:] = bump
    found = sources.measure(0, 0.3)
    assert found.readings == 4
    assert found.agreement.named == Suspect(Fault.TRACKER)
    assert "tracker" in found.reason


def test_tracker_measures_at_many_poses_and_under_load_without_an_alarm():
    sources = Sources(7, swing_m=0.08, tension=(50.0, 30.0))
    for round_number in range(4):
        sources.stop()
        for reflector in range(3):
            found = sources.measure(reflector)
            assert found.state is State.AGREE, (round_number, reflector, found)
        sources.run(3.0)
    assert found.readings == 12
    # How the robot bends is known by then: a millimetre shows under load, too.
    sources.stop()
    assert sources.measure(2).state is State.AGREE
    sources.bump[1] = 1e-3
    assert sources.measure(2).agreement.named == Suspect(Fault.TRACKER)


def test_a_reading_taken_while_the_platform_moves_is_left_out():
    sources = Sources(1)
    sources.run(8.0)
    assert not sources.standing()
    assert sources.measure(0).readings == 0


def test_no_false_alarm_and_the_pose_is_nearer_than_it_says():
    sources, squares = Sources(5), []
    for k in range(round(30.0 / PERIOD_S)):
        found = sources.step()
        if found.agreement is None:
            continue
        assert found.state is State.AGREE, (sources.now, found)
        if k % 20 == 0:
            position, rotation, _ = sources.truth(found.time)
            turn = Rotation.from_matrix(found.agreement.rotation @ rotation.T).as_rotvec()
            error = np.r_[found.agreement.position - position, turn]
            squares.append(error @ np.linalg.solve(found.agreement.covariance, error))
    assert np.mean(squares) < 12.0


def test_what_is_missing_is_told_and_nothing_is_judged():
    sources = Sources(2)
    assert sources.estimator.look().state is State.UNKNOWN
    nothing = np.full(8, np.nan)
    sources.estimator.limbs(LimbSample(0.01, np.zeros(8), nothing, 0))
    assert "zeros" in sources.estimator.look().reason
    assert sources.run(3.0).state is State.AGREE
    # The robot's poses stay away: after a second nothing is known any more.
    sources.estimator.joiner.pose = lambda *_: None
    assert sources.run(2.0).state is State.UNKNOWN
    assert "pose or wrench" in sources.estimator.look().reason


def test_another_run_of_the_bridge_begins_anew():
    sources = Sources(2)
    sources.run(5.0)
    sources.slip[1] = 5e-3
    assert until_named(sources, 2.0)[0] is not None
    sources.now, sources.slip[1] = 0.0, 0.0
    assert sources.run(3.0).state is State.AGREE


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e12, -1e12, 1e300])
def test_numbers_of_no_rig_are_left_out(number):
    """A limb state or a measurement with them ends no node, and leaves nothing behind."""
    sources = Sources(2)
    sources.run(1.0)
    estimator, now_s = sources.estimator, sources.now
    place, wound = np.full(3, number), np.zeros(8)
    wound[3] = number
    estimator.limbs(LimbSample(now_s + 1e-3, wound, np.full(8, 0.01), 1))
    estimator.limbs(LimbSample(now_s + 1e-3, np.zeros(8), np.full(8, number), 1))
    message = ReflectorMeasurement(success=True, covariance=np.full(9, number))
    for reading in (
        reading_of(message),
        Measured(now_s - 0.1, now_s, 0, place, 1e-5),
        Measured(now_s - 0.1, now_s, 0, np.zeros(3), number),
        Measured(number, number, 0, np.zeros(3), 1e-5),
    ):
        estimator.measured(reading)
    found = sources.run(1.0)
    assert found.state is State.AGREE
    assert found.readings == 0
