# SPDX-License-Identifier: Apache-2.0
"""Number of cables as a constant of the compiler, where it pays.

The compiled functions take `size`: either n, or a tuple whose LENGTH is n. A tuple's length is
part of its type, so loops over eight cables become straight vector code, several times faster
than loops whose end is known at run time only.
"""

from __future__ import annotations

from numba import types
from numba.extending import overload

from cabols_control.compiling import njit

compiled = njit(cache=True, error_model="numpy", boundscheck=False)
"""Decorator: cached on disk; divisions follow IEEE 754 instead of raising."""
inlined = njit(cache=True, error_model="numpy", boundscheck=False, inline="always")
"""The same, put into its callers: where the call would cost more than what it does."""

Size = int | tuple[int, ...]

EIGHT = (0, 0, 0, 0, 0, 0, 0, 0)
SIX = (0, 0, 0, 0, 0, 0)
FIVE = (0, 0, 0, 0, 0)
FOUR = (0, 0, 0, 0)


def cables(size: Size) -> int:
    """Return n for either kind of size."""
    return len(size) if isinstance(size, tuple) else size


# No annotations: numba compares the signature with the lambdas'.
@overload(cables)
def _cables(size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if isinstance(size, types.BaseTuple):
        return lambda size: len(size)  # noqa: PLW0108 (numba compiles the lambda)
    return lambda size: size
