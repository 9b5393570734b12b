# SPDX-License-Identifier: Apache-2.0
"""Slower looks at the poses than from the last two, for poses that are noisy; compiled, O(1).

Differences of the newest poses follow a motion at once, and multiply the poses' noise: 16 um
become 0.1 mm over 8 ms, and some newtons of wrench. Filters with a memory have less noise and lag
instead. Which is right changes with the motion, so all run side by side, each judged by how well it
announced the last poses, and what is used is their mean, weighted by

    w_i = (s_0 / s_i)^WEIGHTING,    s_i = mean of the squares of what filter i missed.

Poses without noise leave the differences alone, as all others miss more; poses that stand leave
the mean of their places, at rest.

Filters: the differences themselves; fading-memory polynomials of fourth to first degree
(Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.3); the mean place. Each is kept
by what it has off the newest pose, so that rotations stay small vectors.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit

DEGREE = np.array([2, 4, 3, 2, 2, 1, 0])
FORGETTING = np.array([0.0, 0.1, 0.2, 0.5, 0.75, 0.9, 0.95])
"""Degree of each filter's motion, and what it keeps of the past from pose to pose."""
FILTERS, ORDERS = 7, 5


class Order(IntEnum):
    """Row of a motion: its derivatives by time, those of the differences up to the third."""

    SPEED = 1
    ACCELERATION = 2
    JERK = 3


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
        # Place off the newest pose, speed, acceleration and so on [m/s^order], [rad/s^order], base
        # axes. Of the differences, the third is of smoothed accelerations, two steps late.
        ("motion", np.float64, (FILTERS, ORDERS, 6)),
        ("score", np.float64, (2, FILTERS)),  # of places [m^2], of rotations [rad^2]
    ],
    align=True,
)
"""The filters' states."""


def _correction_gains() -> FloatArray:
    """(FILTERS, ORDERS) what a miss changes of each order, for steps of one second.

    The polynomial through the poses r steps ago that is least in sum kept^r miss_r^2.
    """
    gains, ago = np.zeros((FILTERS, ORDERS)), np.arange(2000.0)
    for i in range(1, FILTERS):
        powers = np.vander(-ago, DEGREE[i] + 1, increasing=True)
        weighted = powers.T * FORGETTING[i] ** ago
        factorial = np.cumprod(np.maximum(np.arange(DEGREE[i] + 1.0), 1.0))
        gains[i, : DEGREE[i] + 1] = factorial * np.linalg.inv(weighted @ powers)[0]
    return gains


GAINS = _correction_gains()


@njit(cache=True)
def go_on(motion: FloatArray, degree: int, dt_s: float) -> None:
    """Move a motion on by a time.

    Args:
        motion: (ORDERS, 6) places, speeds and so on [m/s^order], [rad/s^order]; updated.
        degree: order of the highest that is not zero.
        dt_s: the time [s].
    """
    for order in range(degree):
        share = 1.0
        for more in range(1, degree + 1 - order):
            share *= dt_s / more
            for k in range(6):
                motion[order, k] += share * motion[order + more, k]


@njit(cache=True)
def restart_filters(filters: Any) -> None:
    """Forget the motion; a record of POSE_FILTERS."""
    filters["heard"] = 0
    filters["motion"][:] = 0.0
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
    if last:
        filters["heard"] += 1
    share = max(SCORE_SHARE, 1.0 / max(filters["heard"], 1))
    score, went = filters["score"], np.empty((ORDERS, 6))
    for i in range(FILTERS):
        motion, missed = filters["motion"][i], np.zeros(2)
        went[:] = motion
        go_on(went, DEGREE[i], dt_s)
        for k in range(6):
            miss = step[k] - went[0, k]
            missed[k // 3] += miss * miss
            if i == 0:
                continue
            motion[0, k], scale = (GAINS[i, 0] - 1.0) * miss, miss
            for order in range(1, DEGREE[i] + 1):
                scale /= dt_s
                motion[order, k] = went[order, k] + GAINS[i, order] * scale
        if last:
            for part in range(2):
                score[part, i] += share * (missed[part] - score[part, i])


@njit(cache=True)
def mean_of_filters(filters: Any, motion: FloatArray, late: FloatArray) -> None:
    """Fill what the filters say together.

    Args:
        filters: a record of POSE_FILTERS.
        motion: (ORDERS, 6) place off the newest pose, speed, acceleration and so on, filled.
        late: (6,) with which the differences' acceleration goes on, by their weight; filled.
    """
    motion[:] = 0.0
    for part in range(2):
        floor = FLOOR[part] * FLOOR[part]
        best, total = np.inf, 0.0
        for i in range(FILTERS):
            best = min(best, filters["score"][part, i] + floor)
        axes = slice(3 * part, 3 * part + 3)
        for i in range(FILTERS):
            weight = (best / (filters["score"][part, i] + floor)) ** WEIGHTING
            if i > 0 and filters["heard"] < JUDGED:
                weight = 0.0
            total += weight
            for k in range(axes.start, axes.stop):
                for order in range(DEGREE[i] + 1):
                    motion[order, k] += weight * filters["motion"][i, order, k]
                if i == 0:
                    late[k] = weight * filters["motion"][i, Order.JERK, k]
        # Noise takes high orders away with their filters' weights.
        motion[:, axes] /= total
        late[axes] /= total
