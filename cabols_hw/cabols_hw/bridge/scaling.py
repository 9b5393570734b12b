# SPDX-License-Identifier: Apache-2.0
"""Counts and volts to metres, newtons and amperes, and back; compiled, stateless."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.compiling import njit
from cabols_hw.card.config import ENCODER_MODULUS

HALF_MODULUS = ENCODER_MODULUS // 2
CLOSINGS = 3
"""Closings of a switch before one sets its limb's zero, on a rig that runs.

Until then the limb pays out while it is closed. Of two limbs whose switches are exchanged each
moves by the other's: one then pays out and the other winds in, ever farther, but for a zero that
both find at one instant."""


LIMB_READING = np.dtype(
    [
        ("previous_raw", np.int64),  # the counter's newest value
        ("counts", np.int64),  # since the start, unwrapped
        ("was_closed", np.int64),  # the switch at the sample before
        ("closings", np.int64),  # of the switch, in this pre-tightening
        ("zero", np.float64),  # stretch that counts as elongation 0 [m]; NaN: unknown
        ("stretch", np.float64),  # wound length and way between the points, newest [m]
        ("closed_stretch", np.float64),  # the same when the switch was closed last [m]; NaN: never
        ("stiffness", np.float64),  # k_e at the newest length [N/m]
        ("switch_elongation", np.float64),  # where the switch closes, at the newest length [m]
        ("compliance", np.float64),  # of all but the cable's length [m/N]
        ("compliance_per_metre", np.float64),  # of the cable [1/N]; 0: k_e is constant
    ],
    align=True,
)
"""What is remembered of one limb between samples."""

SENSOR_READING = np.dtype(
    [
        ("matrix", np.float64, (6, 6)),  # sensor's wrench per volt [N/V, N m/V]
        ("bias", np.float64, (6,)),  # volts at the tare [V]
        ("tare_weight", np.float64, (6,)),  # tool's weight at the tare, sensor frame [N, N m]
        ("volts_limit", np.float64),  # end of the converter [V]
        ("limits", np.float64, (6,)),  # range of the sensor, sensor frame [N, N m]
        ("transform", np.float64, (6, 6)),  # from the sensor's to the platform's frame
    ],
    align=True,
)
"""How volts of the force/torque sensor become a wrench."""


@cache
def _reading_dtype(cables: int) -> Any:
    """Build the dtype of limb_reading_work for n cables; the same object for the same number."""
    fields = [
        ("counts_per_metre", np.float64),
        ("switch_tension", np.float64),  # where a switch closes [N]
        ("wanted_closings", np.int64),  # of a switch before one sets its limb's zero
        ("sets_zeros", np.int64),  # whether switches that close set their limbs' zeros
        ("limbs", LIMB_READING, (cables,)),
    ]
    return np.dtype(fields, align=True)


def limb_reading_work(cables: int) -> Any:
    """Build the (1,) record that `limbs_into` works on: no zeros, switches taken as closed."""
    work = np.zeros(1, _reading_dtype(cables))
    work["limbs"]["zero"] = np.nan
    work["limbs"]["closed_stretch"] = np.nan
    work["limbs"]["was_closed"] = True
    return work


@njit(cache=True)
def limbs_into(
    raw: IntArray,
    closed: BoolArray,
    length: FloatArray,
    work: Any,
    zeroed: BoolArray,
    wound: FloatArray,
    elongation: FloatArray,
    tension: FloatArray,
) -> None:
    """Counters to wound length, elongation and tension estimate (3.9).

    Args:
        raw: (n,) 24-bit counters.
        closed: (n,) switches.
        length: (n,) of cable between its points [m].
        work: (1,) record of limb_reading_work; updated. Counts grow by the counters' change; where
            it sets zeros, a switch that has closed `wanted_closings` times sets its limb's.
        zeroed: (n,) whether the zero is known; updated.
        wound: (n,) wound length, filled [m].
        elongation: (n,) filled [m].
        tension: (n,) estimate, filled [N].
    """
    own = work[0]
    limbs, sets_zeros = own["limbs"], own["sets_zeros"]
    for i in range(raw.shape[0]):
        limb = limbs[i]
        moved = (raw[i] - limb["previous_raw"] + HALF_MODULUS) % ENCODER_MODULUS - HALF_MODULUS
        limb["counts"] += moved
        limb["previous_raw"] = raw[i]
        wound[i] = limb["counts"] / own["counts_per_metre"]
        # Winding in and motion of the platform away stretch a cable.
        stretch = wound[i] + length[i]
        if limb["compliance_per_metre"] > 0.0:
            softness = limb["compliance"] + limb["compliance_per_metre"] * length[i]
            limb["stiffness"] = 1.0 / softness
            limb["switch_elongation"] = own["switch_tension"] * softness
        if sets_zeros and closed[i] and not limb["was_closed"] and not zeroed[i]:
            limb["closings"] += 1
            if limb["closings"] >= own["wanted_closings"]:
                limb["zero"] = stretch - limb["switch_elongation"]
                zeroed[i] = True
        limb["was_closed"] = closed[i]
        limb["stretch"] = stretch
        if closed[i]:
            limb["closed_stretch"] = stretch
        elongation[i] = stretch - limb["zero"]
        tension[i] = limb["stiffness"] * elongation[i]


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
    sensor: Any, volts: FloatArray, weight: FloatArray, load: FloatArray, wrench: FloatArray
) -> tuple[int, int]:
    """Gauge volts to the wrench on the platform without the tool's weight.

    Args:
        sensor: (1,) record of SENSOR_READING.
        volts: (6,) of the gauges.
        weight: (6,) tool's weight now, platform frame.
        load: (6,) filled with the whole load of the sensor, sensor frame.
        wrench: (6,) filled with the wrench, platform frame.

    Returns:
        First gauge at the converter's end and first axis of load beyond its limit, -1 for none;
        one that is not a number counts as beyond.
    """
    own = sensor[0]
    matrix, bias, transform = own["matrix"], own["bias"], own["transform"]
    tare_weight, limits, volts_limit = own["tare_weight"], own["limits"], own["volts_limit"]
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

    Args:
        current: (n,) that is asked for [A].
        limit: largest magnitude of a current [A].
        before: (n,) currents of the cycle before [A].
        growth: most that a magnitude may grow by in a cycle [A].
        amperes_per_volt: gain of the amplifiers [A/V].
        reach: largest magnitude of the card's output [V].
        volts: (n,) to be filled [V].
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
