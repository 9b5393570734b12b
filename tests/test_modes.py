"""Modes: legal transitions only, each refusal with its reason; the automatic sequence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cabols_control.modes import ModeMachine, OperatingMode
from cabols_control.supervision import Supervision, SupervisionConfig

READY = np.ones(8, dtype=bool)
STOPPED, PRETIGHTENING, LOADING, FREE, FAULT = (
    OperatingMode.STOPPED,
    OperatingMode.PRETIGHTENING,
    OperatingMode.LOADING,
    OperatingMode.FREE_MOVING,
    OperatingMode.FAULT,
)


def test_numbers_are_the_messages():
    from cabols_msgs.msg import Mode

    for mode in OperatingMode:
        assert getattr(Mode, mode.name) == mode.value


def test_the_way_to_loading_and_back():
    machine = ModeMachine()
    for mode in (PRETIGHTENING, LOADING, STOPPED):
        assert machine.request(mode, READY, True).allowed
        assert machine.mode == mode


@pytest.mark.parametrize(
    ("wanted", "zeroed", "fresh", "reason"),
    [
        (LOADING, READY, True, "LOADING follows PRETIGHTENING"),
        (PRETIGHTENING, None, True, "no limb state"),
        (PRETIGHTENING, READY, False, "no limb state"),
        (FREE, READY, True, "cannot be asked for"),
        (FAULT, READY, True, "cannot be asked for"),
        (17, READY, True, "expected one of"),
        (-1, READY, True, "expected one of"),
    ],
)
def test_refusals_from_stopped(wanted, zeroed, fresh, reason):
    machine = ModeMachine()
    verdict = machine.request(wanted, zeroed, fresh)
    assert not verdict.allowed
    assert reason in verdict.reason
    assert machine.mode == STOPPED


def test_loading_names_the_limbs_that_are_slack():
    machine = ModeMachine()
    machine.request(PRETIGHTENING, READY, True)
    zeroed = READY.copy()
    zeroed[[2, 6]] = False
    assert "2, 6" in machine.request(LOADING, zeroed, True).reason


def test_fault_is_latched_and_keeps_its_first_reason():
    machine = ModeMachine()
    machine.fault("first")
    machine.fault("second")
    for mode in OperatingMode:
        assert not machine.request(mode, READY, True).allowed
    assert machine.reason == "first"
    assert machine.reset().allowed
    assert machine.mode == STOPPED
    assert not machine.reset().allowed


@given(st.lists(st.integers(-2, 6), max_size=30), st.booleans())
def test_fault_is_left_by_reset_only(requests, fresh):
    machine = ModeMachine()
    machine.fault("test")
    for wanted in requests:
        machine.request(wanted, READY, fresh)
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
    assert "[3]" in core.reason


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


def test_a_nodes_fault_stops_the_rig():
    core = supervised()
    core.hear_report("limb_controller", 0.0, False, "tension_command is stale")
    assert core.mode == FAULT
    assert core.reason == "limb_controller: tension_command is stale"
