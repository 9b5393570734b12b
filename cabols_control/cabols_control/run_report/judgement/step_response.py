# SPDX-License-Identifier: Apache-2.0
"""Response of a wrench to its reference: rise time, steady error, cross-coupling of each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import ShapeError

SETTLED_SHARE = 0.2
"""The last fifth of a step's hold time counts as settled."""
MIN_HOLD_S = 0.8
"""A shorter hold cannot settle: the designed response needs 0.6 s to 99 %."""
MIN_STEP_SHARE = 0.01
"""Share of the rated value below which a change is no step."""


@dataclass(frozen=True)
class Step:
    """One component's response to one step of its reference.

    Attributes:
        component: 0 to 5, of [fx fy fz mx my mz].
        time: when the reference stepped [s].
        size: of the step [N or N m].
        rise_time: 10 to 90 % of the measured change [s]; NaN if it did not get there.
        overshoot: beyond the settled value, share of the step.
        steady_error: mean settled deviation from the reference [N or N m].
    """

    component: int
    time: float
    size: float
    rise_time: float
    overshoot: float
    steady_error: float


@dataclass(frozen=True, eq=False)
class Response:
    """All steps of a run.

    Attributes:
        steps: in order of time.
        cross_coupling: (6,) largest excursion of each component, as a share of its rated value,
            while its own reference stood still and another's stepped.
    """

    steps: tuple[Step, ...]
    cross_coupling: FloatArray

    @property
    def rise_times(self) -> FloatArray:
        """Of all steps [s]."""
        return np.array([step.rise_time for step in self.steps])


def rise_time(time: ArrayLike, value: ArrayLike, start: float, end: float) -> float:
    """Time from 10 to 90 % of the way from start to end, crossings interpolated.

    Args:
        time: (k,) [s].
        value: (k,) any unit.
        start: value before.
        end: value after.

    Returns:
        [s]; NaN if 90 % is not reached, or if there is no way to go.
    """
    if start == end:
        return float("nan")
    time_s = finite_array("time", time, (None,))
    share = (finite_array("value", value, (time_s.size,)) - start) / (end - start)
    low, high = _crossing(time_s, share, 0.1), _crossing(time_s, share, 0.9)
    return high - low


def _crossing(time_s: FloatArray, share: FloatArray, level: float) -> float:
    above = np.flatnonzero(share >= level)
    if above.size == 0:
        return float("nan")
    k = int(above[0])
    if k == 0:
        return float(time_s[0])
    part = (level - share[k - 1]) / (share[k] - share[k - 1])
    return float(time_s[k - 1] + part * (time_s[k] - time_s[k - 1]))


def analyse_steps(
    time: ArrayLike, desired: ArrayLike, measured: ArrayLike, rated: ArrayLike
) -> Response:
    """Find the steps of a piecewise constant reference and judge the response to each.

    Args:
        time: (k,) increasing [s].
        desired: (k, 6) reference [N, N m].
        measured: (k, 6) [N, N m].
        rated: (6,) rated values that steps and cross-coupling are compared with [N, N m].

    Raises:
        ShapeError: on other shapes or non-finite data.
    """
    time_s = finite_array("time", time, (None,))
    reference = finite_array("desired", desired, (time_s.size, 6))
    actual = finite_array("measured", measured, (time_s.size, 6))
    scale = finite_array("rated", rated, (6,))
    if time_s.size < 2:
        raise ShapeError(f"time: expected at least 2 samples, got {time_s.size}")
    change = np.abs(np.diff(reference, axis=0)) > MIN_STEP_SHARE * scale
    edges = np.flatnonzero(change.any(axis=1)) + 1
    ends = np.append(edges, time_s.size)[1:]
    steps: list[Step] = []
    coupling = np.zeros(6)
    for begin, end in zip(edges, ends, strict=True):
        if not time_s[end - 1] - time_s[begin] >= MIN_HOLD_S:
            continue
        still = ~change[begin - 1]
        before = max(begin - 50, 0)
        rest = actual[before:begin].mean(axis=0)
        excursion = np.abs(actual[begin:end] - rest).max(axis=0) / scale
        # Before the first of two close steps has settled, its own tail is no cross-coupling.
        settled = np.abs(rest - reference[begin - 1]) < 0.01 * scale
        coupling = np.maximum(coupling, np.where(still & settled, excursion, 0.0))
        for component in np.flatnonzero(change[begin - 1]):
            column = (time_s[begin:end], reference[begin - 1 : end, component])
            steps.append(_judge(int(component), *column, actual[begin:end, component], rest))
    return Response(tuple(steps), coupling)


def _judge(
    component: int,
    time_s: FloatArray,
    reference: FloatArray,
    actual: FloatArray,
    rest: FloatArray,
) -> Step:
    target, size = reference[-1], reference[-1] - reference[0]
    tail = actual[-max(int(SETTLED_SHARE * actual.size), 1) :].mean()
    return Step(
        component=component,
        time=float(time_s[0]),
        size=float(size),
        rise_time=rise_time(time_s, actual, float(rest[component]), float(target)),
        overshoot=float(max(np.max((actual - tail) * np.sign(size)), 0.0) / abs(size)),
        steady_error=float(tail - target),
    )
