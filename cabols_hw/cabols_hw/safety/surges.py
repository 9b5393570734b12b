# SPDX-License-Identifier: Apache-2.0
"""Compiled rules for a motor that gets more current than anybody commands, for every sample."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.compiling import njit

LONG_SAMPLE_S = 0.0035
"""In a sample that took longer nobody knows which current flowed when: the observer starts anew."""
SURGE_A = 2.0
"""Current beyond all commands of the last samples that two samples in a row may not show [A]: an
amplifier that drives by itself is found by it within 3 ms, where the observer takes 5 to 7."""
SURGE_SAMPLES = 2.0
SURPLUS_A, SURPLUS_SHARE = 0.25, 0.1
"""What a motor that winds in may seem to get beyond all commands of the last samples [A], and more
by a share of them: friction takes current, and only a wrong model seems to add any."""
SURPLUS_AS = 0.0035
"""Charge beyond that, gathered while a motor winds in, by which an amplifier drives by itself
[A s]: with 1 A it is off after 6 ms, where the observer takes 14."""
SURPLUS_STEP_AS = 0.00125
"""Most that one sample can add to it [A s]: a count that jumps, or begins to run away, is no
current that lasts."""
BLOCK_S = 0.016
"""Commands of the last one to two blocks may explain such a charge [s]: a bridge that was held up
and reads its buffer of 16 samples in haste does not know when its commands took effect."""
LONE_A = 1.0
"""A step of the speed stands alone if the sample after it shows no more than this beyond all
commands, to the same side [A]: a current of 3 A goes on, whether or not it is beyond SURGE_A."""
CERTAIN_AS = 2.0 * SURPLUS_AS
"""Charge that goes on being gathered after a step: no step's, but an amplifier's [A s]."""
STEPPED_S = 0.1
"""How long a step of the speed is remembered that no current explains, of a single sample: what
follows is then the encoder's fault, not the amplifier's [s]."""


@njit(cache=True)
def note_surge(own: Any, quantum: float, speed: float, current: float, dt_s: float) -> None:
    """Count the samples in a row in which a motor gets more current than anybody commanded.

    A smaller one, while the motor winds in, is gathered until it is beyond doubt.

    The current follows from two speeds by (3.11). When in a sample a command came is not known, so
    those of the last four all may explain it; so may the encoder's steps. A motor that stays
    behind its current does not count here.

    Args:
        own: record of LIMB_WATCH, of the sample before.
        quantum: length of one count [m].
        speed: in this sample [m/s].
        current: on the amplifier at its end [A].
        dt_s: its length [s].
    """
    before = own["last_speed"]
    mean_s = 0.5 * (dt_s + own["last_dt"])
    low = min(current, own["before"], own["earlier"], own["earliest"], 0.0)
    high = max(current, own["before"], own["earlier"], own["earliest"], 0.0)
    own["earliest"], own["earlier"], own["before"] = own["earlier"], own["before"], current
    own["last_dt"] = dt_s
    inertia = own["time_constant"] / own["gain"]
    shown = inertia * (speed - before) / mean_s + 0.5 * (speed + before) / own["gain"]
    allowed = SURGE_A + 2.0 * quantum * inertia / (dt_s * mean_s)
    counted = own["surge"]
    goes_on = counted * (shown - (high if counted > 0.0 else low)) > LONE_A
    if dt_s > LONG_SAMPLE_S or not low - allowed <= shown <= high + allowed:
        sign = 0.0 if dt_s > LONG_SAMPLE_S or np.isnan(shown) else np.sign(shown - high)
        own["surge"] = sign + (own["surge"] if own["surge"] * sign > 0.0 else 0.0)
    else:
        own["surge"] = 0.0
    lone = abs(counted) == 1.0 and abs(own["surge"]) <= 1.0 and not goes_on
    lone = lone and dt_s <= LONG_SAMPLE_S
    own["stepped"] = STEPPED_S if lone else max(own["stepped"] - dt_s, 0.0)
    _note_command(own, current, dt_s)
    # Speeds follow each other without a gap, so that the encoder's steps do not add up.
    most, least = max(own["most"], own["most_before"]), min(own["least"], own["least_before"])
    beyond = shown - most - SURPLUS_A - SURPLUS_SHARE * max(most, -least)
    own["surplus"] = _gathered(own["surplus"], beyond, mean_s, speed > 0.0)
    # A motor or an encoder that is reversed: it goes out although nobody pays out.
    winds_in = least >= 0.0 and current > 0.0 and speed < 0.0
    own["against"] = _gathered(own["against"], -shown - SURPLUS_A, mean_s, winds_in)


@njit(cache=True)
def _note_command(own: Any, current: float, dt_s: float) -> None:
    """Keep the largest and the least command of this block of time and of the one before.

    Args:
        own: record of LIMB_WATCH.
        current: on the amplifier [A].
        dt_s: of the sample [s].
    """
    own["block_s"] += dt_s
    if not own["block_s"] <= BLOCK_S:
        own["most_before"], own["least_before"] = own["most"], own["least"]
        own["most"] = own["least"] = current
        own["block_s"] = 0.0
    own["most"], own["least"] = max(own["most"], current), min(own["least"], current)


@njit(cache=True)
def _gathered(charge: float, beyond: float, dt_s: float, counts: bool) -> float:
    """Add a current that nobody commands [A] to a charge [A s]; what does not count ends it.

    Args:
        charge: so far [A s].
        beyond: what no command explains [A].
        dt_s: time of it [s].
        counts: whether the motor goes where that would drive it.
    """
    if dt_s > LONG_SAMPLE_S or not (counts and np.isfinite(beyond)):
        return 0.0
    return max(charge + min(beyond * dt_s, SURPLUS_STEP_AS), 0.0)
