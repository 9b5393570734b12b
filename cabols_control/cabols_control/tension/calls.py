"""From Python into the compiled code: a call costs a microsecond, most of it the way there.

So there are few arguments, and status and iterations come back in one integer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from cabols_control.checks import FloatArray

from .kernels.dispatch import detect_prepared, solve_at_pose, solve_prepared, spare_residual
from .kernels.static_size import compiled
from .kernels.work_array import CABLES, ITERATIONS

Entry = Callable[..., int]

_WRONG_SHAPE = 3
STATUS_BITS = 3
STATUS_MASK = (1 << STATUS_BITS) - 1
"""An entry returns the status (_WRONG_SHAPE for arrays that do not fit) in these bits, and, where
it also fills a residual, the iterations above them."""


@compiled
def _solve_call(
    work: FloatArray, wrench: FloatArray, tension: FloatArray, residual: FloatArray
) -> int:
    """`solve_prepared` with a shape check; iterations stand above the status."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    status = solve_prepared(work, wrench, tension, residual)
    return status + (int(work[ITERATIONS]) << STATUS_BITS)


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
    return status + (int(work[ITERATIONS]) << STATUS_BITS)


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


def _entry(function: Any, *ranks: int) -> Entry:
    """Compile for C-contiguous float64 arrays of these ranks and for nothing else.

    Other arguments then raise TypeError instead of starting the compiler inside a loop.
    """
    function.compile(tuple(types.Array(types.float64, rank, "C") for rank in ranks))
    function.disable_compile()
    entry: Entry = function
    return entry


solve_entry = _entry(_solve_call, 1, 1, 1, 1)
detect_entry = _entry(_detect_call, 1, 1)
solve_at_entry = _entry(_solve_at_call, 1, 1, 2, 1, 1, 1)
solve_into_entry = _entry(_solve_into_call, 1, 1, 1)
solve_at_into_entry = _entry(_solve_at_into_call, 1, 1, 2, 1, 1)
