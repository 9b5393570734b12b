# SPDX-License-Identifier: Apache-2.0
"""Redundancy resolution for one call: `distribute`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError, ShapeError

from . import calls
from .arguments import check_limits, check_matrix, check_weights, check_wrench
from .calls import EXACT_PATTERN, NOT_PLAIN, PATTERN, SOFTENED, STATUS_MASK, STEP_BITS
from .kernels.basis import prepare_pose
from .kernels.work_array import EXACT, FEASIBLE, INFEASIBLE, INVALID, ITERATIONS, LOSS, work_size
from .many_cables import choose_in_polytope
from .methods import (
    CHOICES,
    DEFAULT_EXPONENT,
    MAX_REDUNDANCY,
    MIN_CABLES,
    check_method,
    choose_prepared,
    set_method,
)
from .references.daqp_fallback import solve_daqp
from .references.enumeration import enumerate_active_sets
from .solution import TensionSolution

Exact = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], tuple[FloatArray | None, int]]
_EXACT: dict[str, Exact] = {"kkt_enumeration": enumerate_active_sets, "daqp": solve_daqp}
METHODS = (*CHOICES, *_EXACT)
_PLAIN = "min_norm"
_NUMBER = 1.0
_empty = np.empty
_new = tuple.__new__


def distribute(
    A: ArrayLike,
    wrench: ArrayLike,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    method: str = _PLAIN,
    weights: ArrayLike | None = None,
    exponent: float = DEFAULT_EXPONENT,
    exact: bool = False,
) -> TensionSolution:
    """Choose the cable tensions that give a wrench: redundancy resolution (3.5)-(3.8).

    Minimises |tension|_2 subject to A @ tension = wrench and the limits. If no tension does,
    the answer is the nearest feasible wrench's: tension minimises
    |diag(weights) (A @ tension - wrench)|_2 inside the limits and has the least norm among
    those that do. Which of the two it is, `feasible` says. Both are given up by a little where
    tensions would run too fast with the pose, unless `exact`.

    Feasible means: limits missed by at most max(1e-12, 4 eps cond) times the largest limit, cond
    the condition of diag(weights) A; the tensions are then clipped, so the residual stays below
    that times the norm of A. A whose condition exceeds 1e10 is treated as rank-deficient and
    always solved as a nearest wrench; feasible then means a weighted residual of at most 1e-11
    times the larger of the weighted wrench and the largest limit's effect.

    Work is bounded: at most n(n - 1)/2 clips for two degrees of redundancy (plane.py), n for
    one, none for zero, a dual active-set method for more (general.py); the nearest wrench takes
    at most 10 block exchanges or 20 n steps of falling objective (nearest.py).

    Args:
        A: (6, n) structure matrix, n >= 6, W = A @ tension on the platform, base axes [1; m].
        wrench: (6,) wanted force [N] then torque [N m], about the platform's origin, base axes.
        tension_min: number or (n,) lower limits [N].
        tension_max: number or (n,) upper limits [N].
        method: "min_norm" (compiled, exact), "kkt_enumeration" (the source's, up to 129 linear
            solves for n = 8) or "daqp" (a QP solver, polished; needs the package `daqp`); or
            other feasible tensions than those of least norm: "p_norm", "barycentre",
            "analytic_centre", compiled for at most 8 cables (methods.py), in milliseconds for more
            and for rank-deficient A (many_cables.py). All but "min_norm" leave infeasible wrenches
            to it.
        weights: (6,) positive weights of the wrench components in the nearest wrench; default
            1/N for force and 1/(0.15 m) for torque, 0.15 m the reference platform's radius.
        exponent: p of "p_norm", 2 to 32.
        exact: keep the least norm and the nearest wrench where tensions then jump with the pose.
            By default they are continuous in pose, wrench and limits, feasible or not: where the
            least norm would be too steep, the wrench is missed by `loss` more than it must be
            (kernels/smooth.py). `feasible` always refers to what the limits allow.

    Returns:
        Tensions inside the limits, whether they are feasible, residual A @ tension - wrench.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if tension_min > tension_max, a weight is not positive, the method is
            unknown, or its package is missing.

    Source:
        Taghirad and Bedoustani 2011 (thesis (3.5)-(3.8), whose cases under (3.8) are stated the
        wrong way round: mu_i > 0 only where tau_i = tau_min), upper limits added.
    """
    if method is _PLAIN and weights is None and exponent is DEFAULT_EXPONENT:
        # Arrays as the compiled code takes them, with its checks; all else is converted, or refused
        # with a reason, below. Few names and branches: they are a fifth of the call.
        try:
            tension, residual = _empty(A.shape[1]), _empty(6)  # type: ignore[union-attr]
        except (TypeError, ValueError, AttributeError, IndexError):
            pass
        else:
            entry, work = calls.distribute_entry, EXACT_PATTERN if exact else PATTERN
            code = entry(work, _NUMBER, A, wrench, tension_min, tension_max, tension, residual)
            steps = code >> STEP_BITS
            if not code & NOT_PLAIN:
                return _new(TensionSolution, (tension, True, residual, _PLAIN, steps, 0.0))
            status, loss = code & STATUS_MASK, 0.0
            if code & SOFTENED:  # seldom: once more, with a place for what was given up
                more = _empty(tension.shape[0] + 1)
                entry(work, _NUMBER, A, wrench, tension_min, tension_max, more, residual)
                loss = more.item(-1)
            if status <= INFEASIBLE:
                feasible = status == FEASIBLE
                return _new(TensionSolution, (tension, feasible, residual, _PLAIN, steps, loss))
    if method not in METHODS:
        raise CabolsError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    matrix, target = check_matrix(A), check_wrench(wrench)
    n = matrix.shape[1]
    low, high = check_limits(n, tension_min, tension_max)
    scale = check_weights(weights)
    work, tension, residual = np.empty(work_size(n)), np.empty(n), np.empty(6)
    work[EXACT] = 1.0 if exact else 0.0
    deficient = prepare_pose(matrix, low, high, scale, work) == 1
    if method in _EXACT and not deficient:
        found, iterations = _EXACT[method](matrix, target, low, high)
        if found is not None:
            return TensionSolution(found, True, matrix @ found - target, method, iterations)
    chosen = method if method in CHOICES else _PLAIN
    check_method(MIN_CABLES, chosen, exponent)
    in_polytope = chosen != _PLAIN and (deficient or n > MIN_CABLES + MAX_REDUNDANCY)
    set_method(work, n, _PLAIN if in_polytope else chosen, exponent)
    status = choose_prepared(work, target, tension, residual)
    if in_polytope and status == FEASIBLE:
        tension = choose_in_polytope(matrix, tension, low, high, CHOICES[chosen], exponent)
        residual = matrix @ tension - target
    if status == INVALID:  # finite, but beyond what squares can hold
        raise ShapeError(f"A, wrench: expected numbers below 1e99, got {target}; check the units")
    steps, loss = int(work[ITERATIONS]), float(work[LOSS])
    return TensionSolution(tension, status == FEASIBLE, residual, method, steps, loss)
