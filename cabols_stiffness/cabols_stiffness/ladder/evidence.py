# SPDX-License-Identifier: Apache-2.0
"""Measurements against an elastic arm: whitened rows of any blocks, cell by cell.

A cell is a configuration, or a load where there are too few configurations; cells are held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_stiffness.identification.observations import Linearised, Observations, whiten

CONFIGURATIONS_LEAST = 4
"""Configurations from which on whole ones are held out."""

FOLDS_MAX = 10


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened rows of the samples in use, cell by cell; offsets and drifts of groups are out.

    Attributes:
        residual: (r,).
        columns: (r, p).
        cell: (r,) of each row, from 0, rising.
        fold: (c,) of each cell.
        numbers: (c,) numbers measured in each cell, less its share of the offsets.
        distances: (k,) squared, of each sample from the model.
        sample: (r,) that each row is of.
    """

    residual: FloatArray
    columns: FloatArray
    cell: IntArray
    fold: IntArray
    numbers: FloatArray
    distances: FloatArray
    sample: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def with_columns(self, columns: FloatArray) -> Rows:
        """Return the same rows with other columns (r, p)."""
        return replace(self, columns=columns)

    @cached_property
    def parts(self) -> list[slice]:
        """Rows of each cell."""
        ends = np.searchsorted(self.cell, np.arange(self.fold.size + 1))
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def freedom(self) -> float:
        """Numbers measured less offsets, of all cells."""
        return float(self.numbers.sum())


def rows_of(
    observations: Observations,
    residual: FloatArray,
    columns: FloatArray,
    like: Linearised,
    use: BoolArray,
) -> Rows:
    """Whiten, and take out what samples of a group share.

    Args:
        observations: of the robot.
        residual: (k, m).
        columns: (k, m, p) of what is measured, by any parameters.
        like: a linearisation with the covariances of the same samples.
        use: (k,) samples in use.
    """
    samples = observations.samples
    line = replace(like, residual=residual)
    white = whiten(line, columns, samples, use.astype(np.float64))
    m, used = residual.shape[1], np.flatnonzero(use)
    cell, fold = cells(observations, used)
    order = np.argsort(cell, kind="stable")
    used, cell = used[order], cell[order]
    share = white.shared / max(used.size, 1)
    numbers = np.bincount(cell, observations.numbers[used] - share, fold.size)
    return Rows(
        white.residual[used].ravel(),
        white.columns[used].reshape(used.size * m, columns.shape[2]),
        np.repeat(cell, m),
        fold,
        np.maximum(numbers, 1.0),
        np.sum(white.residual**2, axis=1),
        np.repeat(used, m),
    )


def cells(observations: Observations, used: IntArray) -> tuple[IntArray, IntArray]:
    """(u,) cell of each sample in use, and (c,) fold of each cell.

    Args:
        observations: of the robot.
        used: (u,) indices of the samples.
    """
    samples = observations.samples
    names, cell = np.unique(samples.configuration[used], return_inverse=True)
    if names.size < CONFIGURATIONS_LEAST:
        key = np.column_stack([samples.configuration[used], samples.load[used]])
        names, cell = np.unique(key, axis=0, return_inverse=True)
    order = np.random.default_rng(0).permutation(len(names))
    return cell.ravel(), order % min(FOLDS_MAX, len(names))


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Error at cells that were held out, in the stated noise.

    Attributes:
        squares: (c,) sum of squared normalised errors of each cell.
        numbers: (c,) numbers measured there.
    """

    squares: FloatArray
    numbers: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square of the normalised errors."""
        return float(np.sqrt(self.squares.sum() / self.numbers.sum()))


def held_out(rows: Rows, columns: FloatArray, precision: FloatArray) -> HeldOut:
    """Predict each fold from the others.

    Args:
        rows: of the samples.
        columns: (r, p) of the model.
        precision: (p,) of the prior of each parameter about zero; 0: none.
    """
    grams = np.array([columns[at].T @ columns[at] for at in rows.parts])
    targets = np.array([columns[at].T @ rows.residual[at] for at in rows.parts])
    gram, target = grams.sum(axis=0) + np.diag(precision), targets.sum(axis=0)
    squares = np.empty(rows.fold.size)
    for f in range(int(rows.fold.max(initial=0)) + 1):
        out = rows.fold == f
        value = solve(gram - grams[out].sum(axis=0), target - targets[out].sum(axis=0))
        for c in np.flatnonzero(out):
            error = rows.residual[rows.parts[c]] - columns[rows.parts[c]] @ value
            squares[c] = error @ error
    return HeldOut(squares, rows.numbers)


def solve(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """(p, ...) solution of positive semidefinite equations; directions without evidence stay zero.

    Args:
        matrix: (p, p).
        target: (p, ...).
    """
    size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-30))
    scaled = matrix / np.outer(size, size)
    right = target / (size if target.ndim == 1 else size[:, None])
    factor, info = dpotrf(scaled - 1e-11 * np.eye(size.size), lower=1)
    if info == 0:
        found, _ = dpotrs(factor, right, lower=1)
    else:
        found = np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ right
    return np.asarray(found / (size if target.ndim == 1 else size[:, None]))


def groups(parts: Sequence[int]) -> list[slice]:
    """Slices of parts of given sizes, one after the other."""
    ends = np.cumsum([0, *parts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
