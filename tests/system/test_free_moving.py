# SPDX-License-Identifier: Apache-2.0
"""FREE_MOVING and UNLOADING on the simulated plant: the real bridge, the real controller."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.supervision.modes import OperatingMode
from one_process import MovingTarget, OneProcess

MOST_N = 15.0
"""Required of a cable that follows the robot."""
MOVES = {
    # A quintic's peak speed is 1.875 times the mean: both first moves reach 60 mm/s.
    "far": (([0.1, 0, 0, 0, 0, 0], 3.125), ([0, 0, 0.08, 0, 0, 0], 4.1)),
    "short": (([0.01, 0, 0, 0, 0, 0], 0.3125), ([0, 0, 0, 0, 0, 0], 0.3125)),
    "turning": (([0.02, 0, 0.02, 0, 0, 0], 0.9), ([-0.02, 0.01, 0, 0.1, -0.05, 0.05], 1.5)),
}


@pytest.fixture
def loop(rig, card, plant_config):
    return OneProcess(rig, card, plant_config, 1, MovingTarget(rig.geometry))


@pytest.mark.parametrize("moves", MOVES)
def test_zeroed_limbs_follow_neither_tight_nor_slack(loop, rig, moves):
    loop.run(0.1)
    loop.pretighten()
    loop.mode = OperatingMode.FREE_MOVING
    settled = loop.run(0.6)[-1]
    # Gear backlash and the cables' length leave 0.5 N between estimate and truth.
    np.testing.assert_allclose(settled, rig.control.free_tension, atol=0.5)
    for to, duration in MOVES[moves]:
        loop.target.move(to, duration)
        tension = loop.run(duration + 0.3)
        assert tension.max() < MOST_N
        assert tension.min() > 1.0
    assert not loop.controller.fault


@pytest.mark.parametrize("moves", MOVES)
def test_limbs_without_zero_follow_by_their_switches(loop, moves):
    loop.mode = OperatingMode.FREE_MOVING
    tension = loop.run(0.6)
    assert tension.max() < MOST_N
    for to, duration in MOVES[moves]:
        loop.target.move(to, duration)
        tension = loop.run(duration + 0.3)
        assert tension.max() < MOST_N
        # They did follow: each switch closed again at the end.
        assert (tension[-300:].max(axis=0) > 4.0).all()
    assert not loop.bridge.zeroed.any()
    assert not loop.controller.fault


def test_platform_that_moves_without_free_moving_breaks_the_rule(loop):
    """The check above can fail: the same move against limbs at rest."""
    loop.run(0.1)
    loop.pretighten()
    loop.mode = OperatingMode.STOPPED
    loop.target.move([0.02, 0, 0, 0, 0, 0], 0.625)
    tension = loop.run(0.7)
    assert tension.max() > MOST_N
    assert tension[-1].min() == 0.0


def load(loop, tension):
    loop.run(0.1)
    loop.pretighten()
    loop.setpoint = TensionSetpoint(0.0, np.asarray(tension, dtype=float), True)
    loop.mode = OperatingMode.LOADING
    loop.run(1.0)


def test_unloading_ramps_without_a_bump_or_a_wrench_controller(loop, rig):
    tensions = np.linspace(20.0, 120.0, 8)
    load(loop, tensions)
    before = loop.controller.current.copy()
    loop.setpoint = None
    loop.mode = OperatingMode.UNLOADING
    loop.cycle()
    assert np.abs(loop.controller.current - before).max() < 0.1
    assert not loop.controller.unloaded
    rate = rig.control.unload_tension_rate
    expected = (tensions.max() - rig.holding_tension) / rate
    path = loop.run(3.0, lambda: loop.controller.unloaded)
    # The ramp itself, then the closed loop's own 0.2 s.
    assert expected < 1e-3 * len(path) < expected + 0.5
    np.testing.assert_allclose(loop.plant.tension, rig.holding_tension, atol=4.0)
    # Never upwards, and never steeper than half as much again.
    steps = np.diff(path[::10], axis=0)
    assert steps.max() < 0.5
    assert -steps.min() < 1.5 * rate * 0.01
    assert path.min() > 1.0


def test_loading_goes_on_from_unloading_without_a_bump(loop):
    load(loop, np.full(8, 60.0))
    loop.mode = OperatingMode.UNLOADING
    loop.run(1.0, lambda: loop.controller.unloaded)
    before = loop.controller.current.copy()
    loop.setpoint = TensionSetpoint(0.0, loop.bridge.tension.copy(), True)
    loop.mode = OperatingMode.LOADING
    loop.cycle()
    # Of 3 A: the integral goes on, the reference alone has changed by what friction left over.
    assert np.abs(loop.controller.current - before).max() < 0.2
    assert not loop.controller.fault


def test_unloading_leaves_limbs_without_zero_at_rest(loop):
    loop.mode = OperatingMode.UNLOADING
    loop.run(0.1)
    np.testing.assert_array_equal(loop.controller.current, 0.0)
    assert loop.controller.unloaded


def test_lost_tension_stops_free_moving(loop):
    loop.run(0.1)
    loop.pretighten()
    loop.mode = OperatingMode.FREE_MOVING
    loop.run(0.1)
    loop.bridge.set_pose(np.full(3, np.nan), np.eye(3))
    loop.cycle()
    assert "not finite" in loop.controller.fault.reason
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_pretightening_again_sets_the_zeros_anew(rig, card, plant_config):
    loop = OneProcess(rig, card, plant_config, 1)
    loop.run(0.1)
    loop.pretighten()
    first = loop.bridge.tension - loop.plant.tension
    # The platform seems to have moved: tension control now goes by wrong zeros.
    geometry = rig.geometry
    loop.bridge.set_pose(geometry.reference_position + np.array([0.0, 0.0, 0.002]), np.eye(3))
    loop.run(0.3)
    assert np.abs(loop.bridge.tension - loop.plant.tension).max() > 1.0
    loop.mode = OperatingMode.STOPPED
    loop.run(0.01)
    assert loop.bridge.zeroed.all(), "only PRETIGHTENING forgets"
    loop.mode = OperatingMode.PRETIGHTENING
    loop.cycle()
    assert not loop.bridge.zeroed.any()
    opened = np.zeros(8, dtype=bool)
    for _ in range(3000):
        loop.cycle()
        opened |= ~loop.bridge.switch_closed & ~loop.bridge.zeroed
        if loop.bridge.zeroed.all():
            break
    assert opened.all(), "every switch opened before it closed at its zero"
    loop.run(0.5)
    np.testing.assert_allclose(loop.bridge.tension - loop.plant.tension, first, atol=0.3)
