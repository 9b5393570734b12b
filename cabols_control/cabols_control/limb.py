# SPDX-License-Identifier: Apache-2.0
"""Limb models and their identification: step data to (3.11), ramp data to the stiffness k_e."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.compiling import njit
from cabols_control.errors import ShapeError

TIME_CONSTANT_RANGE_S = (0.005, 10.0)
MIN_SAMPLES = 20
SPEED_WINDOW = 5
"""Samples over which the direction of motion is determined."""


@dataclass(frozen=True)
class LimbModel:
    """Motor, gear and pulley of one limb: wound length / current = k / (s (1 + T s)), (3.11).

    Attributes:
        gain: k, cable speed per current [m/s/A].
        time_constant: T [s].
        fit: 1 - |y - y_hat| / |y - mean(y)| of the identification data, 1 is perfect.
    """

    gain: float
    time_constant: float
    fit: float = 1.0


@dataclass(frozen=True)
class FrictionFit:
    """Limb model and the dry friction beside it.

    Attributes:
        model: k and T of (3.11) without the friction's share.
        friction: current that overcomes dry friction [A].
    """

    model: LimbModel
    friction: float


@dataclass(frozen=True)
class StiffnessFit:
    """Force/elongation line of one limb, as figure 3.6.

    Attributes:
        stiffness: k_e, slope [N/m].
        offset: tension of the fitted line at zero elongation [N].
        linearity_rms: root mean square of the residual [N].
        hysteresis: mean difference between loading and unloading branch [N]; NaN without both.
    """

    stiffness: float
    offset: float
    linearity_rms: float
    hysteresis: float

    @property
    def play(self) -> float:
        """Backlash of the gear at the cable, which parts the branches [m]; NaN without both.

        While a motor winds in, the cable lags behind it by half the play, and leads as much while
        it pays out: at one elongation by the motor the branches are k_e times the play apart.
        """
        return max(-self.hysteresis / self.stiffness, 0.0)


@njit(cache=True)
def _unit_response(time: FloatArray, current: FloatArray, time_constant: float) -> FloatArray:
    """Wound length of (3.11) with k = 1, exact for a current held between samples."""
    response = np.zeros(time.shape[0])
    speed = 0.0
    for k in range(time.shape[0] - 1):
        dt = time[k + 1] - time[k]
        decay = 1.0 - np.exp(-dt / time_constant)
        difference = speed - current[k]
        response[k + 1] = response[k] + current[k] * dt + difference * time_constant * decay
        speed -= difference * decay
    return response


def step_response(model: LimbModel, time: ArrayLike, current: ArrayLike) -> FloatArray:
    """Wound length that the model gives for a current held between samples.

    Args:
        model: limb model.
        time: (k,) increasing [s].
        current: (k,) [A].

    Returns:
        (k,) [m], zero at the first sample, starting at rest.
    """
    time_s, current_a = _step_data(time, current)
    return model.gain * _unit_response(time_s, current_a, model.time_constant)


def identify_limb(time: ArrayLike, current: ArrayLike, wound_length: ArrayLike) -> LimbModel:
    """Fit (3.11) to recorded data, as section 3.4.3 does with a 0.5 A step.

    The gain and an offset are linear in the data and are eliminated (variable projection); one
    bounded search over the time constant remains. The limb starts at rest; the spring is off.

    Args:
        time: (k,) increasing [s], at least 20 samples; need not be uniform.
        current: (k,) motor current, held between samples [A].
        wound_length: (k,) cable wound in, r theta [m].

    Returns:
        The model and its fit.

    Raises:
        ShapeError: on other shapes, non-finite data, time that does not increase, a current
            that is zero throughout, or a limb that did not move.
    """
    time_s, current_a = _step_data(time, current)
    wound = finite_array("wound_length", wound_length, (time_s.size,))
    if not np.abs(current_a).max() > 0.0:
        raise ShapeError("current: expected a step, got zero throughout; was the amplifier on?")
    if not np.ptp(wound) > 0.0:
        raise ShapeError("wound_length: expected motion, got a constant; is the encoder connected?")

    def project(log_time_constant: float) -> tuple[float, float, FloatArray]:
        response = _unit_response(time_s, current_a, float(np.exp(log_time_constant)))
        regressor = np.column_stack([response, np.ones_like(response)])
        solution = np.linalg.lstsq(regressor, wound, rcond=None)[0]
        residual = wound - regressor @ solution
        return float(residual @ residual), float(solution[0]), residual

    found = _search(lambda value: project(value)[0])
    _, gain, residual = project(found)
    fit = 1.0 - float(np.linalg.norm(residual) / np.linalg.norm(wound - wound.mean()))
    return LimbModel(gain=gain, time_constant=float(np.exp(found)), fit=fit)


def identify_limb_with_friction(
    time: ArrayLike, current: ArrayLike, wound_length: ArrayLike, still: float = 3e-6
) -> FrictionFit:
    """Fit (3.11) driven by current minus dry friction against the motion.

    k and k times the friction are linear in the data, so that one search over T remains, as in
    identify_limb. The data need motion without drive (coasting to rest) or several currents: in
    a single step, or in a pair of opposite ones, friction looks like a smaller k.

    Args:
        time: (k,) [s].
        current: (k,) held between samples [A].
        wound_length: (k,) [m].
        still: less motion than this within five samples is standing still [m].

    Returns:
        Model and friction.

    Raises:
        ShapeError: as identify_limb.
    """
    time_s, current_a = _step_data(time, current)
    wound = finite_array("wound_length", wound_length, (time_s.size,))
    if not np.ptp(wound) > still:
        raise ShapeError("wound_length: expected motion, got a constant; is the encoder connected?")
    moved = np.zeros_like(wound)
    half = SPEED_WINDOW // 2
    moved[half:-half] = wound[2 * half :] - wound[: -2 * half]
    direction = np.where(np.abs(moved) > still, np.sign(moved), 0.0)

    def project(log_time_constant: float) -> tuple[float, FloatArray]:
        constant = float(np.exp(log_time_constant))
        columns = [_unit_response(time_s, signal, constant) for signal in (current_a, -direction)]
        regressor = np.column_stack([*columns, np.ones_like(wound)])
        solution = np.linalg.lstsq(regressor, wound, rcond=None)[0]
        residual = wound - regressor @ solution
        return float(residual @ residual), np.array([*solution, np.linalg.norm(residual)])

    found = _search(lambda value: project(value)[0])
    gain, gain_friction, _, residual = project(found)[1]
    fit = 1.0 - float(residual / np.linalg.norm(wound - wound.mean()))
    model = LimbModel(float(gain), float(np.exp(found)), fit)
    return FrictionFit(model, float(gain_friction / gain))


def _search(cost: Callable[[float], float]) -> float:
    """Logarithm of the time constant with the least cost: grid, then bounded search."""
    low, high = np.log(TIME_CONSTANT_RANGE_S)
    grid = np.linspace(low, high, 40)
    best = int(np.argmin([cost(value) for value in grid]))
    bracket = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    from scipy.optimize import minimize_scalar  # 0.1 s; only identification needs it

    found = minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 1e-10})
    return float(found.x)


def _step_data(time: ArrayLike, current: ArrayLike) -> tuple[FloatArray, FloatArray]:
    time_s = finite_array("time", time, (None,))
    if time_s.size < MIN_SAMPLES:
        raise ShapeError(f"time: expected at least {MIN_SAMPLES} samples, got {time_s.size}")
    if not np.diff(time_s).min() > 0.0:
        raise ShapeError("time: expected strictly increasing samples; sort or drop repeated ones")
    return time_s, finite_array("current", current, (time_s.size,))


def identify_stiffness(
    tension: ArrayLike, elongation: ArrayLike, tension_range: tuple[float, float] = (5.0, 150.0)
) -> StiffnessFit:
    """Fit tension = k_e elongation + offset to a slow ramp up (and down), as figure 3.6.

    Args:
        tension: (k,) measured by the force sensor [N].
        elongation: (k,) measured by the encoder [m].
        tension_range: only samples between these tensions are used [N]: below, the spring's
            coils touch and the limb is as stiff as without a spring.

    Returns:
        Stiffness, offset, linearity and hysteresis (from the two branches, if both are there).

    Raises:
        ShapeError: on other shapes, non-finite data or fewer than 20 samples in the range.
    """
    force = finite_array("tension", tension, (None,))
    stretch = finite_array("elongation", elongation, (force.size,))
    used = (force >= tension_range[0]) & (force <= tension_range[1])
    if int(used.sum()) < MIN_SAMPLES or not np.ptp(stretch[used]) > 0.0:
        raise ShapeError(
            f"tension: expected at least {MIN_SAMPLES} samples of a ramp between "
            f"{tension_range[0]:g} and {tension_range[1]:g} N, got {int(used.sum())}"
        )
    regressor = np.column_stack([stretch[used], np.ones(int(used.sum()))])
    slope, offset = np.linalg.lstsq(regressor, force[used], rcond=None)[0]
    residual = force[used] - regressor @ (slope, offset)
    peak = int(np.argmax(force[used]))
    branches = min(peak, residual.size - peak) >= MIN_SAMPLES
    hysteresis = float(residual[:peak].mean() - residual[peak:].mean()) if branches else np.nan
    rms = float(np.sqrt(np.mean(residual**2)))
    return StiffnessFit(float(slope), float(offset), rms, hysteresis)
