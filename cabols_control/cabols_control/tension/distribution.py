"""Redundancy resolution for one call: `distribute`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import finite_array
from cabols_control.errors import CabolsError, ShapeError
from cabols_control.naming import cable_name

from .kernels.basis import prepare_pose
from .kernels.work_array import ITERATIONS, work_size
from .methods import CHOICES, DEFAULT_EXPONENT, choose_prepared, set_method
from .references.daqp_fallback import solve_daqp
from .references.enumeration import enumerate_active_sets
from .solution import FEASIBLE, INVALID, FloatArray, TensionSolution

MIN_CABLES = 6
WEIGHT_LENGTH_M = 0.15
"""Torque counts as force at this radius, the reference platform's, in the default weights."""
DEFAULT_WEIGHTS = (1.0, 1.0, 1.0, *[1.0 / WEIGHT_LENGTH_M] * 3)

Exact = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], tuple[FloatArray | None, int]]
_EXACT: dict[str, Exact] = {"kkt_enumeration": enumerate_active_sets, "daqp": solve_daqp}
METHODS = (*CHOICES, *_EXACT)


def check_limits(
    n: int, tension_min: ArrayLike, tension_max: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return both limits as (n,) arrays [N].

    Raises:
        ShapeError: if one is neither a number nor (n,), or not finite.
        CabolsError: if a lower limit is above its upper limit.
    """
    limits = []
    for name, value in (("tension_min", tension_min), ("tension_max", tension_max)):
        each = np.full(n, value) if np.ndim(value) == 0 else value
        limits.append(finite_array(name, each, (n,)))
    low, high = limits
    wrong = np.flatnonzero(low > high)
    if wrong.size:
        i = int(wrong[0])
        raise CabolsError(
            f"tension_min: expected at most tension_max for every cable, got {low[i]:g} N above "
            f"{high[i]:g} N for {cable_name(i)}; swap them or widen the limits"
        )
    return low, high


def check_weights(weights: ArrayLike | None) -> FloatArray:
    """Return the weights of the nearest wrench as a (6,) array, the default for None.

    Raises:
        ShapeError: if they are not (6,) or not finite.
        CabolsError: if one is not positive.
    """
    if weights is None:
        return np.array(DEFAULT_WEIGHTS)
    array = finite_array("weights", weights, (6,))
    if not (array > 0.0).all():
        raise CabolsError(f"weights: expected six positive numbers, got {array}; drop the zeros")
    return array


def check_matrix(A: ArrayLike) -> FloatArray:
    """Return the structure matrix as a (6, n) array with n >= 6.

    Raises:
        ShapeError: otherwise, or if it is not finite.
    """
    matrix = finite_array("A", A, (6, None))
    if matrix.shape[1] < MIN_CABLES:
        raise ShapeError(
            f"A: expected at least {MIN_CABLES} columns, got shape {matrix.shape}; six degrees "
            "of freedom need six cables"
        )
    return matrix


def check_wrench(wrench: ArrayLike) -> FloatArray:
    """Return the wrench as a (6,) array.

    Raises:
        ShapeError: if it is not (6,) or not finite (beyond 1e100 counts as not finite).
    """
    array = finite_array("wrench", wrench, (6,))
    if not np.abs(array).max() < 1e99:
        raise ShapeError(f"wrench: expected components below 1e99, got {array}; check the units")
    return array


def distribute(
    A: ArrayLike,
    wrench: ArrayLike,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    method: str = "min_norm",
    weights: ArrayLike | None = None,
    exponent: float = DEFAULT_EXPONENT,
) -> TensionSolution:
    """Choose the cable tensions that give a wrench: redundancy resolution (3.5)-(3.8).

    Minimises |tension|_2 subject to A @ tension = wrench and the limits. If no tension does,
    the answer is the nearest feasible wrench's: tension minimises
    |diag(weights) (A @ tension - wrench)|_2 inside the limits and has the least norm among
    those that do. Which of the two it is, `feasible` says.

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
            solves for n = 8) or "daqp" (a QP solver, polished; needs the package `daqp`); or,
            for at most 8 cables, other feasible tensions than those of least norm: "p_norm",
            "barycentre", "analytic_centre" (methods.py). All but "min_norm" leave infeasible
            wrenches and rank-deficient A to it.
        weights: (6,) positive weights of the wrench components in the nearest wrench; default
            1/N for force and 1/(0.15 m) for torque, 0.15 m the reference platform's radius.
        exponent: p of "p_norm", 2 to 32.

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
    if method not in METHODS:
        raise CabolsError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    matrix, target = check_matrix(A), check_wrench(wrench)
    n = matrix.shape[1]
    low, high = check_limits(n, tension_min, tension_max)
    scale = check_weights(weights)
    work, tension, residual = np.empty(work_size(n)), np.empty(n), np.empty(6)
    deficient = prepare_pose(matrix, low, high, scale, work) == 1
    if method in _EXACT and not deficient:
        found, iterations = _EXACT[method](matrix, target, low, high)
        if found is not None:
            return TensionSolution(found, True, matrix @ found - target, method, iterations)
    set_method(work, n, method if method in CHOICES else "min_norm", exponent)
    status = choose_prepared(work, target, tension, residual)
    if status == INVALID:  # finite, but beyond what squares can hold
        raise ShapeError(f"A, wrench: expected numbers below 1e99, got {target}; check the units")
    return TensionSolution(tension, status == FEASIBLE, residual, method, int(work[ITERATIONS]))
