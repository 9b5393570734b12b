# SPDX-License-Identifier: Apache-2.0
"""A bridge that starts again under a load: the wrench is right or not known, never wrong."""

from __future__ import annotations

import pytest

from cabols_sim.fault_campaign.in_process.restarts import WRONG_N, restart_row, restart_trial
from cabols_sim.fault_campaign.in_process.trials import Bench


@pytest.fixture(scope="module")
def bench():
    return Bench()


@pytest.mark.parametrize("held_n", [10.0, 28.0, 100.0])
def test_kept_bias_makes_the_wrench_known(bench, held_n):
    trial = restart_trial(bench, held_n, 1, bias_kept=True)
    assert trial["true_n"] > 0.8 * held_n
    assert trial["known"]
    assert trial["error_n"] < WRONG_N


@pytest.mark.parametrize("held_n", [10.0, 28.0, 100.0])
def test_without_a_bias_the_load_is_not_taken_for_zero(bench, held_n):
    assert not restart_trial(bench, held_n, 1, bias_kept=False)["known"]


def test_row_counts_the_wrong_and_the_unknown():
    known = {"held_n": 10.0, "bias_kept": True, "known": True, "error_n": 0.1, "error_nm": 0.0}
    trials = [known, {**known, "error_n": 1.1}, {**known, "known": False, "error_n": None}]
    row = restart_row(trials)
    assert (row["trials"], row["usable"], row["wrong"]) == (3, 2, 1)
