# SPDX-License-Identifier: Apache-2.0
"""Who judges what: the supervisor complaints and resets, the fault campaign reports."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.supervision_config import SupervisionConfig
from cabols_control.supervision.supervisor import Supervision
from cabols_sim.fault_campaign.judgement import Report, TrialData, judge

NODES = ("limb_controller", "wrench_controller", "plant")
TICK_S = 0.045


class Clocked:
    """A supervisor and the graph's reports, by its own clock."""

    def __init__(self, **options):
        self.supervision = Supervision(SupervisionConfig(**options))
        self.now_s = 100.0

    def tick(self, times=1, nodes=NODES):
        for _ in range(times):
            self.now_s += TICK_S
            self.supervision.hear_state(
                self.now_s, np.zeros(8, bool), np.full(8, np.nan), zeroing=0, followed=0
            )
            for name in nodes:
                self.supervision.hear_report(name, self.now_s, True, None, self.now_s)


def test_reset_alone_starts_no_motion():
    """ISO 13850. The emergency stop came before all nodes reported, with auto_start."""
    clocked = Clocked(auto_start=True)
    clocked.tick(10, NODES[:1])
    clocked.supervision.emergency_stop("emergency stop")
    clocked.tick(10)
    clocked.supervision.reset()
    clocked.tick(10)
    assert clocked.supervision.mode.name == "STOPPED"


def test_quiet_graph_may_move():
    clocked = Clocked()
    clocked.tick(20)
    assert clocked.supervision.request(1, clocked.now_s).allowed


def test_complaint_ends_with_its_sender():
    clocked = Clocked()
    clocked.tick(10)
    complaint = Fault(FaultName.POSE, "a stranger's complaint")
    clocked.supervision.hear_report("somebody_else", clocked.now_s, False, complaint, clocked.now_s)
    clocked.now_s += 3600.0
    clocked.tick(10)
    assert clocked.supervision.request(1, clocked.now_s).allowed


def judged(*reports):
    """Tensions rise until a fault at 0.3 s; the currents end at 0.33 s."""
    time_s = np.arange(0.0, 0.8, 0.001)
    tension = np.where(time_s < 0.3, 70 + 100 * time_s, 100.0)[:, None] * np.ones(8)
    tension[time_s > 0.32] = 10.0
    current = np.full((time_s.size, 8), 0.2)
    current[time_s > 0.33] = 0.0
    wrench = np.zeros((time_s.size, 6))
    data = TrialData(0.0, time_s, tension, current, wrench, reports)
    return judge("wrench too large", 1, data)


@pytest.fixture
def fault():
    return Report(0.300, "plant", "wrench: force x is 155.2 N, 155 N allowed", True)


def test_fault_alone_is_the_detection(fault):
    assert judged(fault).detection_time_s == pytest.approx(0.300)


def test_notice_before_the_fault_is_no_detection(fault):
    notice = Report(0.020, "wrench_controller", "desired_wrench is older than 0.25 s", False)
    assert judged(notice, fault).detection_time_s == pytest.approx(0.300)
