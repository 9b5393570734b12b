"""Compiled rules of the safety envelope, applied to every sample.

A rule that needs time counts how long it has been broken, in the rows of `since` (3, n), see
SINCE_*. The first broken rule is returned.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray

FINE, ENCODER, TENSION, CABLE, SWITCH, CURRENT, MOTION = range(7)
SENSOR_INVALID, SENSOR_SATURATED, SENSOR_FLAT, WRENCH, ESTIMATE = range(7, 12)
SINCE_CABLE, SINCE_CURRENT, SINCE_MOTION = range(3)
SINCE_ROWS = 3
OBSERVER_RATE = 100.0
"""Bandwidth of the observer that separates current from motion [1/s]: 10 ms."""


@njit(cache=True)
def forget_motion(
    wound: FloatArray, last_wound: FloatArray, last_speed: FloatArray, observed: FloatArray
) -> None:
    """Reset the speeds to rest, e.g. after a gap in the samples; all (n,)."""
    last_wound[:] = wound
    last_speed[:] = np.nan
    observed[:] = 0.0


@njit(cache=True)
def judge_limbs(
    dt_s: float,
    limits: FloatArray,
    gain: FloatArray,
    time_constant: FloatArray,
    wound: FloatArray,
    tension: FloatArray,
    current: FloatArray,
    closed: BoolArray,
    zeroed: BoolArray,
    began: FloatArray,
    last_wound: FloatArray,
    last_speed: FloatArray,
    observed: FloatArray,
    since: FloatArray,
) -> tuple[int, int]:
    """Apply the limbs' rules.

    The motor is (3.11): T dv/dt + v = k i. An observer follows the measured speed; its correction
    of k i is the current that friction, load or a defect takes away.

    Args:
        dt_s: since the sample before [s].
        limits: (9,) encoder_jump, tension_max, cable_tension, cable_time, current limit [A],
            current_saturated, motion_current, motion_time, switch_payout.
        gain: (n,) k [m/s/A].
        time_constant: (n,) T [s].
        wound: (n,) wound length [m].
        tension: (n,) estimate [N], NaN before zeroing.
        current: (n,) on the amplifiers [A].
        closed: (n,) switches.
        zeroed: (n,) whether the estimate counts.
        began: (n,) wound length at which PRETIGHTENING began [m]; NaN in other modes.
        last_wound: (n,) of the sample before [m], updated.
        last_speed: (n,) of the sample before [m/s], NaN if unknown; updated.
        observed: (n,) the observer's speed [m/s], updated.
        since: (SINCE_ROWS, n) how long each rule has been broken [s], updated.

    Returns:
        The broken rule, or FINE, and the limb.
    """
    found, limb = FINE, -1
    for i in range(wound.shape[0]):
        speed = (wound[i] - last_wound[i]) / dt_s
        jumped = abs(speed - last_speed[i]) > limits[0]
        if np.isnan(last_speed[i]):
            jumped = False
            observed[i] = speed
        last_wound[i] = wound[i]
        last_speed[i] = speed
        missing = OBSERVER_RATE * (speed - observed[i])
        observed[i] += dt_s * ((gain[i] * current[i] - observed[i]) / time_constant[i] + missing)
        unexplained = abs(missing) * time_constant[i] / gain[i] > limits[6]
        broken = zeroed[i] and not closed[i] and not tension[i] <= limits[2]
        stuck = closed[i] and not zeroed[i] and began[i] - wound[i] > limits[8]
        saturated = abs(current[i]) >= 0.99 * limits[4]
        since[SINCE_CABLE, i] = since[SINCE_CABLE, i] + dt_s if broken else 0.0
        since[SINCE_CURRENT, i] = since[SINCE_CURRENT, i] + dt_s if saturated else 0.0
        since[SINCE_MOTION, i] = since[SINCE_MOTION, i] + dt_s if unexplained else 0.0
        if found != FINE:
            continue
        if jumped:
            found, limb = ENCODER, i
        elif zeroed[i] and not tension[i] <= limits[1]:
            found, limb = TENSION, i
        elif since[SINCE_CABLE, i] > limits[3]:
            found, limb = CABLE, i
        elif stuck:
            found, limb = SWITCH, i
        elif since[SINCE_CURRENT, i] > limits[5]:
            found, limb = CURRENT, i
        elif since[SINCE_MOTION, i] > limits[7]:
            found, limb = MOTION, i
    return found, limb


@njit(cache=True)
def judge_sensor(
    dt_s: float,
    volts: FloatArray,
    last_volts: FloatArray,
    saturated_volts: float,
    flat_time: float,
    since_flat: FloatArray,
) -> tuple[int, int]:
    """Apply the rules of the (6,) gauge voltages; since_flat (6,) [s] is updated.

    Returns:
        The broken rule, or FINE, and the gauge.
    """
    found, gauge = FINE, -1
    for k in range(6):
        same = volts[k] == last_volts[k]
        last_volts[k] = volts[k]
        since_flat[k] = since_flat[k] + dt_s if same else 0.0
        if found != FINE:
            continue
        if not np.isfinite(volts[k]):
            found, gauge = SENSOR_INVALID, k
        elif not abs(volts[k]) <= saturated_volts:
            found, gauge = SENSOR_SATURATED, k
        elif flat_time > 0.0 and since_flat[k] > flat_time:
            found, gauge = SENSOR_FLAT, k
    return found, gauge


@njit(cache=True)
def judge_wrench(
    dt_s: float,
    wrench: FloatArray,
    wrench_max: FloatArray,
    tension: FloatArray,
    matrix: FloatArray,
    rotation: FloatArray,
    limits: FloatArray,
    since: FloatArray,
) -> tuple[int, int]:
    """Compare the measured wrench (6,), platform axes, with its limits and the tensions.

    Args:
        dt_s: since the sample before [s].
        wrench: (6,) measured, platform axes [N, N m].
        wrench_max: (6,) limits, same axes.
        tension: (n,) estimates [N]; where one is NaN the comparison is left out.
        matrix: (6, n) structure matrix, base axes.
        rotation: (3, 3) platform to base.
        limits: (3,) estimate_force, estimate_torque, estimate_time.
        since: (1,) how long they have disagreed [s], updated.

    Returns:
        The broken rule, or FINE, and the axis.
    """
    for k in range(6):
        if not abs(wrench[k]) <= wrench_max[k]:
            return WRENCH, k
    force = torque = 0.0
    for axis in range(3):
        error_f = error_t = 0.0
        for i in range(tension.shape[0]):
            error_f += matrix[axis, i] * tension[i]
            error_t += matrix[3 + axis, i] * tension[i]
        for k in range(3):
            error_f -= rotation[axis, k] * wrench[k]
            error_t -= rotation[axis, k] * wrench[3 + k]
        force += error_f * error_f
        torque += error_t * error_t
    apart = force > limits[0] ** 2 or torque > limits[1] ** 2
    since[0] = since[0] + dt_s if apart else 0.0
    return (ESTIMATE if since[0] > limits[2] else FINE), -1
