# SPDX-License-Identifier: Apache-2.0
"""Slow and fast: the control loops and the vibrating platform as a singular perturbation.

The loops' states are slow, the platform's are fast. With the platform always at its equilibrium
x = K^-1 v (v the commanded wrench of the winches) the slow model remains: it is what the rig's
design assumes. With v standing still the fast model remains: the modes with the motors standing.
By Tikhonov's theorem both together tell the whole as long as the modes are damped and far above the
loops; `split` measures how far that is true, `fastest_design` how far the loops may go.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from cabols_control.checks import FloatArray, one_or_each
from cabols_control.gains import WrenchGains, wrench_gains
from cabols_control.limb import LimbModel
from cabols_sim.dynamics.loops import (
    FREQUENCIES,
    ComplexArray,
    Margins,
    design_margins,
    margins,
    platform_response,
    wrench_loop,
)
from cabols_sim.dynamics.vibration import VibrationModel

GAIN_MARGIN, PHASE_MARGIN_RAD, DISTANCE = 2.0, np.radians(45.0), 0.5
"""What a design must keep: 6 dB, 45 deg, and half way from -1."""
_SCALES = np.geomspace(0.1, 12.0, 97)


def inner_polynomial(model: LimbModel, gains: WrenchGains, stiffness: float) -> FloatArray:
    """(4,) denominator of T_l (3.13), highest power first; its last entry is the numerator.

    Args:
        model: of the limb.
        gains: of the loops.
        stiffness: k_e of spring and cable [N/m].
    """
    limb, k, time_constant = gains.limbs[0], model.gain, model.time_constant
    return np.array(
        [
            1.0,
            (1.0 + k * limb.velocity) / time_constant,
            k * limb.integral / time_constant,
            k * stiffness * limb.integral * limb.tension / time_constant,
        ]
    )


def closed_loop(
    gains: WrenchGains, model: LimbModel, stiffness: float, vibration: VibrationModel | None
) -> FloatArray:
    """State matrix of both loops with the vibrating platform; None: with a rigid target.

    States, six of each: v, v_d, v_dd of the limbs' loops, the integral of the wrench's error, and
    the platform's displacement and velocity. No delay.

    Args:
        gains: of the wrench law.
        model: of the limbs.
        stiffness: k_e of spring and cable [N/m].
        vibration: platform on its target; None: a rigid one.
    """
    one, zero = np.eye(6), np.zeros((6, 6))
    if vibration is None:
        return _assemble(gains, inner_polynomial(model, gains, stiffness), [one, zero, zero])
    lighter = vibration.platform_mass @ np.linalg.inv(vibration.mass)
    sensor = [
        one - lighter,
        lighter @ vibration.stiffness - vibration.springs,
        lighter @ vibration.damping(),
    ]
    matrix = _assemble(gains, inner_polynomial(model, gains, stiffness), sensor)
    moved = np.linalg.inv(vibration.mass)
    fast = np.zeros((12, 36))
    fast[:6, 30:] = one
    fast[6:, :6] = moved
    fast[6:, 24:30], fast[6:, 30:] = -moved @ vibration.stiffness, -moved @ vibration.damping()
    return np.vstack([matrix, fast])


def slow_loop(
    gains: WrenchGains, model: LimbModel, stiffness: float, vibration: VibrationModel
) -> FloatArray:
    """(24, 24) state matrix of the slow model: the platform always at its equilibrium.

    Args:
        gains: of the wrench law.
        model: of the limbs.
        stiffness: k_e of spring and cable [N/m].
        vibration: platform on its target.
    """
    still = np.eye(6) - vibration.springs @ np.linalg.inv(vibration.stiffness)
    zero = np.zeros((6, 6))
    return _assemble(gains, inner_polynomial(model, gains, stiffness), [still, zero, zero])[:, :24]


def _assemble(gains: WrenchGains, inner: FloatArray, sensor: Sequence[FloatArray]) -> FloatArray:
    """(24, 36) rows of the loops; sensor: what it reads of v, x and x_dot, each (6, 6)."""
    one = np.eye(6)
    reads = np.zeros((6, 36))
    reads[:, :6], reads[:, 24:30], reads[:, 30:] = sensor
    control = -gains.proportional * reads
    control[:, 18:24] += gains.integral * one
    matrix = np.zeros((24, 36))
    matrix[:6, 6:12] = matrix[6:12, 12:18] = one
    *_, leading = inner
    matrix[12:18] = leading * control
    for power, column in ((3, 0), (2, 6), (1, 12)):
        matrix[12:18, column : column + 6] -= inner[power] * one
    matrix[18:24] = -reads
    return matrix if np.any(reads[:, 24:]) else matrix[:, :24]


@dataclass(frozen=True, eq=False)
class Split:
    """The closed loop's poles beside those of its two halves.

    Attributes:
        full: (36,) of everything [1/s].
        slow: (24,) of the slow model, each beside `full_slow`.
        full_slow: (24,) their partners among the full ones.
        fast: (12,) of the vibration with the winches standing, each beside `full_fast`.
        full_fast: (12,) their partners.
        epsilon: sixth slowest slow pole over slowest natural frequency: small is good.
    """

    full: ComplexArray
    slow: ComplexArray
    full_slow: ComplexArray
    fast: ComplexArray
    full_fast: ComplexArray
    epsilon: float

    @property
    def slow_error(self) -> float:
        """Largest relative distance of the dominant slow poles (the slowest six) from the truth."""
        order = np.argsort(np.abs(self.slow))[:6]
        error = np.abs(self.slow - self.full_slow) / np.abs(self.slow)
        return float(error[order].max())

    @property
    def fast_error(self) -> float:
        """Largest relative distance of a vibration's pole from the truth."""
        return float((np.abs(self.fast - self.full_fast) / np.abs(self.fast)).max())

    @property
    def stable(self) -> bool:
        """Whether the whole is stable."""
        return bool(self.full.real.max() < 0.0)


def split(
    gains: WrenchGains, model: LimbModel, stiffness: float, vibration: VibrationModel
) -> Split:
    """Compare the whole with its slow and fast halves.

    Args:
        gains: of the wrench law.
        model: of the limbs.
        stiffness: k_e of spring and cable [N/m].
        vibration: platform on its target.
    """
    full = _poles(closed_loop(gains, model, stiffness, vibration))
    slow = _poles(slow_loop(gains, model, stiffness, vibration))
    frequency = vibration.modes()[0]
    damped = frequency * np.sqrt(1.0 - vibration.damping_ratio**2)
    upper = -vibration.damping_ratio * frequency + 1j * damped
    fast = np.concatenate([upper, upper.conj()])
    halves = np.concatenate([slow, fast])
    scale = np.abs(halves)[:, None]
    rows, columns = linear_sum_assignment(np.abs(halves[:, None] - full[None, :]) / scale)
    partner = full[columns[np.argsort(rows)]]
    *_, dominant = np.sort(np.abs(slow))[:6]
    return Split(full, slow, partner[:24], fast, partner[24:], float(dominant / frequency.min()))


def _poles(matrix: FloatArray) -> ComplexArray:
    return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)


def worst_margins(
    gains: WrenchGains,
    models: Sequence[LimbModel],
    stiffness: ArrayLike,
    response: ComplexArray,
    delay_s: float,
) -> Margins:
    """Smallest margins of the six characteristic loci and of the limbs' loops, each kind by itself.

    Args:
        gains: of both loops, one limb's or more.
        models: of the limbs.
        stiffness: k_e, one for all limbs or (n,) [N/m].
        response: (k, 6) eigenvalues of the platform's response, from `response_eigenvalues`.
        delay_s: of every sample on its way to the current [s].
    """
    s = np.multiply(1j, FREQUENCIES)
    first = float(one_or_each("stiffness", stiffness, len(models))[0])
    curves = wrench_loop(gains, models[0], first, s, delay_s)[:, None] * response
    each = [margins(FREQUENCIES, np.asarray(curve)) for curve in curves.T]
    each += design_margins(gains, models, stiffness, delay_s)[1]
    return Margins(
        gain=min(m.gain for m in each),
        reduction=max(m.reduction for m in each),
        phase=min(m.phase for m in each),
        crossover=max(m.crossover for m in each[:6]),
        delay=min(m.delay for m in each),
        distance=min(m.distance for m in each),
    )


def response_eigenvalues(vibration: VibrationModel) -> ComplexArray:
    """(k, 6) eigenvalues of platform_response at FREQUENCIES, each column a continuous curve."""
    curves = np.linalg.eigvals(platform_response(vibration, np.multiply(1j, FREQUENCIES)))
    for k in range(1, curves.shape[0]):
        apart = np.abs(curves[k - 1][:, None] - curves[k][None, :])
        if not (np.argmin(apart, axis=1) == np.arange(6)).all():
            curves[k] = curves[k][linear_sum_assignment(apart)[1]]
    return np.asarray(curves)


@dataclass(frozen=True)
class Fastest:
    """The fastest of a family of designs that keeps its margins.

    Attributes:
        scale: of all poles and the zero, times the base design's; 0: none keeps them.
        stable_scale: up to which the loops without delay are stable at all.
        limited_by: what ends it.
    """

    scale: float
    stable_scale: float
    limited_by: str


def fastest_design(
    models: Sequence[LimbModel],
    stiffness: ArrayLike,
    poles: Sequence[float],
    zero: float,
    vibration: VibrationModel,
    delay_s: float,
) -> Fastest:
    """Scale a design's poles and zero until it loses 6 dB, 45 deg or the distance 0.5 from -1.

    Scales are tried upwards from one at which the loops are slower than all else, so that a design
    counts only if all slower ones are good, too. The limbs' loops must keep their margins as well.

    Args:
        models: of the limbs.
        stiffness: k_e of each [N/m], one or (n,).
        poles: of the wrench loop [1/s].
        zero: of the wrench loop [1/s].
        vibration: platform on its target.
        delay_s: of the loop [s].
    """

    def design(scale: float) -> WrenchGains:
        return wrench_gains(models, stiffness, scale * np.array(poles), scale * zero)

    response = response_eigenvalues(vibration)
    first = float(one_or_each("stiffness", stiffness, len(models))[0])

    def lacks(scale: float) -> str:
        gains = design(scale)
        found = worst_margins(gains, models, stiffness, response, delay_s)
        if unstable(scale):
            return "stability"
        if not found.gain >= GAIN_MARGIN:
            return "gain margin"
        if not found.phase >= PHASE_MARGIN_RAD:
            return "phase margin"
        return "" if found.distance >= DISTANCE else "distance from -1"

    def unstable(scale: float) -> str:
        matrix = closed_loop(design(scale), models[0], first, vibration)
        return "" if np.linalg.eigvals(matrix).real.max() < 0.0 else "stability"

    scale, why = _first_failure(lacks)
    return Fastest(scale, _first_failure(unstable)[0], why)


def _first_failure(lacks: Callable[[float], str]) -> tuple[float, str]:
    """Largest scale below the first one that lacks something, and what."""
    good = 0.0
    for scale in _SCALES:
        why = lacks(float(scale))
        if why:
            return good, why
        good = float(scale)
    return good, "nothing"
