# SPDX-License-Identifier: Apache-2.0
"""Guards for arguments; written so that NaN fails."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cabols_control.errors import OutOfRangeError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


_NO_NUMBERS = "cVMm"
"""Kinds of arrays that numpy would turn into floats with a loss: complex, structured, times."""


def plain_array(value: ArrayLike) -> FloatArray:
    """Return value as a C-contiguous, aligned, writable float64 array; a copy where it is not.

    Args:
        value: array-like of real numbers, in any byte order.

    Raises:
        TypeError: if it is complex, structured, of times, or has masked entries.
        ValueError: if it is not numeric.
    """
    given = np.asarray(value)
    if given.dtype.kind in _NO_NUMBERS or np.ma.is_masked(value):
        raise TypeError(f"expected real numbers without a mask, got {given.dtype}")
    array = np.ascontiguousarray(given, dtype=np.float64)
    flags = array.flags
    return array if flags.writeable and flags.aligned else array.copy()


def shaped_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return value as a C-contiguous, writable float array of the given shape, finite or not.

    It is the caller's own array where that is one already, else a copy: compiled code takes one
    kind of array, and another would start the compiler or be refused.

    Args:
        name: what the caller calls it, for the message.
        value: array-like of numbers.
        shape: expected shape; None stands for any length.

    Raises:
        ShapeError: if it is not numeric or not of that shape.
    """
    expected = "(" + ", ".join("n" if size is None else str(size) for size in shape) + ")"
    try:
        array = plain_array(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: expected numbers of shape {expected}, got {value!r}") from error
    fits = array.ndim == len(shape) and all(
        size is None or size == actual for size, actual in zip(shape, array.shape, strict=True)
    )
    if not fits:
        turned = array.ndim == len(shape) == 2 and all(
            size is None or size == actual
            for size, actual in zip(shape, array.shape[::-1], strict=True)
        )
        hint = "; transpose?" if turned else ""
        raise ShapeError(f"{name}: expected shape {expected}, got {array.shape}{hint}")
    return array


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return `shaped_array` of finite numbers.

    Args:
        name: what the caller calls it, for the message.
        value: array-like of numbers.
        shape: expected shape; None stands for any length.

    Raises:
        ShapeError: if it is not numeric, not of that shape or not finite.
    """
    array = shaped_array(name, value, shape)
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        index = ", ".join(str(int(i)) for i in where)
        raise ShapeError(f"{name}: expected finite numbers, got {array[tuple(where)]} at [{index}]")
    return array


def one_or_each(name: str, value: ArrayLike, count: int) -> FloatArray:
    """Return a number as (count,) equal ones, and (count,) numbers as they are.

    Args:
        name: what the caller calls it, for the message.
        value: a number, or one for each.
        count: how many.

    Raises:
        ShapeError: if it is neither, or not finite.
    """
    # Not broadcast first: that forgets the mask of a masked array.
    if np.ndim(value) > 0:
        return finite_array(name, value, (count,))
    return np.full(count, finite_array(name, np.ma.asarray(value)[None], (1,))[0])


def unit_rows(name: str, value: ArrayLike, rows: int) -> FloatArray:
    """Check directions and return them as unit vectors, a new array.

    Args:
        name: for messages.
        value: (rows, 3) of any length but zero.
        rows: how many.

    Raises:
        ShapeError: if the shape differs, a number is not finite or a row is no direction.
    """
    directions = finite_array(name, value, (rows, 3)).copy()
    lengths = np.linalg.norm(directions, axis=1)
    for index, length in enumerate(lengths):
        if not length > 1e-9:
            raise ShapeError(f"{name}: expected directions, got zero in row {index + 1}")
    return np.asarray(directions / lengths[:, None], dtype=np.float64)


def in_range(name: str, value: float, lower: float, upper: float) -> float:
    """Return value as a float if lower <= value <= upper.

    Args:
        name: what the caller calls it, for the message.
        value: to be checked.
        lower: least that is allowed.
        upper: largest that is allowed.

    Raises:
        OutOfRangeError: otherwise, NaN included.
    """
    if not lower <= value <= upper:
        raise OutOfRangeError(name, value, lower, upper)
    return float(value)


def rotation_matrix(name: str, value: ArrayLike) -> FloatArray:
    """Return value as a (3, 3) rotation matrix.

    Args:
        name: what the caller calls it, for the message.
        value: (3, 3).

    Raises:
        ShapeError: if it is not (3, 3), finite, orthonormal to 1e-6 and right-handed.
    """
    rotation = finite_array(name, value, (3, 3))
    orthonormal = np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-6
    if not (orthonormal and np.linalg.det(rotation) > 0.0):
        raise ShapeError(
            f"{name}: expected a rotation matrix (orthonormal, determinant +1), "
            f"got determinant {np.linalg.det(rotation):.6g}; normalise the orientation first"
        )
    return rotation
