"""What redundancy resolution returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Six = tuple[float, float, float, float, float, float]

FEASIBLE = 0
"""Status: the wrench is reached inside the limits, with the least 2-norm of the tensions."""
INFEASIBLE = 1
"""Status: no tension inside the limits gives the wrench; the nearest wrench's are returned."""
INVALID = 2
"""Status: something is not finite (or min > max); `tension_min` is returned as the safe answer."""


class TensionSolution(NamedTuple):
    """Tensions for one wrench.

    Attributes:
        tension: (n,) cable tensions [N], always inside the limits.
        feasible: True if the wrench is reached within the tolerance that `distribute` states.
        residual: (6,) A @ tension - wrench, force [N] then torque [N m].
        method: name of the method that was asked for.
        iterations: clips, pivots or active sets that the method went through.
    """

    tension: FloatArray
    feasible: bool
    residual: FloatArray
    method: str
    iterations: int
