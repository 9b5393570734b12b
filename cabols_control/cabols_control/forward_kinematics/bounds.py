# SPDX-License-Identifier: Apache-2.0
"""How much lengths can change over a region of poses: bounds that hold, not estimates; compiled.

Along a straight path of position and rotation vector from a pose, at speeds v and w, a cable whose
platform point is at most b from the axis has |l''| <= b w^2 + (v + b w)^2 / c. Without a pulley c
is its length; over a pulley its direction turns with the radius of its straight part in the wheel's
plane, across that plane at the distance of the platform point from the swivel's axis, and c is the
smaller of bounds below both. c shrinks by no more than the platform point moves. Taylor's remainder
at the end of the path is at most half of |l''| with the least c on the way. So with a left inverse
C of the lengths' derivative, a pose within the region whose lengths differ by d from those of its
middle lies within sum_i |C_ji| remainder_i of C d (Newton-Kantorovich's argument; Moore, Kearfott
and Cloud 2009, Introduction to Interval Analysis, chapter 8).
"""

from __future__ import annotations

import math
from typing import Any

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

MOST_RADII = 40
INSIDE, OUTSIDE, OPEN = 0, 1, 2
"""Of a region: all its poses are the known one; none has the lengths; neither is shown."""


@compiled
def clear_into(cables: Any, task: Any, lengths: FloatArray, work: Any) -> None:
    """Fill `clear`, the c of this file's text, at the pose in `work`, whose residual stands.

    Args:
        cables: (n,) records of CABLE.
        task: record of POSE_TASK.
        lengths: (n,) given [m].
        work: record of POSE_WORK.
    """
    position, rotation, clear = work.position, work.rotation, work.clear
    for i in range(task.cables):
        radius = cables[i].radius
        if radius == 0.0:
            clear[i] = lengths[i] - work.residual[i]
            continue
        base, held, axis = cables[i].base, cables[i].platform, cables[i].axis
        along = square = 0.0
        for k in range(3):
            part = position[k] - base[k]
            for j in range(3):
                part += rotation[k, j] * held[j]
            along += part * axis[k]
            square += part * part
        out = math.sqrt(max(square - along * along, 0.0))
        away = math.sqrt((out - radius) * (out - radius) + along * along)
        clear[i] = min(away - radius, out)


@compiled
def remainder(clear: float, arm: float, v: float, w: float) -> float:
    """Bound of a length's change beyond the linear [m].

    Args:
        clear: of `clear_into` [m].
        arm: of the platform point [m].
        v: largest change of position [m].
        w: largest turn [rad].
    """
    reach = v + arm * w
    if not clear > reach:
        return math.inf
    return 0.5 * (arm * w * w + reach * reach / (clear - reach))


@compiled
def spread(task: Any, work: Any, v: float, w: float) -> float:
    """Bound on how far, scaled [m], noise and all that is not linear move a pose.

    The normal equations hold at the pose, so the lengths' errors count once, by its covariance.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK, with `inverse` and `clear` of the pose.
        v: largest change of position [m].
        w: largest turn [rad].
    """
    directions, variance, arms = task.directions, task.variance, task.arms
    inverse, clear, n = work.inverse, work.clear, task.cables
    moved = turned = 0.0
    for a in range(task.freedom):
        total = noise = 0.0
        for i in range(n):
            share = inverse[a, i]
            total += abs(share) * remainder(clear[i], arms[i], v, w)
            noise += share * share * variance[i]
        total += task.bound * math.sqrt(noise)
        if directions[a] < 3:
            moved += total * total
        else:
            turned += total * total
    scale = float(task.scale)
    return math.sqrt(max(moved, turned * scale * scale))


@compiled
def alone_within(task: Any, work: Any, wanted: float) -> float:
    """Radius round the pose in `work`, scaled [m], in which no other pose has the lengths.

    Of position, and of turn times the scale. Poses that differ by what noise explains count as the
    same; 0 where nothing can be shown. `inverse` and `clear` must be filled.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK.
        wanted: radius that is enough [m].
    """
    blob = spread(task, work, 0.0, 0.0)
    radius = float(min(wanted, 4.0 * task.scale))
    for _ in range(MOST_RADII):
        if radius < 2.0 * blob:
            break
        if spread(task, work, radius, radius / task.scale) < 0.999 * radius:
            return radius
        radius *= 0.7
    return 0.0


@compiled
def apart(task: Any, work: Any) -> float:
    """Scaled distance [m] of the pose in `work` from `near`: the larger of position's and turn's.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK.
    """
    square, position, near = 0.0, work.position, work.near_position
    for k in range(3):
        part = position[k] - near[k]
        square += part * part
    turn = turn_between(work.rotation, work.near_rotation)
    return float(max(math.sqrt(square), task.scale * turn))


@compiled
def turn_between(first: FloatArray, second: FloatArray) -> float:
    """Angle between two orientations [rad], from the chord: exact near zero, too.

    Args:
        first: (3, 3).
        second: (3, 3).
    """
    square = 0.0
    for k in range(3):
        for j in range(3):
            part = first[k, j] - second[k, j]
            square += part * part
    # The Frobenius norm is 2 sqrt(2) sin(angle / 2).
    return 2.0 * math.asin(min(math.sqrt(square / 8.0), 1.0))
