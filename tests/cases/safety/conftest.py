# SPDX-License-Identifier: Apache-2.0
"""The rig in one process, at rest and under load, for the cases of safety."""

from __future__ import annotations

import numpy as np
import pytest

from rig_harness import RigInOneProcess

LOAD = np.array([60.0, 0.0, 80.0, 0.0, 0.0, 2.0])
"""100 N and a torque."""


@pytest.fixture(scope="session")
def make_rig(rig, card, plant_config):
    def make(seed=3, target=None):
        return RigInOneProcess(rig, card, plant_config, seed=seed, target=target)

    return make


@pytest.fixture(scope="session")
def _under_load(make_rig):
    bench = make_rig()
    bench.load(LOAD)
    return bench


@pytest.fixture
def loaded(_under_load):
    """A rig under load, of one's own."""
    return _under_load.fork()


@pytest.fixture(scope="session")
def _started(make_rig):
    bench = make_rig()
    bench.run(0.3)
    return bench


@pytest.fixture
def started(_started):
    """A rig just started, without zeros, of one's own."""
    return _started.fork()
