# SPDX-License-Identifier: Apache-2.0
"""Wrenches that remain when a cable parts, against a linear programme."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from cabols_control.errors import CabolsError
from cabols_control.kinematics import structure_matrix
from cabols_control.rig import load_rig
from cabols_control.workspace.cable_loss import remaining_share
from cabols_control.workspace.tool.command import main

BOX = np.array([40.0, 40.0, 40.0, 4.0, 4.0, 4.0])


@pytest.fixture(scope="module")
def bench():
    rig = load_rig()
    geometry = rig.geometry
    pose = geometry.reference_position, geometry.reference_rotation
    return structure_matrix(geometry, *pose), rig.control.tension_min, rig.control.tension_max


def programme_share(matrix, low, high, wrenches):
    """Share for which HiGHS finds tensions."""
    n = matrix.shape[1]
    bounds = [(low, high)] * n
    found = [linprog(np.zeros(n), A_eq=matrix, b_eq=w, bounds=bounds).status for w in wrenches]
    assert set(found) <= {0, 2}
    return np.mean(np.array(found) == 0)


def test_shares_are_those_of_a_linear_programme(bench):
    matrix, low, high = bench
    wrenches = BOX * np.random.default_rng(1).uniform(-1.0, 1.0, (40, 6))
    found = remaining_share(matrix, low, high, wrenches)
    assert found.intact == programme_share(matrix, low, high, wrenches)
    for i in range(8):
        rest = np.delete(matrix, i, axis=1)
        assert found.without[i] == programme_share(rest, low, high, wrenches)


def test_no_seven_cables_of_the_bench_close_and_a_quarter_of_the_wrenches_remains(bench):
    matrix, low, high = bench
    wrenches = BOX * np.random.default_rng(0).uniform(-1.0, 1.0, (5000, 6))
    found = remaining_share(matrix, low, high, wrenches)
    assert not found.closed.any()
    assert found.without.mean() == pytest.approx(0.27, abs=0.02)
    assert (found.without < found.intact).all()


def test_fewer_than_six_cables_give_nothing_and_nothing_asked_is_refused():
    matrix = np.random.default_rng(2).normal(size=(6, 6))
    found = remaining_share(matrix, 1.0, 100.0, np.zeros((3, 6)))
    assert not found.without.any()
    assert not found.closed.any()
    with pytest.raises(CabolsError):
        remaining_share(matrix, 1.0, 100.0, np.zeros((0, 6)))


def test_command_writes_the_table(tmp_path, capsys):
    box = [str(value) for value in BOX]
    assert main(["loss", "--count", "500", "--output", str(tmp_path), "--box", *box]) == 0
    lines = (tmp_path / "loss.csv").read_text().splitlines()
    assert len(lines) == 9
    assert "without cable 1" in capsys.readouterr().out
