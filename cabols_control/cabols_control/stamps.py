# SPDX-License-Identifier: Apache-2.0
"""Times of messages in nanoseconds: of objects, of columns, of serialised bytes."""

from __future__ import annotations

from collections.abc import Mapping
from struct import Struct
from typing import Any

import numpy as np
import numpy.typing as npt

SECOND_NS = 1_000_000_000
HEADER_STAMP = "header.stamp"
LAST_S = 2**31 - 1
"""Largest number of seconds that a stamp holds."""
STAMP = Struct("<iI")
_BIG_ENDIAN_STAMP = Struct(">iI")
STAMP_AT = 4
"""A message that begins with a header has its stamp right behind the 4 bytes of CDR's header."""


def time_ns(stamp: Any) -> int:
    """Return the time of a builtin_interfaces Time or Duration [ns]."""
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def set_time(stamp: Any, value_ns: int) -> None:
    """Write a time [ns] into a builtin_interfaces Time or Duration; the last one, if it is later.

    Args:
        stamp: message that is filled.
        value_ns: time [ns].
    """
    seconds, stamp.nanosec = divmod(value_ns, SECOND_NS)
    stamp.sec = max(min(seconds, LAST_S), -LAST_S - 1)


def column_ns(columns: Mapping[str, Any], prefix: str = HEADER_STAMP) -> npt.NDArray[np.int64]:
    """Return the times of many messages.

    Args:
        columns: (k,) arrays by dotted field name, as of a bag or of one record.
        prefix: name of the time field.

    Returns:
        (k,) times [ns].

    Raises:
        KeyError: if there is no such field.
    """
    seconds = np.asarray(columns[f"{prefix}.sec"], dtype=np.int64)
    return seconds * SECOND_NS + np.asarray(columns[f"{prefix}.nanosec"], dtype=np.int64)


def first_stamp(raw: bytes) -> int:
    """Return the time of the header that a serialised message begins with [ns]."""
    seconds, nanoseconds = (STAMP if raw[1] else _BIG_ENDIAN_STAMP).unpack_from(raw, STAMP_AT)
    return int(seconds) * SECOND_NS + int(nanoseconds)
