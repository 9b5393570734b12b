# SPDX-License-Identifier: Apache-2.0
"""The method "daqp": a general QP solver as an independent second opinion.

DAQP (Arnstroem, Bemporad, Axehill 2022) works to its own tolerance; its active set is then
solved exactly, so that equilibrium holds to rounding.
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError

_SOLVED = 1
_TIGHT = 1e-7
"""Times the largest limit: a tension this close to a limit with a multiplier is on it."""


def polish(A: FloatArray, wrench: FloatArray, held: FloatArray, tension: FloatArray) -> FloatArray:
    """Least-norm tensions with the `held` (n,) ones kept at the values in `tension`.

    Args:
        A: (6, n) structure matrix.
        wrench: (6,) to be held [N, N m].
        held: (n,) whether a tension is at one of its limits.
        tension: (n,) tensions [N]; those that are held keep their values.
    """
    free = held == 0.0
    result = tension.copy()
    result[free] = 0.0
    part = A[:, free]
    result[free] = np.linalg.lstsq(part, wrench - A @ result, rcond=1e-12)[0]
    return result


def solve_daqp(
    A: FloatArray, wrench: FloatArray, tension_min: FloatArray, tension_max: FloatArray
) -> tuple[FloatArray | None, int]:
    """Least-norm tensions by DAQP, polished.

    Args:
        A: (6, n) structure matrix.
        wrench: (6,) [N], [N m].
        tension_min: (n,) [N].
        tension_max: (n,) [N].

    Returns:
        (n,) tensions [N] or None if DAQP finds the wrench infeasible, and its iterations.

    Raises:
        CabolsError: if the package `daqp` is not installed.
    """
    try:
        import daqp
    except ImportError as error:
        raise CabolsError(
            'method "daqp": expected the Python package `daqp`, not found; '
            'install it with `pip install daqp`, or use method="min_norm", which needs nothing'
        ) from error
    n = A.shape[1]
    upper = np.concatenate([tension_max, wrench])
    lower = np.concatenate([tension_min, wrench])
    sense = np.concatenate([np.zeros(n, np.int32), np.full(6, 5, np.int32)])
    solution, _, flag, info = daqp.solve(
        np.eye(n), np.zeros(n), np.ascontiguousarray(A), upper, lower, sense
    )
    iterations = int(info["iterations"])
    if flag != _SOLVED:
        return None, iterations
    tension = np.clip(np.asarray(solution), tension_min, tension_max)
    tight = _TIGHT * max(np.abs(tension_min).max(), np.abs(tension_max).max())
    multiplier = np.asarray(info["lam"])[:n]
    on_limit = (tension - tension_min <= tight) | (tension_max - tension <= tight)
    held = (on_limit & (multiplier != 0.0)).astype(np.float64)
    near_low = tension - tension_min <= tension_max - tension
    tension = np.where(held != 0.0, np.where(near_low, tension_min, tension_max), tension)
    return np.clip(polish(A, wrench, held, tension), tension_min, tension_max), iterations
