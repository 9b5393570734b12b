# SPDX-License-Identifier: Apache-2.0
"""Packages of RTDE, protocol version 2: a size, a type and fields, all big endian; pure.

After the maker's guide, "Real-Time Data Exchange (RTDE)": recipes name the fields that a data
package holds, and the controller answers with their types.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

from cabols_hw.abb.errors import RobotError

VERSION = 2
PORT = 30004
HEAD = struct.Struct(">HB")
LARGEST = 4096
"""Longest package of a controller [bytes]; the guide's recipes are shorter."""


class PackageType(IntEnum):
    """Second field of each package."""

    REQUEST_PROTOCOL_VERSION = 86
    GET_URCONTROL_VERSION = 118
    TEXT_MESSAGE = 77
    DATA_PACKAGE = 85
    SETUP_OUTPUTS = 79
    SETUP_INPUTS = 73
    START = 83
    PAUSE = 80


FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""struct's format of each type."""
REFUSED = ("NOT_FOUND", "IN_USE")
"""In the place of a type: no such field, or an input that another client writes."""


class Package(NamedTuple):
    """One package.

    Attributes:
        kind: a PackageType, or a number that is none.
        payload: behind the head.
    """

    kind: int
    payload: bytes


def packed(kind: PackageType, payload: bytes = b"") -> bytes:
    """Bytes of a package.

    Args:
        kind: of it.
        payload: behind the head.
    """
    return HEAD.pack(HEAD.size + len(payload), kind) + payload


class Splitter:
    """Takes a stream of bytes apart into packages."""

    def __init__(self) -> None:
        """Start empty."""
        self._rest = b""

    def feed(self, received: bytes) -> list[Package]:
        """Packages that are complete now, in order.

        Args:
            received: next bytes of the stream.

        Raises:
            RobotError: if the bytes are no packages: the stream cannot be taken up again.
        """
        self._rest += received
        found = []
        while len(self._rest) >= HEAD.size:
            size, kind = HEAD.unpack_from(self._rest)
            if not HEAD.size <= size <= LARGEST:
                raise RobotError(
                    f"robot: expected RTDE packages of at most {LARGEST} bytes, got one of {size}: "
                    "is this the RTDE port, 30004?"
                )
            if len(self._rest) < size:
                break
            found.append(Package(kind, self._rest[HEAD.size : size]))
            self._rest = self._rest[size:]
        return found


class Recipe:
    """Fields of a data package, with their types.

    Attributes:
        number: that the controller gave it.
        names: of the fields.
    """

    def __init__(self, names: Sequence[str], answer: bytes) -> None:
        """Read the controller's answer to a set-up.

        Args:
            names: that were asked for.
            answer: payload of it.

        Raises:
            RobotError: naming the fields that the controller does not give.
        """
        self.names = tuple(names)
        types = answer[1:].decode("ascii", "replace").split(",") if len(answer) > 1 else []
        odd = [n for n, t in zip(self.names, types, strict=False) if t not in FORMATS]
        if odd or len(types) != len(self.names):
            told = ", ".join(odd) or f"{len(types)} types for {len(self.names)} fields"
            raise RobotError(
                f"robot: expected the RTDE fields {', '.join(self.names)}, the controller refuses "
                f"{told}: does another client write them, or is its software older than 3.9?"
            )
        self.number = answer[0]
        self._counts = [len(struct.unpack(f">{FORMATS[t]}", bytes(self._size(t)))) for t in types]
        self._struct = struct.Struct(">B" + "".join(FORMATS[t] for t in types))

    @staticmethod
    def _size(kind: str) -> int:
        return struct.calcsize(f">{FORMATS[kind]}")

    def read(self, payload: bytes) -> dict[str, Any]:
        """Values of a data package by field: numbers, or tuples of them.

        Args:
            payload: of the package.

        Raises:
            RobotError: if it is none of this recipe.
        """
        if len(payload) != self._struct.size or payload[0] != self.number:
            raise RobotError(
                f"robot: expected an RTDE data package of {self._struct.size} bytes of recipe "
                f"{self.number}, got {len(payload)} bytes"
            )
        flat = self._struct.unpack(payload)[1:]
        found: dict[str, Any] = {}
        at = 0
        for name, count in zip(self.names, self._counts, strict=True):
            found[name] = flat[at] if count == 1 else flat[at : at + count]
            at += count
        return found

    def write(self, values: Sequence[float]) -> bytes:
        """Bytes of a data package.

        Args:
            values: of all fields, vectors taken apart.
        """
        return packed(PackageType.DATA_PACKAGE, self._struct.pack(self.number, *values))


def setup_outputs(names: Sequence[str], rate: float) -> bytes:
    """Package that asks for outputs.

    Args:
        names: of the fields.
        rate: packages a second [Hz].
    """
    content = struct.pack(">d", rate) + ",".join(names).encode()
    return packed(PackageType.SETUP_OUTPUTS, content)


def setup_inputs(names: Sequence[str]) -> bytes:
    """Package that announces inputs.

    Args:
        names: of the fields.
    """
    return packed(PackageType.SETUP_INPUTS, ",".join(names).encode())


def request_version() -> bytes:
    """Package that asks for protocol version 2."""
    return packed(PackageType.REQUEST_PROTOCOL_VERSION, struct.pack(">H", VERSION))
