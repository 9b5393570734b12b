# SPDX-License-Identifier: Apache-2.0
"""A programme is shaped at ordinary priority: the supervisor shares the core."""

from __future__ import annotations

import os
import threading
from types import SimpleNamespace

import pytest

from cabols_control.nodes.load_program import LoadProgramNode
from cabols_control.realtime.scheduling import may_use_fifo


@pytest.mark.skipif(not may_use_fifo(), reason="the kernel grants no SCHED_FIFO here")
@pytest.mark.parametrize("preview", [True, False])
def test_a_long_programme_does_not_hold_the_core(rig, preview):
    """Ten minutes took a second, before which the supervisor of equal priority did not run."""
    node = SimpleNamespace(rig=rig, _preview=preview, _taught=None, _held_s=0.004)
    place = rig.geometry.reference_position, rig.geometry.reference_rotation
    found = []

    def body():
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        LoadProgramNode._shape(node, "steps", 1.0, place)
        found.append(os.sched_getscheduler(0))

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert found == [os.SCHED_OTHER]
