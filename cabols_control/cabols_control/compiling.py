# SPDX-License-Identifier: Apache-2.0
"""Numba's compiler, with functions whose names say for which record they were compiled.

Numba names a compiled function by its arguments' types, and a record by a number that counts the
types of its process. So two processes that compile the same function for different records, say of
8 and of 10 limbs, keep two functions of one name on disk; in a process that loads both, the linker
takes the first for either, which then reads and writes beyond the smaller record. Here a record is
named by its layout instead. All compiled code of these packages takes `njit` from this module.
"""

from __future__ import annotations

from hashlib import sha256
from typing import Any

from numba import njit, types

__all__ = ["njit"]

DIGITS = 16
"""Of the digest in a name."""


def _mangled(record: Any) -> tuple[str, tuple[str]]:
    """What numba makes a record's part of a function's name of.

    Args:
        record: numba's type, whose name tells fields, types, offsets, size and alignment.
    """
    return type(record).__name__, (sha256(record.name.encode()).hexdigest()[:DIGITS],)


_RECORD: Any = types.Record
_RECORD.mangling_args = property(_mangled)
