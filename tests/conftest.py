# SPDX-License-Identifier: Apache-2.0
"""Shared fixtures, and what every test has: this machine alone, and no state of other rigs."""

from __future__ import annotations

import os
import shutil
import tempfile

import numpy as np
import pytest
from hypothesis import settings

# What `make` sets too, for who runs pytest by hand.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# A test's bridge neither reads nor writes the biases of this computer's rigs.
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="cabols_state_")

from cabols_control.rig import load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.config import load_plant
from file_seconds import pytest_sessionfinish  # noqa: F401
from forked_start import pytest_runtest_protocol  # noqa: F401
from longest_first import pytest_collection_modifyitems  # noqa: F401
from lost_tests import pytest_runtest_makereport, pytest_runtest_setup  # noqa: F401
from outcome_counts import (  # noqa: F401
    pytest_deselected,
    pytest_ignore_collect,
    pytest_terminal_summary,
)

# How long an example takes is no test's business.
settings.register_profile("cabols", deadline=None)
settings.load_profile("cabols")
STATE = os.environ["XDG_STATE_HOME"]


def pytest_unconfigure():
    """Leave no folder behind."""
    shutil.rmtree(STATE, ignore_errors=True)


@pytest.fixture(scope="session")
def rig():
    return load_rig()


@pytest.fixture(scope="session")
def card():
    return load_card()


@pytest.fixture(scope="session")
def plant_config():
    return load_plant()


@pytest.fixture
def random():
    return np.random.default_rng(20261122)
