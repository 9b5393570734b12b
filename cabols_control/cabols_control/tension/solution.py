# SPDX-License-Identifier: Apache-2.0
"""What redundancy resolution returns."""

from __future__ import annotations

from typing import NamedTuple

from cabols_control.checks import FloatArray


class TensionSolution(NamedTuple):
    """Tensions for one wrench.

    Attributes:
        tension: (n,) cable tensions [N], always inside the limits.
        feasible: True if the wrench is reached within the tolerance that `distribute` states.
        residual: (6,) A @ tension - wrench, force [N] then torque [N m].
        method: name of the requested method.
        iterations: clips, pivots or active sets that the method went through.
        loss: what was given up for tensions that change little (kernels/smooth.py): by how much
            the residual is longer than the nearest wrench's, in the weighted metric, newtons by
            default. 0 where nothing was.
    """

    tension: FloatArray
    feasible: bool
    residual: FloatArray
    method: str
    iterations: int
    loss: float = 0.0
