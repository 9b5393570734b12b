# SPDX-License-Identifier: Apache-2.0
"""Numbers in files, as people write them; Python's own readers take more forms.

float() and int() read `1_0` as ten and take digits of every script: a file that means something
else to whoever wrote it, or to another program, is refused instead.
"""

from __future__ import annotations

import re

LARGEST = 1.7e308
"""Largest number that is taken."""
LARGEST_SCALED = 1e200
"""Largest one that is multiplied by a factor of units afterwards."""
LARGEST_WHOLE = 2**63 - 1
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_WHOLE = re.compile(r"[+-]?[0-9]{1,19}")
_SHOWN = 40


def plain_number(cell: str, largest: float = LARGEST) -> float:
    """Read a finite decimal number in the digits 0 to 9.

    Args:
        cell: blanks and tabs around the number are left out.
        largest: greatest absolute value.

    Raises:
        ValueError: if it is none; the message says what was expected and what came.
    """
    word = cell.strip(" \t")
    try:
        value = float(word)
    except ValueError as error:
        raise ValueError(
            f"expected a number such as -1.5 or 2e-3, got {cell[:_SHOWN]!r}"
        ) from error
    if not (_NUMBER.fullmatch(word) and abs(value) <= largest):
        raise ValueError(
            f"expected finite numbers such as -1.5 or 2e-3, of at most {largest:g}, got "
            f"{cell[:_SHOWN]!r}"
        )
    return value


def plain_integer(cell: str) -> int:
    """Read a whole number of at most 64 bits in the digits 0 to 9.

    Args:
        cell: blanks and tabs around the number are left out.

    Raises:
        ValueError: if it is none; the message says what was expected and what came.
    """
    word = cell.strip(" \t")
    if not (_WHOLE.fullmatch(word) and abs(int(word)) <= LARGEST_WHOLE):
        raise ValueError(f"expected a whole number such as 12, got {cell[:_SHOWN]!r}")
    return int(word)
