# SPDX-License-Identifier: Apache-2.0
"""Which poses tell most: a greedy choice for what the calibration is for.

Each stop is the one of the candidates that takes most from the expected squared errors of
lengths and wrenches over the workspace (I-optimality); then stops are exchanged while that helps.
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray, IntArray

from .estimate import Use, information
from .model import Noise, Readings
from .parameters import Layout

GOALS = (5e-5, 1e-3, 1e-4)
"""Errors that count alike: of a length [m], of force and torque per newton of tension [1, m]."""
ROUNDS = 2


def choose_stops(
    layout: Layout, stops: list[Readings], use: Use, noise: Noise, count: int
) -> IntArray:
    """Choose stops, each a pose with its loads.

    Args:
        layout: of the parameters, as the drawing says.
        stops: candidates; their rows are read together.
        use: what counts, over the workspace.
        noise: of what is read.
        count: how many.

    Returns:
        (count,) indices into stops; a stop may come more than once.
    """
    rows, goal = [_told_by(layout, stop, noise) for stop in stops], _goal(layout, use)
    known = np.eye(layout.spread.size)
    chosen: list[int] = []
    for _ in range(count):
        best = _best(rows, known, goal)
        chosen.append(best)
        known = known + rows[best].T @ rows[best]
    for _ in range(ROUNDS):
        for place in range(count):
            known = known - rows[chosen[place]].T @ rows[chosen[place]]
            chosen[place] = _best(rows, known, goal)
            known = known + rows[chosen[place]].T @ rows[chosen[place]]
    return np.array(chosen, dtype=np.int64)


def least_share(
    layout: Layout, stops: list[Readings], use: Use, noise: Noise, chosen: IntArray
) -> float:
    """How far any choice could lower the expected rms error of a chosen one: a certified bound.

    The expected squared error is convex in what the stops tell, so that its tangent at the chosen
    stops is below it for every choice, also for one that divides its time among the candidates
    (Pukelsheim 2006, Optimal Design of Experiments, 5.2).

    Args:
        layout: of the parameters, as the drawing says.
        stops: candidates.
        use: what counts.
        noise: of what is read.
        chosen: (count,) indices into stops.

    Returns:
        Share of the rms error, 0 to 1, below which no choice of as many of these stops comes.
    """
    rows, goal = [_told_by(layout, stop, noise) for stop in stops], _goal(layout, use)
    known = np.eye(layout.spread.size) + sum(rows[i].T @ rows[i] for i in chosen)
    covariance = np.linalg.inv(known)
    middle = covariance @ goal @ covariance
    gains = np.array([np.trace(row @ middle @ row.T) for row in rows])
    now = float(np.trace(goal @ covariance))
    least = now - (len(chosen) * float(gains.max()) - float(gains[chosen].sum()))
    return float(np.sqrt(max(least, 0.0) / now))


def _goal(layout: Layout, use: Use) -> FloatArray:
    """(p, p) matrix whose trace with a covariance, in deviations beforehand, is the criterion."""
    scale = layout.spread
    goal = np.zeros((scale.size, scale.size))
    for part, unit in zip((use.length, use.wrench[:, :3], use.wrench[:, 3:]), GOALS, strict=True):
        rows = (part * scale / unit).reshape(-1, scale.size)
        goal += rows.T @ rows / len(rows)
    return goal


def _told_by(layout: Layout, stop: Readings, noise: Noise) -> FloatArray:
    """(r, p) whitened derivatives of a stop's readings."""
    jacobian, _ = information(layout, layout.start, stop, noise)
    flat = jacobian.reshape(-1, layout.start.size)
    return np.asarray(flat[np.abs(flat).max(axis=1) > 0.0])


def _best(rows: list[FloatArray], known: FloatArray, goal: FloatArray) -> int:
    """Index of the stop that takes most from trace(goal @ covariance)."""
    covariance = np.linalg.inv(known)
    middle = covariance @ goal @ covariance
    gains = []
    for row in rows:
        inner = np.eye(len(row)) + row @ covariance @ row.T
        gains.append(np.trace(np.linalg.solve(inner, row @ middle @ row.T)))
    return int(np.argmax(gains))
