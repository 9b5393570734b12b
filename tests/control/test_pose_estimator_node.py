# SPDX-License-Identifier: Apache-2.0
"""The pose estimator's node beside bridge, controllers and plant: one fault of each kind, and none.

`make bench-pose-faults` does the same over many trials, and for an hour without a fault.
"""

from __future__ import annotations

import numpy as np
import pytest
import rclpy
from cabols_msgs.msg import PoseAgreement

from agreement_rig import AgreementRig
from cabols_control.bringup.free_domains import claim_domain


@pytest.fixture(scope="module", autouse=True)
def _context():
    rclpy.init(args=["--ros-args", "-p", "robot:=true"], domain_id=claim_domain())
    yield
    rclpy.shutdown()


@pytest.fixture
def make():
    made = []

    def one(*args, **kwargs):
        made.append(AgreementRig(*args, **kwargs))
        made[-1].start()
        return made[-1]

    yield one
    for rig in made:
        rig.close()


def named(rig):
    """What is named by the newest answer: kind and limbs."""
    answer = rig.newest
    assert answer.state == PoseAgreement.NAMED, answer.reason
    return answer.suspect[0], answer.limb[0], answer.other_limb[0]


def test_a_session_without_a_fault_has_no_alarm(make):
    rig = make(11)
    rig.follow()
    rig.run(1.5)
    rig.stand()
    assert rig.measure(0).reflectors == 1
    rig.load([30.0, -20.0, 10.0, 1.0, 0.0, -1.0])
    rig.arm.go()
    rig.run(1.0)
    rig.unload()
    assert rig.rig.guard.fault is None
    judged = [answer.state for answer in rig.answers if answer.state != PoseAgreement.UNKNOWN]
    assert len(judged) > 100
    assert set(judged) == {PoseAgreement.AGREE}


def test_slipped_cable_is_named_behind_a_moving_robot(make):
    rig = make(1)
    rig.follow()
    rig.run(2.0)
    rig.rig.plant.inject("cable_slip", 1, 5e-3)
    rig.run(1.0)
    assert named(rig) == (PoseAgreement.SLIPPED_CABLE, 1, -1)


def test_slipped_cable_that_hardly_pulled_is_named_under_load(make):
    """It goes slack and takes little from the wrench; the others must not seem to fit as well."""
    rig = make(2)
    rig.load([40.0, 10.0, -20.0, 0.0, 1.0, 1.0])
    rig.arm.go()
    rig.run(2.0)
    rig.rig.plant.inject("cable_slip", 2, 5e-3)
    rig.run(1.0)
    assert named(rig) == (PoseAgreement.SLIPPED_CABLE, 2, -1)


def test_exchanged_plugs_are_named_though_the_bridge_stops_the_motion(make):
    rig = make(4)
    rig.load([40.0, 10.0, -20.0, 0.0, 1.0, 1.0])
    rig.exchange_encoders(1, 5)
    rig.arm.go()
    rig.run(1.4)
    assert rig.rig.guard.fault is not None
    answer = rig.newest
    found = zip(answer.suspect, answer.limb, answer.other_limb, strict=True)
    assert (PoseAgreement.SWAPPED_ENCODERS, 1, 5) in list(found), answer.reason


def test_bumped_tracker_is_named_at_its_next_measurement(make):
    rig = make(7)
    for reflector in range(3):
        assert rig.measure(reflector, 0.1).state == PoseAgreement.AGREE
    rig.bump[:] = 0.0, 0.0, 1e-3
    rig.measure(0, 0.1)
    assert named(rig)[0] == PoseAgreement.TRACKER


def test_wrong_tool_is_named_within_a_second_of_five_degrees(make):
    rig = make(6, swing=(0.04, 0.15), tool=[0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    rig.follow()
    assert rig.run(3.0, lambda: rig.arm.moved()[1] >= np.deg2rad(5.0))
    rig.run(1.0)
    assert named(rig)[0] == PoseAgreement.ROBOT_TOOL
    wrong = {kind for answer in rig.answers for kind in answer.suspect}
    assert wrong == {PoseAgreement.ROBOT_TOOL}
