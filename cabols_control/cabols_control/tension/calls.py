# SPDX-License-Identifier: Apache-2.0
"""From Python into the compiled code: the way there would cost more than the solving.

So compiled code looks at the caller's objects itself (kernels/array_objects.py), and status and
iterations come back in one integer. Every entry takes `PATTERN` first, which says what a plain
array is; what is not plain it answers by a status above INFEASIBLE, and the caller converts its
arguments or says what is wrong with them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core.errors import NumbaError

from cabols_control.checks import FloatArray

from .arguments import FORCE_WEIGHT, LARGEST_ENTRY, TORQUE_WEIGHT
from .kernels.array_objects import (
    ADDRESS,
    READABLE,
    WRITABLE,
    address,
    float_value,
    is_array,
    is_matrix,
    is_vector,
    layout_is_known,
    length,
    matrix,
    same_kind,
    vector,
)
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
NOT_PLAIN = STATUS_MASK | SOFTENED
"""Bits that are 0 (FEASIBLE, nothing given up) in the common case."""
STEP_BITS = STATUS_BITS + 1
MOST_CABLES = 16
"""Of `distribute_entry`, whose work array is `PATTERN`; more go the longer way."""
PATTERN = np.zeros(work_size(MOST_CABLES) + 1)
EXACT_PATTERN = PATTERN.copy()
"""The same for `distribute_entry`, which gives exact tensions where the last number is not 0."""
EXACT_PATTERN[-1] = 1.0


@inlined
def _code(work: FloatArray, status: int) -> int:
    """Status, whether there is a loss, and iterations, in one integer."""
    softened = SOFTENED if work[LOSS] != 0.0 else 0
    return status + softened + (int(work[ITERATIONS]) << STEP_BITS)


@inlined
def _solve_call(
    work: FloatArray, wrench: FloatArray, tension: FloatArray, residual: FloatArray
) -> int:
    """`solve_prepared` with a shape check; iterations stand above the status."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    status = solve_prepared(work, wrench, tension, residual)
    return _code(work, status)


@inlined
def _solve_into_call(work: FloatArray, wrench: FloatArray, tension: FloatArray) -> int:
    """`_solve_call` for whom tensions and status are enough: an argument less on the way."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    return solve_prepared(work, wrench, tension, spare_residual(work))


@inlined
def _detect_call(work: FloatArray, wrench: FloatArray) -> int:
    """`detect_prepared` with a shape check."""
    return detect_prepared(work, wrench) if wrench.shape[0] == 6 else _WRONG_SHAPE


@inlined
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


@inlined
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
def _solve_objects(pattern: Any, work: Any, wrench: Any, tension: Any, residual: Any) -> int:
    """`_solve_call` for objects; tension and residual are the caller's own."""
    p, w, f = address(pattern), address(work), address(wrench)
    if not (is_array(p, w, 1, WRITABLE) and is_array(p, f, 1, READABLE)):
        return _WRONG_SHAPE
    out, rest = address(tension), address(residual)
    return _solve_call(vector(w), vector(f), vector(out), vector(rest))


@compiled
def _solve_into_objects(pattern: Any, work: Any, wrench: Any, tension: Any) -> int:
    """`_solve_into_call` for objects."""
    p, w, f, out = address(pattern), address(work), address(wrench), address(tension)
    if not (is_array(p, w, 1, WRITABLE) and is_array(p, f, 1, READABLE)):
        return _WRONG_SHAPE
    if not is_array(p, out, 1, WRITABLE):
        return _WRONG_SHAPE
    return _solve_into_call(vector(w), vector(f), vector(out))


@compiled
def _detect_objects(pattern: Any, work: Any, wrench: Any) -> int:
    """`_detect_call` for objects."""
    p, w, f = address(pattern), address(work), address(wrench)
    if not (is_array(p, w, 1, WRITABLE) and is_array(p, f, 1, READABLE)):
        return _WRONG_SHAPE
    return _detect_call(vector(w), vector(f))


@inlined
def _is_pose(p: int, position: int, rotation: int, wrench: int) -> bool:
    """Whether these are the arrays of a pose and a wrench."""
    place = is_vector(p, position, 3, READABLE) and is_matrix(p, rotation, 3, 3)
    return place and is_vector(p, wrench, 6, READABLE)


@compiled
def _solve_at_objects(
    pattern: Any,
    work: Any,
    position: Any,
    rotation: Any,
    wrench: Any,
    tension: Any,
    residual: Any,
) -> int:
    """`_solve_at_call` for objects; tension and residual are the caller's own."""
    p, w, at, turn, f = (
        address(pattern),
        address(work),
        address(position),
        address(rotation),
        address(wrench),
    )
    if not (is_array(p, w, 1, WRITABLE) and _is_pose(p, at, turn, f)):
        return _WRONG_SHAPE
    out, rest = vector(address(tension)), vector(address(residual))
    return _solve_at_call(vector(w), vector(at), matrix(turn), vector(f), out, rest)


@compiled
def _solve_at_into_objects(
    pattern: Any, work: Any, position: Any, rotation: Any, wrench: Any, tension: Any
) -> int:
    """`_solve_at_into_call` for objects."""
    p, w, at, turn, f, out = (
        address(pattern),
        address(work),
        address(position),
        address(rotation),
        address(wrench),
        address(tension),
    )
    if not (is_array(p, w, 1, WRITABLE) and _is_pose(p, at, turn, f)):
        return _WRONG_SHAPE
    if not is_array(p, out, 1, WRITABLE):
        return _WRONG_SHAPE
    return _solve_at_into_call(vector(w), vector(at), matrix(turn), vector(f), vector(out))


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
def _fill_limit(pattern: int, limit: int, n: int, number: int, work: FloatArray, at: int) -> bool:
    """Write a limit, a float or a plain (n,) array, to n places from `at`; False: it is neither."""
    if same_kind(number, limit):
        for i in range(n):
            work[at + i] = float_value(limit)
        return True
    if not is_vector(pattern, limit, n, READABLE):
        return False
    each = vector(limit)
    for i in range(n):
        work[at + i] = each[i]
    return True


@compiled
def _distribute_objects(
    pattern: Any,
    number: Any,
    A: Any,
    wrench: Any,
    low: Any,
    high: Any,
    tension: Any,
    residual: Any,
) -> int:
    """`distribute` by minimum norm; `pattern` is its work array, `number` any float.

    Tension and residual are the caller's own; one more tension is for the loss. The work array
    serves all threads, as none gets the interpreter's lock meanwhile.
    """
    p, m, f = address(pattern), address(A), address(wrench)
    if not (is_array(p, m, 2, READABLE) and is_vector(p, f, 6, READABLE)):
        return _WRONG_SHAPE
    n = length(m, 1)
    if length(m, 0) != 6 or not 6 <= n <= MOST_CABLES:
        return _WRONG_SHAPE
    work, limits = vector(p), at_limits(n)
    if not _fill_limit(p, address(low), n, address(number), work, limits):
        return _WRONG_SHAPE
    if not _fill_limit(p, address(high), n, address(number), work, limits + n):
        return _WRONG_SHAPE
    out, rest = vector(address(tension)), vector(address(residual))
    return _one_call(work, matrix(m), vector(f), work[-1] != 0.0, out, rest)


_TYPES = {
    1: types.Array(types.float64, 1, "C"),
    2: types.Array(types.float64, 2, "C"),
}
_Ways = tuple[Any, int, Any, tuple[int, ...]]


def _compile(function: Any, kinds: tuple[Any, ...]) -> Entry:
    """Compile for these types and for nothing else; the builtin function that takes objects."""
    entry: Entry = function.compile(kinds)
    function.disable_compile()
    return entry


def _by_numba(function: Any, ranks: tuple[int, ...]) -> Entry:
    """An entry that numba's own look at its arguments leads to, for other builds of Python."""
    _compile(function, tuple(_TYPES[rank] for rank in ranks))

    def entry(_pattern: FloatArray, *arguments: Any) -> int:
        # Numba takes a byte-swapped array for a native one, a masked one for a plain one.
        plain = all(type(a) is np.ndarray and a.dtype == np.float64 for a in arguments)
        native = plain and all(a.dtype.isnative for a in arguments)
        try:
            return int(function(*arguments)) if native else _WRONG_SHAPE
        except (TypeError, NumbaError):
            return _WRONG_SHAPE

    return entry


def _refuse_all(*_arguments: Any) -> int:
    """In the place of `distribute_entry` where objects are not known: the longer way is right."""
    return _WRONG_SHAPE


_ENTRIES: dict[str, _Ways] = {
    "solve_entry": (_solve_objects, 5, _solve_call, (1, 1, 1, 1)),
    "detect_entry": (_detect_objects, 3, _detect_call, (1, 1)),
    "solve_at_entry": (_solve_at_objects, 7, _solve_at_call, (1, 1, 2, 1, 1, 1)),
    "solve_into_entry": (_solve_into_objects, 4, _solve_into_call, (1, 1, 1)),
    "solve_at_into_entry": (_solve_at_into_objects, 6, _solve_at_into_call, (1, 1, 2, 1, 1)),
    "distribute_entry": (_distribute_objects, 8, None, ()),
}
"""Function that takes objects and how many, function that numba leads to and its arrays' ranks."""
_loading = threading.Lock()


def _load(name: str) -> Entry:
    """Compile or load an entry."""
    objects, count, typed, ranks = _ENTRIES[name]
    if layout_is_known():
        return _compile(objects, (ADDRESS,) * count)
    return _refuse_all if typed is None else _by_numba(typed, ranks)


def _lazy(name: str) -> Entry:
    """Stand in an entry's place until it is first called: each takes 60 ms to load.

    No `__getattr__` of the module: with one, every look at the module costs 40 ns.
    """

    def entry(*arguments: Any) -> int:
        module = globals()
        with _loading:
            if module[name] is entry:
                module[name] = _load(name)
        loaded: Entry = module[name]
        return loaded(*arguments)

    return entry


solve_entry = _lazy("solve_entry")
detect_entry = _lazy("detect_entry")
solve_at_entry = _lazy("solve_at_entry")
solve_into_entry = _lazy("solve_into_entry")
solve_at_into_entry = _lazy("solve_at_into_entry")
distribute_entry = _lazy("distribute_entry")


def load_all() -> None:
    """Compile or load every entry."""
    module = globals()
    with _loading:
        for name in _ENTRIES:
            module[name] = _load(name)
