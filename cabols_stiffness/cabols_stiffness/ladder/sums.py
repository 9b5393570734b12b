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
        ends = rows.residual[:, None]
        self._squares = np.array([ends[at].T @ ends[at] for at in rows.parts])

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

    def of(self, parts: Sequence[IntArray]) -> FloatArray:
        """(c, 1 + p, 1 + p) products of the residual and the columns of some parts.

        Args:
            parts: columns of each.
        """
        size = 1 + sum(part.size for part in parts)
        found = np.empty((self.rows.fold.size, size, size))
        found[:, :1, :1] = self._squares
        ends = np.cumsum([1, *(part.size for part in parts)])
        for i, (one, a, b) in enumerate(zip(parts, ends, ends[1:], strict=False)):
            found[:, a:b, :1] = self.between(one, None)
            found[:, :1, a:b] = found[:, a:b, :1].swapaxes(1, 2)
            for other, c, d in zip(parts[: i + 1], ends, ends[1:], strict=False):
                found[:, a:b, c:d] = self.between(one, other)
                found[:, c:d, a:b] = found[:, a:b, c:d].swapaxes(1, 2)
        return found

    def held_out(self, parts: Sequence[IntArray], precision: FloatArray) -> HeldOut:
        """Error of a model where each fold is predicted from the others.

        Args:
            parts: columns of the model.
            precision: (p,) of the prior of each parameter about zero; 0: none.
        """
        return _held_out(self.of(parts), precision, self.rows)

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
        value = np.concatenate([[-1.0], solve(total[1:, 1:] + np.diag(precision), total[1:, 0])])
        # Of the joints' columns with what the model leaves of the residual.
        target = -(sums[:, 1 : 1 + n] @ value)
        matrix = sums[:, 1 : 1 + n, 1 : 1 + n]
        scatter = scatter_of_sums(
            self.rows, matrix, target, float(value @ total @ value), quick=True
        )
        if not scatter.any:
            return _held_out(sums, precision, self.rows)
        size = scatter.deviation / np.sqrt(scatter.variance)
        # W W^T = (1 + X X^T)^-1 of the cell's rows, with the scattering columns X.
        across = sums[:, :, 1 : 1 + n] * size
        inner = np.eye(n) + size[:, None] * matrix * size
        sums = sums - across @ np.linalg.solve(inner, across.swapaxes(1, 2))
        found = _held_out(sums, precision, self.rows)
        volume = np.linalg.slogdet(inner)[1]
        return HeldOut(found.squares + scatter.variance * volume, found.numbers)


def _held_out(sums: FloatArray, precision: FloatArray, rows: Rows) -> HeldOut:
    total = sums.sum(axis=0)
    total[1:, 1:] += np.diag(precision)
    squares = np.empty(rows.fold.size)
    for fold in range(int(rows.fold.max(initial=0)) + 1):
        out = rows.fold == fold
        inside = total - sums[out].sum(axis=0)
        value = np.concatenate([[-1.0], solve(inside[1:, 1:], inside[1:, 0])])
        squares[out] = (sums[out] @ value) @ value
    return HeldOut(np.maximum(squares, 0.0), rows.numbers)
