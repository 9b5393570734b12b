# SPDX-License-Identifier: Apache-2.0
"""Whose reports the supervisor believes when two processes speak in one node's name."""

import numpy as np
import pytest

from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_control.supervision.senders import NODES, SenderFollower, draw_instance, make_room
from cabols_control.supervision.supervisor import SENDERS, Supervision, SupervisionConfig

SILENT_S = 1.5


@pytest.fixture
def senders():
    return SenderFollower(SILENT_S)


def test_another_process_in_a_nodes_name_is_dropped_and_counted(senders):
    assert senders.admit("plant", 7, 10.0)
    for now_s in (10.0, 10.1, 11.5):
        assert not senders.admit("plant", 8, now_s)
    assert senders.admit("plant", 7, 11.5)
    assert not senders.admit("plant", 0, 12.9), "a message made by hand"
    assert senders.dropped == 4
    assert senders.admit("limb_controller", 8, 11.5)


def test_a_restarted_node_is_followed_once_the_old_process_is_silent(senders):
    assert senders.admit("plant", 7, 10.0)
    assert not senders.admit("plant", 8, 11.5)
    assert senders.admit("plant", 8, 11.6)
    assert not senders.admit("plant", 7, 11.7)


@pytest.mark.parametrize("now_s", [9.0, float("nan")])
def test_a_clock_set_back_does_not_lock_a_node_out(senders, now_s):
    assert senders.admit("plant", 7, 10.0)
    assert senders.admit("plant", 8, now_s)


def test_memory_is_bounded_and_the_oldest_goes_first(senders):
    for number in range(3 * NODES):
        assert senders.admit(f"node_{number}", 1, float(number) * 1e-3)
    assert not senders.admit(f"node_{3 * NODES - 1}", 2, 0.2)
    assert senders.admit("node_0", 2, 0.2)


def test_no_two_processes_draw_one_number():
    drawn = {draw_instance() for _ in range(1000)}
    assert len(drawn) == 1000
    assert 0 not in drawn


def test_notes_of_the_rigs_own_nodes_survive_a_flood_of_names():
    notes: dict[str, int] = {}
    for name in ("plant", "supervisor", *(f"stranger_{k}" for k in range(10 * NODES)), "console"):
        make_room(notes, name)
        notes[name] = 1
    assert len(notes) == NODES
    assert {"plant", "supervisor", "console"} <= set(notes)


def test_a_node_that_has_said_that_it_ends_and_is_gone_blocks_no_motion_for_ever():
    core = Supervision(SupervisionConfig(controllers=(), bridges=()))
    core.hear_state(10.0, np.zeros(8, dtype=bool), zeroing=0, followed=0)
    for k in range(10 * NODES):
        core.hear_notice(f"stranger_{k}", Fault(FaultName.ENDING, "asked to end"))
    assert len(core._leaving) <= SENDERS
    assert not core.request(OperatingMode.FREE_MOVING, 10.05).allowed
    core.hear_state(20.0, np.zeros(8, dtype=bool), zeroing=0, followed=0)
    assert core.request(OperatingMode.FREE_MOVING, 20.05).allowed
