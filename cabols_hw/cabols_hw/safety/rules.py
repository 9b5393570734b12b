# SPDX-License-Identifier: Apache-2.0
"""Compiled rules of the safety envelope about sensor and wrench, applied to every sample.

A rule that needs time counts for how long it has been broken. The first broken rule is returned.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit


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
    CABLE_SPEED = 12
    SEARCH = 13
    PAYOUT = 14
    SLACK = 15


ALL_FLAT = 0.1
"""Share of the time for which one gauge may stay the same that all six may at once."""

STOPPED_SHARE = 0.7
"""Share of all motors' stopping distances, those that pay out among them, by which a wrench may go
on: damping and friction, which the distances leave out, take the rest at least."""

WRENCH_WATCH = np.dtype(
    [
        ("wrench_max", np.float64, (6,)),  # platform axes [N, N m]
        ("in_all", np.int64),  # whether they hold for the force and torque in all, not by axis
        ("estimate_force", np.float64),  # [N]
        ("estimate_torque", np.float64),  # [N m]
        ("estimate_time", np.float64),  # [s]
        ("apart_s", np.float64),  # how long sensor and estimates have disagreed [s]
    ],
    align=True,
)
"""Limits and memory of the wrench's rules."""


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

    Args:
        dt_s: since the last sample [s].
        volts: (6,) of the gauges [V].
        last_volts: (6,) of the sample before [V].
        saturated_volts: magnitude from which a gauge is saturated [V].
        flat_time: longest that a gauge may stand still to the bit [s].
        since_flat: (6,) for how long each has stood still [s]; updated.

    Returns:
        The broken Rule, or FINE, and the gauge.
    """
    found, gauge, shortest = Rule.FINE.value, -1, np.inf
    for k in range(6):
        same = volts[k] == last_volts[k]
        last_volts[k] = volts[k]
        since_flat[k] = since_flat[k] + dt_s if same else 0.0
        shortest = min(shortest, since_flat[k])
        if found != Rule.FINE:
            continue
        if not np.isfinite(volts[k]):
            found, gauge = Rule.SENSOR_INVALID.value, k
        elif not abs(volts[k]) <= saturated_volts:
            found, gauge = Rule.SENSOR_SATURATED.value, k
        elif flat_time > 0.0 and since_flat[k] > flat_time:
            found, gauge = Rule.SENSOR_FLAT.value, k
    if found == Rule.FINE and flat_time > 0.0 and shortest > ALL_FLAT * flat_time:
        found, gauge = Rule.SENSOR_FLAT.value, 0
    return found, gauge


@njit(cache=True)
def _to_platform(rotation: FloatArray, wrench: FloatArray) -> FloatArray:
    """Turn a wrench (6,) from base to platform axes.

    Args:
        rotation: (3, 3) platform to base.
        wrench: (6,) base axes [N, N m].
    """
    turned = np.zeros(6)
    for k in range(3):
        for axis in range(3):
            turned[k] += rotation[axis, k] * wrench[axis]
            turned[3 + k] += rotation[axis, k] * wrench[3 + axis]
    return turned


@njit(cache=True)
def _axis_beyond(wrench: FloatArray, growth: FloatArray, most: FloatArray, in_all: bool) -> int:
    """Find the axis in which a wrench grows beyond its limit, or -1.

    Args:
        wrench: (6,) now, platform axes [N, N m].
        growth: (6,) that is added until motors stand, likewise.
        most: (6,) limits, likewise.
        in_all: whether they hold for force and torque in all, too.
    """
    shares = np.zeros(2)
    for k in range(6):
        after = wrench[k] + growth[k]
        shares[k // 3] += (after / most[k]) ** 2
        if abs(after) > most[k] and abs(after) > abs(wrench[k]):
            return k
    for part in range(2):
        if in_all and shares[part] > 1.0:
            first = 3 * part
            return first + int(np.argmax(np.abs(wrench[first : first + 3])))
    return -1


@njit(cache=True)
def judge_wrench(
    dt_s: float,
    watch: Any,
    wrench: FloatArray,
    tension: FloatArray,
    matrix: FloatArray,
    rotation: FloatArray,
    limbs: Any,
) -> tuple[int, int]:
    """Compare the measured wrench (6,), platform axes, with its limits and the tensions.

    The limits hold for the wrench, for the one that it becomes until all motors that wind in can be
    stopped, and for the one until all motors stand: a cable that lets go adds to what its
    antagonists pull. So they do for the wrench that the tension estimates make.

    Args:
        dt_s: since the sample before [s].
        watch: (1,) record of WRENCH_WATCH; updated.
        wrench: (6,) measured, platform axes [N, N m].
        tension: (n,) estimates [N]; where one is NaN the comparison is left out.
        matrix: (6, n) structure matrix, base axes.
        rotation: (3, 3) platform to base.
        limbs: (n,) records of LIMB_WATCH of this sample.

    Returns:
        The broken Rule, or FINE, and the axis.
    """
    own = watch[0]
    most = own["wrench_max"]
    for k in range(6):
        if not abs(wrench[k]) <= most[k]:
            return Rule.WRENCH.value, k
    added, released = np.zeros(6), np.zeros(6)
    estimated, known = np.zeros(6), True
    for i in range(tension.shape[0]):
        ahead = limbs[i]["ahead"]
        known = known and not np.isnan(tension[i])
        for k in range(6):
            estimated[k] += matrix[k, i] * tension[i]
        if ahead > 0.0:
            for k in range(6):
                added[k] += matrix[k, i] * ahead
        elif ahead < 0.0 and tension[i] > 0.0:
            # What it goes on to let go until it stands, at most all that it has.
            for k in range(6):
                released[k] += matrix[k, i] * max(ahead, -tension[i])
    estimated = _to_platform(rotation, estimated)
    added, released = _to_platform(rotation, added), _to_platform(rotation, released)
    both = STOPPED_SHARE * (added + released)
    for growth in (added, both):
        axis = _axis_beyond(wrench, growth, most, own["in_all"] != 0)
        if axis < 0 and known:
            # A sensor that has stopped shows no load that grows.
            axis = _axis_beyond(estimated, growth, most, own["in_all"] != 0)
        if axis >= 0:
            return Rule.WRENCH.value, axis
    force = torque = 0.0
    for k in range(3):
        force += (estimated[k] - wrench[k]) ** 2
        torque += (estimated[3 + k] - wrench[3 + k]) ** 2
    apart = force > own["estimate_force"] ** 2 or torque > own["estimate_torque"] ** 2
    own["apart_s"] = own["apart_s"] + dt_s if apart else 0.0
    return (Rule.ESTIMATE.value if own["apart_s"] > own["estimate_time"] else Rule.FINE.value), -1
