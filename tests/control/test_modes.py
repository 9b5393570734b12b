"""Modes: legal transitions only, each refusal with its reason; the automatic sequence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cabols_control.supervision.modes import Condition, ModeMachine, OperatingMode
from cabols_control.supervision.starvation import StarvationWatch
from cabols_control.supervision.supervisor import Supervision, SupervisionConfig

READY = np.ones(8, dtype=bool)
STANDING = Condition(READY, fresh=True)
STOPPED, PRETIGHTENING, LOADING, FREE, FAULT, UNLOADING, COMMISSIONING = (
    OperatingMode.STOPPED,
    OperatingMode.PRETIGHTENING,
    OperatingMode.LOADING,
    OperatingMode.FREE_MOVING,
    OperatingMode.FAULT,
    OperatingMode.UNLOADING,
    OperatingMode.COMMISSIONING,
)


def test_numbers_are_the_messages():
    from cabols_msgs.msg import Mode

    for mode in OperatingMode:
        assert getattr(Mode, mode.name) == mode.value


def reach(*modes):
    """A machine that has gone through some modes."""
    machine = ModeMachine()
    for mode in modes:
        assert machine.request(mode, STANDING).allowed
        assert machine.mode == mode
    return machine


@pytest.mark.parametrize("wanted", [STOPPED, FREE, PRETIGHTENING])
def test_loading_is_left_through_unloading(wanted):
    machine = reach(FREE, PRETIGHTENING, LOADING)
    assert machine.request(wanted, STANDING).allowed
    assert machine.mode == UNLOADING
    machine.unloaded()
    assert machine.mode == wanted


def test_the_newest_wish_counts_while_unloading():
    machine = reach(PRETIGHTENING, LOADING)
    machine.request(FREE, STANDING)
    machine.request(STOPPED, STANDING)
    assert not machine.request(LOADING, STANDING).allowed
    machine.unloaded()
    assert machine.mode == STOPPED


@pytest.mark.parametrize(
    ("before", "wanted", "condition", "reason"),
    [
        ((), LOADING, STANDING, "LOADING follows PRETIGHTENING"),
        ((), PRETIGHTENING, Condition(None, fresh=True), "no limb state"),
        ((), PRETIGHTENING, Condition(READY, fresh=False), "no limb state"),
        ((), FREE, Condition(READY, fresh=False), "no limb state"),
        ((), PRETIGHTENING, Condition(READY, True, 0.05), "50 mm/s"),
        ((), PRETIGHTENING, Condition(READY, True, float("nan")), "stands still"),
        ((), UNLOADING, STANDING, "cannot be asked for"),
        ((), FAULT, STANDING, "cannot be asked for"),
        ((), 17, STANDING, "expected one of"),
        ((), -1, STANDING, "expected one of"),
        ((FREE,), LOADING, STANDING, "the mode is FREE_MOVING"),
        ((FREE,), COMMISSIONING, STANDING, "follows STOPPED or PRETIGHTENING"),
        ((PRETIGHTENING,), COMMISSIONING, Condition(~READY, True), "not pre-tightened"),
        ((PRETIGHTENING, COMMISSIONING), LOADING, STANDING, "the mode is COMMISSIONING"),
    ],
)
def test_refusals(before, wanted, condition, reason):
    machine = reach(*before)
    verdict = machine.request(wanted, condition)
    assert not verdict.allowed
    assert reason in verdict.reason
    assert machine.mode == (before[-1] if before else STOPPED)


def test_cables_may_follow_a_platform_that_moves():
    assert ModeMachine().request(FREE, Condition(~READY, True, 0.05)).allowed


def test_loading_names_the_limbs_that_are_slack():
    machine = reach(PRETIGHTENING)
    zeroed = READY.copy()
    zeroed[[2, 6]] = False
    assert "limbs 3 and 7" in machine.request(LOADING, Condition(zeroed, True)).reason


def test_fault_is_latched_and_keeps_its_first_reason():
    machine = ModeMachine()
    machine.fault("first")
    machine.fault("second")
    for mode in OperatingMode:
        assert not machine.request(mode, STANDING).allowed
    assert machine.reason == "first"
    assert machine.reset().allowed
    assert machine.mode == STOPPED
    assert not machine.reset().allowed


@given(st.lists(st.integers(-2, 6), max_size=30), st.booleans())
def test_fault_is_left_by_reset_only(requests, fresh):
    machine = ModeMachine()
    machine.fault("test")
    for wanted in requests:
        machine.request(wanted, Condition(READY, fresh))
    assert machine.mode == FAULT


def supervised(**options):
    core = Supervision(SupervisionConfig(**options))
    report_all(core, 0.0)
    return core


def report_all(core, now_s):
    for name in (*SupervisionConfig.controllers, "plant"):
        core.hear_report(name, now_s, True, "")


def test_automatic_sequence():
    core = supervised(auto_start=True, report_timeout_s=100.0)
    seen = []
    for k in range(3000):
        stamp = 0.001 * k
        core.hear_state(stamp, READY if stamp > 1.5 else ~READY)
        if not seen or seen[-1] != core.mode:
            seen.append(core.mode)
    assert seen == [STOPPED, PRETIGHTENING, LOADING]


def test_automatic_sequence_does_not_restart_after_a_reset():
    core = supervised(auto_start=True, report_timeout_s=100.0)
    for k in range(2000):
        core.hear_state(0.001 * k, READY)
    core.emergency_stop("emergency stop")
    assert core.reset().allowed
    for k in range(2000, 5000):
        core.hear_state(0.001 * k, READY)
    assert core.mode == STOPPED


def test_pretightening_time_out_names_the_limb():
    core = supervised(pretension_timeout_s=1.0)
    core.hear_state(0.0, ~READY)
    assert core.request(PRETIGHTENING, 0.0).allowed
    zeroed = READY.copy()
    zeroed[3] = False
    for k in range(1200):
        core.hear_state(0.001 * k, zeroed)
    assert core.mode == FAULT
    assert "limb 4 did not reach" in core.reason


def test_silence_of_the_bridge_is_a_fault_unless_at_rest():
    core = supervised()
    core.hear_state(0.0, READY)
    core.check_silence(10.0)
    assert core.mode == STOPPED
    core.hear_state(10.0, READY)
    report_all(core, 10.0)
    assert core.request(PRETIGHTENING, 10.0).allowed
    core.check_silence(10.1)
    assert core.mode == PRETIGHTENING
    core.check_silence(10.5)
    assert core.mode == FAULT
    assert "no limb state" in core.reason


def test_missing_controller_is_named():
    core = Supervision(SupervisionConfig())
    core.hear_state(0.0, READY)
    core.hear_report("limb_controller", 0.0, True, "")
    core.hear_report("wrench_controller", 0.0, False, "")
    core.hear_report("plant", 0.0, False, "")
    verdict = core.request(PRETIGHTENING, 0.0)
    assert not verdict.allowed
    assert "wrench_controller, the bridge" in verdict.reason


def test_a_nodes_fault_stops_what_moves():
    core = supervised()
    now_s = load(core, 1.0)
    core.hear_report("limb_controller", now_s, False, "tension_command is stale")
    assert core.mode == FAULT
    assert core.reason == "limb_controller: tension_command is stale"


def test_a_fault_at_rest_keeps_the_rig_there_while_it_lasts():
    core = supervised()
    core.hear_state(1.0, READY)
    core.hear_report("plant", 1.0, False, "sensor_flat: gauge 3")
    assert core.mode == STOPPED
    assert core.request(PRETIGHTENING, 1.0).reason == "plant: sensor_flat: gauge 3"
    core.hear_report("plant", 1.1, True, "")
    assert core.request(PRETIGHTENING, 1.1).allowed


def test_an_overload_at_rest_leaves_free_moving_as_the_way_out():
    core = supervised()
    core.hear_state(1.0, READY)
    overload = "sensor_saturated: force/torque sensor: force x is 170 N"
    core.hear_report("plant", 1.0, False, overload)
    refused = core.request(PRETIGHTENING, 1.0)
    assert refused.reason == f"plant: {overload}; FREE_MOVING takes a load off"
    assert core.request(FREE, 1.0).allowed
    # What the bridge said before it heard of the mode does not stop the rig again...
    core.hear_state(1.1, READY)
    core.hear_report("plant", 1.1, False, overload)
    assert core.mode == FREE
    # ...what it says long after does, as does every other complaint.
    core.hear_state(3.0, READY)
    core.hear_report("plant", 3.0, False, overload)
    assert core.mode == FAULT


def test_another_fault_at_rest_keeps_free_moving_shut_too():
    core = supervised()
    core.hear_state(1.0, READY)
    core.hear_report("plant", 1.0, False, "sensor_flat: gauge 3")
    assert not core.request(FREE, 1.0).allowed


def test_clock_that_is_set_back_is_a_fault_and_forgets_reports():
    core = supervised()
    report_all(core, 1000.0)
    load(core, 1000.0)
    core.hear_state(5.0, READY)
    assert core.mode == FAULT
    assert "went back by 995 s" in core.reason
    assert core.reset().allowed
    assert "no report from" in core.request(PRETIGHTENING, 5.0).reason
    report_all(core, 5.0)
    load(core, 5.0)
    assert core.mode == LOADING


def test_who_has_slept_believes_no_silence():
    watcher = StarvationWatch(0.06)
    assert not watcher.turn(10.0)
    assert not any(watcher.turn(10.0 + 0.02 * k) for k in range(1, 3))
    assert all(watcher.turn(10.06 + 0.02 * k) for k in range(1, 10))
    # Starved for a quarter of a second: what came meanwhile is heard a little later only.
    assert not watcher.turn(10.5)
    assert not watcher.turn(10.54)
    assert watcher.turn(10.57)


def load(core, now_s):
    """Bring a supervised core to LOADING; returns the time then."""
    core.hear_state(now_s, READY)
    assert core.request(PRETIGHTENING, now_s).allowed
    core.hear_state(now_s + 0.2, READY)
    assert core.request(LOADING, now_s + 0.2).allowed
    return now_s + 0.2


def test_zeros_of_before_do_not_count_for_loading():
    core = supervised()
    core.hear_state(1.0, READY)
    assert core.request(PRETIGHTENING, 1.0).allowed
    core.hear_state(1.05, READY)
    assert "not pre-tightened" in core.request(LOADING, 1.05).reason
    core.hear_state(1.15, READY)
    assert core.request(LOADING, 1.15).allowed


def test_unloading_ends_when_every_limb_is_low():
    core = supervised()
    now_s = load(core, 1.0)
    assert core.request(FREE, now_s).allowed
    core.hear_state(now_s + 0.1, READY, np.full(8, 50.0))
    assert core.mode == UNLOADING
    core.hear_state(now_s + 0.2, READY, np.r_[np.full(7, 5.0), np.nan])
    assert core.mode == UNLOADING
    core.hear_state(now_s + 0.3, READY, np.full(8, 5.0))
    assert core.mode == FREE


def test_a_limb_that_does_not_unload_is_named():
    core = supervised(unload_timeout_s=1.0, report_timeout_s=9.0)
    now_s = load(core, 1.0)
    core.request(STOPPED, now_s)
    tension = np.full(8, 5.0)
    tension[4] = 60.0
    for k in range(12):
        core.hear_state(now_s + 0.1 * (k + 1), READY, tension)
    assert core.mode == FAULT
    assert "still on limb 5 after" in core.reason


def test_a_moving_platform_is_not_pretightened():
    core = supervised()
    for k in range(3):
        core.hear_pose(1.0 + 0.02 * k, np.array([0.001 * k, 0.0, 0.0]))
        core.hear_state(1.0 + 0.02 * k, READY)
    assert "50 mm/s" in core.request(PRETIGHTENING, 1.04).reason
    core.hear_pose(1.06, np.array([0.002, 0.0, 0.0]))
    assert core.request(PRETIGHTENING, 1.06).allowed


def test_echo_of_a_fault_does_not_undo_the_reset():
    core = supervised()
    now_s = load(core, 1.0)
    core.hear_report("plant", now_s, False, "cable: limb 3")
    assert core.mode == FAULT
    assert core.reset().allowed
    core.hear_report("plant", now_s + 0.1, False, "cable: limb 3")
    assert core.mode == STOPPED
