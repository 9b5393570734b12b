# SPDX-License-Identifier: Apache-2.0
"""Modes: legal transitions only, each refusal with its reason; the automatic sequence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cabols_control.result_code import ResultCode
from cabols_control.supervision.faults import Fault, FaultName, fault_name
from cabols_control.supervision.modes import (
    MOVING,
    Cause,
    Condition,
    ModeMachine,
    OperatingMode,
)
from cabols_control.supervision.starvation import StarvationWatch
from cabols_control.supervision.supervision_config import SupervisionConfig
from cabols_control.supervision.supervisor import Supervision

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


def constants(message):
    """Names of a message's constants."""
    return {name for name in dir(message) if name.isupper()} - {"SLOT_TYPES"}


def test_numbers_are_the_messages():
    from cabols_msgs.msg import Mode

    for mode in OperatingMode:
        assert getattr(Mode, mode.name) == mode.value
    for cause in Cause:
        assert getattr(Mode, f"CAUSE_{cause.name}") == cause.value
    assert constants(Mode) == {mode.name for mode in OperatingMode} | {
        f"CAUSE_{cause.name}" for cause in Cause
    }


def test_codes_are_the_messages():
    from cabols_msgs.msg import ResultCode as Message

    for code in ResultCode:
        assert getattr(Message, code.name) == code.value
    assert constants(Message) == {code.name for code in ResultCode}


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


def test_the_newest_request_counts_while_unloading():
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
    machine.fault(Fault(FaultName.CLOCK, "first"))
    machine.fault(Fault(FaultName.OTHER, "second"))
    for mode in OperatingMode:
        assert not machine.request(mode, STANDING).allowed
    assert machine.reason == "first"
    assert (machine.entry.cause, machine.entry.fault) == (Cause.FAULT, FaultName.CLOCK)
    assert machine.reset().allowed
    assert machine.mode == STOPPED
    assert not machine.reset().allowed


@given(st.lists(st.integers(-2, 6), max_size=30), st.booleans())
def test_fault_is_left_by_reset_only(requests, fresh):
    machine = ModeMachine()
    machine.fault(Fault(FaultName.OTHER, "test"))
    for wanted in requests:
        machine.request(wanted, Condition(READY, fresh))
    assert machine.mode == FAULT


def supervised(**options):
    core = Supervision(SupervisionConfig(**options))
    report_all(core, 0.0)
    return core


def report(core, node, now_s, running, fault=None, stamp_s=None):
    """Let a core hear a report about the sample of now, or of stamp_s."""
    core.hear_report(node, now_s, running, fault, now_s if stamp_s is None else stamp_s)


def hear(core, stamp_s, zeroed, tension=None, zeroing=None, followed=None):
    """Let a core hear the state of a bridge that follows at once, unless told otherwise."""
    core.hear_state(
        stamp_s,
        zeroed,
        tension,
        zeroing=core.entry.zeroing if zeroing is None else zeroing,
        followed=core.mode if followed is None else followed,
    )


def report_all(core, now_s):
    for name in (*SupervisionConfig.controllers, "plant"):
        report(core, name, now_s, True)


def test_automatic_sequence():
    core = supervised(auto_start=True, report_timeout_s=100.0)
    seen = []
    for k in range(3000):
        stamp = 0.001 * k
        hear(core, stamp, READY if stamp > 1.5 else ~READY)
        if not seen or seen[-1] != core.mode:
            seen.append(core.mode)
    assert seen == [STOPPED, PRETIGHTENING, LOADING]


def loading():
    core = supervised(report_timeout_s=100.0)
    hear(core, 0.0, READY)
    assert core.request(PRETIGHTENING, 0.0).allowed
    hear(core, 0.1, READY)
    assert core.request(LOADING, 0.1).allowed
    hear(core, 0.2, READY, np.full(8, 50.0))
    return core


@pytest.mark.parametrize("name", [FaultName.ENDING, FaultName.RECORDING])
def test_node_that_must_end_is_unloaded_first(name):
    core = loading()
    core.hear_notice("recorder", Fault(name, "the disk is full"))
    assert core.mode == UNLOADING
    assert "recorder: the disk is full" in core.reason
    hear(core, 0.3, READY, np.full(8, 5.0))
    assert core.mode == STOPPED
    refused = core.request(PRETIGHTENING, 0.3)
    assert not refused.allowed
    assert "the disk is full" in refused.reason
    core.hear_notice("recorder", None)
    assert core.request(PRETIGHTENING, 0.3).allowed


def test_recorder_that_falls_silent_ends_a_test_in_order():
    core = loading()
    report(core, "recorder", 0.2, True)
    hear(core, 5.0, READY, np.full(8, 50.0))
    core.check_silence(5.1)
    assert core.mode == LOADING
    hear(core, 5.3, READY, np.full(8, 50.0))
    core.check_silence(5.3)
    assert core.mode == UNLOADING


def test_recorder_that_was_switched_off_ends_nothing():
    core = loading()
    report(core, "recorder", 0.2, True)
    report(core, "recorder", 0.3, False)
    hear(core, 20.0, READY, np.full(8, 50.0))
    core.check_silence(20.0)
    assert core.mode == LOADING


@pytest.mark.parametrize("mode", MOVING)
def test_a_platform_that_nothing_holds_is_not_moved(mode):
    core = supervised(report_timeout_s=100.0)
    hear(core, 0.0, READY)
    said = Fault(FaultName.NOT_HELD, "nothing but the cables holds the platform")
    core.hear_notice("q8_ati_bridge", said)
    refused = core.request(mode, 0.0)
    assert (refused.allowed, refused.fault) == (False, FaultName.NOT_HELD)
    assert "q8_ati_bridge: nothing but" in refused.reason
    assert core.request(OperatingMode.STOPPED, 0.0).allowed
    core.hear_notice("q8_ati_bridge", None)
    assert core.request(PRETIGHTENING, 0.0).allowed


def test_no_load_without_the_sensors_bias():
    core = supervised(report_timeout_s=100.0)
    hear(core, 0.0, READY)
    assert core.request(PRETIGHTENING, 0.0).allowed
    hear(core, 0.1, READY)
    core.hear_notice("q8_ati_bridge", Fault(FaultName.NOT_TARED, "tare refused: limb 3"))
    refused = core.request(LOADING, 0.1)
    assert not refused.allowed
    assert refused.fault == FaultName.NOT_TARED
    assert "limb 3" in refused.reason
    assert core.request(FREE, 0.1).allowed, "a load can be taken off without a bias"
    assert core.request(PRETIGHTENING, 0.1).allowed
    hear(core, 0.2, READY)
    core.hear_notice("q8_ati_bridge", Fault(FaultName.TARE_REFUSED, "the bias before stays"))
    assert core.request(LOADING, 0.2).allowed


def test_automatic_sequence_does_not_restart_after_a_reset():
    core = supervised(auto_start=True, report_timeout_s=100.0)
    for k in range(2000):
        hear(core, 0.001 * k, READY)
    core.emergency_stop("emergency stop")
    assert core.reset().allowed
    for k in range(2000, 5000):
        hear(core, 0.001 * k, READY)
    assert core.mode == STOPPED


def test_pretightening_time_out_names_the_limb():
    core = supervised(pretension_timeout_s=1.0)
    hear(core, 0.0, ~READY)
    assert core.request(PRETIGHTENING, 0.0).allowed
    zeroed = READY.copy()
    zeroed[3] = False
    for k in range(1200):
        hear(core, 0.001 * k, zeroed)
    assert core.mode == FAULT
    assert "limb 4 did not reach" in core.reason


def test_silence_of_the_bridge_is_a_fault_unless_at_rest():
    core = supervised()
    hear(core, 0.0, READY)
    core.check_silence(10.0)
    assert core.mode == STOPPED
    hear(core, 10.0, READY)
    report_all(core, 10.0)
    assert core.request(PRETIGHTENING, 10.0).allowed
    core.check_silence(10.1)
    assert core.mode == PRETIGHTENING
    core.check_silence(10.5)
    assert core.mode == FAULT
    assert "no limb state" in core.reason


def test_missing_controller_is_named():
    core = Supervision(SupervisionConfig())
    hear(core, 0.0, READY)
    report(core, "limb_controller", 0.0, True)
    report(core, "wrench_controller", 0.0, False)
    report(core, "plant", 0.0, False)
    verdict = core.request(PRETIGHTENING, 0.0)
    assert not verdict.allowed
    assert "wrench_controller, the bridge" in verdict.reason


def test_a_nodes_fault_stops_what_moves():
    core = supervised()
    now_s = load(core, 1.0)
    report(
        core,
        "limb_controller",
        now_s,
        False,
        Fault(FaultName.TENSION_AGE, "tension_command is stale"),
    )
    assert core.mode == FAULT
    assert core.reason == "limb_controller: tension_command is stale"


def test_a_fault_at_rest_keeps_the_rig_there_while_it_lasts():
    core = supervised()
    hear(core, 1.0, READY)
    report(core, "plant", 1.0, False, Fault(FaultName.SENSOR_FLAT, "sensor_flat: gauge 3"))
    assert core.mode == STOPPED
    assert core.request(PRETIGHTENING, 1.0).reason == "plant: sensor_flat: gauge 3"
    report(core, "plant", 1.1, True)
    assert core.request(PRETIGHTENING, 1.1).allowed


def test_an_overload_at_rest_leaves_free_moving_as_the_way_out():
    core = supervised()
    hear(core, 1.0, READY)
    overload = Fault(
        FaultName.SENSOR_SATURATED, "sensor_saturated: force/torque sensor: force x is 170 N"
    )
    report(core, "plant", 1.0, False, overload)
    refused = core.request(PRETIGHTENING, 1.0)
    assert refused.reason == f"plant: {overload.reason}; FREE_MOVING takes a load off"
    assert (refused.code, refused.fault) == (ResultCode.FAULT_REPORTED, overload.name)
    assert core.request(FREE, 1.0).allowed
    # What the bridge found before it followed the mode does not stop the rig again...
    hear(core, 1.05, READY, followed=STOPPED)
    report(core, "plant", 1.1, False, overload, stamp_s=1.05)
    assert core.mode == FREE
    # ...also if it comes late; what it finds afterwards does, as does every other complaint.
    hear(core, 1.06, READY)
    report(core, "plant", 1.2, False, overload, stamp_s=1.05)
    assert core.mode == FREE
    report(core, "plant", 1.2, False, overload, stamp_s=1.06)
    assert core.mode == FAULT


def test_an_overload_is_not_excused_for_ever_if_the_bridge_does_not_follow():
    core = supervised()
    hear(core, 1.0, READY)
    overload = Fault(FaultName.SENSOR_SATURATED, "force x is 170 N")
    report(core, "plant", 1.0, False, overload)
    assert core.request(FREE, 1.0).allowed
    hear(core, 2.5, READY, followed=STOPPED)
    report(core, "plant", 2.5, False, overload)
    assert core.mode == FAULT


def test_another_fault_at_rest_keeps_free_moving_shut_too():
    core = supervised()
    hear(core, 1.0, READY)
    report(core, "plant", 1.0, False, Fault(FaultName.SENSOR_FLAT, "sensor_flat: gauge 3"))
    assert not core.request(FREE, 1.0).allowed


def test_clock_that_is_set_back_is_a_fault_and_forgets_reports():
    core = supervised()
    report_all(core, 1000.0)
    load(core, 1000.0)
    hear(core, 5.0, READY)
    assert core.mode == FAULT
    assert "went back by 995 s" in core.reason
    assert core.reset().allowed
    assert "no report from" in core.request(PRETIGHTENING, 5.0).reason
    report_all(core, 5.0)
    load(core, 5.0)
    assert core.mode == LOADING


def test_silence_proves_nothing_after_a_stall():
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
    hear(core, now_s, READY)
    assert core.request(PRETIGHTENING, now_s).allowed
    hear(core, now_s + 0.2, READY)
    assert core.request(LOADING, now_s + 0.2).allowed
    return now_s + 0.2


def test_zeros_of_before_do_not_count_for_loading():
    core = supervised(report_timeout_s=9.0)
    hear(core, 1.0, READY)
    assert core.request(PRETIGHTENING, 1.0).allowed
    # However long ago it began: zeros of before count only where the bridge has followed.
    hear(core, 1.05, READY, zeroing=0)
    assert "not pre-tightened" in core.request(LOADING, 1.05).reason
    hear(core, 1.9, READY, zeroing=0)
    assert core.request(LOADING, 1.9).code == ResultCode.NOT_ZEROED
    hear(core, 1.95, ~READY)
    assert core.request(LOADING, 1.95).code == ResultCode.NOT_ZEROED
    hear(core, 1.96, READY)
    assert core.request(LOADING, 1.96).allowed


def test_a_bridge_that_does_not_follow_pretightening_is_a_fault_with_old_zeros_too():
    core = supervised(pretension_timeout_s=1.0, report_timeout_s=9.0)
    hear(core, 1.0, READY)
    assert core.request(PRETIGHTENING, 1.0).allowed
    for k in range(12):
        hear(core, 1.1 + 0.1 * k, READY, zeroing=0)
    assert core.mode == FAULT
    assert core.entry.fault == FaultName.PRETIGHTENING_TIME


def test_each_pretightening_has_a_number_of_its_own():
    core = supervised(report_timeout_s=99.0)
    hear(core, 1.0, READY, zeroing=41)
    assert core.request(PRETIGHTENING, 1.0).allowed
    assert core.entry.zeroing == 42, "a supervisor that begins anew goes on from the bridge's"
    assert core.request(STOPPED, 1.0).allowed
    assert core.entry.zeroing == 42
    assert core.request(PRETIGHTENING, 1.0).allowed
    assert core.entry.zeroing == 43
    machine = ModeMachine()
    machine.zeroing_seen = 2**32 - 1
    assert machine.request(PRETIGHTENING, STANDING).allowed
    assert machine.entry.zeroing == 1, "0 means: of none"


def test_pretightening_after_unloading_has_a_number_of_its_own_too():
    machine = reach(PRETIGHTENING, LOADING)
    assert machine.request(PRETIGHTENING, STANDING).allowed
    assert machine.entry.zeroing == 1
    machine.unloaded()
    assert (machine.mode, machine.entry.zeroing) == (PRETIGHTENING, 2)


def test_every_entry_has_its_cause():
    machine = ModeMachine()
    seen = [machine.entry.cause]

    def note(_=None):
        seen.append(machine.entry.cause)

    note(machine.request(PRETIGHTENING, STANDING))
    note(machine.request(LOADING, STANDING))
    note(machine.request(STOPPED, STANDING))
    note(machine.unloaded())
    note(machine.request(FREE, STANDING))
    note(machine.abandon("nobody"))
    note(machine.fault(Fault(FaultName.OTHER, "test")))
    note(machine.emergency("stop"))
    note(machine.reset())
    loaded = "START REQUEST REQUEST ON_THE_WAY UNLOADED"
    ended = "REQUEST UNATTENDED FAULT EMERGENCY_STOP RESET"
    assert [cause.name for cause in seen] == [*loaded.split(), *ended.split()]


def test_an_emergency_stop_is_reported_after_a_fault_and_stays():
    machine = reach(PRETIGHTENING, LOADING)
    machine.fault(Fault(FaultName.CABLE, "limb 3"), "plant")
    machine.emergency("emergency stop")
    assert machine.entry.cause == Cause.EMERGENCY_STOP
    assert machine.entry.fault == FaultName.EMERGENCY_STOP
    assert machine.reason == "emergency stop, after plant: limb 3"
    entry = machine.entry
    machine.emergency("emergency stop")
    machine.fault(Fault(FaultName.CABLE, "limb 4"), "plant")
    assert machine.entry == entry


@pytest.mark.parametrize(
    ("text", "in_fault", "name"),
    [
        ("", False, None),
        ("", True, FaultName.OTHER),
        ("cable", True, FaultName.CABLE),
        ("cable: limb 3", True, FaultName.OTHER),
        ("none", True, FaultName.OTHER),
    ],
)
def test_a_fault_is_a_fault_whatever_its_name(text, in_fault, name):
    assert fault_name(text, in_fault) == name


def test_unloading_ends_when_every_limb_is_low():
    core = supervised()
    now_s = load(core, 1.0)
    assert core.request(FREE, now_s).allowed
    hear(core, now_s + 0.1, READY, np.full(8, 50.0))
    assert core.mode == UNLOADING
    hear(core, now_s + 0.2, READY, np.r_[np.full(7, 5.0), np.nan])
    assert core.mode == UNLOADING
    hear(core, now_s + 0.3, READY, np.full(8, 5.0))
    assert core.mode == FREE


def test_a_limb_that_does_not_unload_is_named():
    core = supervised(unload_timeout_s=1.0, report_timeout_s=9.0)
    now_s = load(core, 1.0)
    core.request(STOPPED, now_s)
    tension = np.full(8, 5.0)
    tension[4] = 60.0
    for k in range(12):
        hear(core, now_s + 0.1 * (k + 1), READY, tension)
    assert core.mode == FAULT
    assert "still on limb 5 after" in core.reason


def test_a_moving_platform_is_not_pretightened():
    core = supervised()
    for k in range(3):
        core.hear_pose(1.0 + 0.02 * k, np.array([0.001 * k, 0.0, 0.0]))
        hear(core, 1.0 + 0.02 * k, READY)
    assert "50 mm/s" in core.request(PRETIGHTENING, 1.04).reason
    core.hear_pose(1.06, np.array([0.002, 0.0, 0.0]))
    assert core.request(PRETIGHTENING, 1.06).allowed


def test_echo_of_a_fault_does_not_undo_the_reset():
    core = supervised()
    now_s = load(core, 1.0)
    report(core, "plant", now_s, False, Fault(FaultName.CABLE, "cable: limb 3"))
    assert core.mode == FAULT
    assert core.reset().allowed
    report(core, "plant", now_s + 0.1, False, Fault(FaultName.CABLE, "cable: limb 3"))
    assert core.mode == STOPPED
