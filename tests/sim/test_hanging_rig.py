# SPDX-License-Identifier: Apache-2.0
"""A rig whose platform hangs on its cables, with its compiled controllers, in one process.

What it does is judged by the simulated body (`plant/free_platform.py`, as MuJoCo's), not by what
the bridge says.
"""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.hanging_kinds import HANGING_KINDS, weaken
from cabols_sim.fault_campaign.in_process.hanging_rig import HangingRig
from cabols_sim.fault_campaign.in_process.hanging_trials import (
    HangingBench,
    hanging_table,
    run_hanging,
    why_wrong,
)
from cabols_sim.plant.stand import hanging_body

pytestmark = pytest.mark.timeout(300)
MODE = OperatingMode


@pytest.fixture(scope="module")
def bench():
    return HangingBench()


@pytest.fixture
def lifted(bench):
    """Its platform hangs 60 mm above the stand."""
    return bench.lifted(0)


def offset(rig):
    """(3,) of the true platform from its stand [m]."""
    return rig.body.position - rig.rig.geometry.reference_position


def test_lifts_from_its_stand_holds_and_sets_down(lifted):
    rig = lifted
    assert not rig.body.held
    np.testing.assert_allclose(offset(rig), [0.0, 0.0, 0.06], atol=1e-3)
    rig.go(np.array([0.03, -0.02, 0.08]))
    assert rig.guard.fault is None
    np.testing.assert_allclose(offset(rig), [0.03, -0.02, 0.08], atol=1e-3)
    # What it knows of its place is where the body is, and its cables pull what it says.
    np.testing.assert_allclose(rig.guard.watch.hang.position, rig.body.position, atol=5e-4)
    np.testing.assert_allclose(rig.guard.watch.hang.tension, rig.plant.tension, atol=2.5)
    rig.go(np.array([0.0, 0.0, -0.006]))
    assert rig.body.held
    rig.mode = MODE.STOPPED
    rig.run(0.1)
    # The told pose, below the stand, comes back to it first.
    assert rig.guard.notice(rig.bridge) is not None
    rig.run(0.6)
    assert rig.guard.notice(rig.bridge) is None
    # From there the next start has zeros and a proof of its own.
    rig.prepare()
    assert rig.body.held


def test_what_it_exerts_is_what_is_asked_for(lifted):
    """Held fast where it should be, the true platform feels 5 N more than its weight."""
    rig = lifted
    rig.desired[:] = [0.0, 0.0, 5.0, 0.0, 0.0, 0.0]
    rig.run(1.0)
    # Free, it gives way by the force over the stiffness that its cables have.
    rises = offset(rig)[2] - 0.06
    stiff = rig.guard.watch.hang.stiffness
    assert rises == pytest.approx(np.linalg.inv(stiff)[2, 2] * 5.0, abs=3e-4)
    rig.body.position[:] = rig.guard.watch.hoist.position
    rig.body.rotation[:] = rig.guard.watch.hoist.rotation
    rig.body.held, rig.body._lifted = True, lambda _wrench: False
    rig.plant._place()
    rig.run(1.0)
    exerts = rig.plant.wrench.copy()
    exerts[2] -= 4.0 * 9.80665
    np.testing.assert_allclose(exerts[:3], [0.0, 0.0, 5.0], atol=0.8)


@pytest.mark.parametrize("mode", [MODE.PRETIGHTENING, MODE.FREE_MOVING, MODE.COMMISSIONING])
def test_modes_that_would_let_it_go_are_cut_at_once(lifted, mode):
    rig = lifted
    rig.mode = MODE.STOPPED
    rig.run(0.1)
    assert rig.guard.notice(rig.bridge).name == "hangs"
    rig.watch()
    rig.mode = mode
    rig.run(1.0)
    assert rig.guard.fault.name == "not_held"
    assert rig.heights[0] - min(rig.heights) < 1e-3


def test_a_bridge_that_starts_in_the_air_moves_nothing(lifted):
    """It knows no zeros, and switches that are closed do not say that the platform stands."""
    rig = lifted
    rig.start_again(None)
    rig.run(0.3)
    assert rig.guard.notice(rig.bridge).name == "not_held"
    rig.watch()
    for mode in (MODE.PRETIGHTENING, MODE.LOADING):
        rig.mode = mode
        rig.run(0.5)
        assert rig.guard.fault is not None
        rig.mode = MODE.STOPPED
        rig.run(0.1)
    assert rig.heights[0] - min(rig.heights) < 1e-3


def test_a_load_goes_on_at_once_after_a_short_stop(lifted):
    """A wrench has shifted the platform by 2 mm, which is not taken for a motion afterwards."""
    rig = lifted
    rig.desired[:3] = [0.0, 0.0, 15.0]
    rig.run(1.0)
    for stopped_s in (0.005, 0.05, 0.3):
        rig.mode = MODE.STOPPED
        rig.run(0.004)
        rig.run(stopped_s)
        rig.run(2.0, lambda: not rig.guard.watch.refusal(MODE.LOADING, rig.bridge))
        rig.mode = MODE.LOADING
        rig.run(0.3)
        assert rig.guard.fault is None, rig.guard.fault
    assert offset(rig)[2] > 0.06


def test_goes_on_after_a_stop_in_the_air_but_not_after_a_doubt(lifted):
    rig = lifted
    rig.mode = MODE.STOPPED
    rig.run(0.5)
    rig.mode = MODE.LOADING
    rig.run(0.5)
    assert rig.guard.fault is None
    np.testing.assert_allclose(offset(rig), [0.0, 0.0, 0.06], atol=2e-3)
    rig.plant.inject("encoder_jump", 2, 0.01)
    rig.run(0.2)
    assert rig.guard.fault.name == "encoder"
    rig.mode = MODE.STOPPED
    rig.run(0.2)
    assert "in doubt" in rig.guard.watch.refusal(MODE.LOADING, rig.bridge)
    rig.mode = MODE.LOADING
    rig.run(0.2)
    assert rig.guard.fault.name == "not_held"


def test_refuses_goals_beyond_its_range(lifted):
    watch, place = lifted.guard.watch, lifted.rig.geometry.reference_position
    turn = np.eye(3)
    for away in ([0.2, 0.0, 0.05], [0.0, 0.0, -0.02], [0.0, 0.0, np.nan]):
        assert watch.go(place + np.array(away), turn)
    assert watch.go(place + np.array([0.0, 0.0, 0.05]), np.diag([1.0, -1.0, -1.0]))
    assert not watch.hoist.moving


def test_a_gear_weaker_than_declared_is_found_on_the_stand(bench):
    """ "gear": by its motor, which is turned back without current."""
    for limb in (0, 5):
        rig = bench.made(1)
        weaken(rig, limb)
        with pytest.raises(RuntimeError, match=rf"gear: limb {limb + 1}: without current"):
            rig.prepare()
        assert rig.guard.fault.name == "gear"
        # The others are let down with it: their pulls alone would tip the platform.
        rig.run(1.0)
        assert rig.body.held
        assert rig.plant.tension.max() < 10.0
        assert rig.peak < 80.0


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_a_wrong_mass_is_borne_and_costs_its_weight(bench, share):
    """No sensor tells it: the wrench is wrong by it, the pose by it over the stiffness."""
    files = (*bench._files, bench._plant, bench.safety, 1)
    rig = HangingRig(*files, body=hanging_body(bench._files[0].hanging, share))
    rig.prepare()
    rig.go(np.array([0.0, 0.0, 0.05]))
    assert rig.guard.fault is None
    assert rig.peak < 80.0
    lacks = (1.0 - share) * 4.0 * 9.80665
    stiff = np.linalg.inv(rig.guard.watch.hang.stiffness)[2, 2]
    assert offset(rig)[2] - 0.05 == pytest.approx(stiff * lacks, abs=5e-4)
    rig.mode = MODE.STOPPED
    rig.watch()
    rig.run(1.0)
    assert rig.heights[0] - min(rig.heights) < 2e-3


def test_no_tensions_are_commanded_in_its_place(lifted):
    """Tensions that somebody else asks for would let it go."""
    from cabols_control.wrench_control.tension_setpoint import DesiredTension

    rig = lifted
    step = rig.wrenches.step

    def asked(stamp_s, measured, mode, setpoint, tensions=None):
        del tensions
        wanted = DesiredTension(stamp_s, np.full(8, 6.0))
        return step(stamp_s, measured, mode, setpoint, wanted)

    rig.wrenches.step = asked
    rig.watch()
    rig.run(0.5)
    assert rig.guard.fault is None
    assert rig.heights[0] - min(rig.heights) < 1e-3


NAMES = ("supply lost", "limb controller ends", "cable breaks", "currents reversed", "no tensions")


@pytest.mark.parametrize("name", NAMES)
def test_kinds_of_the_campaign_hold_their_bounds(bench, name):
    kind = next(kind for kind in HANGING_KINDS if kind.name == name)
    trials = [run_hanging(bench, kind, state, 1) for state in kind.states[:2]]
    assert [why_wrong(bench, trial) for trial in trials] == ["", ""]
    assert name in hanging_table(bench, trials)


def test_a_fall_would_be_judged(bench):
    """The judgement can fail: a limb controller that nothing stops lets the platform down."""
    kind = next(kind for kind in HANGING_KINDS if kind.name == "currents reversed")
    trial = run_hanging(bench, kind, "hangs", 0)
    assert not why_wrong(bench, trial)
    assert "sank" in why_wrong(bench, trial | {"sank_m": 0.1})
    assert "pulled" in why_wrong(bench, trial | {"peak_n": 151.0})
    found = trial | {"kind": "encoder jumps", "found_s": None}
    assert "not found" in why_wrong(bench, found)
    below = trial | {"kind": "cable breaks", "below_m": 0.3}
    assert "net" in why_wrong(bench, below)


def test_a_goal_that_is_told_again_and_again_is_reached(lifted):
    rig = lifted
    place = rig.rig.geometry.reference_position + np.array([0.0, 0.02, 0.07])
    for _ in range(500):
        assert not rig.guard.watch.go(place, np.eye(3))
        rig.run(0.01)
    np.testing.assert_allclose(offset(rig), [0.0, 0.02, 0.07], atol=1e-3)
    # Another one on the way is gone to from where the platform comes to rest, without a jump.
    rig.guard.watch.go(place + 0.05, np.eye(3))
    rig.run(1.0)
    rig.go(np.array([0.0, 0.0, 0.07]))
    assert rig.guard.fault is None
    np.testing.assert_allclose(offset(rig), [0.0, 0.0, 0.07], atol=1e-3)
