# SPDX-License-Identifier: Apache-2.0
"""Where the platform is now, by poses that are some milliseconds old; compiled, O(1).

A pose of the robot describes a moment in the past. At 100 mm/s six milliseconds are 0.6 mm, which a
spring turns into newtons. The newest pose is therefore extrapolated over its age, to every sample:

    p(t) = p_k + v dt + a dt^2 / 2,    R(t) = exp([w dt + b dt^2 / 2]) R_k,    dt = t - t_k + lag,

v, w from the last two poses, moved to the newer one by the accelerations a, b, which are smoothed
differences. The lag is what the robot does not say: how old a pose is at its stamp.

The extrapolation is for the tension estimates alone; safety rules compare the poses as they come.
It is bounded: in time by a horizon, and to motions that go on. A pose that the ones before do not
announce (a jump) begins anew, at rest, and is extrapolated once two steps agree.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.poses.filters import (
    ORDERS,
    POSE_FILTERS,
    Order,
    go_on,
    hear_step,
    mean_of_filters,
    restart_filters,
)

SMOOTHING = 0.5
"""Share of the newest difference in the accelerations."""
SHORTEST_STEP_S = 0.0005
"""Poses closer in time than this say nothing about speeds [s]."""
LONGEST_STEP_S = 0.05
"""Gap between poses after which the motion is unknown; a clock may go back by no more [s]."""
ACCELERATION_MAX = 10.0
"""Of a robot's tool, at most [m/s^2]; what looks like more is a jump."""
SPIN_MAX = 50.0
"""Angular acceleration, likewise [rad/s^2]."""
JERK_MAX, SPIN_JERK_MAX = 400.0, 2000.0
"""That an acceleration is extrapolated with, at most [m/s^3], [rad/s^3]."""
HIGHEST = np.array([[0.0, 0.0, 0.0, JERK_MAX, 2e4], [0.0, 0.0, 0.0, SPIN_JERK_MAX, 1e5]])
"""Of each order from the third on, likewise, in places and rotations [m/s^order], [rad/s^order]."""
SPEED_MAX, TURNING_MAX = 1.0, 3.0
"""Speeds beyond these are no robot's under load [m/s], [rad/s]."""
NOISE_MPS, NOISE_RADPS = 0.01, 0.1
"""Change of speed between two steps that noise of the poses may make."""
NOISE_MOST_M, NOISE_MOST_RAD = 5e-4, 4e-3
"""More may come of noise that the last poses showed: NOISY times their rms, and at most this."""
NOISY = 3.0
AHEAD_MOST_M, AHEAD_MOST_RAD = 0.02, 0.05
"""Most that a reference may be ahead of the platform [m], [rad]."""
STAMP_WITHIN_S = 0.1
"""Stamps further from their arrival are of another clock [s]."""
STILL = 1e-9
"""Motion per second that counts as none."""


class Heard(IntEnum):
    """What became of a pose."""

    TAKEN = 0
    """It continues the motion."""
    BEGUN = 1
    """The motion begins anew: the first pose, or one after a gap or a jump."""
    OLD = 2
    """Not newer than the newest: dropped."""
    UNUSABLE = 3
    """Not finite: dropped."""


POSE_TRACK = np.dtype(
    [
        ("steps", np.int64),  # steps between poses that agree: 0 none, up to 2
        ("poses", np.int64),  # whether there is one
        ("time", np.float64),  # of the newest pose [s]
        ("step", np.float64),  # between the last two [s]
        ("lag", np.float64),  # age of a pose at its stamp [s]
        ("horizon", np.float64),  # most to extrapolate over [s]
        ("position", np.float64, (3,)),  # newest, base frame [m]
        ("rotation", np.float64, (3, 3)),  # newest, platform to base axes
        ("mean", np.float64, (6,)),  # mean velocity over the last step [m/s], [rad/s], base axes
        ("filters", POSE_FILTERS),
        ("motion", np.float64, (ORDERS, 6)),  # from the newest pose: place, speed and so on
        ("late", np.float64, (6,)),  # with which the acceleration is two steps late
        ("place", np.float64, (3,)),  # extrapolated position [m]
        ("turn", np.float64, (3, 3)),  # extrapolated rotation
        ("velocity", np.float64, (6,)),  # extrapolated [m/s], [rad/s]
        ("acceleration", np.float64, (6,)),  # in force [m/s^2], [rad/s^2]
    ],
    align=True,
)
"""Newest poses and the motion between them."""


@njit(cache=True)
def _turn_between(before: FloatArray, after: FloatArray, vector: FloatArray) -> None:
    """Fill the rotation vector (3,) [rad], base axes, that takes (3, 3) before to after."""
    skew = np.zeros((3, 3))
    trace = 0.0
    for i in range(3):
        for j in range(3):
            for k in range(3):
                skew[i, j] += after[i, k] * before[j, k]
        trace += skew[i, i]
    vector[0] = 0.5 * (skew[2, 1] - skew[1, 2])
    vector[1] = 0.5 * (skew[0, 2] - skew[2, 0])
    vector[2] = 0.5 * (skew[1, 0] - skew[0, 1])
    sine = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    if sine > 1e-12:
        # The arc tangent keeps its digits at small angles and tells large ones from small.
        factor = np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
        for i in range(3):
            vector[i] *= factor


@njit(cache=True)
def _turned_into(vector: FloatArray, rotation: FloatArray, turned: FloatArray) -> None:
    """Fill turned (3, 3) = exp([vector]) rotation, Rodrigues' formula; vector (3,) [rad]."""
    angle2 = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    angle = np.sqrt(angle2)
    one = np.sin(angle) / angle if angle > 1e-6 else 1.0 - angle2 / 6.0
    two = (1.0 - np.cos(angle)) / angle2 if angle > 1e-4 else 0.5 - angle2 / 24.0
    for column in range(3):
        a, b, c = rotation[0, column], rotation[1, column], rotation[2, column]
        x = vector[1] * c - vector[2] * b
        y = vector[2] * a - vector[0] * c
        z = vector[0] * b - vector[1] * a
        turned[0, column] = a + one * x + two * (vector[1] * z - vector[2] * y)
        turned[1, column] = b + one * y + two * (vector[2] * x - vector[0] * z)
        turned[2, column] = c + one * z + two * (vector[0] * y - vector[1] * x)


@njit(cache=True)
def _size(vector: FloatArray, first: int) -> float:
    return float(np.sqrt(vector[first] ** 2 + vector[first + 1] ** 2 + vector[first + 2] ** 2))


@njit(cache=True)
def _bound(vector: FloatArray, first: int, most: float) -> None:
    """Shorten three numbers of vector (6,) to a length of at most `most`."""
    size = _size(vector, first)
    if size > most:
        for k in range(first, first + 3):
            vector[k] *= most / size


@njit(cache=True)
def _begin(own: Any, time_s: float, position: FloatArray, rotation: FloatArray) -> None:
    """Take a pose without a history: at rest as far as is known."""
    own["steps"], own["poses"], own["time"] = 0, 1, time_s
    own["position"][:], own["rotation"][:] = position, rotation
    own["motion"][:], own["late"][:], own["mean"][:] = 0.0, 0.0, 0.0
    restart_filters(own["filters"])


@njit(cache=True)
def hear_pose(track: Any, time_s: float, position: FloatArray, rotation: FloatArray) -> int:
    """Take a pose; return a Heard.

    Args:
        track: (1,) record of POSE_TRACK; updated.
        time_s: its stamp, on the clock of the samples [s].
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) platform to base axes.
    """
    own = track[0]
    finite = np.isfinite(time_s)
    for i in range(3):
        finite = finite and np.isfinite(position[i])
        for j in range(3):
            finite = finite and np.isfinite(rotation[i, j])
    if not finite:
        return Heard.UNUSABLE.value
    dt_s = time_s - own["time"]
    if not own["poses"] or not -LONGEST_STEP_S <= dt_s <= LONGEST_STEP_S:
        _begin(own, time_s, position, rotation)
        return Heard.BEGUN.value
    if dt_s < SHORTEST_STEP_S:
        return Heard.OLD.value
    mean = np.zeros(6)
    _turn_between(own["rotation"], rotation, mean[3:])
    for k in range(3):
        mean[k] = (position[k] - own["position"][k]) / dt_s
        mean[3 + k] /= dt_s
    known = own["steps"] > 0
    middle_s = 0.5 * (dt_s + own["step"]) if known else dt_s
    change = mean - own["mean"]
    fits = _size(mean, 0) <= SPEED_MAX and _size(mean, 3) <= TURNING_MAX
    if known:
        seen_m = min(NOISY * np.sqrt(own["filters"]["score"][0, 0]), NOISE_MOST_M)
        seen_rad = min(NOISY * np.sqrt(own["filters"]["score"][1, 0]), NOISE_MOST_RAD)
        noise, spin = NOISE_MPS + seen_m / dt_s, NOISE_RADPS + seen_rad / dt_s
        fits = fits and _size(change, 0) <= ACCELERATION_MAX * middle_s + noise
        fits = fits and _size(change, 3) <= SPIN_MAX * middle_s + spin
    if not fits:
        _begin(own, time_s, position, rotation)
        return Heard.BEGUN.value
    filters = own["filters"]
    hear_step(filters, mean * dt_s, dt_s, own["steps"] > 1)
    # Views of one filter: that of the differences.
    differences = filters["motion"][0]
    speed, gain = differences[Order.SPEED], differences[Order.ACCELERATION]
    jerk = differences[Order.JERK]
    for k in range(6):
        if own["steps"] > 1:
            grown = SMOOTHING * (change[k] / middle_s - gain[k])
            gain[k] += grown
            jerk[k] += SMOOTHING * (grown / dt_s - jerk[k])
        elif known:
            gain[k] = SMOOTHING * change[k] / middle_s
    own["steps"] = min(own["steps"] + 1, 2)
    own["time"], own["step"] = time_s, dt_s
    own["position"][:], own["rotation"][:], own["mean"][:] = position, rotation, mean
    _bound(gain, 0, ACCELERATION_MAX)
    _bound(gain, 3, SPIN_MAX)
    _bound(jerk, 0, JERK_MAX)
    _bound(jerk, 3, SPIN_JERK_MAX)
    for k in range(6):
        if abs(mean[k]) < STILL and abs(gain[k]) < STILL:
            gain[k] = 0.0
        speed[k] = mean[k] + 0.5 * gain[k] * dt_s
    motion = own["motion"]
    mean_of_filters(filters, motion, own["late"])
    for order in range(3, ORDERS):
        _bound(motion[order], 0, HIGHEST[0, order])
        _bound(motion[order], 3, HIGHEST[1, order])
    return Heard.TAKEN.value


@njit(cache=True)
def place_platform(track: Any, now_s: float) -> bool:
    """Extrapolate the newest pose to a moment; place, turn, velocity and acceleration are set.

    Args:
        track: (1,) record of POSE_TRACK; updated.
        now_s: on the clock of the poses' stamps [s].

    Returns:
        Whether place or turn have changed.
    """
    own = track[0]
    if not own["poses"]:
        return False
    dt_s = max(now_s - own["time"] + own["lag"], 0.0)
    # Written so that a time that is not a number extrapolates nothing.
    fresh = dt_s <= own["horizon"]
    dt_s = dt_s if fresh else (own["horizon"] if dt_s > own["horizon"] else 0.0)
    known = own["steps"] > 1 and own["horizon"] > 0.0
    vector, moved, changed = np.zeros(3), own["motion"].copy(), False
    go_on(moved, ORDERS - 1, dt_s)
    for k in range(6):
        way = moved[0, k] if known else 0.0
        if k < 3:
            value = own["position"][k] + way
            changed = changed or value != own["place"][k]
            own["place"][k] = value
        else:
            vector[k - 3] = way
        moves = known and fresh
        # Differences of differences, smoothed, are two steps late.
        grown = own["late"][k] * (dt_s + 2.0 * own["step"])
        own["acceleration"][k] = moved[2, k] + grown if moves else 0.0
        own["velocity"][k] = moved[1, k] if moves else 0.0
    _bound(own["acceleration"], 0, ACCELERATION_MAX)
    _bound(own["acceleration"], 3, SPIN_MAX)
    turned = np.empty((3, 3))
    _turned_into(vector, own["rotation"], turned)
    for i in range(3):
        for j in range(3):
            changed = changed or turned[i, j] != own["turn"][i, j]
            own["turn"][i, j] = turned[i, j]
    return changed


@njit(cache=True)
def pose_ahead_into(track: Any, ahead_s: float, position: FloatArray, rotation: FloatArray) -> None:
    """Fill a pose, (3,) and (3, 3), to which the placed platform goes on at its velocity.

    For references alone, which may look further ahead than tension estimates; turning is bounded.

    Args:
        track: (1,) record of POSE_TRACK, placed.
        ahead_s: beyond the moment of the placing [s].
        position: (3,) of the platform's origin, base frame, filled [m].
        rotation: (3, 3) platform to base axes, filled.
    """
    own = track[0]
    step = np.zeros(6)
    for k in range(6):
        step[k] = ahead_s * own["velocity"][k]
    _bound(step, 0, AHEAD_MOST_M)
    _bound(step, 3, AHEAD_MOST_RAD)
    for k in range(3):
        position[k] = own["place"][k] + step[k]
    _turned_into(step[3:], own["turn"], rotation)


def pose_track(position: FloatArray, rotation: FloatArray, lag_s: float, horizon_s: float) -> Any:
    """Build the (1,) record of POSE_TRACK: a place, and no pose heard yet.

    Args:
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) platform to base axes.
        lag_s: age of a pose at its stamp [s].
        horizon_s: most to extrapolate over; 0: never [s].
    """
    track = np.zeros(1, POSE_TRACK)
    track["lag"], track["horizon"] = lag_s, horizon_s
    track["position"], track["rotation"] = position, rotation
    track["place"], track["turn"] = position, rotation
    return track


def pose_time(stamp_s: float, arrival_s: float) -> float:
    """Return the moment of a pose on the samples' clock [s].

    Args:
        stamp_s: of its message [s].
        arrival_s: when it was read, on the samples' clock [s].

    Returns:
        The stamp, if it can be of the samples' clock; the arrival, if the sender has another one.
    """
    return stamp_s if abs(arrival_s - stamp_s) <= STAMP_WITHIN_S else arrival_s
