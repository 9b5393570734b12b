# SPDX-License-Identifier: Apache-2.0
"""Configurations whose joints differ beyond the model: their scatter, and rows weighted by it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.adequacy.normal import (
    Blocks,
    heterogeneity,
    random_effects,
    whitened_by_scatter,
)
from cabols_stiffness.ladder.evidence import Rows

DIFFER = 1e-4
"""Chance of Cochran's Q below which configurations differ."""

CELLS_LEAST = 4
ROUNDS = 60
SETTLED = 1e-3
"""Relative change of the scatter's square that ends the rounds."""

START = 0.03
"""Scatter to begin with, relative."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Between cells.

    Attributes:
        deviation: (n,) of each joint's compliance, relative to its scale; zero where cells do not
            differ.
        variance: of the residuals within cells, in the stated noise.
        freedom: (n,) degrees of freedom of each joint's mean.
    """

    deviation: FloatArray
    variance: float
    freedom: FloatArray

    @property
    def any(self) -> bool:
        """Whether cells differ."""
        return bool(self.deviation.any())


def scatter_of(
    rows: Rows, residual: FloatArray, joints: FloatArray, quick: bool = False
) -> Scatter:
    """Estimate the scatter by restricted maximum likelihood; none unless cells differ for certain.

    Args:
        rows: of the samples, not weighted.
        residual: (r,) of a fit.
        joints: (r, n) columns of the joints' compliance.
        quick: whether a few rounds of maximum likelihood will do, to compare models.
    """
    n, count = joints.shape[1], rows.fold.size
    matrix = np.array([joints[at].T @ joints[at] for at in rows.parts]).reshape(count, n, n)
    target = np.array([joints[at].T @ residual[at] for at in rows.parts]).reshape(count, n)
    return scatter_of_sums(rows, matrix, target, float(residual @ residual), quick)


def scatter_of_sums(
    rows: Rows, matrix: FloatArray, target: FloatArray, squares: float, quick: bool = False
) -> Scatter:
    """Do as scatter_of, from the cells' normal equations.

    Args:
        rows: of the samples.
        matrix: (c, n, n) products of the joints' columns.
        target: (c, n) of them with the residual.
        squares: of the residual, their sum.
        quick: as scatter_of.
    """
    count, n = target.shape
    values, vectors = np.linalg.eigh(matrix)
    known = values > 1e-9 * np.maximum(values[:, -1:], 1e-300)
    along = np.einsum("cij,ci->cj", vectors, target)
    own = np.where(known, along**2 / np.where(known, values, 1.0), 0.0)
    left = max(squares - float(own.sum()), 0.0)
    rank = int(known.sum())
    within = max(round(rows.freedom) - rank, 1)
    none = Scatter(np.zeros(n), left / within, np.full(n, float(within)))
    parts = Blocks(np.arange(count), matrix, target, left / within, within)
    if count < CELLS_LEAST or not heterogeneity(parts).probability < DIFFER:
        return none
    if quick:
        return replace(none, deviation=_quick(parts))
    between = random_effects(parts, n)
    return replace(none, deviation=between.scatter, freedom=between.freedom)


def _quick(parts: Blocks) -> FloatArray:
    """(n,) deviation between cells, by expectation maximisation about a mean of zero."""
    matrix, target = parts.matrix / parts.variance, parts.target / parts.variance
    n = matrix.shape[1]
    square = np.full(n, START**2)
    for _ in range(ROUNDS):
        inner = np.linalg.inv(matrix + np.diag(1.0 / square))
        effect = np.einsum("cij,cj->ci", inner, target)
        spread = np.einsum("cjj->cj", inner)
        before, square = square, np.maximum(np.mean(effect**2 + spread, axis=0), 1e-14)
        if (np.abs(square - before) <= SETTLED * before).all():
            break
    return np.asarray(np.sqrt(square))


def weighted(rows: Rows, joints: FloatArray, scatter: Scatter, values: FloatArray) -> FloatArray:
    """(r, ...) values, whitened where the cells' joints scatter.

    Args:
        rows: of the samples.
        joints: (r, n) columns of the joints' compliance.
        scatter: between cells.
        values: (r, ...) rows.
    """
    if not scatter.any:
        return values
    found = values.copy()
    size = scatter.deviation / np.sqrt(scatter.variance)
    for at in rows.parts:
        found[at] = whitened_by_scatter(joints[at], size, values[at])
    return found
