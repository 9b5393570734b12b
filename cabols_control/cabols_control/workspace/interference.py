# SPDX-License-Identifier: Apache-2.0
"""Whether cables touch each other, the platform or the target: poses and ranges of orientation.

Cables are straight segments from where they leave their pulleys (wheels count as no body), bodies
are capsules, so every distance is one between two segments, in closed form (segments.py). Over a
range of orientation nothing is sampled: a platform point at distance rho from the axis moves at
most rho per radian, so a gap g between two bodies whose points move at most L per radian cannot
close within g / L. Stepping by that (conservative advancement, Mirtich 1996) certifies every angle
that it passes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import departures_into
from cabols_control.checks import FloatArray, finite_array, in_range, rotation_matrix
from cabols_control.errors import CabolsError, ShapeError
from cabols_control.geometry import RigGeometry
from cabols_control.tension.kernels.static_size import compiled

from .bodies import SHARE_BASE, SHARE_PLATFORM, Bodies, InterferenceTask, interference_task
from .segments import Point, dot, minus, row, segment_distance, towards

CABLES, PLATFORM, TARGET = 0, 1, 2
"""Places in a row of clearances."""
CLOSE_ENOUGH_M = 1e-6
"""Where advancement stops: this near to the required clearance."""
MAX_STEPS = 2000
"""Steps of one advancement; at the cap, the angle certified so far is the answer."""


class Clearance(NamedTuple):
    """Free space around the cables at k poses; negative: they overlap; inf: nothing to touch.

    Attributes:
        cables: (k,) between cables [m].
        platform: (k,) between cables and platform [m].
        target: (k,) between cables and target [m].
    """

    cables: FloatArray
    platform: FloatArray
    target: FloatArray

    @property
    def least(self) -> FloatArray:
        """(k,) least of the three [m]."""
        return np.minimum(np.minimum(self.cables, self.platform), self.target)


@compiled
def _point(vector: FloatArray) -> Point:
    """Return a vector (3,) as a point."""
    return vector[0], vector[1], vector[2]


@compiled
def _place(rotation: FloatArray, position: FloatArray, point: Point, moves: bool) -> Point:
    """Return a point in the base frame; it is given in the platform frame if it moves."""
    if not moves:
        return point
    x, y, z = point
    return (
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled
def _shorten(start: Point, end: Point, length: float) -> Point:
    """Return the point `length` from start towards end, at most end."""
    whole = minus(end, start)
    return towards(start, end, min(length / max(math.sqrt(dot(whole, whole)), 1e-12), 1.0))


@compiled
def _arm(point: Point, axis: FloatArray) -> float:
    """Distance of a platform point from the axis through the platform's origin."""
    x = axis[1] * point[2] - axis[2] * point[1]
    y = axis[2] * point[0] - axis[0] * point[2]
    z = axis[0] * point[1] - axis[1] * point[0]
    return math.sqrt(x * x + y * y + z * z)


@compiled
def _cables_apart(
    task: InterferenceTask, held: FloatArray, starts: FloatArray, i: int, j: int
) -> float:
    """Gap between the cables i and j, from starts (n, 3) to held (n, 3), base frame."""
    kind = task.shared[i, j]
    p, r = row(held, i), row(held, j)
    q, s = row(starts, i), row(starts, j)
    if kind == SHARE_PLATFORM:
        p, r = _shorten(p, q, task.joint_length), _shorten(r, s, task.joint_length)
    elif kind == SHARE_BASE:
        q, s = _shorten(q, p, task.joint_length), _shorten(s, r, task.joint_length)
    return segment_distance(p, q, r, s) - 2.0 * task.cable_radius


@compiled
def clearances_at(
    task: InterferenceTask,
    position: FloatArray,
    rotation: FloatArray,
    axis: FloatArray,
    required: float,
    work: FloatArray,
    out: FloatArray,
) -> float:
    """Clearances of one pose and how far it may turn about an axis without losing them.

    Args:
        task: see InterferenceTask.
        position: (3,) [m].
        rotation: (3, 3) from platform to base axes.
        axis: (3,) unit vector, platform frame, through the platform's origin.
        required: clearance to keep [m].
        work: (at least 2 n, 3) scratch.
        out: (3,) clearances: CABLES, PLATFORM, TARGET [m].

    Returns:
        Angle [rad] within which no gap can fall below `required`; negative if one has.
    """
    n = task.cables.shape[0]
    held, starts = work[:n], work[n : 2 * n]
    departures_into(task.cables, position, rotation, starts)
    out[:] = math.inf
    safe = math.inf
    for i in range(n):
        point = _place(rotation, position, _point(task.cables[i]["platform"]), True)
        held[i, 0], held[i, 1], held[i, 2] = point
    for i in range(n):
        reach = _arm(_point(task.cables[i]["platform"]), axis)
        for j in range(i):
            gap = _cables_apart(task, held, starts, i, j)
            out[CABLES] = min(out[CABLES], gap)
            speed = reach + _arm(_point(task.cables[j]["platform"]), axis)
            safe = min(safe, (gap - required) / max(speed, 1e-9))
    for c in range(task.capsule_radius.shape[0]):
        moves, ends = task.on_platform[c], task.capsule_ends[c]
        start = _place(rotation, position, row(ends, 0), moves[0] == 1)
        end = _place(rotation, position, row(ends, 1), moves[1] == 1)
        speed = max(moves[0] * _arm(row(ends, 0), axis), moves[1] * _arm(row(ends, 1), axis))
        kind = PLATFORM if c < task.platform_capsules else TARGET
        for i in range(n):
            far = row(starts, i)
            near = _shorten(row(held, i), far, task.attachment_length)
            gap = segment_distance(near, far, start, end)
            gap -= task.cable_radius + task.capsule_radius[c]
            out[kind] = min(out[kind], gap)
            together = speed + _arm(_point(task.cables[i]["platform"]), axis)
            safe = min(safe, (gap - required) / max(together, 1e-9))
    return safe


@compiled
def _turn_into(rotation: FloatArray, axis: FloatArray, angle: float, out: FloatArray) -> None:
    """Write rotation times the turn about axis (platform frame) by angle to out (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    turn = (
        (c + x * x * (1.0 - c), x * y * (1.0 - c) - z * s, x * z * (1.0 - c) + y * s),
        (x * y * (1.0 - c) + z * s, c + y * y * (1.0 - c), y * z * (1.0 - c) - x * s),
        (x * z * (1.0 - c) - y * s, y * z * (1.0 - c) + x * s, c + z * z * (1.0 - c)),
    )
    for a in range(3):
        for b in range(3):
            out[a, b] = (
                rotation[a, 0] * turn[0][b]
                + rotation[a, 1] * turn[1][b]
                + rotation[a, 2] * turn[2][b]
            )


@compiled
def advance(
    task: InterferenceTask,
    position: FloatArray,
    rotation: FloatArray,
    axis: FloatArray,
    limit: float,
    required: float,
    work: FloatArray,
) -> float:
    """Angle up to which the clearance is certain while turning one way.

    Args:
        task: see InterferenceTask.
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes, where the turn is zero.
        axis: (3,) unit vector, platform frame, through the platform's origin.
        limit: where the search ends; its sign is the way to turn [rad].
        required: clearance to keep [m].
        work: (2 n + 3, 3) scratch, see clearance_work.

    Returns:
        The angle, with the sign of `limit` [rad]; 0 if the clearance is missing at the start.
    """
    n = task.cables.shape[0]
    turned, out = work[2 * n : 2 * n + 3], np.empty(3)
    sign, angle = (1.0 if limit >= 0.0 else -1.0), 0.0
    for _ in range(MAX_STEPS):
        _turn_into(rotation, axis, sign * angle, turned)
        safe = clearances_at(task, position, turned, axis, required, work, out)
        # Written so that NaN stops.
        if not safe > 0.0:
            break
        if angle + safe >= abs(limit):
            return limit
        angle += safe
        if min(out[0], out[1], out[2]) - required < CLOSE_ENOUGH_M:
            break
    return sign * angle


@compiled
def clearance_loop(
    task: InterferenceTask,
    positions: FloatArray,
    rotations: FloatArray,
    work: FloatArray,
    results: FloatArray,
) -> None:
    """Clearances at every position with every rotation.

    Args:
        task: see InterferenceTask.
        positions: (k, 3) platform origins, base frame [m].
        rotations: (o, 3, 3) from platform to base axes.
        work: (2 n + 3, 3) scratch, see clearance_work.
        results: (k, o, 3) filled: CABLES, PLATFORM, TARGET [m].
    """
    axis = np.array([0.0, 0.0, 1.0])
    for k in range(positions.shape[0]):
        for o in range(rotations.shape[0]):
            clearances_at(task, positions[k], rotations[o], axis, 0.0, work, results[k, o])


def clearance_work(task: InterferenceTask) -> FloatArray:
    """Return scratch for the functions above."""
    return np.zeros((2 * task.cables.shape[0] + 3, 3))


def clearance_along(
    geometry: RigGeometry, bodies: Bodies, positions: ArrayLike, rotations: ArrayLike
) -> Clearance:
    """Free space around the cables at the poses of a trajectory.

    Args:
        geometry: attachment points.
        bodies: what must not be touched.
        positions: (k, 3) [m].
        rotations: (k, 3, 3) from platform to base axes; not checked to be rotations.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    task = interference_task(geometry, bodies)
    points = finite_array("positions", positions, (None, 3))
    turns = finite_array("rotations", rotations, (points.shape[0], 3, 3))
    results, work = np.empty((points.shape[0], 1, 3)), clearance_work(task)
    for k in range(points.shape[0]):
        clearance_loop(task, points[k : k + 1], turns[k : k + 1], work, results[k : k + 1])
    return Clearance(*results.reshape(-1, 3).T)


def free_turn(
    geometry: RigGeometry,
    bodies: Bodies,
    position: ArrayLike,
    rotation: ArrayLike,
    axis: ArrayLike,
    limit_rad: float = math.pi,
) -> tuple[float, float]:
    """Largest range of turn about an axis in which no cable comes too near to anything.

    Args:
        geometry: attachment points.
        bodies: what must not be touched; their `clearance` is kept.
        position: (3,) platform origin [m].
        rotation: (3, 3) from platform to base axes, where the turn is zero.
        axis: (3,) direction in the platform frame, through the platform's origin.
        limit_rad: where the search ends on both sides [rad].

    Returns:
        Least and largest angle [rad]; every angle between them is certified free. Both are 0 if
        the clearance is missing at zero already.

    Raises:
        ShapeError: if an argument has another shape, is not finite or is no rotation.
        CabolsError: if cables leave pulleys: their ends at the frame move, so that the bound of
            this certificate does not hold.
    """
    if geometry.has_pulleys:
        raise CabolsError(
            "free_turn: expected cables between points, got pulleys, over which no range is "
            "certified; use clearance_along at the orientations that count"
        )
    task = interference_task(geometry, bodies)
    direction = finite_array("axis", axis, (3,))
    length = float(np.linalg.norm(direction))
    if not length > 1e-12:
        raise ShapeError(f"axis: expected a direction, got {direction}; give one that is not zero")
    limit = in_range("limit_rad", limit_rad, 0.0, 2.0 * math.pi)
    place_at = finite_array("position", position, (3,))
    turn = rotation_matrix("rotation", rotation)
    low, high = (
        float(
            advance(
                task,
                place_at,
                turn,
                direction / length,
                end,
                bodies.clearance,
                clearance_work(task),
            )
        )
        for end in (-limit, limit)
    )
    return low, high
