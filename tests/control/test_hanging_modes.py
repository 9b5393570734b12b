# SPDX-License-Identifier: Apache-2.0
"""Modes of a rig whose platform hangs on its cables: nothing on the way lets it go."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.result_code import ResultCode
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_control.supervision.supervision_config import SupervisionConfig
from cabols_control.supervision.supervisor import Supervision

MODE = OperatingMode
ZEROED = np.ones(8, dtype=bool)


@pytest.fixture
def core():
    made = Supervision(SupervisionConfig(controllers=(), bridges=(), hangs=True))
    made.hear_state(1.0, ZEROED, np.full(8, 20.0), zeroing=1, followed=0)
    return made


def loaded(core):
    assert core.request(MODE.LOADING, 1.0).allowed
    assert core.mode == MODE.LOADING
    return core


def test_it_is_loaded_again_from_a_stop_and_stopped_without_unloading(core):
    loaded(core)
    assert core.request(MODE.STOPPED, 1.0).allowed
    assert core.mode == MODE.STOPPED
    loaded(core)
    core.abandon("nobody is there")
    assert core.mode == MODE.STOPPED
    loaded(core)
    core.hear_notice("plant", Fault(FaultName.ENDING, "asked to end"))
    assert core.mode == MODE.STOPPED


@pytest.mark.parametrize("present", [MODE.STOPPED, MODE.PRETIGHTENING, MODE.LOADING])
@pytest.mark.parametrize("mode", [MODE.FREE_MOVING, MODE.COMMISSIONING])
def test_modes_that_would_let_it_go_are_not_to_be_had(core, present, mode):
    if present != MODE.STOPPED:
        assert core.request(present, 1.0).allowed
    verdict = core.request(mode, 1.0)
    assert verdict.code == ResultCode.WRONG_MODE
    assert "let the platform go" in verdict.reason
    assert core.mode == present


def test_zeros_are_found_on_the_stand_alone(core):
    core.hear_notice("plant", Fault(FaultName.HANGS, "let it down"))
    verdict = core.request(MODE.PRETIGHTENING, 1.0)
    assert (verdict.code, verdict.fault) == (ResultCode.FAULT_REPORTED, FaultName.HANGS)
    loaded(core)
    core.request(MODE.STOPPED, 1.0)
    core.hear_notice("plant", None)
    assert core.request(MODE.PRETIGHTENING, 1.0).allowed


def test_another_rig_is_loaded_after_pre_tightening_and_unloaded_first():
    core = Supervision(SupervisionConfig(controllers=(), bridges=()))
    core.hear_state(1.0, ZEROED, np.full(8, 20.0), zeroing=1, followed=0)
    assert core.request(MODE.LOADING, 1.0).code == ResultCode.WRONG_MODE
    assert core.request(MODE.FREE_MOVING, 1.0).allowed
