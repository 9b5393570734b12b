"""Counts and volts to metres, newtons and amperes, and back; compiled, stateless."""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_hw.card.config import ENCODER_MODULUS

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

    Counters have 24 bits: counts grows by their change since previous_raw, which is updated. Where
    set_zero is True, a switch that closes sets its limb's zero.
    """
    for i in range(raw.shape[0]):
        moved = (raw[i] - previous_raw[i] + HALF_MODULUS) % ENCODER_MODULUS - HALF_MODULUS
        counts[i] += moved
        previous_raw[i] = raw[i]
        wound[i] = counts[i] / counts_per_metre
        # Winding in and motion of the platform away stretch a cable.
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

    Args:
        matrix: (6, 6) of the sensor's calibration [N/V, N m/V].
        volts: (6,) of the gauges [V].
        bias: (6,) volts at no load [V].
        limit: largest voltage that counts as valid [V].
        wrench: (6,), filled [N, N m].
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
def loaded_wrench_into(
    matrix: FloatArray,
    volts: FloatArray,
    bias: FloatArray,
    tare_weight: FloatArray,
    volts_limit: float,
    limits: FloatArray,
    transform: FloatArray,
    weight: FloatArray,
    load: FloatArray,
    wrench: FloatArray,
) -> tuple[int, int]:
    """Gauge volts to the wrench on the platform without the tool's weight.

    Args:
        matrix: (6, 6) sensor's wrench per volt.
        volts: (6,) of the gauges.
        bias: (6,) volts at the tare.
        tare_weight: (6,) tool's weight on the sensor at the tare, sensor frame.
        volts_limit: end of the converter.
        limits: (6,) range of the sensor, sensor frame.
        transform: (6, 6) from the sensor's to the platform's frame.
        weight: (6,) tool's weight now, platform frame.
        load: (6,) filled with the whole load of the sensor, sensor frame.
        wrench: (6,) filled with the wrench, platform frame.

    Returns:
        First gauge at the converter's end and first axis of load beyond its limit, -1 for none;
        one that is not a number counts as beyond.
    """
    gauge, axis = -1, -1
    for row in range(6):
        if gauge < 0 and not abs(volts[row]) <= volts_limit:
            gauge = row
        total = tare_weight[row]
        for k in range(6):
            total += matrix[row, k] * (volts[k] - bias[k])
        load[row] = total
        if axis < 0 and not abs(total) <= limits[row]:
            axis = row
    for row in range(6):
        total = -weight[row]
        for k in range(6):
            total += transform[row, k] * load[k]
        wrench[row] = total
    return gauge, axis


@njit(cache=True)
def volts_into(
    current: FloatArray,
    limit: float,
    before: FloatArray,
    growth: float,
    amperes_per_volt: float,
    reach: float,
    volts: FloatArray,
) -> None:
    """Fill volts (n,) for currents (n,) [A].

    A current is limited to +-limit, and grows in size by at most growth [A] over what it was
    before (n,); it falls, as far as zero, at once. Volts are limited to +-reach. NaN becomes 0.
    """
    for i in range(current.shape[0]):
        setpoint = current[i] if np.isfinite(current[i]) else 0.0
        held = abs(before[i]) if setpoint * before[i] > 0.0 else 0.0
        size = min(limit, held + growth)
        volt = min(max(setpoint, -size), size) / amperes_per_volt
        volts[i] = min(max(volt, -reach), reach)


@njit(cache=True)
def quantise(value: float, step: float, limit: float) -> float:
    """Round to a converter's nearest multiple of step; step 0 only limits.

    A converter's codes are two's complement: the highest stands for one step less than +limit.

    Args:
        value: to be converted.
        step: of the converter; 0: none.
        limit: of its range.
    """
    clipped = min(max(value, -limit), limit)
    if step <= 0.0:
        return clipped
    return min(max(round(clipped / step) * step, -limit), limit - step)
