# SPDX-License-Identifier: Apache-2.0
"""Compiled rules of the safety envelope about the limbs, applied to every sample in every mode."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.compiling import njit
from cabols_control.load_programs.stopping import BRAKE_LAG_S
from cabols_control.rig import Rig
from cabols_hw.bridge.braking import RESPONSE_S
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.rules import Rule
from cabols_hw.safety.surges import LONG_SAMPLE_S, SURGE_SAMPLES, SURPLUS_AS, note_surge

OBSERVER_RATE = 200.0
"""Bandwidth of the observer that separates current from motion [1/s]: 5 ms."""

FIRM_S = 0.005
"""A switch that was open for so long was not merely bouncing when it closes [s]."""
SLACK_S = 0.3
"""A limb whose switch has been open for so long although it should be closed may be slack [s]."""
SLACK_N = 1.0
"""By how much its estimate must be beyond the switch's tension for that [N]."""
MODEL_RATE = 5.0
"""At which the modelled speed follows the measured one [1/s]: slower than any stop."""

LIMB_LIMITS = np.dtype(
    [
        ("acts", np.int64),  # whether currents may flow; else nothing is found
        ("encoder_jump", np.float64),
        ("tension_max", np.float64),
        ("cable_speed", np.float64),
        ("search_speed", np.float64),
        ("search_length", np.float64),
        ("cable_tension", np.float64),
        ("cable_time", np.float64),
        ("switch_tension", np.float64),  # where a switch closes [N]
        ("current_limit", np.float64),  # of the bridge [A]
        ("current_saturated", np.float64),
        ("motion_current", np.float64),
        ("motion_time", np.float64),
        ("switch_payout", np.float64),
        ("quantum", np.float64),  # length of one count [m]
        ("searches", np.int64),  # whether limbs without a zero go by their switches alone
        ("follows", np.int64),  # whether limbs with one hold more than closes their switches
    ],
    align=True,
)
"""Limits of the limbs' rules, as in SafetyConfig."""

LIMB_WATCH = np.dtype(
    [
        ("gain", np.float64),  # k [m/s/A]
        ("time_constant", np.float64),  # T [s]
        ("began", np.float64),  # wound length at PRETIGHTENING's begin [m]; NaN in other modes
        ("last_wound", np.float64),  # of the sample before [m]; NaN if unknown
        ("last_speed", np.float64),  # of the sample before [m/s]; NaN if unknown
        ("leapt_from", np.float64),  # speed before a count that jumped in this sample [m/s]; NaN
        ("observed", np.float64),  # the observer's speed [m/s]
        ("cable_s", np.float64),  # how long the switch has contradicted the estimate [s]
        ("current_s", np.float64),  # how long the current has been at its limit [s]
        ("motion_s", np.float64),  # how long current has been missing from the motion [s]
        ("motion_sign", np.float64),  # to which side
        ("modelled", np.float64),  # speed by the currents, whatever the encoder says [m/s]
        ("last_dt", np.float64),  # length of the sample before [s]
        ("before", np.float64),  # current of the sample before [A]
        ("earlier", np.float64),  # of the one before that [A]
        ("earliest", np.float64),  # likewise [A]
        ("most_speed", np.float64),  # from which full current stops it in time [m/s]
        ("allowed", np.float64),  # current that makes it no faster than that [A]
        ("surge", np.float64),  # samples in a row with a current beyond all of them; their sign
        ("most", np.float64),  # command of this block of time [A]
        ("least", np.float64),  # likewise [A]
        ("most_before", np.float64),  # of the block before [A]
        ("least_before", np.float64),  # likewise [A]
        ("block_s", np.float64),  # age of this block [s]
        ("stepped", np.float64),  # how long a step is still remembered [s]; 0: none
        ("surplus", np.float64),  # charge beyond all commands while it winds in [A s]
        ("against", np.float64),  # charge that pays it out while all commands wind in [A s]
        ("open_s", np.float64),  # how long the switch has been open [s]; 0: it is closed
        ("slack_s", np.float64),  # how long the switch has called it slack, in FREE_MOVING [s]
        ("farthest", np.float64),  # wound in since the switch opened, at most [m]
        ("closed_from", np.float64),  # most stretch since the switch closed, in a search [m]
        ("slack_stretch", np.float64),  # stretch at which the cable would be slack [m]; NaN: start
        ("proven", np.int64),  # whether the switch has shown that, not only the start
        ("bound", np.float64),  # largest tension that fits all of that [N]
        ("ahead", np.float64),  # tension that is added until the motor can be stopped [N]
    ],
    align=True,
)
"""Model and memory of one limb."""


def limits_of(config: SafetyConfig, rig: Rig, current_limit: float) -> Any:
    """Return the (1,) record of LIMB_LIMITS.

    Args:
        config: limits of the file.
        rig: with the switches' tension.
        current_limit: what the bridge limits currents to [A].
    """
    limits = np.zeros(1, LIMB_LIMITS)
    for name in limits.dtype.names or ():
        limits[name] = getattr(config, name, 0.0)
    limits["current_limit"], limits["switch_tension"] = current_limit, rig.limbs.switch_tension
    return limits


def watch_of(rig: Rig, stop_time_s: float, current_limit: float) -> Any:
    """Return the (n,) records of LIMB_WATCH of a start.

    Args:
        rig: with the motors' model.
        stop_time_s: in which full current stops a motor at its most speed [s].
        current_limit: that current [A].
    """
    watch = np.zeros(rig.geometry.cables, LIMB_WATCH)
    watch["gain"], watch["time_constant"] = rig.limbs.gain, rig.limbs.time_constant
    watch["most_speed"] = stop_time_s * watch["gain"] / watch["time_constant"] * current_limit
    for name in ("last_wound", "last_speed", "leapt_from", "began", "slack_stretch"):
        watch[name] = np.nan
    return watch


@njit(cache=True)
def forget_motion(watch: Any) -> None:
    """Forget the speeds, e.g. after a gap in the samples: the next two samples give new ones.

    Args:
        watch: (n,) records of LIMB_WATCH; updated.
    """
    for i in range(watch.shape[0]):
        watch[i]["last_wound"] = np.nan
        watch[i]["last_speed"] = watch[i]["leapt_from"] = np.nan
        watch[i]["observed"] = watch[i]["surge"] = 0.0
        watch[i]["surplus"] = watch[i]["against"] = 0.0


@njit(cache=True)
def _note_leap(own: Any, speed: float, dt_s: float, jumped: bool, most: float) -> None:
    """Move the place at which a cable is slack along with a count that jumps.

    Not the cable moves then. The sample after a jump shows a change of speed as large, back to what
    it was before: that is none.

    Args:
        own: record of LIMB_WATCH; last_speed is of the sample before.
        speed: of this sample [m/s].
        dt_s: its length [s].
        jumped: whether the speed has changed as no current can change it.
        most: largest change that a current may make [m/s].
    """
    before = own["last_speed"] if np.isnan(own["leapt_from"]) else own["leapt_from"]
    own["leapt_from"] = np.nan
    if jumped and not abs(speed - before) <= most:
        own["slack_stretch"] += dt_s * (speed - before)
        own["leapt_from"] = before


@njit(cache=True)
def _track_slack(own: Any, reading: Any, closed: bool, dt_s: float) -> None:
    """Keep the stretch at which a limb's cable would be slack, and so the most that it can pull.

    It holds in every mode, with and without a zero. At the start a cable counts as slack. A switch
    that closes shows its own tension; one that opens may be a broken wire, so it only counts where
    it says that the cable pulls more than was assumed.
    """
    stretch = reading["stretch"]
    here = stretch - reading["switch_elongation"]
    if np.isnan(own["slack_stretch"]):
        own["slack_stretch"] = here if closed else stretch
        own["proven"] = 0
    elif closed and own["open_s"] > 0.0:
        if own["open_s"] >= FIRM_S or here < own["slack_stretch"]:
            own["slack_stretch"], own["proven"] = here, 1
    elif not closed and own["open_s"] == 0.0 and (here < own["slack_stretch"] or not own["proven"]):
        own["slack_stretch"], own["proven"] = here, 1
    own["open_s"] = 0.0 if closed else own["open_s"] + dt_s
    zero = own["slack_stretch"] if np.isnan(reading["zero"]) else reading["zero"]
    own["bound"] = reading["stiffness"] * (stretch - zero)


@njit(cache=True)
def _stopping_distance(own: Any, current: float, current_limit: float) -> float:
    """Length that a motor still winds in until full current has stopped it [m].

    Negative while it pays out.

    Args:
        own: record of LIMB_WATCH.
        current: on the amplifier [A].
        current_limit: with which it is braked [A].
    """
    drive = own["gain"] / own["time_constant"]
    speed = own["last_speed"]
    if np.isnan(speed):
        speed = 0.0
    if speed >= 0.0:
        speed += max(drive * current, 0.0) * 0.5 * BRAKE_LAG_S
    return float(speed * BRAKE_LAG_S + 0.5 * speed * abs(speed) / (drive * current_limit))


@njit(cache=True)
def _model_speed(own: Any, speed: float, current: float, dt_s: float) -> None:
    """Follow (3.11) by the current, and the measured speed only slowly.

    A motor whose encoder has stopped counting is stopped by it.

    Args:
        own: record of LIMB_WATCH.
        speed: measured [m/s]; NaN: not known.
        current: on the amplifier [A].
        dt_s: of the sample [s].
    """
    if np.isnan(speed):
        return
    rate = (own["gain"] * current - own["modelled"]) / own["time_constant"]
    own["modelled"] += min(dt_s, LONG_SAMPLE_S) * (rate + MODEL_RATE * (speed - own["modelled"]))


@njit(cache=True)
def _allowed_current(own: Any) -> float:
    """Return the current with which a motor comes to its most speed, and no farther [A].

    Args:
        own: record of LIMB_WATCH of this sample.
    """
    speed, most = own["last_speed"], own["most_speed"]
    if np.isnan(speed):
        return np.inf
    rate = (most - speed) / RESPONSE_S
    return max(float((most + own["time_constant"] * rate) / own["gain"]), 0.0)


@njit(cache=True)
def _rule_of(
    own: Any, most: Any, reading: Any, closed: bool, tension: float, current: float
) -> int:
    """Find the first rule that one limb breaks now, but for an encoder's jump.

    Args:
        own: record of LIMB_WATCH of this sample.
        most: record of LIMB_LIMITS.
        reading: record of LIMB_READING; the estimate counts where there is a zero.
        closed: the switch.
        tension: estimate [N].
        current: on the amplifier [A].
    """
    zeroed = not np.isnan(reading["zero"])
    speed, bound, ahead = own["last_speed"], own["bound"], own["ahead"]
    # A load, or friction, takes current away: only a motor ahead of its current goes by itself.
    unexplained = own["motion_s"] > 0.0 and own["motion_sign"] * speed > 0.0
    winds = speed > 0.0 or current > 0.0
    if zeroed:
        heavy = not tension <= most["tension_max"] or tension + ahead > most["tension_max"]
    else:
        heavy = winds and (own["proven"] or closed) and not bound + ahead <= most["tension_max"]
    fast = abs(speed) > most["cable_speed"] or (not zeroed and speed > most["search_speed"])
    if (heavy or fast) and unexplained:
        # Nobody commands this: no current will stop it.
        return Rule.MOTION.value
    if heavy:
        return Rule.TENSION.value
    if fast:
        return Rule.CABLE_SPEED.value
    searched = bound + ahead > min(
        most["search_length"] * reading["stiffness"], most["tension_max"]
    )
    if searched and winds and not (zeroed or closed or own["proven"]):
        return Rule.SEARCH.value
    if own["cable_s"] > most["cable_time"]:
        return Rule.CABLE.value
    if own["current_s"] > most["current_saturated"]:
        return Rule.CURRENT.value
    if own["motion_s"] > most["motion_time"] or abs(own["surge"]) >= SURGE_SAMPLES:
        return Rule.MOTION.value
    if max(own["surplus"], own["against"]) > SURPLUS_AS:
        return Rule.MOTION.value
    return Rule.FINE.value


@njit(cache=True)
def judge_limbs(
    dt_s: float,
    limits: Any,
    watch: Any,
    readings: Any,
    wound: FloatArray,
    tension: FloatArray,
    current: FloatArray,
    closed: BoolArray,
) -> tuple[int, int]:
    """Follow all limbs by one sample and apply their rules.

    The motor is (3.11): T dv/dt + v = k i. An observer follows the measured speed; its correction
    of k i is the current that friction, load or a defect takes away.

    Args:
        dt_s: since the sample before [s].
        limits: (1,) record of LIMB_LIMITS.
        watch: (n,) records of LIMB_WATCH; updated.
        readings: (n,) records of LIMB_READING; the estimate counts where there is a zero.
        wound: (n,) wound length [m].
        tension: (n,) estimate [N], NaN before zeroing.
        current: (n,) on the amplifiers [A].
        closed: (n,) switches.

    Returns:
        The broken Rule, or FINE, and the limb.
    """
    found, limb, most = Rule.FINE.value, -1, limits[0]
    slack = -1
    acts = most["acts"] != 0
    for i in range(wound.shape[0]):
        own, reading = watch[i], readings[i]
        gain, time_constant = own["gain"], own["time_constant"]
        zeroed = not np.isnan(reading["zero"])
        # NaN after a gap: no comparison holds then.
        speed = (wound[i] - own["last_wound"]) / dt_s
        jumped = abs(speed - own["last_speed"]) > most["encoder_jump"]
        note_surge(own, most["quantum"], speed, current[i], dt_s)
        _note_leap(own, speed, dt_s, jumped, most["encoder_jump"])
        if np.isnan(own["last_speed"]) or not acts:
            jumped = False
            own["observed"] = speed
        if dt_s > LONG_SAMPLE_S:
            own["observed"] = speed
        own["last_wound"] = wound[i]
        own["last_speed"] = speed
        own["allowed"] = _allowed_current(own)
        if np.isnan(speed):
            own["observed"] = 0.0
        missing = 0.0 if np.isnan(speed) else OBSERVER_RATE * (speed - own["observed"])
        pull = (gain * current[i] - own["observed"]) / time_constant + missing
        own["observed"] += dt_s * pull
        _model_speed(own, np.nan if jumped else speed, current[i], dt_s)
        _track_slack(own, reading, closed[i], dt_s)
        own["ahead"] = reading["stiffness"] * _stopping_distance(
            own, current[i], most["current_limit"]
        )
        if not acts:
            own["cable_s"] = own["current_s"] = own["motion_s"] = 0.0
            own["surge"] = own["surplus"] = own["against"] = 0.0
            own["farthest"], own["closed_from"] = wound[i], reading["stretch"]
            continue
        share = abs(missing) * time_constant / gain / most["motion_current"]
        broken = (
            (zeroed or own["proven"])
            and not closed[i]
            and not own["bound"] <= most["cable_tension"]
        )
        paid_out = own["began"] - wound[i]
        if closed[i] or most["searches"] == 0 or wound[i] > own["farthest"] or jumped:
            own["farthest"] = wound[i]
        lost = not zeroed and own["farthest"] - wound[i] > most["search_length"]
        taut = most["switch_tension"] + SLACK_N
        contradicts = zeroed and not closed[i] and most["follows"] != 0 and own["bound"] > taut
        own["slack_s"] = own["slack_s"] + dt_s if contradicts else 0.0
        if own["slack_s"] > SLACK_S:
            slack = i
        here = reading["stretch"]
        if not closed[i] or zeroed or most["searches"] == 0 or here > own["closed_from"] or jumped:
            own["closed_from"] = here
        # What the gears hold may be taken off first, without a zero.
        most_out = most["switch_payout"] + most["tension_max"] / reading["stiffness"]
        gives_way = paid_out > most["switch_payout"] or own["closed_from"] - here > most_out
        stuck = closed[i] and not zeroed and gives_way
        saturated = abs(current[i]) >= 0.99 * most["current_limit"]
        own["cable_s"] = own["cable_s"] + dt_s if broken else 0.0
        own["current_s"] = own["current_s"] + dt_s if saturated else 0.0
        # The larger the current, the less time it may take. A defect takes current to one side; a
        # command that comes late in its sample seems to take it to both in turn.
        sign = np.sign(missing)
        lasting = own["motion_s"] if sign == own["motion_sign"] else 0.0
        own["motion_sign"] = sign
        own["motion_s"] = lasting + dt_s * share if share > 1.0 else 0.0
        if found != Rule.FINE:
            continue
        if jumped:
            found, limb = Rule.ENCODER.value, i
            continue
        rule = _rule_of(own, most, reading, closed[i], tension[i], current[i])
        if stuck and (rule == Rule.FINE or rule == Rule.CURRENT or rule == Rule.MOTION):
            rule = Rule.SWITCH.value
        if lost and rule == Rule.FINE:
            rule = Rule.PAYOUT.value
        if rule != Rule.FINE:
            found, limb = rule, i
    if found == Rule.FINE and slack >= 0:
        found, limb = Rule.SLACK.value, slack
    return found, limb
