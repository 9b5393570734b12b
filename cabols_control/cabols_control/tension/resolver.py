# SPDX-License-Identifier: Apache-2.0
"""Solvers to keep: one for a fixed pose, one for a rig whose pose changes with every call.

Each holds one work array, so an object serves one thread.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import CABLE, cable_records, refuse_short_cable
from cabols_control.checks import FloatArray, IntArray, finite_array, unit_rows
from cabols_control.errors import ShapeError

from . import calls
from .arguments import (
    MIN_CABLES,
    batch_outputs,
    batch_rows,
    check_limits,
    check_matrix,
    check_weights,
    check_wrench,
    output_row,
    refuse_output,
    refuse_wrench,
)
from .calls import NOT_PLAIN, PATTERN, SOFTENED, STATUS_MASK, STEP_BITS
from .kernels.basis import prepare_pose
from .kernels.dispatch import solve_batch, solve_pose_batch
from .kernels.work_array import (
    CABLES,
    EXACT,
    FEASIBLE,
    INFEASIBLE,
    LOSS,
    at_limits,
    at_weights,
    rig_work_size,
    work_size,
)
from .solution import TensionSolution

_METHOD = "min_norm"
_new = tuple.__new__
_empty = np.empty


class TensionResolver:
    """Redundancy resolution at one pose, for many wrenches; see `distribute` for the problem.

    Args:
        A: (6, n) structure matrix, n >= 6, base axes [1; m].
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        weights: (6,) of the nearest wrench; default as in `distribute`.
        exact: as in `distribute`.

    Attributes:
        work: the work array that the compiled functions take.
        cables: number n of cables.
        deficient: True if A is nearly rank-deficient.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """

    __slots__ = ("cables", "deficient", "work")

    def __init__(
        self,
        A: ArrayLike,
        tension_min: ArrayLike,
        tension_max: ArrayLike,
        weights: ArrayLike | None = None,
        exact: bool = False,
    ) -> None:
        """Check everything and prepare the pose."""
        matrix = check_matrix(A)
        self.cables = int(matrix.shape[1])
        limits = check_limits(self.cables, tension_min, tension_max)
        self.work = np.zeros(work_size(self.cables))
        self.work[EXACT] = 1.0 if exact else 0.0
        self.deficient = prepare_pose(matrix, *limits, check_weights(weights), self.work) == 1

    def solve(self, wrench: ArrayLike) -> TensionSolution:
        """Tensions for one wrench, (6,) [N], [N m]; fastest for a float64 array.

        Raises:
            ShapeError: if the wrench is not (6,) or not finite.
        """
        tension, residual = _empty(self.cables), _empty(6)
        code = calls.solve_entry(PATTERN, self.work, wrench, tension, residual)
        if not code & NOT_PLAIN:
            return _new(TensionSolution, (tension, True, residual, _METHOD, code >> STEP_BITS, 0.0))
        status = code & STATUS_MASK
        if status > INFEASIBLE:  # a list, float32, strided: convert, then the same way
            other = check_wrench(wrench)
            code = calls.solve_entry(PATTERN, self.work, other, tension, residual)
            status = code & STATUS_MASK
            if status > INFEASIBLE:
                refuse_wrench(wrench)
        loss = self.work.item(LOSS) if code & SOFTENED else 0.0
        steps = code >> STEP_BITS
        return _new(TensionSolution, (tension, status == 0, residual, _METHOD, steps, loss))

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
        status = calls.solve_into_entry(PATTERN, self.work, wrench, tension)
        if status > INFEASIBLE:  # a list, float32, strided: convert, then the same way
            tension, other = output_row(tension, self.cables), check_wrench(wrench)
            status = calls.solve_into_entry(PATTERN, self.work, other, tension)
            if status > INFEASIBLE:
                refuse_output(wrench, tension, self.cables)
        return status == FEASIBLE

    def feasible(self, wrench: ArrayLike) -> bool:
        """Whether the wrench, (6,) [N], [N m], is feasible, without the nearest one.

        Raises:
            ShapeError: if the wrench is not (6,) or not finite.
        """
        status = calls.detect_entry(PATTERN, self.work, wrench)
        if status > INFEASIBLE:
            status = calls.detect_entry(PATTERN, self.work, check_wrench(wrench))
            if status > INFEASIBLE:
                refuse_wrench(wrench)
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
        array = batch_rows("wrenches", wrenches, (6,))
        tensions, status = batch_outputs(out, array.shape[0], self.cables)
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
        exact: as in `distribute`.
        pulley_radius: number or (n,) [m], as in RigGeometry.
        pulley_axes: (n, 3) directions, needed where there are pulleys.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """

    __slots__ = ("cables", "work")

    def __init__(
        self,
        base_points: ArrayLike,
        platform_points: ArrayLike,
        tension_min: ArrayLike,
        tension_max: ArrayLike,
        weights: ArrayLike | None = None,
        exact: bool = False,
        pulley_radius: ArrayLike = 0.0,
        pulley_axes: ArrayLike | None = None,
    ) -> None:
        """Check everything and put limits and weights where the compiled code finds them."""
        base = finite_array("base_points", base_points, (None, 3))
        n = self.cables = int(base.shape[0])
        if n < MIN_CABLES:
            raise ShapeError(
                f"base_points: expected at least {MIN_CABLES} cables, got {n}; add some"
            )
        platform = finite_array("platform_points", platform_points, (n, 3))
        limits, start = check_limits(n, tension_min, tension_max), at_limits(n)
        self.work = np.zeros(rig_work_size(n))
        self.work[CABLES] = n
        self.work[EXACT] = 1.0 if exact else 0.0
        self.work[start : start + 2 * n] = np.concatenate(limits)
        self.work[at_weights(n) : at_weights(n) + 6] = check_weights(weights)
        radius = finite_array("pulley_radius", np.broadcast_to(pulley_radius, (n,)), (n,))
        axes = None if pulley_axes is None else unit_rows("pulley_axes", pulley_axes, n)
        if not (radius >= 0.0).all():
            raise ShapeError(f"pulley_radius: expected none below 0, got {radius.min():g}")
        if axes is None and radius.any():
            raise ShapeError("pulley_axes: expected them beside pulley_radius, got None")
        self.work[work_size(n) :] = cable_records(base, platform, radius, axes).view(np.float64)

    def solve(self, position: ArrayLike, rotation: ArrayLike, wrench: ArrayLike) -> TensionSolution:
        """Tensions for one wrench at one pose.

        Args:
            position: (3,) platform origin, base frame [m].
            rotation: (3, 3) from platform to base axes; not checked to be a rotation.
            wrench: (6,) [N], [N m] about the platform's origin, base axes.

        Raises:
            ShapeError: if an argument has another shape or is not finite, or a cable has no length
                at the pose.
        """
        tension, residual = _empty(self.cables), _empty(6)
        entry = calls.solve_at_entry
        code = entry(PATTERN, self.work, position, rotation, wrench, tension, residual)
        if not code & NOT_PLAIN:
            return _new(TensionSolution, (tension, True, residual, _METHOD, code >> STEP_BITS, 0.0))
        status = code & STATUS_MASK
        if status > INFEASIBLE:
            place = finite_array("position", position, (3,))
            turn = finite_array("rotation", rotation, (3, 3))
            code = entry(PATTERN, self.work, place, turn, check_wrench(wrench), tension, residual)
            status = code & STATUS_MASK
            if status > INFEASIBLE:
                self._refuse_pose(place, turn)
                refuse_wrench(wrench)
        loss = self.work.item(LOSS) if code & SOFTENED else 0.0
        steps = code >> STEP_BITS
        return _new(TensionSolution, (tension, status == 0, residual, _METHOD, steps, loss))

    def _refuse_pose(self, place: FloatArray, turn: FloatArray) -> None:
        """Say what is wrong with a pose that the compiled code refused, if it is the pose."""
        refuse_short_cable(self.work[work_size(self.cables) :].view(CABLE), place, turn)

    def solve_into(
        self, position: FloatArray, rotation: FloatArray, wrench: FloatArray, tension: FloatArray
    ) -> bool:
        """Tensions for one wrench at one pose into an array; fastest for float64 arrays, see solve.

        Args:
            position: (3,) of the platform in the base frame [m].
            rotation: (3, 3) from platform to base axes.
            wrench: (6,) on the platform [N, N m].
            tension: (n,) to be filled [N].

        Returns:
            True if feasible; otherwise the tensions are those of the nearest feasible wrench.

        Raises:
            ShapeError: if an argument has another shape or is not finite.
        """
        entry = calls.solve_at_into_entry
        status = entry(PATTERN, self.work, position, rotation, wrench, tension)
        if status > INFEASIBLE:
            place = finite_array("position", position, (3,))
            turn = finite_array("rotation", rotation, (3, 3))
            other, tension = check_wrench(wrench), output_row(tension, self.cables)
            status = entry(PATTERN, self.work, place, turn, other, tension)
            if status > INFEASIBLE:
                self._refuse_pose(place, turn)
                refuse_output(wrench, tension, self.cables)
        return status == FEASIBLE

    def solve_batch(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        wrenches: ArrayLike,
        out: tuple[FloatArray, IntArray] | None = None,
    ) -> tuple[FloatArray, IntArray]:
        """One wrench at each of many poses: (k, 3) [m], (k, 3, 3), (k, 6) [N], [N m].

        Args:
            positions: (k, 3) of the platform in the base frame [m].
            rotations: (k, 3, 3) from platform to base axes.
            wrenches: (k, 6) on the platform [N, N m].
            out: (k, n) tensions [N] and (k,) status to be filled; None: new arrays.

        Returns:
            (k, n) tensions [N] and (k,) status as `TensionResolver.solve_batch`; 2 also where a
            cable has no length at the pose.

        Raises:
            ShapeError: if the arguments are not of these shapes.
        """
        wrench = batch_rows("wrenches", wrenches, (6,))
        k = wrench.shape[0]
        position = batch_rows("positions", positions, (3,), k)
        rotation = batch_rows("rotations", rotations, (3, 3), k)
        tensions, status = batch_outputs(out, k, self.cables)
        solve_pose_batch(self.work, position, rotation, wrench, tensions, status)
        return tensions, status
