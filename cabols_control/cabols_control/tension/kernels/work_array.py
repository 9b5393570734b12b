# SPDX-License-Identifier: Apache-2.0
"""Where things lie in the work array that one pose's solver lives in.

One flat float64 array holds everything that depends on the pose and on the limits, then scratch:
a call from Python costs 50 to 100 ns for every array that is handed over, so there is one.
All matrices are row major with cables along the row, so that compiled loops run over cables.
"""

from __future__ import annotations

from cabols_control.cable_kernels import CABLE_FLOATS

from .static_size import compiled

Six = tuple[float, float, float, float, float, float]

# Status of a wrench.
FEASIBLE = 0
"""The wrench is reached inside the limits, with the least 2-norm of the tensions."""
INFEASIBLE = 1
"""No tension inside the limits gives the wrench; the nearest wrench's are returned."""
INVALID = 2
"""Something is not finite (or min > max); `tension_min` is returned as the safe answer."""

HEADER = 24
# Slots of the header.
CABLES = 0
RANK = 1
STATE = 2
TOLERANCE = 3
SCALE = 4
GRAM_MAX = 5
ITERATIONS = 6
# What the plane solver leaves behind when it proves infeasibility: up to three cables whose
# limits contradict each other (-1: none) and the limit of each (-1 lower, +1 upper).
CONFLICT = 7
CONFLICT_SIDE = 10
# Which feasible tensions are wanted (methods.py): method, p of the p-norm, share of the method.
METHOD = 13
EXPONENT = 14
SHARE = 15
# 1: the least norm and the nearest wrench as they are; else those that change little (smooth.py).
EXACT = 16
# What is given up for that: by how much the miss is longer, in the weighted metric.
LOSS = 17
# Multipliers of the limits up to this cannot be steep; see EXACT.
STEEPEST = 18
# Share of the method's tensions that a polygon this narrow leaves (methods.py).
WIDTH = 19

# Values of STATE.
READY = 0.0
DEFICIENT = 1.0
BROKEN = 2.0


@compiled
def at_structure(_n: int) -> int:
    """(6, n) structure matrix A."""
    return HEADER


@compiled
def at_limits(n: int) -> int:
    """(2, n) tension_min, tension_max."""
    return HEADER + 6 * n


@compiled
def at_weights(n: int) -> int:
    """(6,) weights of the wrench components."""
    return HEADER + 8 * n


@compiled
def at_scaled(n: int) -> int:
    """(6, n) diag(weights) A."""
    return HEADER + 8 * n + 6


@compiled
def at_inverse(n: int) -> int:
    """(6, n) transposed pseudo-inverse of diag(weights) A."""
    return HEADER + 14 * n + 6


@compiled
def at_basis(n: int) -> int:
    """(n, n) orthonormal rows: first the row space of A, then its null space."""
    return HEADER + 20 * n + 6


@compiled
def at_gram(n: int) -> int:
    """(n, n) Gram matrix of the columns of diag(weights) A."""
    return HEADER + 20 * n + n * n + 6


@compiled
def at_scratch(n: int) -> int:
    """Scratch: see the functions that use it."""
    return HEADER + 20 * n + 2 * n * n + 6


@compiled
def at_vector(n: int, k: int) -> int:
    """(n,) scratch vector; each file says which ones it uses.

    Args:
        n: number of cables.
        k: which vector, 0 to 17.
    """
    return at_scratch(n) + k * n


@compiled
def at_factor(n: int) -> int:
    """(n, n) scratch for a factor."""
    return at_scratch(n) + 18 * n


@compiled
def at_triangle(n: int) -> int:
    """(n, n) scratch for a triangle beside the factor."""
    return at_scratch(n) + 18 * n + n * n


@compiled
def at_face(n: int) -> int:
    """(n, n) basis of a face, then its (6, n) rows and their (6, 6) factor."""
    return at_scratch(n) + 18 * n + 2 * n * n


@compiled
def work_size(n: int) -> int:
    """Length of the work array for n cables."""
    return at_face(n) + n * n + 6 * n + 36


@compiled
def rig_work_size(n: int) -> int:
    """Length of a rig's work array: its cables' (n,) records of CABLE come last."""
    return work_size(n) + CABLE_FLOATS * n
