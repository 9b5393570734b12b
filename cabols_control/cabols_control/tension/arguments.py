# SPDX-License-Identifier: Apache-2.0
"""Arguments of redundancy resolution: checked, converted, or refused with what to do."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, IntArray, finite_array, plain_array
from cabols_control.errors import CabolsError, ShapeError
from cabols_control.naming import cable_name

MIN_CABLES = 6
WEIGHT_LENGTH_M = 0.15
"""Torque counts as force at this radius, the reference platform's, in the default weights."""
LARGEST_ENTRY = 1e99
"""Components of a wrench beyond this count as not finite: their squares would overflow."""
FORCE_WEIGHT, TORQUE_WEIGHT = 1.0, 1.0 / WEIGHT_LENGTH_M
DEFAULT_WEIGHTS = (*[FORCE_WEIGHT] * 3, *[TORQUE_WEIGHT] * 3)


def check_limits(
    n: int, tension_min: ArrayLike, tension_max: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return both limits as (n,) arrays [N].

    Args:
        n: number of cables.
        tension_min: least tension [N], one or (n,).
        tension_max: largest tension [N], one or (n,).

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
    if not np.abs(array).max() < LARGEST_ENTRY:
        raise ShapeError(f"wrench: expected components below 1e99, got {array}; check the units")
    return array


def refuse_wrench(wrench: ArrayLike) -> NoReturn:
    """Say what is wrong with a wrench that the compiled code refused."""
    check_wrench(wrench)
    raise ShapeError(f"wrench: expected six finite numbers, got {wrench!r}; check the pose, too")


def refuse_output(wrench: FloatArray, tension: FloatArray, n: int) -> NoReturn:
    """Say what is wrong with a wrench or an output array.

    Args:
        wrench: that was given, (6,) is right.
        tension: array for the result, (n,) is right.
        n: number of cables.
    """
    if tension.shape != (n,):
        raise ShapeError(f"tension: expected shape ({n},), got {tension.shape}; one per cable")
    refuse_wrench(wrench)


def batch_outputs(
    out: tuple[FloatArray, IntArray] | None, count: int, n: int
) -> tuple[FloatArray, IntArray]:
    """Return the caller's arrays, checked, or new ones.

    Args:
        out: (k, n) tensions [N] and (k,) status to be filled; None: new arrays.
        count: k, number of wrenches.
        n: number of cables.
    """
    if out is None:
        return np.empty((count, n)), np.empty(count, dtype=np.int64)
    tensions, status = out
    fits = tensions.shape == (count, n) and status.shape == (count,)
    if not (fits and tensions.dtype == np.float64 and status.dtype == np.int64):
        raise ShapeError(
            f"out: expected float64 ({count}, {n}) and int64 ({count},), got {tensions.dtype} "
            f"{tensions.shape} and {status.dtype} {status.shape}"
        )
    for array in (tensions, status):
        if not (array.flags.c_contiguous and array.flags.writeable and array.flags.aligned):
            raise ShapeError(
                "out: expected C-contiguous, writable arrays, got others; make them by np.empty"
            )
    return tensions, status


def output_row(tension: FloatArray, n: int) -> FloatArray:
    """Return the array that a solver fills, if it can be filled in place.

    Args:
        tension: the caller's array.
        n: number of cables.

    Raises:
        ShapeError: if it is not (n,) float64, C-contiguous and writable.
    """
    fits = isinstance(tension, np.ndarray) and tension.dtype == np.float64
    if not (fits and tension.shape == (n,)):
        shape = getattr(tension, "shape", None)
        raise ShapeError(f"tension: expected shape ({n},) of float64, got {shape}; one per cable")
    flags = tension.flags
    if not (flags.c_contiguous and flags.writeable and flags.aligned):
        raise ShapeError("tension: expected a C-contiguous, writable array; make it by np.empty")
    return tension


def batch_rows(
    name: str, value: ArrayLike, row: tuple[int, ...], count: int | None = None
) -> FloatArray:
    """Return value as a C-contiguous (k, *row) array; it need not be finite.

    Args:
        name: of the argument, for messages.
        value: of the caller, of any form that numpy takes.
        row: shape of one entry.
        count: k that is expected; None: any.
    """
    try:
        array = plain_array(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: expected rows of numbers, got {value!r}") from error
    fits = array.ndim == 1 + len(row) and array.shape[1:] == row
    if not fits or (count is not None and array.shape[0] != count):
        length = "k" if count is None else str(count)
        raise ShapeError(
            f"{name}: expected shape ({', '.join([length, *map(str, row)])}), got {array.shape}; "
            "one row per case"
        )
    return array
