# SPDX-License-Identifier: Apache-2.0
"""From limb states to the law's inputs: kind of control, reference, position; compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.limb_control.records import ControlKind

RATE_FILTER_S = 0.012
"""Time constant of the filter of the cable's rate, three periods of the pose (4 ms each) [s]."""
RATE_MOST = 10.0
"""Rate beyond which no cable goes [m/s]: what looks faster, or is no number, must not stay in the
filter."""

LEAD_S = 0.0005
"""How far ahead of its sample a current acts in the mean: half of the period at 1 kHz for which it
is held [s]."""


@njit(cache=True)
def follow_backlash(limb: Any, wound: float) -> float:
    """Return how much more than its motor says a cable is stretched, as its gear has play [m].

    The cable moves once the motor has crossed the play (an operator of play, as in Krasnosel'skii
    and Pokrovskii 1989, section 2). Zeros are set while a motor winds in, so that it is nothing
    while one winds in, and all of the play while one pays out.

    Args:
        limb: record of LIMB; updated.
        wound: length by the motor's encoder [m].
    """
    half = 0.5 * limb["backlash"]
    if not (half > 0.0 and abs(wound) < np.inf):
        return 0.0
    limb["pulley"] = min(max(limb["pulley"], wound - half), wound + half)
    return float(half - (wound - limb["pulley"]))


@njit(cache=True)
def set_references(state: Any, task: Any, limbs: Any, dt_s: float) -> None:
    """Set each limb's kind of control, position and reference.

    Args:
        state: record of the limb state.
        task: record of TASK.
        limbs: (m,) records of LIMB whose setpoints are set; updated.
        dt_s: time since the previous state [s].
    """
    share = dt_s / (RATE_FILTER_S + dt_s)
    # Reading one of these costs more than its use, so they are read outside the loop.
    wound_lengths, elongations, tensions = (
        state["wound_length"],
        state["elongation"],
        state["tension"],
    )
    zeroed, switch_closed = state["zeroed"], state["switch_closed"]
    speeds, changes = state["cable_speed"], state["cable_acceleration"]
    for place in range(limbs.shape[0]):
        limb = limbs[place]
        i = limb["limb"]
        now = task["kind_with_zero"] if zeroed[i] else task["kind_without_zero"]
        if place == task["programme_place"]:
            now = task["programme_kind"]
        limb["changed"] = now != limb["kind"]
        limb["kind"] = now
        wound = wound_lengths[i]
        more = follow_backlash(limb, wound)
        # A moving platform will have stretched the cable once the current acts.
        if now == ControlKind.TENSION and abs(speeds[i]) <= RATE_MOST:
            more += LEAD_S * speeds[i]
        limb["position"] = wound
        limb["reference"] = limb["feed_forward"] = 0.0
        if now == ControlKind.SWITCH:
            # A switch that is closed before its zero is known must open first: the zero is set
            # where it closes.
            limb["reference"] = -task["speed"] if switch_closed[i] else task["speed"]
        elif now == ControlKind.SPEED:
            limb["reference"] = limb["setpoint"]
        elif now == ControlKind.TENSION or now == ControlKind.FOLLOW:
            limited = min(max(limb["setpoint"], 0.0), task["tension_limit"])
            # 0 * x is NaN for an x that is not finite, which the law refuses.
            error = limited - tensions[i] - limb["stiffness"] * more
            limb["reference"] = limb["tension_gain"] * error + 0.0 * limb["setpoint"]
            elongation = elongations[i]
            if now == ControlKind.TENSION:
                limb["position"] = elongation + more
                # The motor pays out as the platform lengthens the cable: T v_dot + v = k i (3.11).
                ahead = limb["current_per_speed"] * speeds[i]
                ahead += limb["current_per_change"] * changes[i]
                limb["feed_forward"] = -ahead if abs(ahead) < np.inf else 0.0
                continue
            # The pose's steps would reach the current through k_P1 if elongation were
            # differentiated; the motor's own motion has none, and the platform's comes filtered.
            beyond = elongation - wound
            if limb["changed"]:
                limb["cable_length"], limb["cable_rate"] = beyond, 0.0
            rate = (beyond - limb["cable_length"]) / dt_s
            if abs(rate) <= RATE_MOST:
                limb["cable_rate"] += share * (rate - limb["cable_rate"])
            limb["cable_length"] = beyond
            limb["reference"] -= limb["cable_rate"] + 0.0 * beyond


@njit(cache=True)
def override_currents(limbs: Any, limit: float) -> None:
    """Write zero, or a given current, where the law does not control.

    Args:
        limbs: (m,) records of LIMB; `current` is set where the kind is REST or CURRENT.
        limit: largest current either way [A].
    """
    for place in range(limbs.shape[0]):
        limb = limbs[place]
        if limb["kind"] == ControlKind.REST:
            limb["current"] = 0.0
        elif limb["kind"] == ControlKind.CURRENT:
            # Written so that NaN becomes zero.
            given = limb["setpoint"]
            value = given if abs(given) < np.inf else 0.0
            limb["current"] = min(max(value, -limit), limit)


@njit(cache=True)
def set_setpoints(
    state: Any, task: Any, limbs: Any, given: FloatArray, dt_s: float, anew: bool, near: float
) -> bool:
    """Set each limb's setpoint: as given, or one step along its ramp.

    Args:
        state: record of the limb state.
        task: record of TASK.
        limbs: (m,) records of LIMB; updated.
        given: (m,) setpoints of a task without ramps.
        dt_s: time since the previous state [s].
        anew: whether ramps start at the present tensions.
        near: how near the goal a tension counts as there [N].

    Returns:
        Whether every ramp is at its end and every tension with a known zero near it.
    """
    step, goal, arrived = task["rate"] * dt_s, task["goal"], True
    tensions, zeroed = state["tension"], state["zeroed"]
    for place in range(limbs.shape[0]):
        limb = limbs[place]
        if place == task["programme_place"]:
            limb["setpoint"] = task["programme_value"]
        elif not task["ramps"]:
            limb["setpoint"] = given[place]
        else:
            i = limb["limb"]
            tension, ramp = tensions[i], limb["ramp"]
            if anew or not abs(ramp) < np.inf:
                ramp = tension if abs(tension) < np.inf else goal
            ramp += min(max(goal - ramp, -step), step)
            limb["ramp"] = limb["setpoint"] = ramp
            there = abs(tension - goal) <= near or not zeroed[i]
            arrived = arrived and ramp == goal and there
    return arrived
