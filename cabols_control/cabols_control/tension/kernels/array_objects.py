# SPDX-License-Identifier: Apache-2.0
"""Arrays of the caller, read by compiled code where numpy keeps them.

Numba takes an array of Python's by looking up its type and counting a reference: 50 ns each, and
what the type does not say (a mask, another byte order) has to be asked for in Python before. Here
an argument comes as the object's address, and compiled code asks the object itself: is it a
`numpy.ndarray` and no subclass, is its type the native float64, are its memory and shape as they
must be. Two loads and a comparison each, and nothing is converted or counted: who calls holds the
arguments, and the interpreter's lock, until the call returns.

The places are those of CPython's PyObject and of numpy's PyArrayObject_fields, which both keep
stable for extensions (https://numpy.org/doc/stable/reference/c-api/types-and-structures.html).
`layout_is_known` compares them with what Python says of a few arrays; where they differ (a build
without the lock has other objects), calls.py goes numba's way.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import NativeValue, intrinsic, models, register_model, unbox
from numba.np import arrayobj

from cabols_control.checks import FloatArray, IntArray

from .static_size import compiled, inlined

_KIND, _DATA, _RANK, _SHAPE, _DTYPE, _FLAGS = 8, 16, 24, 32, 56, 64
"""Bytes from the start of an array object: its type, memory, rank, shape, element type, flags."""
_VALUE = _DATA
"""Bytes from the start of a float object to its value."""
_RANK_BITS = 0xFFFFFFFF
READABLE = 0x101
"""Flags of an array that is C-contiguous and aligned."""
WRITABLE = 0x501
"""The same, and writeable."""

_WORD = ir.IntType(64)


class _Address(types.Type):
    """Numba's type of a Python object of which the address alone is known."""

    def __init__(self) -> None:
        super().__init__(name="cabols_object_address")


ADDRESS = _Address()
"""Type of an argument that is any Python object; `address` makes an integer of it."""


@register_model(_Address)
class _AddressModel(models.PrimitiveModel):
    """An address is a word."""

    def __init__(self, manager: Any, of: Any) -> None:
        super().__init__(manager, of, _WORD)  # type: ignore[no-untyped-call]


@unbox(_Address)  # type: ignore[no-untyped-call]
def _unbox_address(of: Any, obj: Any, c: Any) -> Any:
    """Any object fits; it is looked at later."""
    return NativeValue(c.builder.ptrtoint(obj, _WORD))  # type: ignore[no-untyped-call]


# Below, what numba calls while it compiles: typing context and arguments' types, then the context,
# builder, signature and values that code is generated with. Numba goes by their names and number.
# ruff: noqa: ANN001, ANN202, ARG001


def _address(typing, obj):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return args[0]

    return types.int64(obj), generate


def _load(kind: Any, of: Any) -> Any:
    """What an intrinsic needs to load one value from an address and offset."""

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(builder.add(*args), of.as_pointer()))

    return kind(types.int64, types.int64), generate


def _word_at(typing, at, offset):  # type: ignore[no-untyped-def]
    return _load(types.int64, _WORD)


def _number_at(typing, at, offset):  # type: ignore[no-untyped-def]
    return _load(types.float64, ir.DoubleType())


def _view(rank: int) -> Any:
    """What an intrinsic needs to make an array of memory that somebody else keeps."""
    view = types.Array(types.float64, rank, "C")

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        array = arrayobj.make_array(view)(context, builder)  # type: ignore[no-untyped-call]
        step = context.get_constant(types.intp, 8)
        strides = [step] if rank == 1 else [builder.mul(args[2], step), step]
        arrayobj.populate_array(  # type: ignore[no-untyped-call]
            array,
            data=builder.inttoptr(args[0], ir.DoubleType().as_pointer()),
            shape=list(args[1:]),
            strides=strides,
            itemsize=step,
            meminfo=None,
            parent=None,
        )
        return array._getvalue()

    return view(*[types.int64] * (1 + rank)), generate


def _vector_of(typing, memory, n):  # type: ignore[no-untyped-def]
    return _view(1)


def _matrix_of(typing, memory, rows, n):  # type: ignore[no-untyped-def]
    return _view(2)


_intrinsic: Any = intrinsic
address: Callable[[Any], int] = _intrinsic(_address)
"""Address of an object as an integer."""
_word: Callable[[int, int], int] = _intrinsic(_word_at)
"""The eight bytes at an address and offset, as an integer."""
_number: Callable[[int, int], float] = _intrinsic(_number_at)
"""The same, as a float64."""
_vector: Callable[[int, int], FloatArray] = _intrinsic(_vector_of)
"""(n,) view of the memory at an address."""
_matrix: Callable[[int, int, int], FloatArray] = _intrinsic(_matrix_of)
"""(rows, n) view of the memory at an address."""


@inlined
def is_array(pattern: int, obj: int, rank: int, flags: int) -> bool:
    """Whether an object is a float64 array as plain as `pattern`, of this rank, with these flags.

    Args:
        pattern: address of a float64 array.
        obj: address of any object; nothing but its type is read before that is right.
        rank: number of dimensions.
        flags: READABLE or WRITABLE.
    """
    return (
        _word(obj, _KIND) == _word(pattern, _KIND)
        and _word(obj, _DTYPE) == _word(pattern, _DTYPE)
        and _word(obj, _RANK) & _RANK_BITS == rank
        and _word(obj, _FLAGS) & flags == flags
    )


@inlined
def same_kind(pattern: int, obj: int) -> bool:
    """Whether two objects have the same Python type.

    Args:
        pattern: address of an object of the type that is meant.
        obj: address of any object.
    """
    return _word(obj, _KIND) == _word(pattern, _KIND)


@inlined
def length(array: int, axis: int) -> int:
    """Length of an array's axis.

    Args:
        array: its address; `is_array` has been asked before.
        axis: from 0, below its rank.
    """
    return _word(_word(array, _SHAPE), 8 * axis)


@inlined
def is_vector(pattern: int, obj: int, n: int, flags: int) -> bool:
    """Whether an object is a plain (n,) float64 array.

    Args:
        pattern: address of a float64 array.
        obj: address of any object.
        n: length that it must have.
        flags: READABLE or WRITABLE.
    """
    return is_array(pattern, obj, 1, flags) and length(obj, 0) == n


@inlined
def is_matrix(pattern: int, obj: int, rows: int, n: int) -> bool:
    """Whether an object is a plain (rows, n) float64 array that can be read.

    Args:
        pattern: address of a float64 array.
        obj: address of any object.
        rows: how many it must have.
        n: length that each must have.
    """
    right = is_array(pattern, obj, 2, READABLE)
    return right and length(obj, 0) == rows and length(obj, 1) == n


@inlined
def vector(array: int) -> FloatArray:
    """View of a plain array of one dimension."""
    return _vector(_word(array, _DATA), length(array, 0))


@inlined
def matrix(array: int) -> FloatArray:
    """View of a plain array of two dimensions."""
    return _matrix(_word(array, _DATA), length(array, 0), length(array, 1))


@inlined
def float_value(obj: int) -> float:
    """Value of a Python float."""
    return _number(obj, _VALUE)


@compiled
def _fields(obj: Any, rank: int, out: IntArray) -> None:
    """What this file reads of an array, for `layout_is_known`; of any object if rank is -1."""
    at = address(obj)
    out[0], out[1] = _word(at, _KIND), _word(at, _DATA)
    if rank >= 0:
        out[2], out[3] = _word(at, _RANK) & _RANK_BITS, _word(at, _DTYPE)
        out[4] = _word(at, _FLAGS) & WRITABLE
    if rank > 0 and out[2] == rank:
        for axis in range(rank):
            out[5 + axis] = length(at, axis)


def layout_is_known() -> bool:
    """Whether objects look as this file reads them; compared with what Python says of some."""
    locked = getattr(sys, "_is_gil_enabled", lambda: True)()
    if not (sys.implementation.name == "cpython" and sys.maxsize == 2**63 - 1 and locked):
        return False
    fields = _fields.compile((ADDRESS, types.int64, types.Array(types.int64, 1, "C")))
    plain, fixed, found = np.arange(6.0).reshape(2, 3), np.arange(4.0), np.zeros(7, np.int64)
    fixed.flags.writeable = False
    for array in (plain, fixed, plain[:, ::2], np.arange(5, dtype=np.float32), plain.T):
        fields(array, array.ndim, found)
        stated = [id(type(array)), array.ctypes.data, array.ndim, id(array.dtype)]
        stated += [array.flags.num & WRITABLE, *array.shape]
        if found[: len(stated)].tolist() != stated:
            return False
    number = 1.5
    fields(number, -1, found)
    return bool(found[0] == id(float) and found[1:2].view(np.float64)[0] == number)
