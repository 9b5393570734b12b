"""How much lengths can change over a region of poses: bounds that hold, not estimates; compiled.

Along a straight path of position and rotation vector from a pose, at speeds v and w, a cable of
length l whose platform point is at most b from the axis has |l''| <= b w^2 + (v + b w)^2 / l.
Taylor's remainder at the end of the path is at most half of that, with the least l on the way. So
with a left inverse C of the lengths' derivative, a pose within the region whose lengths differ by d
from those of its middle lies within sum_i |C_ji| remainder_i of C d (Newton-Kantorovich's argument,
after Moore, Kearfott and Cloud 2009, Introduction to Interval Analysis, section 8.3).
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

from .task import PoseTask, PoseWork

MOST_RADII = 40
INSIDE, OUTSIDE, OPEN = 0, 1, 2
"""Of a region: all its poses are the known one; none has the lengths; neither is shown."""


@compiled
def remainder(length: float, arm: float, v: float, w: float) -> float:
    """Bound of a length's change beyond the linear, for motions up to v [m] and w [rad] [m]."""
    reach = v + arm * w
    if not length > reach:
        return math.inf
    return 0.5 * (arm * w * w + reach * reach / (length - reach))


@compiled
def spread(task: PoseTask, work: PoseWork, lengths: FloatArray, v: float, w: float) -> float:
    """Bound on how far, scaled [m], noise and all that is not linear move a pose.

    The normal equations hold at the pose, so the lengths' errors count once, by its covariance.

    Args:
        task: what is asked.
        work: with `inverse` and `residual` of the middle.
        lengths: (n,) given [m].
        v: largest change of position [m].
        w: largest turn [rad].
    """
    directions, information, arms = task.directions, task.information, task.arms
    inverse, residual = work.inverse, work.residual
    moved = turned = 0.0
    for a in range(directions.shape[0]):
        total = variance = 0.0
        for i in range(lengths.shape[0]):
            share = inverse[a, i]
            total += abs(share) * remainder(lengths[i] - residual[i], arms[i], v, w)
            variance += share * share / information[i]
        total += task.bound * math.sqrt(variance)
        if directions[a] < 3:
            moved += total * total
        else:
            turned += total * total
    return math.sqrt(max(moved, turned * task.scale * task.scale))


@compiled
def alone_within(task: PoseTask, work: PoseWork, lengths: FloatArray) -> float:
    """Radius round the pose in `work`, scaled [m], in which no other pose has the lengths.

    Of position, and of turn times the scale. Poses that differ by what noise explains count as the
    same; 0 where nothing can be shown. `inverse` must be filled.
    """
    blob = spread(task, work, lengths, 0.0, 0.0)
    radius = 4.0 * task.scale
    for _ in range(MOST_RADII):
        error = spread(task, work, lengths, radius, radius / task.scale)
        if error < 0.999 * radius:
            return radius
        radius *= 0.7
        if radius < 2.0 * blob:
            break
    return 0.0


@compiled
def apart(task: PoseTask, position: FloatArray, rotation: FloatArray, work: PoseWork) -> float:
    """Scaled distance [m] of a pose from `near`: the larger of that in position and in turn."""
    square = 0.0
    for k in range(3):
        part = position[k] - work.near_position[k]
        square += part * part
    return max(math.sqrt(square), task.scale * turn_between(rotation, work.near_rotation))


@compiled
def turn_between(first: FloatArray, second: FloatArray) -> float:
    """Angle between two orientations [rad], from the chord: exact near zero, too."""
    square = 0.0
    for k in range(3):
        for j in range(3):
            part = first[k, j] - second[k, j]
            square += part * part
    # The Frobenius norm is 2 sqrt(2) sin(angle / 2).
    return 2.0 * math.asin(min(math.sqrt(square / 8.0), 1.0))
