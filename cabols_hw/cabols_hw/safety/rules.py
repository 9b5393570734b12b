"""Compiled rules of the safety envelope, applied to every sample.

A rule that needs time counts for how long it has been broken. The first broken rule is returned.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray


class Rule(IntEnum):
    """What a sample can break."""

    FINE = 0
    ENCODER = 1
    TENSION = 2
    CABLE = 3
    SWITCH = 4
    CURRENT = 5
    MOTION = 6
    SENSOR_INVALID = 7
    SENSOR_SATURATED = 8
    SENSOR_FLAT = 9
    WRENCH = 10
    ESTIMATE = 11


OBSERVER_RATE = 100.0
"""Bandwidth of the observer that separates current from motion [1/s]: 10 ms."""

LIMB_LIMITS = np.dtype(
    [
        ("encoder_jump", np.float64),
        ("tension_max", np.float64),
        ("cable_tension", np.float64),
        ("cable_time", np.float64),
        ("current_limit", np.float64),  # of the bridge [A]
        ("current_saturated", np.float64),
        ("motion_current", np.float64),
        ("motion_time", np.float64),
        ("switch_payout", np.float64),
    ],
    align=True,
)
"""Limits of the limbs' rules, as in SafetyConfig."""

LIMB_WATCH = np.dtype(
    [
        ("gain", np.float64),  # k [m/s/A]
        ("time_constant", np.float64),  # T [s]
        ("began", np.float64),  # wound length at PRETIGHTENING's begin [m]; NaN in other modes
        ("last_wound", np.float64),  # of the sample before [m]
        ("last_speed", np.float64),  # of the sample before [m/s]; NaN if unknown
        ("observed", np.float64),  # the observer's speed [m/s]
        ("cable_s", np.float64),  # how long the switch has contradicted the estimate [s]
        ("current_s", np.float64),  # how long the current has been at its limit [s]
        ("motion_s", np.float64),  # how long current has been missing from the motion [s]
    ],
    align=True,
)
"""Model and memory of one limb."""

WRENCH_WATCH = np.dtype(
    [
        ("wrench_max", np.float64, (6,)),  # platform axes [N, N m]
        ("estimate_force", np.float64),  # [N]
        ("estimate_torque", np.float64),  # [N m]
        ("estimate_time", np.float64),  # [s]
        ("apart_s", np.float64),  # how long sensor and estimates have disagreed [s]
    ],
    align=True,
)
"""Limits and memory of the wrench's rules."""


@njit(cache=True)
def forget_motion(wound: FloatArray, watch: Any) -> None:
    """Reset the speeds to rest, e.g. after a gap in the samples.

    Args:
        wound: (n,) wound length [m].
        watch: (n,) records of LIMB_WATCH; updated.
    """
    for i in range(wound.shape[0]):
        watch[i]["last_wound"] = wound[i]
        watch[i]["last_speed"] = np.nan
        watch[i]["observed"] = 0.0


@njit(cache=True)
def judge_limbs(
    dt_s: float,
    limits: Any,
    watch: Any,
    wound: FloatArray,
    tension: FloatArray,
    current: FloatArray,
    closed: BoolArray,
    zeroed: BoolArray,
) -> tuple[int, int]:
    """Apply the limbs' rules.

    The motor is (3.11): T dv/dt + v = k i. An observer follows the measured speed; its correction
    of k i is the current that friction, load or a defect takes away.

    Args:
        dt_s: since the sample before [s].
        limits: (1,) record of LIMB_LIMITS.
        watch: (n,) records of LIMB_WATCH; updated.
        wound: (n,) wound length [m].
        tension: (n,) estimate [N], NaN before zeroing.
        current: (n,) on the amplifiers [A].
        closed: (n,) switches.
        zeroed: (n,) whether the estimate counts.

    Returns:
        The broken Rule, or FINE, and the limb.
    """
    found, limb, most = Rule.FINE.value, -1, limits[0]
    for i in range(wound.shape[0]):
        own = watch[i]
        gain, time_constant = own["gain"], own["time_constant"]
        speed = (wound[i] - own["last_wound"]) / dt_s
        jumped = abs(speed - own["last_speed"]) > most["encoder_jump"]
        if np.isnan(own["last_speed"]):
            jumped = False
            own["observed"] = speed
        own["last_wound"] = wound[i]
        own["last_speed"] = speed
        missing = OBSERVER_RATE * (speed - own["observed"])
        pull = (gain * current[i] - own["observed"]) / time_constant + missing
        own["observed"] += dt_s * pull
        unexplained = abs(missing) * time_constant / gain > most["motion_current"]
        broken = zeroed[i] and not closed[i] and not tension[i] <= most["cable_tension"]
        paid_out = own["began"] - wound[i]
        stuck = closed[i] and not zeroed[i] and paid_out > most["switch_payout"]
        saturated = abs(current[i]) >= 0.99 * most["current_limit"]
        own["cable_s"] = own["cable_s"] + dt_s if broken else 0.0
        own["current_s"] = own["current_s"] + dt_s if saturated else 0.0
        own["motion_s"] = own["motion_s"] + dt_s if unexplained else 0.0
        if found != Rule.FINE:
            continue
        if jumped:
            found, limb = Rule.ENCODER.value, i
        elif zeroed[i] and not tension[i] <= most["tension_max"]:
            found, limb = Rule.TENSION.value, i
        elif own["cable_s"] > most["cable_time"]:
            found, limb = Rule.CABLE.value, i
        elif stuck:
            found, limb = Rule.SWITCH.value, i
        elif own["current_s"] > most["current_saturated"]:
            found, limb = Rule.CURRENT.value, i
        elif own["motion_s"] > most["motion_time"]:
            found, limb = Rule.MOTION.value, i
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
        The broken Rule, or FINE, and the gauge.
    """
    found, gauge = Rule.FINE.value, -1
    for k in range(6):
        same = volts[k] == last_volts[k]
        last_volts[k] = volts[k]
        since_flat[k] = since_flat[k] + dt_s if same else 0.0
        if found != Rule.FINE:
            continue
        if not np.isfinite(volts[k]):
            found, gauge = Rule.SENSOR_INVALID.value, k
        elif not abs(volts[k]) <= saturated_volts:
            found, gauge = Rule.SENSOR_SATURATED.value, k
        elif flat_time > 0.0 and since_flat[k] > flat_time:
            found, gauge = Rule.SENSOR_FLAT.value, k
    return found, gauge


@njit(cache=True)
def judge_wrench(
    dt_s: float,
    watch: Any,
    wrench: FloatArray,
    tension: FloatArray,
    matrix: FloatArray,
    rotation: FloatArray,
) -> tuple[int, int]:
    """Compare the measured wrench (6,), platform axes, with its limits and the tensions.

    Args:
        dt_s: since the sample before [s].
        watch: (1,) record of WRENCH_WATCH; updated.
        wrench: (6,) measured, platform axes [N, N m].
        tension: (n,) estimates [N]; where one is NaN the comparison is left out.
        matrix: (6, n) structure matrix, base axes.
        rotation: (3, 3) platform to base.

    Returns:
        The broken Rule, or FINE, and the axis.
    """
    own = watch[0]
    most = own["wrench_max"]
    for k in range(6):
        if not abs(wrench[k]) <= most[k]:
            return Rule.WRENCH.value, k
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
    apart = force > own["estimate_force"] ** 2 or torque > own["estimate_torque"] ** 2
    own["apart_s"] = own["apart_s"] + dt_s if apart else 0.0
    return (Rule.ESTIMATE.value if own["apart_s"] > own["estimate_time"] else Rule.FINE.value), -1
