# SPDX-License-Identifier: Apache-2.0
"""Ten configurations, each with its own stiffness, as in the source's table 4.3.

10.1186/s10033-022-00778-1 finds such variation, too. Independence between the configurations must
not be assumed: pooled intervals hold the spread.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import independent_arm as arm
from cabols_stiffness import identify
from cabols_stiffness.measurements.samples import select

QUIET = {"position_m": 5e-6, "force_n": 0.05, "torque_nm": 0.005}


def pooled(stiffness):
    """Identification of ten configurations with (10, 6) stiffness."""
    rng, chain = np.random.default_rng(21), arm.Chain()
    Q, W = arm.configurations(rng, 10), arm.loads(rng, 4)
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, stiffness[i]))
    return identify(arm.noisy(columns, np.random.default_rng(2), **QUIET), arm.robot())


@pytest.fixture(scope="module")
def table():
    """(10, 6) of the source [N m/rad]."""
    with (Path(__file__).parent / "table_4_3.csv").open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([[float(cell) for cell in row[1:11]] for row in rows]).T


def covers(result, true):
    return np.abs(result.stiffness - true) <= 3.0 * result.standard_deviation


def test_constant_stiffness_is_covered(table):
    mean = table.mean(axis=0)
    assert np.all(covers(pooled(np.tile(mean, (10, 1))), mean))


def test_stiffness_that_differs_is_covered(table):
    assert np.all(covers(pooled(table), table.mean(axis=0)))


def test_noise_alone_scatters_joint_1_most_and_joint_6_least(table):
    """The table has the reverse order: its scatter at joint 6 is no noise."""
    rng, chain = np.random.default_rng(21), arm.Chain()
    Q, W = arm.configurations(rng, 10), arm.loads(rng, 4)
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, table.mean(axis=0)))
    samples = arm.noisy(columns, np.random.default_rng(2))
    each = [
        identify(select(samples, samples.configuration == i), arm.robot(), judged=False)
        for i in range(10)
    ]
    single = np.array([result.parameters[:6] for result in each])
    noise = single.std(axis=0, ddof=1) / single.mean(axis=0)
    scatter = table.std(axis=0, ddof=1) / table.mean(axis=0)
    assert noise.argmax() == 0
    assert noise.argmin() == 5
    assert scatter.argmax() == 5
    assert scatter[5] > 4.0 * noise[5]
