# SPDX-License-Identifier: Apache-2.0
"""What a programme that is known in advance asks of the motors: to follow, and to be stopped."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from cabols_control.checks import FloatArray
from cabols_control.load_programs.preview import PERIOD_S
from cabols_control.rig import Rig

BRAKE_LAG_S = 0.006
"""From a sample to the whole braking current: two samples, and the ramp of the current [s]."""
WINDOW = 7
"""Points of the moving average before tensions are differentiated."""
LASTING = 80
"""Points over which a current counts as lasting: the bridge allows 0.1 s at the limit."""


def gained_until_stopped(rig: Rig, tension: FloatArray) -> FloatArray:
    """Tension that each limb that winds in still gains until full current has stopped its motor.

    As the bridge's envelope has it, by (3.11) without damping and friction.

    Args:
        rig: limbs, current limit.
        tension: (k, n) along a programme, a point per millisecond [N].

    Returns:
        (k, n), at least 0 [N].
    """
    springs = rig.springs.nominal
    speed = np.maximum(_speed(rig, tension), 0.0)
    drive = np.array(rig.limbs.gain) / np.array(rig.limbs.time_constant)
    # Until the braking acts the motor goes on to be driven.
    driven = speed + 0.5 * BRAKE_LAG_S * np.maximum(np.gradient(speed, PERIOD_S, axis=0), 0.0)
    driven = np.where(speed > 0.0, driven, 0.0)
    way = driven * BRAKE_LAG_S + 0.5 * driven**2 / (drive * rig.control.current_limit)
    return np.asarray(springs * way)


def saturating_current(rig: Rig, tension: FloatArray) -> FloatArray:
    """Largest current of any motor along a programme, averaged over a while, by (3.11).

    A motor may be at its limit for a moment, not for long.

    Args:
        rig: limbs.
        tension: (k, n) along a programme, a point per millisecond [N].

    Returns:
        (k,) [A].
    """
    speed = _speed(rig, tension)
    rise = np.array(rig.limbs.time_constant) * np.gradient(speed, PERIOD_S, axis=0)
    current = (speed + rise) / np.array(rig.limbs.gain)
    lasting = uniform_filter1d(np.abs(current), LASTING, axis=0, mode="nearest")
    return np.asarray(lasting.max(axis=1))


def _speed(rig: Rig, tension: FloatArray) -> FloatArray:
    """(k, n) speeds that wind the springs along tensions (k, n) [m/s]."""
    smooth = uniform_filter1d(tension, WINDOW, axis=0, mode="nearest")
    return np.asarray(np.gradient(smooth, PERIOD_S, axis=0) / rig.springs.nominal)
