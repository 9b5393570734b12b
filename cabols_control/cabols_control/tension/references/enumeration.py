# SPDX-License-Identifier: Apache-2.0
"""The source's own method: go through the sets of active limits and test the KKT conditions.

Thesis (3.5)-(3.8), after Taghirad and Bedoustani 2011: minimise |t| subject to A t = W and
t >= tension_min (here t <= tension_max as well). With a set of tensions held at their limits,
the others follow from t_F = A_F^T y, A_F A_F^T y = W - A_B b_B; the set is optimal if the free
tensions keep their limits and the multipliers mu = t - A^T y have the right sign.
Erratum: the two cases under (3.8) are stated the wrong way round. mu_i > 0 only where
tau_i = tau_min, and mu_i = 0 where tau_i > tau_min (mu_i < 0 at an upper limit).
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from cabols_control.checks import FloatArray

LIMIT_TOLERANCE = 1e-9
"""Times the largest limit: how far limits, multipliers and the balance may be missed."""


def _stationary(
    A: FloatArray, wrench: FloatArray, held: list[int], values: list[float]
) -> tuple[FloatArray, FloatArray] | None:
    """Least-norm tensions and multipliers with some tensions held; None if there are none."""
    n = A.shape[1]
    free = [i for i in range(n) if i not in held]
    tension = np.zeros(n)
    tension[held] = values
    rest = wrench - A @ tension
    part = A[:, free]
    y = np.linalg.lstsq(part @ part.T, rest, rcond=1e-13)[0]
    tension[free] = part.T @ y
    return tension, tension - A.T @ y


def enumerate_active_sets(
    A: FloatArray, wrench: FloatArray, tension_min: FloatArray, tension_max: FloatArray
) -> tuple[FloatArray | None, int]:
    """Least-norm tensions by enumeration of the KKT conditions.

    Sets are taken by size: at most n - 6 limits are active unless the limits meet by accident,
    so larger sets are not visited. For n = 8: 1 + 16 + 112 = 129 linear solves at most.

    Args:
        A: (6, n) structure matrix of rank 6.
        wrench: (6,) [N], [N m].
        tension_min: (n,) [N].
        tension_max: (n,) [N].

    Returns:
        (n,) tensions [N], or None if no set of active limits satisfies the conditions (the
        wrench is infeasible), and the number of sets visited.
    """
    n = A.shape[1]
    tolerance = LIMIT_TOLERANCE * max(np.abs(tension_min).max(), np.abs(tension_max).max())
    visited = 0
    for size in range(n - 5):
        for held in combinations(range(n), size):
            for sides in product((0, 1), repeat=size):
                visited += 1
                values = [
                    float((tension_min, tension_max)[s][i])
                    for i, s in zip(held, sides, strict=True)
                ]
                found = _stationary(A, wrench, list(held), values)
                if found is None:
                    continue
                tension, multiplier = found
                kept = bool(
                    (tension >= tension_min - tolerance).all()
                    and (tension <= tension_max + tolerance).all()
                    and np.abs(A @ tension - wrench).max() <= tolerance
                )
                signs = all(
                    (multiplier[i] >= -tolerance) if s == 0 else (multiplier[i] <= tolerance)
                    for i, s in zip(held, sides, strict=True)
                )
                if kept and signs:
                    return np.clip(tension, tension_min, tension_max), visited
    return None, visited
