# SPDX-License-Identifier: Apache-2.0
"""Slower looks at the poses than from the last two, for poses that are noisy; compiled, O(1).

Differences of the newest poses follow a motion at once, and multiply the poses' noise: 16 um
become 0.1 mm over 8 ms, and some newtons of wrench. Filters with a memory have less noise and lag
instead. Which is right changes with the motion, so all run side by side, each judged by how well it
announced the last poses, and what is used is their mean, weighted by

    w_i = (s_0 / s_i)^WEIGHTING,    s_i = mean of the squares of what filter i missed.

Poses without noise leave the differences alone, as all others miss more; poses that stand leave
the mean of their places, at rest.

Filters: the differences themselves; fading-memory polynomials of second and of first degree
(Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.3); the mean place. Each is kept
by what it has off the newest pose, so that rotations stay small vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from cabols_control.checks import FloatArray

FILTERS = 5
DEGREE = np.array([2, 2, 2, 1, 0])
FORGETTING = np.array([0.0, 0.5, 0.75, 0.9, 0.95])
"""Degree of each filter's motion, and what it keeps of the past from pose to pose."""
SCORE_SHARE = 0.06
"""Of the newest miss in a score: about 16 poses count."""
WEIGHTING = 4
JUDGED = 8
"""Poses by which the filters have been judged before any but the differences counts: one alone may
have been announced by chance."""
FLOOR = (1e-8, 1e-8)
"""Misses that count as none: of places [m], of rotations [rad]."""

POSE_FILTERS = np.dtype(
    [
        ("heard", np.int64),  # misses that the scores hold
        ("off", np.float64, (FILTERS, 6)),  # from the newest pose [m], [rad], base axes
        ("speed", np.float64, (FILTERS, 6)),  # at the newest pose [m/s], [rad/s]
        ("gain", np.float64, (FILTERS, 6)),  # acceleration [m/s^2], [rad/s^2]
        ("jerk", np.float64, (6,)),  # of the differences [m/s^3], [rad/s^3]
        ("score", np.float64, (2, FILTERS)),  # of places [m^2], of rotations [rad^2]
    ],
    align=True,
)
"""The filters' states."""


@njit(cache=True)
def restart_filters(filters: Any) -> None:
    """Forget the motion; a record of POSE_FILTERS."""
    filters["heard"] = 0
    filters["off"][:] = 0.0
    filters["speed"][:] = 0.0
    filters["gain"][:] = 0.0
    filters["jerk"][:] = 0.0
    filters["score"][:] = 0.0


@njit(cache=True)
def hear_step(filters: Any, step: FloatArray, dt_s: float, last: Any) -> None:
    """Take the way to a new pose.

    Args:
        filters: a record of POSE_FILTERS; updated but for the differences.
        step: (6,) way from the pose before [m], rotation vector [rad], base axes.
        dt_s: between the two [s].
        last: whether the differences announced this pose, so that it can be judged by.
    """
    off, speed, gain, score = filters["off"], filters["speed"], filters["gain"], filters["score"]
    if last:
        filters["heard"] += 1
    share = max(SCORE_SHARE, 1.0 / max(filters["heard"], 1))
    for i in range(FILTERS):
        kept = FORGETTING[i]
        missed = np.zeros(2)
        for k in range(6):
            announced = off[i, k] + speed[i, k] * dt_s + 0.5 * gain[i, k] * dt_s * dt_s
            miss = step[k] - announced
            missed[k // 3] += miss * miss
            if i == 0:
                continue
            off[i, k] = -(kept ** (DEGREE[i] + 1)) * miss
            speed[i, k] += gain[i, k] * dt_s
            if DEGREE[i] == 2:
                speed[i, k] += 1.5 * (1.0 - kept**2) * (1.0 - kept) * miss / dt_s
                gain[i, k] += (1.0 - kept) ** 3 * miss / (dt_s * dt_s)
            elif DEGREE[i] == 1:
                speed[i, k] += (1.0 - kept) ** 2 * miss / dt_s
        if last:
            for part in range(2):
                score[part, i] += share * (missed[part] - score[part, i])


@njit(cache=True)
def mean_of_filters(
    filters: Any, off: FloatArray, speed: FloatArray, gain: FloatArray, jerk: FloatArray
) -> None:
    """Fill what the filters say together.

    Args:
        filters: a record of POSE_FILTERS.
        off: (6,) from the newest pose, filled [m], [rad], base axes.
        speed: (6,), filled [m/s], [rad/s].
        gain: (6,) acceleration, filled [m/s^2], [rad/s^2].
        jerk: (6,), filled [m/s^3], [rad/s^3].
    """
    for part in range(2):
        floor = FLOOR[part] * FLOOR[part]
        best = np.inf
        for i in range(FILTERS):
            best = min(best, filters["score"][part, i] + floor)
        total = 0.0
        for k in range(3 * part, 3 * part + 3):
            off[k] = speed[k] = gain[k] = 0.0
        for i in range(FILTERS):
            weight = (best / (filters["score"][part, i] + floor)) ** WEIGHTING
            if i > 0 and filters["heard"] < JUDGED:
                weight = 0.0
            total += weight
            for k in range(3 * part, 3 * part + 3):
                off[k] += weight * filters["off"][i, k]
                speed[k] += weight * filters["speed"][i, k]
                gain[k] += weight * filters["gain"][i, k]
        for k in range(3 * part, 3 * part + 3):
            # Only the differences have one, so that noise takes it away with their weight.
            share = (best / (filters["score"][part, 0] + floor)) ** WEIGHTING / total
            jerk[k] = share * filters["jerk"][k]
            off[k] /= total
            speed[k] /= total
            gain[k] /= total
