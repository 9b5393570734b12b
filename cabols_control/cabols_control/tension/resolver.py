"""Solvers to keep: one for a fixed pose, one for a rig whose pose changes with every call.

Both hold one work array, so an object serves one thread. A call costs about a microsecond, most
of it the way from Python into compiled code: few arguments, and status and iterations in one
integer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import structure_matrix_into
from cabols_control.checks import finite_array
from cabols_control.errors import ShapeError

from .distribution import MIN_CABLES, check_limits, check_matrix, check_weights, check_wrench
from .kernels.basis import prepare_pose
from .kernels.dispatch import detect_prepared, solve_batch, solve_pose_batch, solve_prepared
from .kernels.eight_cables import solve_pose_eight
from .kernels.static_size import compiled
from .kernels.work_array import CABLES, ITERATIONS, at_limits, at_structure, at_weights, work_size
from .solution import FEASIBLE, FloatArray, IntArray, TensionSolution

_WRONG_SHAPE = 3
_STATUS_BITS = 3
_METHOD = "min_norm"
_new = tuple.__new__
_empty = np.empty


@compiled
def _solve_call(
    work: FloatArray, wrench: FloatArray, tension: FloatArray, residual: FloatArray
) -> int:
    """`solve_prepared` with a shape check; iterations stand above the status."""
    if wrench.shape[0] != 6 or tension.shape[0] != int(work[CABLES]):
        return _WRONG_SHAPE
    status = solve_prepared(work, wrench, tension, residual)
    return status + (int(work[ITERATIONS]) << _STATUS_BITS)


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
    """Structure matrix, basis and solution; the rig's points lie at the end of `work`.

    Its limits and weights lie where prepare_pose writes them: it reads them there, too.
    """
    if position.shape[0] != 3 or rotation.shape != (3, 3) or wrench.shape[0] != 6:
        return _WRONG_SHAPE
    n = int(work[CABLES])
    if tension.shape[0] != n:
        return _WRONG_SHAPE
    start = work_size(n)
    base = work[start : start + 3 * n].reshape((n, 3))
    platform = work[start + 3 * n : start + 6 * n].reshape((n, 3))
    A = work[at_structure(n) : at_structure(n) + 6 * n].reshape((6, n))
    low = work[at_limits(n) : at_limits(n) + n]
    high = work[at_limits(n) + n : at_limits(n) + 2 * n]
    structure_matrix_into(base, platform, position, rotation, A)
    if n == 8 and solve_pose_eight(work, low, high, wrench, tension):
        for row in range(6):
            total = -wrench[row]
            for i in range(8):
                total += A[row, i] * tension[i]
            residual[row] = total
        return FEASIBLE + (int(work[ITERATIONS]) << _STATUS_BITS)
    weights = work[at_weights(n) : at_weights(n) + 6]
    prepare_pose(A, low, high, weights, work)
    return _solve_call(work, wrench, tension, residual)


def _entry(function: Any, *ranks: int) -> Callable[..., int]:
    """Compile for C-contiguous float64 arrays of these ranks and for nothing else.

    Other arguments then raise TypeError instead of starting the compiler inside a loop.
    """
    function.compile(tuple(types.Array(types.float64, rank, "C") for rank in ranks))
    function.disable_compile()
    entry: Callable[..., int] = function
    return entry


_entry_solve = _entry(_solve_call, 1, 1, 1, 1)
_entry_detect = _entry(_detect_call, 1, 1)
_entry_solve_at = _entry(_solve_at_call, 1, 1, 2, 1, 1, 1)


def _refuse(wrench: ArrayLike) -> NoReturn:
    """Say what is wrong with a wrench that the compiled code refused."""
    check_wrench(wrench)
    raise ShapeError(f"wrench: expected six finite numbers, got {wrench!r}; check the pose, too")


def _refuse_into(wrench: FloatArray, tension: FloatArray, n: int) -> NoReturn:
    """Say what is wrong with a wrench or an output array."""
    if tension.shape != (n,):
        raise ShapeError(f"tension: expected shape ({n},), got {tension.shape}; one per cable")
    _refuse(wrench)


class TensionResolver:
    """Redundancy resolution at one pose, for many wrenches; see `distribute` for what it solves.

    Args:
        A: (6, n) structure matrix, n >= 6, base axes [1; m].
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        weights: (6,) of the nearest wrench; default as in `distribute`.

    Attributes:
        work: the work array that the compiled functions take.
        cables: number n of cables.
        deficient: True if A is nearly rank-deficient.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """

    __slots__ = ("_residual", "cables", "deficient", "work")

    def __init__(
        self,
        A: ArrayLike,
        tension_min: ArrayLike,
        tension_max: ArrayLike,
        weights: ArrayLike | None = None,
    ) -> None:
        """Check everything and prepare the pose."""
        matrix = check_matrix(A)
        self.cables = int(matrix.shape[1])
        limits = check_limits(self.cables, tension_min, tension_max)
        self.work = np.zeros(work_size(self.cables))
        self._residual = np.zeros(6)
        self.deficient = prepare_pose(matrix, *limits, check_weights(weights), self.work) == 1

    def solve(self, wrench: ArrayLike) -> TensionSolution:
        """Tensions for one wrench, (6,) [N], [N m]; fastest for a float64 array.

        Raises:
            ShapeError: if the wrench is not (6,) or not finite.
        """
        tension, residual = _empty(self.cables), _empty(6)
        try:
            code = _entry_solve(self.work, wrench, tension, residual)
        except TypeError:  # a list, float32, strided: convert, then the same way
            code = _entry_solve(self.work, check_wrench(wrench), tension, residual)
        status = code & 7
        if status > 1:
            _refuse(wrench)
        return _new(
            TensionSolution, (tension, status == 0, residual, _METHOD, code >> _STATUS_BITS)
        )

    def solve_into(self, wrench: FloatArray, tension: FloatArray) -> bool:
        """Tensions for one wrench into an array, for loops that allocate nothing.

        Args:
            wrench: (6,) float64 [N], [N m].
            tension: (n,) float64, filled [N].

        Returns:
            True if feasible; otherwise the tensions are those of the nearest feasible wrench.

        Raises:
            ShapeError: if the wrench is not (6,) or not finite, or tension is not (n,).
        """
        status = _entry_solve(self.work, wrench, tension, self._residual) & 7
        if status > 1:
            _refuse_into(wrench, tension, self.cables)
        return bool(status == 0)

    def feasible(self, wrench: ArrayLike) -> bool:
        """Whether the wrench, (6,) [N], [N m], is feasible, without the nearest one.

        Raises:
            ShapeError: if the wrench is not (6,) or not finite.
        """
        try:
            status = _entry_detect(self.work, wrench)
        except TypeError:
            status = _entry_detect(self.work, check_wrench(wrench))
        if status > 1:
            _refuse(wrench)
        return bool(status == FEASIBLE)

    def solve_batch(
        self, wrenches: ArrayLike, out: tuple[FloatArray, IntArray] | None = None
    ) -> tuple[FloatArray, IntArray]:
        """Tensions for many wrenches, the same bits as one by one.

        Args:
            wrenches: (k, 6) [N], [N m]; rows that are not finite get status 2, not an error.
            out: (k, n) float64 and (k,) int64 to fill; new arrays where None. Fresh memory can
                cost more than the solving.

        Returns:
            (k, n) tensions [N] and (k,) status: 0 feasible, 1 infeasible (nearest wrench's
            tensions), 2 not finite (tension_min).

        Raises:
            ShapeError: if the wrenches are not (k, 6).
        """
        array = _batch("wrenches", wrenches, (6,))
        tensions, status = _batch_out(out, array.shape[0], self.cables)
        solve_batch(self.work, array, tensions, status)
        return tensions, status


class RigTensionResolver:
    """Redundancy resolution for a rig at a new pose with every call, structure matrix included.

    Args:
        base_points: (n, 3) A_i, n >= 6, base frame [m].
        platform_points: (n, 3) b_i, platform frame [m].
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        weights: (6,) of the nearest wrench; default as in `distribute`.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """

    __slots__ = ("_limits", "_points", "_residual", "_weights", "cables", "work")

    def __init__(
        self,
        base_points: ArrayLike,
        platform_points: ArrayLike,
        tension_min: ArrayLike,
        tension_max: ArrayLike,
        weights: ArrayLike | None = None,
    ) -> None:
        """Check everything and put limits and weights where the compiled code finds them."""
        base = finite_array("base_points", base_points, (None, 3))
        n = self.cables = int(base.shape[0])
        if n < MIN_CABLES:
            raise ShapeError(
                f"base_points: expected at least {MIN_CABLES} cables, got {n}; add some"
            )
        platform = finite_array("platform_points", platform_points, (n, 3))
        self._points = np.ascontiguousarray(np.stack([base, platform]))
        self._limits = check_limits(n, tension_min, tension_max)
        self._weights = check_weights(weights)
        self.work = np.zeros(work_size(n) + 6 * n)
        self._residual = np.zeros(6)
        self.work[CABLES] = n
        self.work[-6 * n :] = self._points.ravel()
        start = at_limits(n)
        self.work[start : start + 2 * n] = np.concatenate(self._limits)
        self.work[at_weights(n) : at_weights(n) + 6] = self._weights

    def solve(self, position: ArrayLike, rotation: ArrayLike, wrench: ArrayLike) -> TensionSolution:
        """Tensions for one wrench at one pose.

        Args:
            position: (3,) platform origin, base frame [m].
            rotation: (3, 3) from platform to base axes; not checked to be a rotation.
            wrench: (6,) [N], [N m] about the platform's origin, base axes.

        Raises:
            ShapeError: if an argument has another shape or is not finite.
        """
        tension, residual = _empty(self.cables), _empty(6)
        try:
            code = _entry_solve_at(self.work, position, rotation, wrench, tension, residual)
        except TypeError:
            code = _entry_solve_at(
                self.work,
                finite_array("position", position, (3,)),
                finite_array("rotation", rotation, (3, 3)),
                check_wrench(wrench),
                tension,
                residual,
            )
        status = code & 7
        if status > 1:
            finite_array("position", position, (3,))
            finite_array("rotation", rotation, (3, 3))
            _refuse(wrench)
        return _new(
            TensionSolution, (tension, status == 0, residual, _METHOD, code >> _STATUS_BITS)
        )

    def solve_into(
        self, position: FloatArray, rotation: FloatArray, wrench: FloatArray, tension: FloatArray
    ) -> bool:
        """Tensions for one wrench at one pose into an array; float64 arrays only, see solve.

        Returns:
            True if feasible; otherwise the tensions are those of the nearest feasible wrench.

        Raises:
            ShapeError: if an argument has another shape or is not finite.
        """
        code = _entry_solve_at(self.work, position, rotation, wrench, tension, self._residual)
        status = code & 7
        if status > 1:
            finite_array("position", position, (3,))
            finite_array("rotation", rotation, (3, 3))
            _refuse_into(wrench, tension, self.cables)
        return bool(status == 0)

    def solve_batch(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        wrenches: ArrayLike,
        out: tuple[FloatArray, IntArray] | None = None,
    ) -> tuple[FloatArray, IntArray]:
        """One wrench at each of many poses: (k, 3) [m], (k, 3, 3), (k, 6) [N], [N m].

        Returns:
            (k, n) tensions [N] and (k,) status as `TensionResolver.solve_batch`.

        Raises:
            ShapeError: if the arguments are not of these shapes.
        """
        wrench = _batch("wrenches", wrenches, (6,))
        k = wrench.shape[0]
        position = _batch("positions", positions, (3,), k)
        rotation = _batch("rotations", rotations, (3, 3), k)
        tensions, status = _batch_out(out, k, self.cables)
        solve_pose_batch(
            self.work,
            self._points[0],
            self._points[1],
            position,
            rotation,
            wrench,
            *self._limits,
            self._weights,
            tensions,
            status,
        )
        return tensions, status


def _batch_out(
    out: tuple[FloatArray, IntArray] | None, count: int, n: int
) -> tuple[FloatArray, IntArray]:
    """Return the caller's arrays, checked, or new ones."""
    if out is None:
        return np.empty((count, n)), np.empty(count, dtype=np.int64)
    tensions, status = out
    fits = tensions.shape == (count, n) and status.shape == (count,)
    if not (fits and tensions.dtype == np.float64 and status.dtype == np.int64):
        raise ShapeError(
            f"out: expected float64 ({count}, {n}) and int64 ({count},), got {tensions.dtype} "
            f"{tensions.shape} and {status.dtype} {status.shape}"
        )
    return tensions, status


def _batch(
    name: str, value: ArrayLike, row: tuple[int, ...], count: int | None = None
) -> FloatArray:
    """Return value as a C-contiguous (k, *row) array; it need not be finite."""
    array = np.ascontiguousarray(value, dtype=np.float64)
    fits = array.ndim == 1 + len(row) and array.shape[1:] == row
    if not fits or (count is not None and array.shape[0] != count):
        length = "k" if count is None else str(count)
        raise ShapeError(
            f"{name}: expected shape ({', '.join([length, *map(str, row)])}), got {array.shape}; "
            "one row per case"
        )
    return array
