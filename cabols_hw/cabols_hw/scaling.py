"""Counts and volts to metres, newtons and amperes, and back; compiled, stateless."""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_hw.card_config import ENCODER_MODULUS

HALF_MODULUS = ENCODER_MODULUS // 2


@njit(cache=True)
def limbs_into(
    raw: IntArray,
    previous_raw: IntArray,
    counts: IntArray,
    counts_per_metre: float,
    length: FloatArray,
    closed: BoolArray,
    was_closed: BoolArray,
    set_zero: bool,
    switch_elongation: float,
    stiffness: float,
    zero: FloatArray,
    zeroed: BoolArray,
    wound: FloatArray,
    elongation: FloatArray,
    tension: FloatArray,
) -> None:
    """Counters to wound length, elongation and tension estimate (3.9); all arrays (n,).

    Counters have 24 bits: counts adds what they moved since previous_raw, which is updated. Where
    set_zero is True, a switch that closes sets its limb's zero.
    """
    for i in range(raw.shape[0]):
        moved = (raw[i] - previous_raw[i] + HALF_MODULUS) % ENCODER_MODULUS - HALF_MODULUS
        counts[i] += moved
        previous_raw[i] = raw[i]
        wound[i] = counts[i] / counts_per_metre
        # A cable is stretched by what is wound in and by what the platform moves away.
        stretch = wound[i] + length[i]
        if set_zero and closed[i] and not was_closed[i] and not zeroed[i]:
            zero[i] = stretch - switch_elongation
            zeroed[i] = True
        was_closed[i] = closed[i]
        elongation[i] = stretch - zero[i]
        tension[i] = stiffness * elongation[i]


@njit(cache=True)
def wrench_into(
    matrix: FloatArray, volts: FloatArray, bias: FloatArray, limit: float, wrench: FloatArray
) -> bool:
    """Fill wrench (6,) = matrix (6, 6) @ (volts - bias), the sensor's linear calibration.

    Returns True if a gauge is beyond +-limit or not a number.
    """
    saturated = False
    for row in range(6):
        # Written so that NaN counts as saturated.
        saturated = saturated or not abs(volts[row]) <= limit
        total = 0.0
        for k in range(6):
            total += matrix[row, k] * (volts[k] - bias[k])
        wrench[row] = total
    return saturated


@njit(cache=True)
def volts_into(
    current: FloatArray, limit: float, amperes_per_volt: float, reach: float, volts: FloatArray
) -> None:
    """Fill volts (n,) for currents (n,) [A] within +-limit, then within +-reach; NaN becomes 0."""
    for i in range(current.shape[0]):
        wanted = current[i] if np.isfinite(current[i]) else 0.0
        volt = min(max(wanted, -limit), limit) / amperes_per_volt
        volts[i] = min(max(volt, -reach), reach)


@njit(cache=True)
def quantise(value: float, step: float, limit: float) -> float:
    """Nearest multiple of step within +-limit, as a converter gives it; step 0 only limits."""
    clipped = min(max(value, -limit), limit)
    if step <= 0.0:
        return clipped
    return min(max(round(clipped / step) * step, -limit), limit)
