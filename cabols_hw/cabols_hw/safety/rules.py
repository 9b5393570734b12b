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
    antagonists pull.

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
    for i in range(tension.shape[0]):
        ahead = limbs[i]["ahead"]
        if ahead > 0.0:
            for k in range(6):
                added[k] += matrix[k, i] * ahead
        elif ahead < 0.0 and tension[i] > 0.0:
            # What it goes on to let go until it stands, at most all that it has.
            for k in range(6):
                released[k] += matrix[k, i] * max(ahead, -tension[i])
    for after in range(2):
        if after == 1:
            added = STOPPED_SHARE * (added + released)
        shares = np.zeros(2)
        for k in range(3):
            force, torque = wrench[k], wrench[3 + k]
            for axis in range(3):
                force += rotation[axis, k] * added[axis]
                torque += rotation[axis, k] * added[3 + axis]
            shares[0] += (force / most[k]) ** 2
            shares[1] += (torque / most[3 + k]) ** 2
            if abs(force) > most[k] and abs(force) > abs(wrench[k]):
                return Rule.WRENCH.value, k
            if abs(torque) > most[3 + k] and abs(torque) > abs(wrench[3 + k]):
                return Rule.WRENCH.value, 3 + k
        for part in range(2):
            if own["in_all"] and shares[part] > 1.0:
                first = 3 * part
                return Rule.WRENCH.value, first + int(np.argmax(np.abs(wrench[first : first + 3])))
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
