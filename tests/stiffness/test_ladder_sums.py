# SPDX-License-Identifier: Apache-2.0
"""The ladder's sums over cells against the same from whole matrices."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_stiffness.ladder.evidence import Rows, held_out
from cabols_stiffness.ladder.scatter import scatter_of
from cabols_stiffness.ladder.sums import Sums

CELLS, EACH, JOINTS, MORE = 12, 20, 3, 4


def rows_with(scatter):
    """Cells whose joints scatter, with columns of a cause beside them."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(CELLS * EACH, JOINTS + MORE)) * 10.0
    cell = np.repeat(np.arange(CELLS), EACH)
    own = scatter * rng.normal(size=(CELLS, JOINTS))
    residual = rng.normal(size=cell.size)
    residual += np.sum(columns[:, :JOINTS] * own[cell], axis=1) + columns[:, JOINTS]
    numbers, fold = np.full(CELLS, float(EACH)), np.arange(CELLS) % 5
    return Rows(residual, columns, cell, fold, numbers, np.ones(cell.size))


def test_held_out_error_is_that_of_the_rows():
    rows = rows_with(0.0)
    precision = np.r_[np.zeros(JOINTS), np.full(MORE, 0.5)]
    parts = [np.arange(JOINTS), np.arange(JOINTS, JOINTS + MORE)]
    found = Sums(rows, parts[0]).held_out(parts, precision)
    wanted = held_out(rows, rows.columns, precision)
    np.testing.assert_allclose(found.squares, wanted.squares, rtol=1e-9)


def test_scattering_cells_are_weighed_by_their_whole_covariance():
    rows = rows_with(0.3)
    parts = [np.arange(JOINTS), np.arange(JOINTS, JOINTS + MORE)]
    precision = np.full(JOINTS + MORE, 1e-6)
    found = Sums(rows, parts[0]).predictive(parts, precision)
    columns, target = rows.columns, rows.residual
    gram = columns.T @ columns + np.diag(precision)
    left = target - columns @ np.linalg.solve(gram, columns.T @ target)
    scatter = scatter_of(rows, left, columns[:, :JOINTS], quick=True)
    assert scatter.any
    inverses, volumes = [], []
    for at in rows.parts:
        own = columns[at, :JOINTS] * scatter.deviation
        whole = np.eye(EACH) + own @ own.T / scatter.variance
        inverses.append(np.linalg.inv(whole))
        volumes.append(np.linalg.slogdet(whole)[1])
    for c, at in enumerate(rows.parts):
        others = [i for i in range(CELLS) if rows.fold[i] != rows.fold[c]]
        normal, right = np.diag(precision), 0.0
        for i in others:
            mine = columns[rows.parts[i]]
            normal = normal + mine.T @ inverses[i] @ mine
            right = right + mine.T @ inverses[i] @ target[rows.parts[i]]
        error = target[at] - columns[at] @ np.linalg.solve(normal, right)
        wanted = error @ inverses[c] @ error + scatter.variance * volumes[c]
        assert found.squares[c] == pytest.approx(wanted, rel=1e-6)
