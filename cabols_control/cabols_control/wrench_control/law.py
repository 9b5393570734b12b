"""The wrench law (3.16), (3.17): PI on each component, then redundancy resolution."""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import FloatArray
from cabols_control.tension import choose_prepared


@njit(cache=True)
def wrench_law_into(
    proportional: float,
    integral: float,
    desired: FloatArray,
    measured: FloatArray,
    dt_s: float,
    work: FloatArray,
    accumulated: FloatArray,
    control: FloatArray,
    tension: FloatArray,
    residual: FloatArray,
) -> int:
    """One step of (3.17) and (3.16), unchecked; wrenches on the platform, at its origin, base axes.

    Args:
        proportional: k_Po [-].
        integral: k_Io [1/s].
        desired: (6,) [N, N m].
        measured: (6,) [N, N m].
        dt_s: time since the previous step [s].
        work: pose and tension limits, from cabols_control.tension.prepare_pose, and the method of
            redundancy resolution, from set_method.
        accumulated: (6,) integral part of u [N, N m]; updated.
        control: (6,) output u [N, N m].
        tension: (n,) output tau_d [N].
        residual: (6,) output, structure matrix times tension minus u [N, N m].

    Returns:
        Status of redundancy resolution: 0 feasible, 1 nearest feasible wrench, 2 non-finite input.
    """
    for k in range(6):
        error = desired[k] - measured[k]
        accumulated[k] += integral * error * dt_s
        control[k] = proportional * error + accumulated[k]
    status = int(choose_prepared(work, control, tension, residual))
    if status == 1:
        # Anti-windup: the integral is reset to what the cables can give, so that it leaves
        # the limit as soon as the error turns.
        for k in range(6):
            accumulated[k] += residual[k]
    return status


class WrenchLaw:
    """State of (3.17) with anti-windup against infeasible wrenches and bumpless start."""

    def __init__(self, proportional: float, integral: float, cables: int) -> None:
        """Start with a zero integral.

        Args:
            proportional: k_Po [-].
            integral: k_Io [1/s].
            cables: number n of cables.
        """
        self._proportional = float(proportional)
        self._integral = float(integral)
        self._accumulated = np.zeros(6)
        self.control = np.zeros(6)
        self.tension = np.zeros(cables)
        self.residual = np.zeros(6)

    def reset(self, control: FloatArray, desired: FloatArray, measured: FloatArray) -> None:
        """Make the next output u continue from a value.

        Args:
            control: (6,) u to continue from, e.g. the wrench that the cables exert now [N, N m].
            desired: (6,) desired wrench [N, N m].
            measured: (6,) measured wrench [N, N m].
        """
        self._accumulated[:] = control - self._proportional * (desired - measured)

    def step(self, desired: FloatArray, measured: FloatArray, dt_s: float, work: FloatArray) -> int:
        """Advance by one sample; see wrench_law_into. Results are in control, tension, residual.

        A step whose input is not finite leaves the state as it was and returns 2; tension keeps
        its previous value.

        Args:
            desired: (6,) setpoint of the wrench [N, N m].
            measured: (6,) in the same axes [N, N m].
            dt_s: time since the last step [s].
            work: memory of the tension kernels.
        """
        if not (np.isfinite(desired).all() and np.isfinite(measured).all() and dt_s > 0.0):
            return 2
        return int(
            wrench_law_into(
                self._proportional,
                self._integral,
                desired,
                measured,
                dt_s,
                work,
                self._accumulated,
                self.control,
                self.tension,
                self.residual,
            )
        )
