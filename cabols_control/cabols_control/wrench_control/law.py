# SPDX-License-Identifier: Apache-2.0
"""The wrench law (3.16), (3.17): PI on each component, then redundancy resolution."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.tension import INFEASIBLE, INVALID, choose_prepared


@cache
def _work_dtype(cables: int) -> Any:
    """Build the dtype of wrench_law_work for n cables; the same object for the same number."""
    fields = [
        ("proportional", np.float64),  # k_Po [-]
        ("integral", np.float64),  # k_Io [1/s]
        ("accumulated", np.float64, (6,)),  # integral part of u [N, N m]
        ("control", np.float64, (6,)),  # newest output u [N, N m]
        ("tension", np.float64, (cables,)),  # newest output tau_d [N]
        ("residual", np.float64, (6,)),  # structure matrix times tension minus u [N, N m]
    ]
    return np.dtype(fields, align=True)


def wrench_law_work(proportional: float, integral: float, cables: int) -> Any:
    """Build the (1,) record that `wrench_law_into` works on, with nothing accumulated.

    Args:
        proportional: k_Po [-].
        integral: k_Io [1/s].
        cables: number n of cables.
    """
    work = np.zeros(1, _work_dtype(cables))
    work["proportional"], work["integral"] = proportional, integral
    return work


@njit(cache=True)
def wrench_law_into(
    law: Any, desired: FloatArray, measured: FloatArray, dt_s: float, work: FloatArray
) -> int:
    """One step of (3.17) and (3.16), unchecked; wrenches on the platform, at its origin, base axes.

    Args:
        law: (1,) record of wrench_law_work; updated.
        desired: (6,) [N, N m].
        measured: (6,) [N, N m].
        dt_s: time since the previous step [s].
        work: pose and tension limits, from cabols_control.tension.prepare_pose, and the method of
            redundancy resolution, from set_method.

    Returns:
        Status of redundancy resolution: 0 feasible, 1 nearest feasible wrench, 2 non-finite input.
    """
    own = law[0]
    # Slices, as the arrays of a record are of a type for which nothing else is compiled.
    accumulated, control = own["accumulated"][:], own["control"][:]
    tension, residual = own["tension"][:], own["residual"][:]
    proportional, integral = own["proportional"], own["integral"]
    for k in range(6):
        error = desired[k] - measured[k]
        accumulated[k] += integral * error * dt_s
        control[k] = proportional * error + accumulated[k]
    status = int(choose_prepared(work, control, tension, residual))
    if status == INFEASIBLE:
        # Anti-windup: the integral is set back to what the cables can give, so that it leaves
        # the limit as soon as the error turns.
        for k in range(6):
            accumulated[k] += residual[k]
    return status


class WrenchLaw:
    """State of (3.17) with anti-windup against infeasible wrenches and bumpless start."""

    def __init__(self, proportional: float, integral: float, cables: int) -> None:
        """Start with nothing accumulated.

        Args:
            proportional: k_Po [-].
            integral: k_Io [1/s].
            cables: number n of cables.
        """
        self._record = wrench_law_work(proportional, integral, cables)

    @property
    def control(self) -> FloatArray:
        """(6,) newest u [N, N m]; a view."""
        return self._field("control")

    @property
    def tension(self) -> FloatArray:
        """(n,) newest tau_d [N]; a view."""
        return self._field("tension")

    @property
    def residual(self) -> FloatArray:
        """(6,) structure matrix times tension minus u [N, N m]; a view."""
        return self._field("residual")

    def _field(self, name: str) -> FloatArray:
        field: FloatArray = self._record[name][0]
        return field

    def reset(self, control: FloatArray, desired: FloatArray, measured: FloatArray) -> None:
        """Make the next output u continue from a value.

        Args:
            control: (6,) u to continue from, e.g. the wrench that the cables exert now [N, N m].
            desired: (6,) desired wrench [N, N m].
            measured: (6,) measured wrench [N, N m].
        """
        proportional = self._record["proportional"][0]
        self._record["accumulated"] = control - proportional * (desired - measured)

    def step(self, desired: FloatArray, measured: FloatArray, dt_s: float, work: FloatArray) -> int:
        """Advance by one sample; see wrench_law_into. Results are in control, tension, residual.

        A step whose input is not finite leaves the state as it was and returns 2; tension keeps
        its previous value.

        Args:
            desired: (6,) setpoint of the wrench [N, N m].
            measured: (6,) in the same axes [N, N m].
            dt_s: time since the last step [s].
            work: of the tension kernels, as in wrench_law_into.
        """
        if not (np.isfinite(desired).all() and np.isfinite(measured).all() and dt_s > 0.0):
            return INVALID
        return int(wrench_law_into(self._record, desired, measured, dt_s, work))
