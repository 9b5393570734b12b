# SPDX-License-Identifier: Apache-2.0
"""Messages of any type whose fields are, one after the other and all at once, what nobody expects.

From rclpy's own definition of a type, so that a new field is tried without a line here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import deepcopy
from importlib import import_module
from typing import Any

import numpy as np

FLOATS = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, -1.0, 0.0, 5e-324)
SINGLES = (float("nan"), float("inf"), float("-inf"), 3e38, -3e38, -1.0, 0.0)
TEXTS = (
    "",
    "x" * 100_000,
    "../" * 50,
    "\u202e",
    "<script>",
    "n\x1b[2J\n",
    "1e999",
    "\U0001f480",
)
LENGTHS = (0, 1, 7, 9, 4096)
STAMPS = ((-(2**31), 0), (2**31 - 1, 2**32 - 1), (0, 0), (-1, 999_999_999))
_INTEGER = re.compile(r"u?int(\d+)")
_ARRAY = re.compile(r"(?:sequence<([\w/]+)(?:, *\d+)?>|([\w/]+)\[(\d+)\])")


def message_class(kind: str) -> Any:
    """Class of a type named as rclpy does: package/Name."""
    package, _, name = kind.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


def scalars(kind: str) -> tuple[Any, ...]:
    """Hostile values of a primitive type."""
    if kind == "double":
        return FLOATS
    if kind == "float":
        return SINGLES
    if kind.startswith("string"):
        return TEXTS
    if kind == "boolean":
        return (True, False)
    if kind == "octet":
        return (b"\x00", b"\xff")
    bits = int(_INTEGER.fullmatch(kind)[1])
    if kind.startswith("u"):
        return (0, 1, 2 ** (bits - 1), 2**bits - 1)
    return (-(2 ** (bits - 1)), -1, 0, 2 ** (bits - 1) - 1)


def values(kind: str) -> Iterator[Any]:
    """Hostile values of a field."""
    if kind == "builtin_interfaces/Time":
        for sec, nanosec in STAMPS:
            yield message_class(kind)(sec=sec, nanosec=nanosec)
        return
    array = _ARRAY.fullmatch(kind)
    if array is None:
        if "/" in kind:
            yield from hostile(message_class(kind))
        else:
            yield from scalars(kind)
        return
    inner = array[1] or array[2]
    fixed = array[3] and int(array[3])
    few = list(hostile(message_class(inner)))[:40] if "/" in inner else list(scalars(inner))
    for count in (fixed,) if fixed else LENGTHS:
        for value in few if count and count < 100 else few[:1]:
            made = [value] * count
            if ("/" not in inner and inner in ("double", "float")) or _INTEGER.fullmatch(inner):
                kinds = {"double": "f8", "float": "f4"}
                made = np.array(made, dtype=kinds.get(inner) or inner)
            yield made


def hostile(kind: Any, usual: Any = None) -> Iterator[Any]:
    """Messages of a class: one for each field and value, then some with all fields at once.

    Args:
        kind: message class.
        usual: from which the other fields are taken; None: a new message.
    """
    base = kind() if usual is None else usual
    fields = kind.get_fields_and_field_types()
    for name, text in fields.items():
        nested = "/" in text and not _ARRAY.fullmatch(text) and text != "builtin_interfaces/Time"
        found = hostile(message_class(text), getattr(base, name)) if nested else values(text)
        for value in found:
            made = deepcopy(base)
            setattr(made, name, value)
            yield made
    pools = {name: list(values(text))[:60] for name, text in fields.items()}
    for turn in range(8):
        made = kind()
        for name, pool in pools.items():
            if pool:
                setattr(made, name, deepcopy(pool[turn % len(pool)]))
        yield made


def numbers_of(message: Any) -> Iterator[float]:
    """All floating-point numbers of a message."""
    for name, text in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        array = _ARRAY.fullmatch(text)
        inner = text if array is None else array[1] or array[2]
        members = [value] if array is None else list(value)
        if "/" in inner:
            for member in members:
                yield from numbers_of(member)
        elif inner in ("double", "float"):
            yield from map(float, members)
