"""Whether a pose is the only one in a region whose cables have the given lengths; compiled.

Branch and bound: the region is cut into boxes until each is shown to hold no pose with the lengths,
or to lie where the known pose is alone. What a region cannot be shown to be is never called known.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

from .bounds import INSIDE, OPEN, OUTSIDE, alone_within, apart, remainder, spread, turn_between
from .iteration import covariance_into, factor, invert, iterate, look, turned
from .task import BOXES, PoseTask, PoseWork

KNOWN, NOT_FOUND, NO_POSE, NOT_ALONE, NOT_SHOWN = 0, 1, 2, 3, 4
"""Answers: see `pose.PoseState`."""
STARTS_EVERY = 3
"""Splits between two attempts to find a pose from a box's middle."""


@compiled
def consistent(task: PoseTask, work: PoseWork) -> bool:
    """Whether the lengths' noise explains the residuals in `work`."""
    cost = 0.0
    for i in range(task.tolerance.shape[0]):
        cost += task.information[i] * work.residual[i] * work.residual[i]
    return cost <= task.bound * task.bound


@compiled
def within(task: PoseTask, work: PoseWork, slack: float) -> bool:
    """Whether the pose in `work` is in the region, or at most `slack` [m], scaled, outside."""
    for k in range(3):
        if not abs(work.position[k] - task.centre[k]) <= task.half_widths[k] + slack:
            return False
    turn = turn_between(work.rotation, task.rotation)
    return bool(turn <= task.half_widths[3:].max() + slack / task.scale)


@compiled
def _middle(task: PoseTask, work: PoseWork, top: int) -> None:
    """Put the pose in the middle of a box into `work`."""
    for k in range(3):
        work.position[k] = work.boxes[top, k]
    box = work.boxes[top]
    turned(task.rotation, box[3], box[4], box[5], work.rotation)


@compiled
def _judge(task: PoseTask, lengths: FloatArray, work: PoseWork, top: int, alone: float) -> int:
    """Judge the box on top of the stack, and shrink it where that can be shown.

    `work` takes its middle; `alone` is the radius round `near` where no other pose is, 0 for none.
    """
    box, widths = work.boxes[top, :6], work.boxes[top, 6:]
    v = math.sqrt(widths[0] * widths[0] + widths[1] * widths[1] + widths[2] * widths[2])
    w = math.sqrt(widths[3] * widths[3] + widths[4] * widths[4] + widths[5] * widths[5])
    away = math.sqrt(box[3] * box[3] + box[4] * box[4] + box[5] * box[5])
    if away - w > task.half_widths[3:].max():
        return OUTSIDE
    _middle(task, work, top)
    if alone > 0.0:
        square = 0.0
        for k in range(3):
            part = abs(work.position[k] - work.near_position[k]) + widths[k]
            square += part * part
        turn = turn_between(work.rotation, work.near_rotation) + w
        if max(math.sqrt(square), task.scale * turn) <= alone:
            return INSIDE
    directions, information, arms = task.directions, task.information, task.arms
    residual, inverse, tolerance = work.residual, work.inverse, task.tolerance
    cost = look(task, lengths, work.position, work.rotation, work.matrix, residual)
    n, m = lengths.shape[0], directions.shape[0]
    for i in range(n):
        if abs(residual[i]) > v + arms[i] * w + tolerance[i]:
            return OUTSIDE
    if not cost < math.inf or not factor(task, work, 0.0):
        return OPEN
    invert(task, work)
    turn2 = error2 = 0.0
    for a in range(m):
        row, step, error, variance = directions[a], 0.0, 0.0, 0.0
        for i in range(n):
            share = inverse[a, i]
            step += share * residual[i]
            error += abs(share) * remainder(lengths[i] - residual[i], arms[i], v, w)
            variance += share * share / information[i]
        error += task.bound * math.sqrt(variance)
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
    if math.sqrt(turn2) - math.sqrt(error2) > w:
        return OUTSIDE
    return OPEN


@compiled
def _split(task: PoseTask, work: PoseWork, top: int) -> None:
    """Cut the box on top in two across its longest side, turns counted at the scale."""
    longest, side = -1.0, 0
    for k in range(6):
        size = work.boxes[top, 6 + k] * (1.0 if k < 3 else task.scale)
        if size > longest:
            longest, side = size, k
    for k in range(12):
        work.boxes[top + 1, k] = work.boxes[top, k]
    half = 0.5 * work.boxes[top, 6 + side]
    work.boxes[top, 6 + side] = work.boxes[top + 1, 6 + side] = half
    work.boxes[top, side] -= half
    work.boxes[top + 1, side] += half


@compiled
def _adopt(task: PoseTask, lengths: FloatArray, work: PoseWork, covariance: FloatArray) -> float:
    """Make the pose in `work` the known one: `near`, its covariance, how far it is alone [m]."""
    work.near_position[:] = work.position
    work.near_rotation[:, :] = work.rotation
    covariance_into(task, work, covariance)
    invert(task, work)
    return alone_within(task, work, lengths)


@compiled
def _other(task: PoseTask, lengths: FloatArray, work: PoseWork, alone: float, slack: float) -> bool:
    """Whether Newton's method leads from the pose in `work` to another one with the lengths."""
    if iterate(task, lengths, work) == 0 or not consistent(task, work):
        return False
    if not within(task, work, slack):
        return False
    return apart(task, work.position, work.rotation, work) > max(alone, slack)


@compiled
def locate(
    task: PoseTask,
    lengths: FloatArray,
    budget: int,
    work: PoseWork,
    covariance: FloatArray,
    residual: FloatArray,
) -> int:
    """Find the pose, and whether it is the only one in the task's region.

    Args:
        task: what is asked.
        lengths: (n,) of the cables, between their points [m].
        budget: largest number of boxes to look at.
        work: `position` and `rotation`: a start, then the answer.
        covariance: (6, 6), filled with the pose's; zeros where none was found.
        residual: (n,), filled with given less computed lengths [m].

    Returns:
        KNOWN; NOT_FOUND: no pose was found, but some may exist; NO_POSE: none in the region has
        these lengths; NOT_ALONE: several have; NOT_SHOWN: one was found, others may exist.
    """
    alone = slack = 0.0
    found = iterate(task, lengths, work) > 0
    residual[:] = work.residual
    covariance[:, :] = 0.0
    have = False
    if found and consistent(task, work):
        alone = _adopt(task, lengths, work, covariance)
        slack = spread(task, work, lengths, 0.0, 0.0)
        have = within(task, work, slack)
    if not have:
        alone = 0.0
    for k in range(3):
        work.boxes[0, k], work.boxes[0, 3 + k] = task.centre[k], 0.0
    for k in range(6):
        work.boxes[0, 6 + k] = task.half_widths[k]
    top, used, state = 0, 0, KNOWN
    while top >= 0:
        used += 1
        if used > budget or top + 1 >= BOXES:
            state = NOT_SHOWN if have else NOT_FOUND
            break
        if _judge(task, lengths, work, top, alone) != OPEN:
            top -= 1
            continue
        if used % STARTS_EVERY == 0:
            if have:
                if _other(task, lengths, work, alone, slack):
                    state = NOT_ALONE
                    break
            elif iterate(task, lengths, work) > 0 and consistent(task, work):
                wanted = spread(task, work, lengths, 0.0, 0.0)
                if within(task, work, wanted):
                    residual[:] = work.residual
                    alone, have, slack = _adopt(task, lengths, work, covariance), True, wanted
        _split(task, work, top)
        top += 1
    if have:
        work.position[:] = work.near_position
        work.rotation[:, :] = work.near_rotation
        return state
    return NO_POSE if state == KNOWN else state
