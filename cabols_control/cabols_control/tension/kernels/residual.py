# SPDX-License-Identifier: Apache-2.0
"""What the tensions found miss of the wrench, once rounding is taken off the limits."""

from __future__ import annotations

from cabols_control.checks import FloatArray

from .static_size import Size, cables, compiled
from .work_array import at_limits, at_structure, at_weights


@compiled
def clip_and_subtract(
    work: FloatArray,
    size: Size,
    wrench: FloatArray,
    tension_out: FloatArray,
    residual_out: FloatArray,
) -> float:
    """Take rounding off the limits, and fill the residual A t - w.

    Args:
        work: work array that `prepare_pose` filled.
        size: number of cables n, see static_size.py.
        wrench: (6,) w [N, N m].
        tension_out: (n,) t [N], clipped to the limits.
        residual_out: (6,) filled [N, N m].

    Returns:
        Largest entry of the residual, either sign, times its weight.
    """
    n = cables(size)
    limits, structure, weights = at_limits(n), at_structure(n), at_weights(n)
    for i in range(n):
        tension_out[i] = min(max(tension_out[i], work[limits + i]), work[limits + n + i])
    largest = 0.0
    for k in range(6):
        even, odd = -wrench[k], 0.0
        row = structure + k * n
        for i in range(0, n - 1, 2):
            even += work[row + i] * tension_out[i]
            odd += work[row + i + 1] * tension_out[i + 1]
        if n % 2 == 1:
            even += work[row + n - 1] * tension_out[n - 1]
        residual_out[k] = even + odd
        largest = max(largest, abs(even + odd) * work[weights + k])
    return largest
