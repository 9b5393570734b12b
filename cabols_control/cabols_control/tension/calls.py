# SPDX-License-Identifier: Apache-2.0
"""From Python into the compiled code: a call costs a microsecond, most of it the way there.

So there are few arguments, and status and iterations come back in one integer.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from cabols_control.checks import FloatArray

from .arguments import FORCE_WEIGHT, LARGEST_ENTRY, TORQUE_WEIGHT
from .kernels.dispatch import (
    detect_prepared,
    solve_at_pose,
    solve_prepared,
    solve_unprepared,
    spare_residual,
)
from .kernels.static_size import compiled, inlined
from .kernels.work_array import (
    CABLES,
    EXACT,
    INVALID,
    ITERATIONS,
    LOSS,
    METHOD,
    at_limits,
    at_structure,
    at_weights,
    work_size,
)

Entry = Callable[..., int]

_WRONG_SHAPE = 3
STATUS_BITS = 3
STATUS_MASK = (1 << STATUS_BITS) - 1
"""An entry returns the status (_WRONG_SHAPE for arrays that do not fit) in these bits; where it
also fills a residual, SOFTENED if the work array's LOSS is not 0, and the iterations above them."""
SOFTENED = 1 << STATUS_BITS
STEP_BITS = STATUS_BITS + 1


@inlined
def _code(work: FloatArray, status: int) -> int:
    """Status, whether there is a loss, and iterations, in one integer."""
    softened = SOFTENED if work[LOSS] != 0.0 else 0
    return status + softened + (int(work[ITERATIONS]) << STEP_BITS)


@compiled
def _solve_call(
    work: FloatArray, wrench: FloatArray, tension: FloatArray, residual: FloatArray
) -> int:
    """`solve_prepared` with a shape check; iterations stand above the status."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    status = solve_prepared(work, wrench, tension, residual)
    return _code(work, status)


@compiled
def _solve_into_call(work: FloatArray, wrench: FloatArray, tension: FloatArray) -> int:
    """`_solve_call` for whom tensions and status are enough: an argument less on the way."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    return solve_prepared(work, wrench, tension, spare_residual(work))


@compiled
def _detect_call(work: FloatArray, wrench: FloatArray) -> int:
    """`detect_prepared` with a shape check."""
    return detect_prepared(work, wrench) if wrench.shape[0] == 6 else _WRONG_SHAPE


@compiled
def _solve_at_call(
    work: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    wrench: FloatArray,
    tension: FloatArray,
    residual: FloatArray,
) -> int:
    """`solve_at_pose` with a shape check; iterations stand above the status."""
    if position.shape[0] != 3 or rotation.shape != (3, 3) or wrench.shape[0] != 6:
        return _WRONG_SHAPE
    if tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    status = solve_at_pose(work, position, rotation, wrench, tension, residual)
    return _code(work, status)


@compiled
def _solve_at_into_call(
    work: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    wrench: FloatArray,
    tension: FloatArray,
) -> int:
    """`_solve_at_call` for whom tensions and status are enough."""
    if position.shape[0] != 3 or rotation.shape != (3, 3) or wrench.shape[0] != 6:
        return _WRONG_SHAPE
    if tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    return solve_at_pose(work, position, rotation, wrench, tension, spare_residual(work))


@compiled
def _one_call(
    work: FloatArray,
    A: FloatArray,
    wrench: FloatArray,
    exact: bool,
    tension: FloatArray,
    residual: FloatArray,
) -> int:
    """Solve once with the limits in `work` and the default weights; with every check."""
    n = A.shape[1]
    work[CABLES], work[EXACT], work[METHOD], work[ITERATIONS] = n, 1.0 if exact else 0.0, 0.0, 0.0
    limits, structure, weights = at_limits(n), at_structure(n), at_weights(n)
    low, high = work[limits : limits + n], work[limits + n : limits + 2 * n]
    for k in range(3):
        work[weights + k] = FORCE_WEIGHT
        work[weights + 3 + k] = TORQUE_WEIGHT
    ordered = True
    for i in range(n):
        ordered = ordered and low[i] <= high[i]
    for k in range(6):
        ordered = ordered and abs(wrench[k]) < LARGEST_ENTRY
        for i in range(n):
            work[structure + k * n + i] = A[k, i]
    if not ordered:  # what is not finite the solver refuses
        return INVALID
    matrix = work[structure : structure + 6 * n].reshape((6, n))
    status = solve_unprepared(work, matrix, low, high, wrench, tension[:n], residual)
    if tension.shape[0] > n:
        tension[n] = work[LOSS]
    return _code(work, status)


@inlined
def _misfit(A: FloatArray, wrench: FloatArray, tension: FloatArray) -> bool:
    """Whether the arrays of one call do not belong together; one more tension is for the loss."""
    n = A.shape[1]
    spare = tension.shape[0] - n
    return A.shape[0] != 6 or n < 6 or wrench.shape[0] != 6 or not 0 <= spare <= 1


@compiled
def _distribute_call(
    A: FloatArray,
    wrench: FloatArray,
    low: float,
    high: float,
    exact: bool,
    tension: FloatArray,
    residual: FloatArray,
) -> int:
    """`distribute` by minimum norm, the same limits for all cables; allocates its work array."""
    if _misfit(A, wrench, tension):
        return _WRONG_SHAPE
    n = A.shape[1]
    work = np.empty(work_size(n))
    limits = at_limits(n)
    for i in range(n):
        work[limits + i], work[limits + n + i] = low, high
    return _one_call(work, A, wrench, exact, tension, residual)


@compiled
def _distribute_each_call(
    A: FloatArray,
    wrench: FloatArray,
    low: FloatArray,
    high: FloatArray,
    exact: bool,
    tension: FloatArray,
    residual: FloatArray,
) -> int:
    """`_distribute_call` with limits for each cable."""
    n = A.shape[1]
    if _misfit(A, wrench, tension) or low.shape[0] != n or high.shape[0] != n:
        return _WRONG_SHAPE
    work = np.empty(work_size(n))
    limits = at_limits(n)
    for i in range(n):
        work[limits + i], work[limits + n + i] = low[i], high[i]
    return _one_call(work, A, wrench, exact, tension, residual)


_BOOLEAN = -1
_TYPES = {
    _BOOLEAN: types.boolean,
    0: types.float64,
    1: types.Array(types.float64, 1, "C"),
    2: types.Array(types.float64, 2, "C"),
}


def _entry(function: Any, *ranks: int) -> Entry:
    """Compile for C-contiguous float64 arrays of these ranks (0: numbers) and for nothing else.

    Other arguments then raise TypeError instead of starting the compiler inside a loop.
    """
    function.compile(tuple(_TYPES[rank] for rank in ranks))
    function.disable_compile()
    entry: Entry = function
    return entry


_ENTRIES: dict[str, tuple[Any, tuple[int, ...]]] = {
    "solve_entry": (_solve_call, (1, 1, 1, 1)),
    "detect_entry": (_detect_call, (1, 1)),
    "solve_at_entry": (_solve_at_call, (1, 1, 2, 1, 1, 1)),
    "solve_into_entry": (_solve_into_call, (1, 1, 1)),
    "solve_at_into_entry": (_solve_at_into_call, (1, 1, 2, 1, 1)),
    "distribute_entry": (_distribute_call, (2, 1, 0, 0, _BOOLEAN, 1, 1)),
    "distribute_each_entry": (_distribute_each_call, (2, 1, 1, 1, _BOOLEAN, 1, 1)),
}
_loading = threading.Lock()


def __getattr__(name: str) -> Entry:
    """An entry, compiled or loaded when it is first asked for.

    Each takes 60 ms to load, and most processes of a rig need none.
    """
    if name not in _ENTRIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with _loading:
        if name not in globals():
            function, ranks = _ENTRIES[name]
            globals()[name] = _entry(function, *ranks)
    entry: Entry = globals()[name]
    return entry


def load_all() -> None:
    """Compile or load every entry."""
    for name in _ENTRIES:
        getattr(sys.modules[__name__], name)
