# SPDX-License-Identifier: Apache-2.0
"""What remains of a robot's wrenches when a cable parts: the share that the others can give."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import BoolArray, FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.tension import FEASIBLE, TensionResolver, distribute

SIX = 6
"""Cables without which six directions of motion are not held."""


class RemainingShare(NamedTuple):
    """Of wrenches that are asked about, the share that is feasible.

    Attributes:
        intact: with all cables.
        without: (n,) without each cable, of all wrenches; 0 where fewer than six cables are left.
        closed: (n,) whether the others can pull in every direction at once (wrench closure).
    """

    intact: float
    without: FloatArray
    closed: BoolArray


def remaining_share(
    matrix: ArrayLike, tension_min: ArrayLike, tension_max: ArrayLike, wrenches: ArrayLike
) -> RemainingShare:
    """Share of wrenches that a robot gives with all cables, and without each of them.

    Args:
        matrix: (6, n) structure matrix, base axes [1; m].
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        wrenches: (k, 6) that are asked about [N, N m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if there is no wrench, or a limit is above the other.
    """
    structure = finite_array("matrix", matrix, (6, None))
    asked = finite_array("wrenches", wrenches, (None, 6))
    if not asked.shape[0]:
        raise CabolsError("wrenches: expected at least one, got none")
    n = structure.shape[1]
    low, high = (np.broadcast_to(np.asarray(v, float), (n,)) for v in (tension_min, tension_max))
    without, closed = np.zeros(n), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        rest = np.delete(np.arange(n), i)
        if rest.size < SIX:
            continue
        without[i] = _share(structure[:, rest], low[rest], high[rest], asked)
        closed[i] = _closes(structure[:, rest])
    return RemainingShare(_share(structure, low, high, asked), without, closed)


def _share(matrix: FloatArray, low: FloatArray, high: FloatArray, wrenches: FloatArray) -> float:
    """Share of wrenches that have tensions within the limits."""
    _, status = TensionResolver(matrix, low, high, exact=True).solve_batch(wrenches)
    return float(np.mean(status == FEASIBLE))


def _closes(matrix: FloatArray) -> bool:
    """Whether some tensions of at least 1 N hold no wrench: then any wrench has some."""
    found = distribute(matrix, np.zeros(6), 1.0, 1e4, exact=True)
    return bool(found.feasible and np.linalg.matrix_rank(matrix) == SIX)
