"""From limb states to what the law gets: kind of control, reference, position; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, IntArray

REST = 0
"""Zero current: the gear's friction holds."""
SWITCH = 1
"""Winding speed by the switch: in while it is open, out while it is closed."""
TENSION = 2
"""Tension control by elongation (3.10)."""
FOLLOW = 3
"""Tension control around the speed at which the platform lengthens the cable."""
SPEED = 4
"""A given winding speed [m/s]."""
CURRENT = 5
"""A given current [A]."""

RATE_FILTER_S = 0.012
"""The pose comes every 4 ms, the cable's length in steps: three of them smooth its rate."""


@njit(cache=True)
def references_into(
    kind: IntArray,
    zeroed: BoolArray,
    closed: BoolArray,
    wound: FloatArray,
    elongation: FloatArray,
    tension: FloatArray,
    wanted: FloatArray,
    gain: FloatArray,
    tension_limit: float,
    speed: float,
    dt_s: float,
    previous: IntArray,
    changed: BoolArray,
    length: FloatArray,
    rate: FloatArray,
    position: FloatArray,
    reference: FloatArray,
) -> bool:
    """Fill the law's inputs for n limbs; all arrays (n,) but kind.

    Args:
        kind: (n, 2) kind of control of each limb without and with a known zero.
        zeroed: whether the zero is known.
        closed: whether the switch is closed.
        wound: wound length [m].
        elongation: [m].
        tension: estimate [N].
        wanted: desired tension [N], or speed [m/s] or current [A] for SPEED and CURRENT.
        gain: k_P2 [m/s/N].
        tension_limit: bound on the desired tension [N].
        speed: of SWITCH [m/s].
        dt_s: time since the previous state [s].
        previous: kinds at the previous state; updated.
        changed: where the kind of control changes.
        length: of cable between its points, but for a constant, at the previous state; updated [m].
        rate: at which it grows, filtered; updated [m/s].
        position: what the law differentiates [m].
        reference: of the law [m/s].

    Returns:
        Whether any kind of control changes.
    """
    any_changed = False
    share = dt_s / (RATE_FILTER_S + dt_s)
    for i in range(wound.shape[0]):
        now = kind[i, 1] if zeroed[i] else kind[i, 0]
        changed[i] = now != previous[i]
        any_changed |= now != previous[i]
        previous[i] = now
        position[i] = wound[i]
        reference[i] = 0.0
        if now == SWITCH:
            # A switch that is closed before its zero is known must open first: the zero is set
            # where it closes.
            reference[i] = -speed if closed[i] else speed
        elif now == SPEED:
            reference[i] = wanted[i]
        elif now in (TENSION, FOLLOW):
            limited = min(max(wanted[i], 0.0), tension_limit)
            # 0 * x is NaN for what is not finite, and the law refuses that.
            reference[i] = gain[i] * (limited - tension[i]) + 0.0 * wanted[i]
            if now == TENSION:
                position[i] = elongation[i]
                continue
            # The pose's steps would reach the current through k_P1 if elongation were
            # differentiated; the motor's own motion has none, and the platform's comes filtered.
            beyond = elongation[i] - wound[i]
            if changed[i]:
                length[i], rate[i] = beyond, 0.0
            rate[i] += share * ((beyond - length[i]) / dt_s - rate[i])
            length[i] = beyond
            reference[i] -= rate[i]
    return any_changed


@njit(cache=True)
def override_into(kind: IntArray, wanted: FloatArray, limit: float, current: FloatArray) -> None:
    """Put zero, or the given current within +-limit, where the law is not in charge; all (n,)."""
    for i in range(kind.shape[0]):
        if kind[i] == REST:
            current[i] = 0.0
        elif kind[i] == CURRENT:
            # Written so that NaN becomes zero.
            value = wanted[i] if abs(wanted[i]) < np.inf else 0.0
            current[i] = min(max(value, -limit), limit)


@njit(cache=True)
def ramp_into(goal: float, step: float, tension: FloatArray, wanted: FloatArray) -> bool:
    """Move wanted (n,) towards goal by at most step [N]; where it is NaN, start from tension (n,).

    Returns:
        Whether all have arrived.
    """
    arrived = True
    for i in range(wanted.shape[0]):
        if not abs(wanted[i]) < np.inf:
            wanted[i] = tension[i] if abs(tension[i]) < np.inf else goal
        wanted[i] += min(max(goal - wanted[i], -step), step)
        arrived = arrived and wanted[i] == goal
    return arrived
