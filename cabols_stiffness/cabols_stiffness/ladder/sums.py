# SPDX-License-Identifier: Apache-2.0
"""Sums over cells: all that a comparison of models needs of the whitened rows.

A model is some of the columns; what it leaves at held-out cells, also weighted by the cells' own
scatter, follows from the products of its columns with each other and with the residual, cell by
cell. Each product is made once, whatever models have it in common.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.ladder.evidence import HeldOut, Rows, solve
from cabols_stiffness.ladder.scatter import scatter_of_sums

RESIDUAL = 0
"""Row and column of products that are of the residual; those of the columns follow."""
KEPT_CELLS = 200
"""Of more cells products are made anew each time: they take memory."""


class Sums:
    """Products of a campaign's columns, cell by cell; see the module."""

    def __init__(self, rows: Rows, joints: IntArray) -> None:
        """Take the rows.

        Args:
            rows: of the samples, with all columns.
            joints: (n,) columns of the joints' compliance.
        """
        self.rows, self.joints = rows, joints
        self._made: dict[tuple[bytes, bytes], FloatArray] = {}
        self._in_folds: dict[tuple[bytes, bytes], FloatArray] = {}
        self._squares = np.array([rows.residual[at] @ rows.residual[at] for at in rows.parts])
        folds = int(rows.fold.max(initial=0)) + 1
        self._to_folds = (rows.fold[None] == np.arange(folds)[:, None]).astype(np.float64)

    def between(self, one: IntArray, other: IntArray | None) -> FloatArray:
        """(c, p, q) products of some columns with others.

        Args:
            one: (p,) columns.
            other: (q,) columns; None: the residual.
        """
        key = one.tobytes(), b"" if other is None else other.tobytes()
        if key in self._made:
            return self._made[key]
        if (key[1], key[0]) in self._made:
            return self._made[key[1], key[0]].swapaxes(1, 2)
        rows, left = self.rows, self.rows.columns[:, one]
        right = left if other is one else rows.residual[:, None]
        if other is not None and other is not one:
            right = rows.columns[:, other]
        found = np.array([left[at].T @ right[at] for at in rows.parts])
        if rows.fold.size <= KEPT_CELLS:
            self._made[key] = found
        return found

    def _by_fold(self, one: IntArray, other: IntArray | None) -> FloatArray:
        """(f, p, q) the same, summed up in folds."""
        key = one.tobytes(), b"" if other is None else other.tobytes()
        if key not in self._in_folds:
            sums = self.between(one, other)
            flat = self._to_folds @ sums.reshape(sums.shape[0], -1)
            self._in_folds[key] = flat.reshape(-1, *sums.shape[1:])
        return self._in_folds[key]

    def of(self, parts: Sequence[IntArray]) -> FloatArray:
        """(f, 1 + p, 1 + p) products of the residual and the columns of some parts, in folds.

        Args:
            parts: columns of each.
        """
        ends = np.cumsum([1, *(part.size for part in parts)])
        found = np.empty((self._to_folds.shape[0], ends[-1], ends[-1]))
        found[:, RESIDUAL, RESIDUAL] = self._to_folds @ self._squares
        for i, (one, a, b) in enumerate(zip(parts, ends, ends[1:], strict=False)):
            found[:, a:b, :1] = self._by_fold(one, None)
            found[:, :1, a:b] = found[:, a:b, :1].swapaxes(1, 2)
            for other, c, d in zip(parts[: i + 1], ends, ends[1:], strict=False):
                found[:, a:b, c:d] = self._by_fold(one, other)
                found[:, c:d, a:b] = found[:, a:b, c:d].swapaxes(1, 2)
        return found

    def held_out(self, parts: Sequence[IntArray], precision: FloatArray) -> HeldOut:
        """Error of a model where each fold is predicted from the others.

        Args:
            parts: columns of the model.
            precision: (p,) of the prior of each parameter about zero; 0: none.
        """
        values = _held_out(self.of(parts), precision)
        return HeldOut(np.maximum(self._left(parts, values), 0.0), self.rows.numbers)

    def _left(self, parts: Sequence[IntArray], values: FloatArray) -> FloatArray:
        """(c,) squares that are left in each cell of values (f, p) of its fold."""
        ends = np.cumsum([part.size for part in parts])[:-1]
        mine = np.split(values[self.rows.fold], ends, axis=1)
        found = self._squares.copy()
        for i, (one, own) in enumerate(zip(parts, mine, strict=True)):
            found -= 2.0 * np.einsum("cp,cp->c", own, self.between(one, None)[:, :, 0])
            for other, theirs in zip(parts[: i + 1], mine, strict=False):
                through = (self.between(one, other) @ theirs[:, :, None])[:, :, 0]
                both = 1.0 if other is one else 2.0
                found += both * np.einsum("cp,cp->c", own, through)
        return found

    def predictive(self, parts: Sequence[IntArray], precision: FloatArray) -> HeldOut:
        """Deviance of held-out cells, the model's own scatter between cells taken into account.

        It is minus twice the logarithm of the likelihood, but for a constant: squared errors in
        their own covariance, and the logarithm of its determinant. So a model that explains why
        cells differ gains over one that calls it scatter.

        Args:
            parts: columns of the model, joints first.
            precision: as held_out.
        """
        sums, n = self.of(parts), self.joints.size
        total = sums.sum(axis=0)
        value = np.append(-1.0, solve(total[1:, 1:] + np.diag(precision), total[1:, RESIDUAL]))
        # (c, 1 + p, n) products of the residual and all columns with the joints' columns.
        first = parts[0]
        with_joints = [self.between(first, None).swapaxes(1, 2)]
        with_joints += [self.between(part, first) for part in parts]
        across = np.concatenate(with_joints, axis=1)
        matrix, target = across[:, 1 : 1 + n], -(value @ across)
        scatter = scatter_of_sums(
            self.rows, matrix, target, float(value @ total @ value), quick=True
        )
        if not scatter.any:
            squares = self._left(parts, _held_out(sums, precision))
            return HeldOut(np.maximum(squares, 0.0), self.rows.numbers)
        size = scatter.deviation / np.sqrt(scatter.variance)
        # W W^T = (1 + X X^T)^-1 of the cell's rows, with the scattering columns X.
        inner = np.eye(n) + size[:, None] * matrix * size
        root = np.linalg.inv(np.linalg.cholesky(inner))
        taken = (across * size) @ root.swapaxes(1, 2)
        for fold in range(sums.shape[0]):
            mine = np.concatenate(list(taken[self.rows.fold == fold]), axis=1)
            sums[fold] -= mine @ mine.T
        values = _held_out(sums, precision)
        squares = self._left(parts, values)
        ends = np.full((values.shape[0], 1), -1.0)
        own = np.hstack([ends, values])[self.rows.fold]
        squares -= np.sum(np.einsum("cp,cpn->cn", own, taken) ** 2, axis=1)
        volume = np.linalg.slogdet(inner)[1]
        return HeldOut(np.maximum(squares, 0.0) + scatter.variance * volume, self.rows.numbers)


def _held_out(sums: FloatArray, precision: FloatArray) -> FloatArray:
    """(f, p) values of each fold by the others, of sums (f, 1 + p, 1 + p)."""
    total = sums.sum(axis=0)
    total[1:, 1:] += np.diag(precision)
    inside = total - sums
    return np.array([solve(one[1:, 1:], one[1:, RESIDUAL]) for one in inside])
