# SPDX-License-Identifier: Apache-2.0
"""Whatever fails, no cable goes beyond 150 N: single faults, common causes, wrong controllers.

The simulated spring never ends and the motor is not loaded by the gear's limits: what is beyond
150 N means that nothing stops the motor. Terms: ISO 10218-1, ISO 13849 (common cause failures,
standstill monitored or torque off).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode as Mode
from cabols_hw.safety.faults import Reaction
from one_process import MovingTarget
from rig_harness import Peaks, RigInOneProcess

BOUND_N = Peaks.TENSION_N
FORCE_N, TORQUE_NM = 495.0, 15.0
"""The sensor's range."""


@pytest.mark.parametrize("limb", [0, 4])
def test_way_out_of_an_overload_makes_no_load_larger(make_rig, limb):
    """One switch's wire is broken; reset and FREE_MOVING as docs/safety.md advises."""
    bench = make_rig(seed=2)
    bench.run(0.3)
    bench.mode = Mode.FREE_MOVING
    bench.run(2.0)
    bench.plant.inject("switch_open", limb)
    Peaks(bench).run(4.0, after=0.5)
    bench.mode = Mode.STOPPED
    bench.run(0.5)
    before = float(bench.plant.tension.max())
    bench.mode = Mode.FREE_MOVING
    assert Peaks(bench).run(3.5).tension <= max(before, BOUND_N)


def test_supply_of_all_switches_lost(make_rig):
    """All eight lines read open, before PRETIGHTENING."""
    bench = make_rig(seed=1)
    bench.run(0.3)
    for limb in range(8):
        bench.plant.inject("switch_open", limb)
    bench.mode = Mode.PRETIGHTENING
    assert Peaks(bench).run(8.0).tension <= BOUND_N


@pytest.mark.parametrize(("axis", "sign"), [(0, 1.0), (2, -1.0)], ids=["+x", "-z"])
def test_robot_goes_on_and_its_bridge_dies(make_rig, rig, axis, sign):
    """FREE_MOVING; the robot moves 0.2 m at up to 60 mm/s, and no pose comes any more."""
    target = MovingTarget(rig.geometry)
    bench = make_rig(target=target)
    bench.run(0.3)
    bench.pretighten()
    bench.mode = Mode.FREE_MOVING
    bench.run(1.0)
    target.move(np.eye(6)[axis] * 0.2 * sign, 6.2)
    bench.run(1.5)
    bench.plant.inject("pose_silent")
    peaks = Peaks(bench).run(5.0)
    assert peaks.tension <= BOUND_N
    assert peaks.force <= FORCE_N


@pytest.mark.parametrize("offset_a", [0.3, 1.0])
def test_amplifier_offset_at_rest(started, offset_a):
    started.plant.inject("amplifier_offset", 0, offset_a)
    assert Peaks(started).run(3.0, hold=Mode.STOPPED).tension <= BOUND_N


def test_limb_controller_commands_full_current_under_load(loaded):
    assert commanded(loaded, 3, 3.0).tension <= BOUND_N


def test_limb_controller_commands_full_current_without_zeros(started):
    started.mode = Mode.FREE_MOVING
    peaks = commanded(started, 0, 2.9)
    assert peaks.tension <= BOUND_N
    assert peaks.torque <= TORQUE_NM


def commanded(bench, limb, current_a):
    """Peaks of 4 s in which a stranger commands one limb besides the controller."""
    limbs = np.array([limb], dtype=np.uint8)

    def answer():
        RigInOneProcess.answer(bench)
        if bench.mode != Mode.FAULT:
            bench.guard.command(limbs, np.array([current_a]), bench.now_s)
            bench.write(bench.guard.output(bench.mode))

    bench.answer = answer
    return Peaks(bench).run(4.0, after=0.6)


def test_pose_that_turns_at_once(loaded):
    """By 0.69 rad about y from one packet to the next, at the same position."""
    turn = Rotation.from_rotvec([0.0, 0.69, 0.0]).as_matrix()

    def tell():
        pose = loaded.plant.target.position, turn @ loaded.plant.target.rotation
        if loaded.guard.safety.hear_pose(loaded.now_s, *pose):
            loaded.bridge.set_pose(*pose)
            loaded.wrenches.set_pose(*pose)

    loaded.tell_pose = tell
    assert Peaks(loaded).run(2.0).tension <= BOUND_N


def test_encoder_that_loses_counts(loaded):
    """Limb 4's, 0.3 m/s of them, under load."""
    sense, began = loaded.plant.sense, loaded.now_s

    def drifting():
        counts, *rest = sense()
        counts = np.array(counts)
        counts[3] -= int(0.3e6 * (loaded.now_s - began))
        return (counts, *rest)

    loaded.plant.sense = drifting
    assert Peaks(loaded).run(3.0, after=1.2).tension <= BOUND_N


def test_harder_fault_overrides_a_softer_one(loaded):
    """The bridge unloads as the pose is silent; 5 ms later an encoder freezes."""
    limb = int(np.argmax(loaded.plant.tension))
    loaded.plant.inject("pose_silent")
    loaded.run(1.0, lambda: loaded.guard.fault is not None)
    assert loaded.guard.fault.reaction is Reaction.UNLOAD
    loaded.run(0.005)
    loaded.plant.inject("encoder_frozen", limb)
    Peaks(loaded).run(1.5)
    assert loaded.guard.fault.reaction is Reaction.CUT


@pytest.mark.parametrize("speed_m_s", [0.05, 0.2])
def test_pose_that_drifts_while_limbs_search(started, speed_m_s):
    """Zeroed limbs go by the pose before pose and sensor can be compared: the platform stands."""
    began = started.now_s + 0.3

    def tell():
        target = started.plant.target
        way = np.array([max(started.now_s - began, 0.0) * speed_m_s, 0.0, 0.0])
        started.hear_pose(started.now_s, target.position + way, target.rotation)

    started.tell_pose = tell
    started.mode = Mode.PRETIGHTENING
    peaks = Peaks(started).run(2.0)
    assert peaks.fault.name == FaultName.POSE_SPEED
    assert peaks.force < 20.0
