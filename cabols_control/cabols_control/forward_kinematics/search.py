# SPDX-License-Identifier: Apache-2.0
"""Whether a pose is the only one in a region whose cables have the given lengths; compiled.

Branch and bound: the region is cut into boxes until each is shown to hold no pose with the lengths,
or to lie where the known pose is alone. What a region cannot be shown to be is never called known.
"""

from __future__ import annotations

import math
from typing import Any

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

from .bounds import (
    INSIDE,
    OPEN,
    OUTSIDE,
    alone_within,
    apart,
    clear_into,
    remainder,
    spread,
    turn_between,
)
from .iteration import copy_pose, covariance_into, factor, invert, iterate, look, turned
from .task import BOXES

KNOWN, NOT_FOUND, NO_POSE, NOT_ALONE, NOT_SHOWN = 0, 1, 2, 3, 4
"""Answers: see `pose.PoseState`."""
STARTS_EVERY = 3
"""Boxes between two attempts to find a pose from a box's middle."""


@compiled
def _length(vector: FloatArray, first: int) -> float:
    """Length of three components of a vector."""
    x, y, z = vector[first], vector[first + 1], vector[first + 2]
    return math.sqrt(x * x + y * y + z * z)


@compiled
def _largest_turn(task: Any) -> float:
    """Largest turn of the region [rad]."""
    turn = task.half_widths[3:]
    return float(max(turn[0], turn[1], turn[2]))


@compiled
def _consistent(task: Any, work: Any) -> bool:
    """Whether the lengths' noise explains the residual."""
    cost, information, residual = 0.0, task.information, work.residual
    for i in range(task.cables):
        cost += information[i] * residual[i] * residual[i]
    return bool(cost <= task.bound * task.bound)


@compiled
def _within(task: Any, work: Any, slack: float) -> bool:
    """Whether the pose is in the region, or at most `slack` [m], scaled, outside."""
    position, centre, half = work.position, task.centre, task.half_widths
    for k in range(3):
        if not abs(position[k] - centre[k]) <= half[k] + slack:
            return False
    turn = turn_between(work.rotation, task.rotation)
    return bool(turn <= _largest_turn(task) + slack / task.scale)


@compiled
def _farthest(task: Any, work: Any) -> float:
    """Scaled distance [m] within which all of the region lies from the pose."""
    square, position, centre, half = 0.0, work.position, task.centre, task.half_widths
    for k in range(3):
        part = abs(position[k] - centre[k]) + half[k]
        square += part * part
    turn = turn_between(work.rotation, task.rotation) + _largest_turn(task)
    return float(max(math.sqrt(square), task.scale * turn))


@compiled
def _judge(cables: Any, task: Any, lengths: FloatArray, work: Any, top: int, alone: float) -> int:
    """Judge the box on top of the stack, and shrink it where that can be shown.

    `work` takes its middle; `alone` is the radius round `near` where no other pose is, 0 for none.
    """
    box, widths = work.boxes[top, :6], work.boxes[top, 6:]
    v, w = _length(widths, 0), _length(widths, 3)
    if _length(box, 3) - w > _largest_turn(task):
        return OUTSIDE
    position, rotation = work.position, work.rotation
    for k in range(3):
        position[k] = box[k]
    about = box[3:]
    turned(task.rotation, about[0], about[1], about[2], rotation)
    if alone > 0.0:
        square, near = 0.0, work.near_position
        for k in range(3):
            part = abs(position[k] - near[k]) + widths[k]
            square += part * part
        turn = turn_between(rotation, work.near_rotation) + w
        if max(math.sqrt(square), task.scale * turn) <= alone:
            return INSIDE
    cost = look(cables, task, lengths, position, rotation, work)
    directions, variance, arms, tolerance = (
        task.directions,
        task.variance,
        task.arms,
        task.tolerance,
    )
    residual, inverse, clear, n = work.residual, work.inverse, work.clear, task.cables
    for i in range(n):
        if abs(residual[i]) > v + arms[i] * w + tolerance[i]:
            return OUTSIDE
    if not cost < math.inf or not factor(task, work, 0.0):
        return OPEN
    invert(task, work)
    clear_into(cables, task, lengths, work)
    turn2 = error2 = 0.0
    for a in range(task.freedom):
        row, step, error, noise = directions[a], 0.0, 0.0, 0.0
        for i in range(n):
            share = inverse[a, i]
            step += share * residual[i]
            error += abs(share) * remainder(clear[i], arms[i], v, w)
            noise += share * share * variance[i]
        error += task.bound * math.sqrt(noise)
        if not error < math.inf:
            return OPEN
        if row < 3:
            low, high = max(-widths[row], step - error), min(widths[row], step + error)
            if low > high:
                return OUTSIDE
            box[row] += 0.5 * (low + high)
            widths[row] = 0.5 * (high - low)
        else:
            turn2 += step * step
            error2 += error * error
    return OUTSIDE if math.sqrt(turn2) - math.sqrt(error2) > w else OPEN


@compiled
def _split(task: Any, work: Any, top: int) -> None:
    """Cut the box on top in two across its longest side, turns counted at the scale."""
    boxes, longest, side = work.boxes, -1.0, 0
    for k in range(6):
        size = boxes[top, 6 + k] * (1.0 if k < 3 else task.scale)
        if size > longest:
            longest, side = size, k
    for k in range(12):
        boxes[top + 1, k] = boxes[top, k]
    half = 0.5 * boxes[top, 6 + side]
    boxes[top, 6 + side] = boxes[top + 1, 6 + side] = half
    boxes[top, side] -= half
    boxes[top + 1, side] += half


@compiled
def _adopt(
    cables: Any,
    task: Any,
    lengths: FloatArray,
    work: Any,
    covariance: FloatArray,
    residual: FloatArray,
) -> float:
    """Take the pose in `work` for the known one, if noise explains it and it is in the region.

    Returns what its noise moves it by at most, scaled [m]; -1 where it is not taken.
    """
    if not _consistent(task, work):
        return -1.0
    invert(task, work)
    clear_into(cables, task, lengths, work)
    slack = spread(task, work, 0.0, 0.0)
    if not _within(task, work, slack):
        return -1.0
    copy_pose(work.position, work.rotation, work.near_position, work.near_rotation)
    covariance_into(task, work, covariance)
    for i in range(task.cables):
        residual[i] = work.residual[i]
    return slack


@compiled
def _other(
    cables: Any, task: Any, lengths: FloatArray, work: Any, least: float, slack: float
) -> bool:
    """Whether Newton's method leads from the pose in `work` to another one, `least` away [m]."""
    if iterate(cables, task, lengths, work) == 0 or not _consistent(task, work):
        return False
    return _within(task, work, slack) and apart(task, work) > least


@compiled
def _cut(
    cables: Any,
    task: Any,
    lengths: FloatArray,
    budget: int,
    work: Any,
    covariance: FloatArray,
    residual: FloatArray,
    found: tuple[float, float],
) -> int:
    """Cut the region into boxes until it is decided; `found` are slack (-1: none) and alone [m]."""
    slack, alone = found
    boxes, centre, half = work.boxes, task.centre, task.half_widths
    for k in range(3):
        boxes[0, k], boxes[0, 3 + k] = centre[k], 0.0
    for k in range(6):
        boxes[0, 6 + k] = half[k]
    top, used = 0, 0
    while top >= 0:
        used += 1
        if used > budget or top + 1 >= BOXES:
            return NOT_FOUND if slack < 0.0 else NOT_SHOWN
        if _judge(cables, task, lengths, work, top, alone) != OPEN:
            top -= 1
            continue
        if used % STARTS_EVERY == 0:
            if slack >= 0.0:
                if _other(cables, task, lengths, work, max(alone, slack), slack):
                    return NOT_ALONE
            elif iterate(cables, task, lengths, work) > 0:
                slack = _adopt(cables, task, lengths, work, covariance, residual)
                if slack >= 0.0:
                    alone = alone_within(task, work, _farthest(task, work))
        _split(task, work, top)
        top += 1
    return NO_POSE if slack < 0.0 else KNOWN


@compiled
def locate(
    cables: Any,
    task: Any,
    lengths: FloatArray,
    budget: int,
    work: Any,
    covariance: FloatArray,
    residual: FloatArray,
) -> int:
    """Find the pose, and whether it is the only one in the task's region.

    Args:
        cables: (n,) records of CABLE.
        task: record of POSE_TASK.
        lengths: (n,) of the cables, as `cable_lengths` gives them [m].
        budget: largest number of boxes to look at.
        work: record of POSE_WORK; `position` and `rotation`: a start, then the answer.
        covariance: (6, 6), filled with the pose's where one was found.
        residual: (n,), filled with given less computed lengths [m].

    Returns:
        KNOWN; NOT_FOUND: no pose was found, but some may exist; NO_POSE: none in the region has
        these lengths; NOT_ALONE: several have; NOT_SHOWN: one was found, others may exist.
    """
    slack, alone = -1.0, 0.0
    converged = iterate(cables, task, lengths, work) > 0
    for i in range(task.cables):
        residual[i] = work.residual[i]
    if converged:
        slack = _adopt(cables, task, lengths, work, covariance, residual)
    if slack >= 0.0:
        wanted = _farthest(task, work)
        alone = alone_within(task, work, wanted)
        if alone >= wanted and budget > 0:
            return KNOWN
    state = _cut(cables, task, lengths, budget, work, covariance, residual, (slack, alone))
    if state != NO_POSE and state != NOT_FOUND:
        copy_pose(work.near_position, work.near_rotation, work.position, work.rotation)
    return state
