# SPDX-License-Identifier: Apache-2.0
"""Words of command lines that several tasks take."""

from __future__ import annotations

from cabols_control.errors import UsageError


def joint_position(word: str) -> tuple[str, float]:
    """Name and position [rad, m] of NAME=POSITION; without a position zero.

    Raises:
        UsageError: if the position is no number.
    """
    name, mark, value = word.partition("=")
    try:
        return name, float(value if mark else "0")
    except ValueError as error:
        raise UsageError(f"--lock {word}: expected NAME=POSITION [rad or m]") from error
